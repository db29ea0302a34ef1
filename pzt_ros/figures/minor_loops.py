"""Figures 2.9 to 2.16: the four types of minor loops in the actuator range."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pzt_ros.experiments.procedures import FAMILIES
from pzt_ros.figures.canvas import (
    LADDER,
    POLARIZATION,
    SHADE,
    STRAIN,
    curve,
    legend_below,
    over_field,
    same_limits,
    sheet,
)
from pzt_ros.figures.experiments import ACTUATOR_CHAIN, Record, experiment, mean_gap, steepest
from pzt_ros.figures.thesis_figure import Drawing, Finding, below, near
from pzt_ros.physics.signals import Array

DRIVES = {
    "0.1 Hz": "(a) half-sine, 0.1 Hz",
    "0.1 kV/mm/s": "(b) linear, 0.1 kV/mm/s",
    "100 Hz": "(c) half-sine, 100 Hz",
    "100 kV/mm/s": "(d) linear, 100 kV/mm/s",
}
SLOW_DRIVES, FAST_DRIVES = ("0.1 Hz", "0.1 kV/mm/s"), ("100 Hz", "100 kV/mm/s")

NOTICEABLE = {"polarization": 0.002, "strain": 0.1 / 80.0}
"""A change that we take for noticeable in the thesis' plots: 1 % of 0.2 C/m^2; the sensor's 0.1 um as strain [%]."""

Family = dict[str, list[Record]]
"""Records by drive, in the order of the reversal fields."""


def reversals(name: str) -> list[float]:
    """Reversal fields of a type of minor loops [kV/mm]."""
    return sorted(voltage / 100 for voltage in FAMILIES[name].reversals)


def family(name: str, samples: int) -> Family:
    """All experiments of a type that the thesis plots."""
    return {
        drive: [experiment(name, drive, reversal, samples=samples) for reversal in reversals(name)] for drive in DRIVES
    }


def polarization_of(name: str) -> Callable[[int], Drawing]:
    """How the figure of a type's polarization is drawn."""
    return lambda samples: _draw(name, "polarization", POLARIZATION, samples)


def strain_of(name: str) -> Callable[[int], Drawing]:
    """How the figure of a type's strain is drawn."""
    return lambda samples: _draw(name, "strain", STRAIN, samples)


def _draw(name: str, quantity: str, label: str, samples: int) -> Drawing:
    records = family(name, samples)
    figure = sheet(9.4, 7.0, f"actuator chain {ACTUATOR_CHAIN}")
    axes = figure.subplots(2, 2, sharex=True)
    for axis, (drive, title) in zip(axes.flat, DRIVES.items(), strict=True):
        ladder = LADDER if len(records[drive]) == len(LADDER) else LADDER[::2] + LADDER[-1:]
        for record, colour, reversal in zip(records[drive], ladder, reversals(name), strict=True):
            values = getattr(record, quantity)
            common, own = record.leg(0), slice(record.ends[0], None)
            curve(axis, record.field[common], values[common], SHADE, linewidth=1.1, zorder=1.5)
            curve(axis, record.field[own], values[own], colour, f"{reversal:g}", linewidth=1.2)
        axis.set(title=title, ylabel=label)
    same_limits(list(axes.flat))
    for axis in axes[1]:
        over_field(axis, label, axis.get_title(loc="left"))
    legend_below(figure, axes[0, 0], "reversal field [kV/mm]")
    return Drawing(figure, tuple(_FINDINGS[name](records, quantity)), _NOTES.get(name, ""))


def _lowest(records: Family, quantity: str) -> list[Finding]:
    """What the largest loop comes down to."""
    expected = {"polarization": (0.12, 0.16, "C/m²"), "strain": (0.02, 0.035, "%")}[quantity]
    found = [float(getattr(records[drive][0], quantity)[records[drive][0].ends[0]]) for drive in ("0.1 Hz", "100 Hz")]
    return [
        near(f"the largest loop is down to {expected[0]:g} at 0.1 Hz", found[0], expected[0], 0.1, expected[2]),
        near(f"at 100 Hz only to {expected[1]:g}", found[1], expected[1], 0.1, expected[2]),
    ]


def type1(records: Family, quantity: str) -> list[Finding]:
    """Ascending minor loops from the descending branch."""
    found = _lowest(records, quantity)
    if quantity == "polarization":
        places = [steepest(record, 1) for record in records["0.1 Hz"][:3]]
        found.append(
            Finding(
                "ascending loops transform fastest almost all at 0.4 kV/mm",
                f"at 0.1 Hz at {_list(places, 2)} kV/mm from -0.4, -0.2 and 0 kV/mm, above there is no such place;"
                " taken as agreeing between 0.3 and 0.5",
                bool(min(places) >= 0.3 and max(places) <= 0.5),
            )
        )
    span = _span(records, quantity)
    bends = [100 * _bend(record, getattr(record, quantity)) / span for record in records["0.1 Hz"]]
    return [
        *found,
        Finding(
            "the higher the reversal point, the less nonlinear is the way up",
            f"off a straight line by {_list(bends, 1)} % of the largest loop's span, lowest reversal first",
            bool(np.all(np.diff(bends) < 0.1)),
        ),
        _end_of_hold(records, quantity, "very little relaxation at 1.5 kV/mm", 5.0),
    ]


def type2(records: Family, quantity: str) -> list[Finding]:
    """Descending minor loops to the lowest field, which is held."""
    starts, ends = _hold_levels(records, quantity)
    drop = (starts - ends)[[k for drive in SLOW_DRIVES for k in _rows(records, drive)]]
    shapes = [_descending_shape(record, getattr(record, quantity)) for record in records["0.1 Hz"][1:]]
    return [
        below(
            "the descending loops are very similar in shape",
            "at 0.1 Hz, each scaled to its own range, largest rms distance from their mean",
            float(max(100 * np.sqrt(np.mean((shape - np.mean(shapes, axis=0)) ** 2)) for shape in shapes)),
            10.0,
        ),
        Finding(
            "over the hold there is a noticeable drop, even at the lowest rates",
            f"by {drop.min():.4f} to {drop.max():.4f} {_unit(quantity)} after the slow drives; {_yardstick(quantity)}",
            bool(np.all(drop > NOTICEABLE[quantity])),
        ),
        Finding(
            "slow drives start their relaxation lower than fast ones",
            f"on average {_mean(records, starts, SLOW_DRIVES):.4f} against {_mean(records, starts, FAST_DRIVES):.4f}"
            f" {_unit(quantity)}",
            bool(_mean(records, starts, SLOW_DRIVES) < _mean(records, starts, FAST_DRIVES)),
        ),
        _one_level(float(np.ptp(starts)), float(np.ptp(ends)), quantity),
    ]


def type3(records: Family, quantity: str) -> list[Finding]:
    """A shuttle upwards from the descending branch, then a hold."""
    starts, ends = _hold_levels(records, quantity)
    count = len(records["0.1 Hz"])
    drops, begins, levels = (v.reshape(len(records), count) for v in (starts - ends, starts, ends))
    seen = np.max(drops, axis=0) > NOTICEABLE[quantity]
    slow, fast = drops[:2, seen], drops[2:, seen]
    worst = float(np.max(np.ptp(levels, axis=0)[seen] / np.ptp(begins, axis=0)[seen]))
    where = f"where there is any, up to {reversals('type3')[int(np.sum(seen)) - 1]:g} kV/mm,"
    return [
        _narrower(records, quantity, 1, 2),
        Finding(
            "at the same rate the relaxation is larger at lower reversals, -0.4 kV/mm above all",
            f"{where} it is {_list(list(slow[0]), 4)} {_unit(quantity)} at 0.1 Hz, {_list(list(fast[0]), 4)} at 100 Hz",
            bool(np.all(np.diff(drops[::2, seen], axis=1) < 0)),
        ),
        Finding(
            "it is larger after a faster cycle",
            f"at {int(np.sum(fast > slow))} of {fast.size} pairs, by factors from {np.min(fast / slow):.1f} to"
            f" {np.max(fast / slow):.1f}",
            bool(np.all(fast > slow)),
        ),
        below(
            "at one reversal it always ends at the same level, whatever the rate before",
            "distance of the four drives at the end of the hold over that at its beginning, at most",
            100 * worst,
            10.0,
        ),
    ]


def type4(records: Family, quantity: str) -> list[Finding]:
    """A shuttle downwards from the ascending branch, then a hold."""
    starts, ends = _hold_levels(records, quantity)
    growth = float(np.max(np.abs(ends - starts)[: 2 * len(records["0.1 Hz"])]))
    return [
        _narrower(records, quantity, 2, 3),
        Finding(
            "over the hold the increase is hardly noticeable",
            f"up to {growth:.4f} {_unit(quantity)} after the slow drives and"
            f" {float(np.max(np.abs(ends - starts))):.4f} after the fast ones; {_yardstick(quantity)}, which is asked"
            " of the slow ones",
            bool(growth < NOTICEABLE[quantity]),
        ),
    ]


def _narrower(records: Family, quantity: str, first: int, second: int) -> Finding:
    gaps = [mean_gap(record, getattr(record, quantity), first, second) for record in records["0.1 Hz"]]
    return Finding(
        "the minor loops are shuttles, narrower at higher fields",
        f"at 0.1 Hz on average {_list(gaps, 4)} {_unit(quantity)} wide, lowest reversal first; closed ones may tie",
        bool(np.all(np.diff(gaps) < 0.01 * max(gaps))),
    )


def _hold_levels(records: Family, quantity: str) -> tuple[Array, Array]:
    """Values at the beginning and at the end of every hold, drive by drive."""
    every = [record for drive in DRIVES for record in records[drive]]
    values = [getattr(record, quantity)[record.hold] for record in every]
    return np.array([value[0] for value in values]), np.array([value[-1] for value in values])


def _rows(records: Family, drive: str) -> range:
    count, place = len(records[drive]), list(DRIVES).index(drive)
    return range(place * count, (place + 1) * count)


def _mean(records: Family, values: Array, drives: Sequence[str]) -> float:
    return float(np.mean([values[k] for drive in drives for k in _rows(records, drive)]))


def _span(records: Family, quantity: str) -> float:
    return float(max(np.ptp(getattr(record, quantity)) for record in records["0.1 Hz"]))


def _one_level(apart: float, left: float, quantity: str) -> Finding:
    return Finding(
        "they all relax to almost the same level",
        f"{apart:.4f} {_unit(quantity)} apart at the beginning of the hold, {left:.4f} at its end; taken as agreeing"
        " below a tenth",
        bool(left < 0.1 * apart),
    )


def _end_of_hold(records: Family, quantity: str, claim: str, limit: float) -> Finding:
    starts, ends = _hold_levels(records, quantity)
    moved = float(100 * np.max(ends - starts) / _span(records, quantity))
    return below(claim, "largest change over the span", moved, limit)


def _bend(record: Record, values: Array) -> float:
    """How far the way up is from its chord, at most [unit of `values`]."""
    part = record.leg(1)
    x, y = record.field[part], values[part]
    chord = y[0] + (y[-1] - y[0]) * (x - x[0]) / (x[-1] - x[0])
    return float(np.max(np.abs(y - chord)))


def _descending_shape(record: Record, values: Array) -> Array:
    """The last leg scaled to its own range, at 50 places."""
    part = record.leg(-2)
    x, y = record.field[part], values[part]
    place, level = (x - x[-1]) / (x[0] - x[-1]), (y - y[-1]) / (y[0] - y[-1])
    return np.interp(np.linspace(0.0, 1.0, 50), place[::-1], level[::-1])


def _list(values: Sequence[float], digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _yardstick(quantity: str) -> str:
    return f"noticeable is taken to be {NOTICEABLE[quantity]:.4g} {_unit(quantity)}"


def _unit(quantity: str) -> str:
    return {"polarization": "C/m²", "strain": "%"}[quantity]


_FINDINGS = {"type1": type1, "type2": type2, "type3": type3, "type4": type4}
_NOTES = {
    "type3": "The shipped actuator chain has one ceramic for both directions; its notes say what it cannot meet.",
    "type4": "The shipped actuator chain has one ceramic for both directions; its notes say what it cannot meet.",
}
