"""Figures 3.24 to 3.28: the parametrized model beside the actuator, full loop and minor loops."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pzt_ros.figures.canvas import (
    DASHED,
    FAST,
    LADDER,
    POLARIZATION,
    SHADE,
    SLOW,
    STRAIN,
    curve,
    legend_below,
    over_field,
    sheet,
)
from pzt_ros.figures.experiments import ACTUATOR_CHAIN, Record, experiment, mean_gap, rms_apart
from pzt_ros.figures.full_loops import strain_gap
from pzt_ros.figures.minor_loops import reversals
from pzt_ros.figures.thesis_figure import Drawing, Finding, below
from pzt_ros.physics.signals import Array

_RATE = "0.1 kV/mm/s"
_NOTE = (
    f"In place of the experiment stands the simulated actuator {ACTUATOR_CHAIN}, which was fitted to the numbers of"
    " chapter 2: where both differ, either may be off."
)


def full_loop(samples: int) -> Drawing:
    """Figure 3.24."""
    actuator, model = (experiment("full-loop", _RATE, None, chain, samples) for chain in (ACTUATOR_CHAIN, "thesis-p1"))
    figure = sheet(9.8, 4.5, f"actuator chain {ACTUATOR_CHAIN}, model chain thesis-p1")
    axes = figure.subplots(1, 2)
    for axis, name, label in zip(axes, ("polarization", "strain"), (POLARIZATION, STRAIN), strict=True):
        curve(
            axis,
            actuator.field,
            getattr(actuator, name),
            FAST,
            "actuator, in place of the experiment",
            linestyle=DASHED,
        )
        curve(axis, model.field, getattr(model, name), SLOW, "parametrized model")
        over_field(axis, label, name)
    legend_below(figure, axes[0])
    p, s = (rms_apart(getattr(actuator, name), getattr(model, name)) for name in ("polarization", "strain"))
    (loop, _), (parabola, _) = strain_gap(actuator), strain_gap(model)
    findings = (
        below(
            "the model captures the hysteresis qualitatively", f"rms difference over the span: S {s:.1f} %, P", p, 15.0
        ),
        Finding("no perfect match, strain above all", f"P {p:.1f} %, S {s:.1f} % of the span", bool(s > p > 1.0)),
        Finding(
            "S = ζP² has no loop of strain over polarization, the actuator has one",
            f"branches up to {abs(parabola):.4f} % apart in the model, {loop:.4f} % in the actuator",
            bool(abs(parabola) < 0.05 * loop),
        ),
    )
    return Drawing(figure, findings, _NOTE)


def minor_loops(name: str) -> Callable[[int], Drawing]:
    """How figures 3.25 to 3.28 are drawn."""
    return lambda samples: _draw(name, samples)


def _draw(name: str, samples: int) -> Drawing:
    sides = {
        "actuator, in place of the experiment": _all(name, ACTUATOR_CHAIN, samples),
        "parametrized model": _all(name, "thesis-p2", samples),
    }
    figure = sheet(9.8, 4.9, f"actuator chain {ACTUATOR_CHAIN}, model chain thesis-p2, linear drives of {_RATE}")
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    fields = reversals(name)
    ladder = LADDER if len(fields) == len(LADDER) else LADDER[::2] + LADDER[-1:]
    for axis, (title, records) in zip(axes, sides.items(), strict=True):
        for record, reversal, colour in zip(records, fields, ladder, strict=True):
            common, own = record.leg(0), slice(record.ends[0], None)
            curve(axis, record.field[common], record.strain[common], SHADE, zorder=1.5)
            curve(axis, record.field[own], record.strain[own], colour, f"{reversal:g}", linewidth=1.2)
        over_field(axis, STRAIN, title)
    axes[1].set_ylabel("")
    legend_below(figure, axes[0], "reversal field [kV/mm]")
    actuator, model = sides.values()
    findings = [_match(actuator, model, samples)]
    if name in ("type3", "type4"):
        legs = (1, 2) if name == "type3" else (2, 3)
        findings.append(_narrower(actuator, model, *legs))
    else:
        findings.append(_trend(name, actuator, model))
    return Drawing(figure, tuple(findings), _NOTE)


def _all(name: str, chain: str, samples: int) -> list[Record]:
    return [experiment(name, _RATE, reversal, chain, samples) for reversal in reversals(name)]


def _match(actuator: Sequence[Record], model: Sequence[Record], samples: int) -> Finding:
    """RMS over all drives, in % of strain, against that of the full loop of figure 3.24."""
    misses = [one.strain - two.strain for one, two in zip(actuator, model, strict=True)]
    minor = _rms(np.concatenate(misses))
    full = [experiment("full-loop", _RATE, None, chain, samples).strain for chain in (ACTUATOR_CHAIN, "thesis-p1")]
    major = _rms(full[0] - full[1])
    return Finding(
        "here the model matches strain much better than in the full range",
        f"rms difference {minor:.4f} %, in figure 3.24 {major:.4f} %; taken as agreeing below a half",
        bool(minor < 0.5 * major),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _trend(name: str, actuator: Sequence[Record], model: Sequence[Record]) -> Finding:
    """Strain at the turns of the family in both, and how it goes with the reversal field."""
    turn = 0 if name == "type1" else 1
    levels = [[record.strain[record.ends[turn]] for record in records] for records in (actuator, model)]
    correlation = float(np.corrcoef(levels[0], levels[1])[0, 1])
    return Finding(
        "the trends over the family are reflected",
        f"strains at the reversal go together with a correlation of {correlation:.3f}; taken as agreeing above 0.95",
        bool(correlation > 0.95),
    )


def _narrower(actuator: Sequence[Record], model: Sequence[Record], first: int, second: int) -> Finding:
    """Mean width of the shuttles."""
    gaps = [[mean_gap(record, record.strain, first, second) for record in records] for records in (actuator, model)]
    listed = [", ".join(f"{1e3 * gap:.2f}" for gap in side) for side in gaps]
    return Finding(
        "the simulated small minor loops are narrower than the measured ones",
        f"mean widths {listed[1]} of the model against {listed[0]} of the actuator [10⁻³ %], lowest reversal first",
        bool(np.all(np.array(gaps[1]) < np.array(gaps[0]))),
    )
