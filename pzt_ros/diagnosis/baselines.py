"""Models that know no physics, for comparison: a straight line, the last cycle, a sum of play operators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import optimize

from pzt_ros.diagnosis.data import FIT, SCORE, RunData, highest_voltage
from pzt_ros.diagnosis.outcome import Errors, errors_from
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.result import SETTLE_TIME
from pzt_ros.sysid.run import first_half

_lsq_linear: Any = optimize.lsq_linear  # SciPy carries no types
_minimize_scalar: Any = optimize.minimize_scalar

_PLAYS = 40
_DEGREE = 3
_CHUNK = 50_000  # samples whose columns are in memory at once
_MOST_FITTED = 20_000  # samples of a run that a baseline is fitted to
_SAME_DRIVE = 0.01  # of the span: two cycles whose drives differ by less (rms) are the same
_MOST_TRIED = 4096  # delays tried for a period, coarsely
_MOST_REFINED = 8


def baselines(runs: Sequence[RunData]) -> dict[str, Errors]:
    """Errors of each, fitted to the train runs and predicted on all; "last cycle" only where the test drives repeat.

    The zero of a train run is fitted, that of a test run comes from its first second, or from its first half where it
    begins driven: as `pzt predict` takes it.
    """
    found = {"straight line": _errors_of(_Columns(runs, plays=0, degree=1), runs)}
    cycles = [_last_cycle(run) for run in runs]
    tested = [c for c, run in zip(cycles, runs, strict=True) if SCORE in run.picks] or cycles
    if all(c is not None for c in tested):
        line = found["straight line"].residuals
        filled = [a if c is None else np.where(np.isnan(c), a, c) for c, a in zip(cycles, line, strict=True)]
        found["last cycle"] = errors_from(filled, runs)
    found["play sum"] = _errors_of(_Columns(runs, _PLAYS, _DEGREE), runs)
    return found


class _Columns:
    """Powers of the voltage and play operators of it, all in units of the largest voltage."""

    def __init__(self, runs: Sequence[RunData], plays: int, degree: int) -> None:
        self.scale = highest_voltage(runs)
        self.degree = degree
        reach = max(float(np.ptp(run.record.voltage)) for run in runs) / self.scale / 2.0
        self.radii = np.linspace(0.0, reach, plays + 2)[1:-1]

    @property
    def bounded(self) -> NDArray[np.bool_]:
        """Whether a weight must not be negative [bool, shape (degree + plays,)]."""
        return np.arange(self.degree + self.radii.size) >= self.degree

    def over(self, record: Record, weights: Array | None = None, every: int = 1) -> Array:
        """Columns at every so many samples [shape (m, degree + plays)], or their weighted sum [shape (m,)]."""
        drive = record.voltage / self.scale
        state = np.clip(0.0, drive[0] - self.radii, drive[0] + self.radii)
        parts = []
        for low in range(0, drive.size, _CHUNK):
            piece = drive[low : low + _CHUNK]
            powers = piece[:, None] ** np.arange(1, self.degree + 1)
            columns = np.column_stack((powers, _play(piece, self.radii, state)))
            parts.append(columns[-low % every :: every] if weights is None else columns @ weights)
        return np.concatenate(parts)


@njit(cache=True)
def _play(drive, radii, state):  # type: ignore[no-untyped-def]
    """Play operators of a drive [shape (n, k)]; `state` [shape (k,)] goes on from call to call.

    Krejci, "Hysteresis, Convexity and Dissipation", II.2: p <- max(v - r, min(v + r, p)).
    """
    out = np.empty((drive.size, radii.size))
    for i in range(drive.size):
        for k in range(radii.size):
            state[k] = max(drive[i] - radii[k], min(drive[i] + radii[k], state[k]))
            out[i, k] = state[k]
    return out


def _errors_of(columns: _Columns, runs: Sequence[RunData]) -> Errors:
    weights = _weights(columns, [run for run in runs if FIT in run.picks])
    residuals = []
    for run in runs:
        left = run.record.displacement - columns.over(run.record, weights)
        residuals.append(left - float(np.mean(left[: _tells_zero(run)])))
    return errors_from(residuals, runs)


def _tells_zero(run: RunData) -> int:
    """How many samples at the beginning of a run tell its zero."""
    if FIT in run.picks:
        return len(run.record)
    if run.begins_driven:
        return first_half(len(run.record))
    return int(np.searchsorted(run.record.time, run.record.time[0] + SETTLE_TIME))


def _weights(columns: _Columns, runs: Sequence[RunData]) -> Array:
    """Least squares in units of the noise, each run with a zero of its own; some weights not negative."""
    rows, targets = [], []
    for run in runs:
        every = -(-len(run.record) // _MOST_FITTED)
        found, measured = columns.over(run.record, every=every), run.record.displacement[::every]
        rows.append((found - found.mean(axis=0)) / run.noise)
        targets.append((measured - measured.mean()) / run.noise)
    whole = np.vstack(rows)
    size = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
    q, r = np.linalg.qr(whole / size)
    lower = np.where(columns.bounded, 0.0, -np.inf)
    solved: Array = _lsq_linear(r, q.T @ np.concatenate(targets), (lower, np.inf), method="bvls").x
    return solved / size


def _last_cycle(run: RunData) -> Array | None:
    """Measurement minus the measurement one period before [m]; NaN in the first period, None where nothing repeats."""
    record = run.record
    period = _period(record)
    if period is None:
        return None
    before = record.time - period
    left = record.displacement - np.interp(before, record.time, record.displacement)
    left[before < record.time[0]] = np.nan
    return left


def _period(record: Record) -> float | None:
    """Shortest delay after which the drive of the second half is the same again [s]; None where there is none."""
    time, voltage = record.time, record.voltage
    half = np.arange(len(record) // 2, len(record))
    allowed = _SAME_DRIVE * float(np.ptp(voltage))

    def difference(delay: float) -> float:
        late = half[time[half] - delay >= time[0]]
        return float(np.sqrt(np.mean((voltage[late] - np.interp(time[late] - delay, time, voltage)) ** 2)))

    longest = float(time[half[0]] - time[0])
    delays = np.linspace(0.0, longest, min(_MOST_TRIED, half.size))[1:]
    thin = half[:: max(1, half.size // 1000)]
    past = time[thin][None, :] - delays[:, None]
    coarse = np.sqrt(np.mean((voltage[thin] - np.interp(past, time, voltage)) ** 2, axis=1))
    gone = np.flatnonzero(coarse > 0.5 * coarse.max())
    if not gone.size:
        return None
    low = 0.3 * float(coarse.max())
    minima = [k for k in range(gone[0] + 1, coarse.size - 1) if low > coarse[k] <= min(coarse[k - 1], coarse[k + 1])]
    step = float(delays[0])
    for k in minima[:_MOST_REFINED]:
        best = _minimize_scalar(
            difference, bounds=(delays[k] - step, delays[k] + step), method="bounded", options={"xatol": 1e-3 * step}
        )
        if best.fun < allowed:
            return float(best.x)
    return None
