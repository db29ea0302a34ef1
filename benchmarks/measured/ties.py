"""Effects that one frequency cannot tell apart, each put behind the identified base with sizes of a grid.

A run at one frequency and one amplitude says nearly nothing about them, so their size cannot be fitted: it is chosen
where it was not fitted. If several do about equally well there, the data do not say which it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pzt_benchmarks.measured.judged import Row, centred, row
from pzt_ros.diagnosis.data import SELECTION, RunData
from pzt_ros.effects.sensor_lag import SensorLag
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.effects.slow_relaxation import SlowRelaxation
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.records import Record
from pzt_ros.sysid.identified_fit import IdentifiedFit
from pzt_ros.sysid.identified_problem import MeasuredRun

DELAYS = (0.0025, 0.005, 0.0075, 0.01)
"""[s]"""

SHARES, TIMES = (0.3, 1.0), (0.005, 0.01, 0.02)
"""Of the relaxation: late over prompt displacement, and its time [s]."""

CURVES = (-0.02, -0.005, 0.005, 0.02)
"""Cubic error at the end of the range over the range."""

_THICKNESS = 1e-4  # stands for none: only its ratio to the fields counts
_RESOLUTION, _ROTATION, _ORDER = 8, 10.0, 2


@dataclass(frozen=True)
class Trial:
    """An effect of one size: what it makes of the run, and its way back to the reading."""

    effect: str
    size: str
    link: Link | None = None
    delay: float = 0.0

    def undone(self, record: Record, centre: float) -> tuple[Array, Array]:
        """Voltage and displacement that the base sees; a delay of the reading is one of the voltage."""
        voltage = np.interp(record.time - self.delay, record.time, record.voltage)
        if self.link is None:
            return voltage, record.displacement
        seen = Signals(time=record.time, displacement=record.displacement - centre)
        return voltage, self.link.invert(self.link.init(_rest(record)), seen)[1].displacement

    def done(self, record: Record, displacement: Array) -> Array:
        """The reading of what the base gives."""
        if self.link is None:
            return displacement
        signals = Signals(time=record.time, displacement=displacement)
        return self.link.step(self.link.init(_rest(record)), signals)[1].displacement


def _rest(record: Record) -> Rest:
    return Rest(time=float(record.time[0]), voltage=float(record.voltage[0]))


def trials(span: float) -> Iterator[Trial]:
    """None, and every effect with every size."""
    yield Trial("none", "")
    for delay in DELAYS:
        yield Trial(SensorLag.kind, f"a delay of {1e3 * delay:g} ms", delay=delay)
    for share in SHARES:
        for time in TIMES:
            link = SlowRelaxation(share=share, shortest_time=0.7 * time, longest_time=1.4 * time)
            yield Trial(SlowRelaxation.kind, f"{share:.0%} late by {1e3 * time:g} ms", link)
    for curve in CURVES:
        link = SensorNonlinearity(amplitude=curve, mix=0.5 * math.pi, range=0.5 * span)
        yield Trial(SensorNonlinearity.kind, f"cubic, {curve:+.1%} at the end of the range", link)


def compared(train: RunData, test: RunData, tell: Callable[[str], None]) -> list[tuple[Trial, Row, Array]]:
    """The size of every effect that does best on the part that chooses: its errors, and residual of the test run."""
    best: dict[str, tuple[Trial, Row, Array]] = {}
    for trial in trials(float(np.ptp(train.record.displacement))):
        tell(f"{trial.effect} {trial.size}")
        residual = _residual(trial, train, test)
        found = trial, row(trial.effect, test, residual), residual
        if trial.effect not in best or found[1].chosen < best[trial.effect][1].chosen:
            best[trial.effect] = found
    return list(best.values())


def _residual(trial: Trial, train: RunData, test: RunData) -> Array:
    """Of the test run [m]; its start and zero are from the part that chooses."""
    centre = float(np.mean(train.record.displacement))
    counted = np.zeros(len(test.record), dtype=bool)
    counted[test.picks[SELECTION]] = True
    fitted = _run(trial, train, centre, np.ones(len(train.record), dtype=bool))
    fit = IdentifiedFit(_THICKNESS, resolutions=(_RESOLUTION,), rotations=(_ROTATION,), orders=(_ORDER,))
    found = fit.fit([fitted], [_run(trial, test, centre, counted)])
    predicted = found.predict(_run(trial, test, centre, counted))
    return centred(test, test.record.displacement - trial.done(test.record, predicted))


def _run(trial: Trial, run: RunData, centre: float, counted: NDArray[np.bool_]) -> MeasuredRun:
    voltage, displacement = trial.undone(run.record, centre)
    return MeasuredRun(run.record.time, voltage, displacement, run.noise, counted)
