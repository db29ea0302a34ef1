"""PNZT ceramic: polarization from the drive, strain from polarization and field, and the hold record from the loops.

Fitted are two loops to 1400 V and the first half of one to 1000 V; its second half scores. The hold record was made
before, so what the specimen had seen by then is driven through first, as the README of the data tells it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from pzt_benchmarks.measured.sets import CERAMIC, HOLD
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.identified_fit import IdentifiedFit, IdentifiedResult
from pzt_ros.sysid.identified_problem import MeasuredRun
from pzt_ros.sysid.run import rms

_least_squares: Any = optimize.least_squares  # SciPy carries no types

Mask = NDArray[np.bool_]

THICKNESS = 0.8e-3
"""[m]"""

NOISE = 1e-3
"""What a misfit of the polarization is weighed with [C/m^2]."""

PULSE, REST_AGAIN = 10.0, 40.0
"""The hold record is at rest from 40 s on: zero and drift of its integrator are taken there. Its first pulse ends at
10 s: until then its zero of the polarization is fitted, for the strain law [s]."""

_REST = 72.0  # what the monitor reads where 0 V was programmed [V]
_PAUSE = 5.0  # between the records before and the hold [s]


@dataclass(frozen=True)
class Part:
    """A prediction beside its measurement.

    Attributes:
        what: quantity and record.
        time, measured: [s], [unit].
        predicted: by model.
        scored: samples that score.
        unit, scale: in which it is shown.
        span: of the measurement over the record.
    """

    what: str
    time: Array
    measured: Array
    predicted: dict[str, Array]
    scored: Mask
    unit: str
    scale: float

    @property
    def is_scored(self) -> bool:
        """Whether anything of it was not fitted."""
        return bool(np.any(self.scored))

    def rows(self) -> list[tuple[str, ...]]:
        """Error of each model where it was fitted, or took its zero from, and on what scores."""
        span = float(np.ptp(self.measured))
        found = []
        for model, values in self.predicted.items():
            left = self.measured - values
            known, error = rms(left[~self.scored]) * self.scale, rms(left[self.scored]) * self.scale
            held_out = f"{error:.3g} {self.unit}", f"{100.0 * error / (span * self.scale):.1f}"
            found.append((self.what, model, f"{known:.3g} {self.unit}", *(held_out if self.is_scored else ("", ""))))
        return found


HEADS = ("what is predicted", "by", "where it was fitted", "on the rest", "rest, % of span")


def study(data: Path, tell: Callable[[str], None]) -> list[Part]:
    """Everything of this specimen."""
    loops = [cut.record(data) for cut in (*CERAMIC.train, CERAMIC.test)]
    hold = HOLD.record(data)
    counted = [np.ones(len(loop), dtype=bool) for loop in loops]
    counted[-1][len(loops[-1]) // 2 :] = False
    tell("identifying the polarization")
    found = identified(loops, counted)
    tell("predicting the hold from what was before it")
    p_small, p_hold = found.problem.predict(found.vector)[-1], after(found, _pulses(), hold)
    rest = hold.time > REST_AGAIN
    line = np.polyfit(
        *(np.concatenate([v[c] for v, c in zip(x, counted, strict=True)]) for x in _drive_and_p(loops)), 1
    )
    level = np.polyval(line, loops[-1].voltage)
    level += float(np.mean((_p(loops[-1]) - level)[counted[-1]]))
    models = {"straight line": level, "identified density": p_small}
    what = "polarization, 1000 V loop, second half"
    return [
        Part(what, loops[-1].time, _p(loops[-1]), models, ~counted[-1], "mC/m²", 1e3),
        _polarization_in_hold(
            hold, {"straight line": np.polyval(line, hold.voltage), "identified density": p_hold}, rest
        ),
        *_strains(loops, counted, hold, rest),
    ]


def _drive_and_p(records: Sequence[Record]) -> tuple[list[Array], list[Array]]:
    return [record.voltage for record in records], [_p(record) for record in records]


def identified(loops: Sequence[Record], counted: Sequence[Mask]) -> IdentifiedResult:
    """Voltage to polarization; every record starts as it may, and has a zero of its own."""
    runs = [MeasuredRun(r.time, r.voltage, _p(r), NOISE, c) for r, c in zip(loops, counted, strict=True)]
    return IdentifiedFit(THICKNESS, resolutions=(8, 12), rotations=(0.0, 1.0), orders=(1,)).fit(runs)


def after(found: IdentifiedResult, before: Record, record: Record) -> Array:
    """Polarization of a record after what was done before it, with a zero of its own [C/m^2]."""
    late = record.time - record.time[0] + float(before.time[-1]) + _PAUSE
    time, voltage = np.concatenate((before.time, late)), np.concatenate((before.voltage, record.voltage))
    base = found.problem.base.for_runs([time], [True])
    vector = base.start.copy()
    vector[: base.shared] = found.vector[: base.shared]
    return np.asarray(base.polarization(vector, [voltage])[0][-len(record) :])


def _pulses() -> Record:
    """The hold record of five minutes before: 2 s at 1400, -1400, 0 and 1000 V, then 60 s at rest."""
    levels, lengths = (1400.0, -1400.0, 0.0, 1000.0, 0.0), (2.0, 2.0, 2.0, 2.0, 60.0)
    edges = np.concatenate(([0.0], np.cumsum(lengths)))
    time = np.arange(0.0, edges[-1], 0.0136)
    place = np.searchsorted(edges[1:-1], time, side="right")
    return Record("history", {"time_s": time, "voltage_V": _REST + np.array(levels)[place]})


def _p(record: Record) -> Array:
    polarization = record.polarization
    assert polarization is not None
    return polarization


def _polarization_in_hold(hold: Record, found: dict[str, Array], rest: Mask) -> Part:
    """Zero and drift from the rest at its end."""
    models = {}
    for name, values in found.items():
        models[name] = values + np.polyval(np.polyfit(hold.time[rest], (_p(hold) - values)[rest], 1), hold.time)
    return Part("polarization, hold, first 40 s", hold.time, _p(hold), models, ~rest, "mC/m²", 1e3)


LAWS = {
    "P²": lambda p, e: [p**2],
    "P² + P⁴": lambda p, e: [p**2, p**4],
    "P² + E·P": lambda p, e: [p**2, e * p],
}
"""Displacement over polarization and field, but for factors and a zero."""


def _strains(loops: Sequence[Record], counted: Sequence[Mask], hold: Record, rest: Mask) -> list[Part]:
    """Displacement from the measured polarization, in the second half of the last loop and in the hold."""
    in_loops: list[dict[str, Array]] = [{} for _ in loops]
    in_hold = {}
    drift = np.polyfit(hold.time[rest], _p(hold)[rest], 1)[0]
    steady, calm = _p(hold) - drift * hold.time, rest | (hold.time < PULSE)
    for name in LAWS:
        factors, zeros = _law(name, loops, counted)
        for loop, zero, known, found in zip(loops, zeros, counted, in_loops, strict=True):
            found[name] = _placed(_strain(name, factors, _p(loop) + zero, loop), loop, known)
        in_hold[name] = _with_zero(name, factors, steady, hold, calm)
    names = ("1400 V loop, 1 Hz", "1400 V loop, 0.1 Hz", "1000 V loop, second half")
    found = [
        Part(f"displacement, {name}", loop.time, loop.displacement, models, ~known, "nm", 1e9)
        for name, loop, models, known in zip(names, loops, in_loops, counted, strict=True)
    ]
    return [*found, Part("displacement, hold, 10 to 40 s", hold.time, hold.displacement, in_hold, ~calm, "nm", 1e9)]


def _strain(name: str, factors: Array, p: Array, record: Record) -> Array:
    return np.asarray(np.column_stack(LAWS[name](p, record.voltage / THICKNESS)) @ factors)


def _placed(values: Array, record: Record, known: Mask) -> Array:
    """With the zero of the displacement from the samples that are known."""
    return values + float(np.mean((record.displacement - values)[known]))


def _law(name: str, records: Sequence[Record], counted: Sequence[Mask]) -> tuple[Array, Array]:
    """Factors, and the zero of the polarization of each record [C/m^2]; each has a zero of displacement, too."""
    measured = np.concatenate(
        [r.displacement[c] - r.displacement[c].mean() for r, c in zip(records, counted, strict=True)]
    )

    def columns(zeros: Array) -> Array:
        rows = []
        for record, c, zero in zip(records, counted, zeros, strict=True):
            terms = np.column_stack(LAWS[name](_p(record) + zero, record.voltage / THICKNESS))[c]
            rows.append(terms - terms.mean(axis=0))
        return np.vstack(rows)

    def factors(zeros: Array) -> Array:
        matrix = columns(zeros)
        size = np.linalg.norm(matrix, axis=0)
        return np.asarray(np.linalg.lstsq(matrix / size, measured, rcond=None)[0] / size)

    zeros = _best_zeros(lambda zeros: measured - columns(zeros) @ factors(zeros), len(records))
    return factors(zeros), zeros


def _with_zero(name: str, factors: Array, p: Array, record: Record, known: Mask) -> Array:
    """Strain with the zero of the polarization that suits the samples that are known."""

    def value(zero: Array) -> Array:
        return _placed(_strain(name, factors, p + zero[0], record), record, known)

    return value(_best_zeros(lambda zero: (record.displacement - value(zero))[known], 1))


def _best_zeros(left: Callable[[Array], Array], count: int) -> Array:
    """Zeros of the polarization with the least squares, from three starts [C/m^2]."""
    found = [_least_squares(lambda zeros: 1e9 * left(zeros), np.full(count, start)) for start in (-0.1, 0.0, 0.1)]
    return np.asarray(min(found, key=lambda each: each.cost).x)
