"""Measured runs against an identified density with a strain law behind it: the problem that IdentifiedFit solves.

Domains that never switch shift the polarization, and its scale can be had in the law as well. A polynomial takes up
both, but along a bent path that costs a search a hundred steps. So the law is one of the centred polarization, which
neither shift nor scale changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import integrate

from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.signals import Array

_integrate: Any = integrate  # SciPy carries no types
_LAG_STEP = 0.01  # of a sample: difference step


@dataclass(frozen=True)
class MeasuredRun:
    """One run as it is fitted.

    Attributes:
        time, voltage: every sample, since the history counts [s, V].
        measured: displacement [m] or, with a law of order 1, polarization [C/m^2].
        noise: rms of its noise, in the same unit.
        counted: which samples are compared.
        unknown_start: False: the run begins in the state that `initial` of the lattice names.
        chooses: samples that are not compared but may choose between fits; None: none.
        polarization: recorded beside the displacement [C/m^2]; empty where it takes no part.
        polarization_noise: rms of its noise [C/m^2].
    """

    time: Array
    voltage: Array
    measured: Array
    noise: float
    counted: NDArray[np.bool_]
    unknown_start: bool = True
    chooses: NDArray[np.bool_] | None = None
    polarization: Array = field(default_factory=lambda: np.empty(0))
    polarization_noise: float = 0.0

    @property
    def is_polarized(self) -> bool:
        """Whether its polarization takes part."""
        return self.polarization.size > 0

    @cached_property
    def beyond_polarization(self) -> Array:
        """What a recorded polarization has beside it at the counted samples, orthonormal: zero, drift, leakage.

        The last goes with the integral of the voltage [shape (n, 3)].
        """
        leaked = _integrate.cumulative_trapezoid(self.voltage, self.time, initial=0.0)
        columns = np.column_stack((np.ones(self.time.size), self.time - self.time[0], leaked))[self.counted]
        return np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]

    def part(self, counted: NDArray[np.bool_]) -> MeasuredRun:
        """The same run with other samples counted."""
        return replace(self, counted=counted)


class IdentifiedBase(Protocol):
    """Voltage at the ceramic to polarization for several runs at once, with a density that is sought.

    Attributes:
        names, start, lower, upper: of the coordinates: those of all runs, then the starts that are not known.
        unknown_start: of each run.
        rotation_strength, smoothness_strength: as IdentifiedHysteresis.
    """

    names: list[str]
    start: Array
    lower: Array
    upper: Array
    unknown_start: list[bool]
    rotation_strength: float
    smoothness_strength: float

    @property
    def shared(self) -> int:
        """How many coordinates belong to all runs."""
        ...

    @property
    def polarized(self) -> slice:
        """Coordinates in units of polarization."""
        ...

    @property
    def occupancies(self) -> slice:
        """Where the starts that are not known stand in the vector."""
        ...

    def finest(self, vector: Array) -> float:
        """Lines of a fine lattice that a vector asks for."""
        ...

    def for_runs(self, times: Sequence[Array], unknown_start: Sequence[bool]) -> IdentifiedBase:
        """The same coordinates, bounds and strengths for other runs."""
        ...

    def carried(self, former: Any, vector: Array) -> Array:
        """The vector of another resolution of the same kind, over the same range and the same runs."""
        ...

    def link(self, vector: Array) -> Ferroelectric:
        """The density of a vector."""
        ...

    def polarization(self, vector: Array, voltages: Sequence[Array]) -> list[Array]:
        """P of each run whose voltage is given [C/m^2, each shape (n,)]."""
        ...

    def tangent(self, vector: Array, voltages: Sequence[Array]) -> tuple[list[Array], list[Any]]:
        """The same, and dP/dvector [each shape (n, p), float32]."""
        ...

    def regularisation(self) -> tuple[Array, Array]:
        """Rows and targets of what is believed before the data, in units of the noise."""
        ...


class IdentifiedProblem:
    """Residuals (model - measured)/noise at the counted samples, for gauss_newton.solve.

    The vector is that of the base, then the coefficients of the law y = y0 + s1 q + s2 q^2 + ... of the
    centred polarization q, then a sensor lag where wanted, then what a recorded polarization is of that of the base,
    then of each run its offset y0 and drift.

    Attributes:
        names, start, lower, upper: of the coordinates.
        polarization_scale: place of what a recorded polarization is of that of the base; None where no run has one.
        known_centring: mean and scale that the law was fitted with; None: those of the runs.
    """

    def __init__(
        self, base: IdentifiedBase, runs: Sequence[MeasuredRun], *, order: int, lag: bool, drift: bool
    ) -> None:
        """
        Args:
            base: made for the times of these runs.
            runs: to be fitted together.
            order: of the law.
            lag: whether the measurement may be late; the same in all runs.
            drift: whether each run may drift linearly in time.
        """
        self.base, self.runs, self.order = base, list(runs), order
        size = len(base.names)
        self.law = slice(size, size + order)
        self.lag = size + order if lag else None
        polarized = any(run.is_polarized for run in runs)
        self.polarization_scale = size + order + int(lag) if polarized else None
        self.offsets = size + order + int(lag) + int(polarized)
        self.per_run = 1 + int(drift)
        self.known_centring: tuple[float, float] | None = None
        self.names = [*base.names, *(f"law {power}" for power in range(1, order + 1)), *(["lag"] if lag else [])]
        self.names += ["polarization scale"] if polarized else []
        for run in range(len(runs)):
            self.names += [f"run {run} offset", f"run {run} drift"][: self.per_run]
        extra = len(self.names) - size
        self.start = np.concatenate((base.start, np.zeros(extra)))
        self.lower = np.concatenate((base.lower, np.full(extra, -np.inf)))
        self.upper = np.concatenate((base.upper, np.full(extra, np.inf)))
        if self.lag is not None:
            step = float(np.median(np.concatenate([np.diff(run.time) for run in runs])))
            self.lower[self.lag], self.upper[self.lag] = 0.0, 20.0 * step
            self.start[self.lag] = step  # at 0, its lower bound, it would look as if the other way were better
            self._lag_step = _LAG_STEP * step
        if self.polarization_scale is not None:
            self.start[self.polarization_scale] = 1.0

    def voltages(self, vector: Array) -> list[Array]:
        """What the ceramic saw by the time of each reading [V]."""
        if self.lag is None:
            return [run.voltage for run in self.runs]
        return [np.interp(run.time - vector[self.lag], run.time, run.voltage) for run in self.runs]

    def law_at(self, vector: Array, centred: Array) -> tuple[Array, Array]:
        """Value of the law without its offset, and its slope over q."""
        law, powers = vector[self.law], range(1, self.order + 1)
        value = sum(law[k - 1] * centred**k for k in powers)
        slope = sum(law[k - 1] * k * centred ** (k - 1) for k in powers)
        return np.asarray(value), np.asarray(slope) * np.ones_like(centred)

    def _own(self, run: int) -> tuple[int, Array]:
        """Place of the coordinates of one run, and their columns: offset, drift over its duration."""
        time = self.runs[run].time
        columns = np.stack([np.ones(time.size), (time - time[0]) / (time[-1] - time[0])], axis=1)
        return self.offsets + run * self.per_run, columns[:, : self.per_run]

    def centring(self, polarizations: Sequence[Array]) -> tuple[float, float]:
        """Mean and rms of the polarization about it, over the counted samples of all runs [C/m^2]."""
        if self.known_centring is not None:
            return self.known_centring
        counted = np.concatenate([p[run.counted] for run, p in zip(self.runs, polarizations, strict=True)])
        return float(counted.mean()), max(float(counted.std()), 1e-30)

    def predicted(self, vector: Array, polarizations: Sequence[Array]) -> list[Array]:
        """The measurement as the model has it, at every sample."""
        mean, scale = self.centring(polarizations)
        found = []
        for run, polarization in enumerate(polarizations):
            place, columns = self._own(run)
            law, _ = self.law_at(vector, (polarization - mean) / scale)
            found.append(law + columns @ vector[place : place + self.per_run])
        return found

    def predict(self, vector: Array) -> list[Array]:
        """The same, from the recorded voltages."""
        return self.predicted(vector, self._polarizations(vector))

    def residuals(self, vector: Array) -> list[Array]:
        """Of each run at its counted samples, its polarization behind its displacement."""
        return self._compared(vector, self._polarizations(vector))

    def _polarizations(self, vector: Array) -> list[Array]:
        return self.base.polarization(vector[: self.law.start], self.voltages(vector))

    def _compared(self, vector: Array, polarizations: Sequence[Array]) -> list[Array]:
        found = []
        for run, y, p in zip(self.runs, self.predicted(vector, polarizations), polarizations, strict=True):
            parts = [(y - run.measured)[run.counted] / run.noise]
            if run.is_polarized:
                parts.append(_alone(run, (vector[self.polarization_scale] * p - run.polarization)[run.counted]))
            found.append(np.concatenate(parts))
        return found

    def linearise(self, vector: Array) -> tuple[list[Array], list[Any]]:
        """Residuals and their Jacobian, float32."""
        size, voltages = self.law.start, self.voltages(vector)
        polarizations, tangents = self.base.tangent(vector[:size], voltages)
        later = self._later(vector, voltages, polarizations)
        mean, scale = self.centring(polarizations)
        centred = [((p - mean) / scale)[run.counted] for run, p in zip(self.runs, polarizations, strict=True)]
        jacobians, recorded = [], []
        for number, (run, q, tangent) in enumerate(zip(self.runs, centred, tangents, strict=True)):
            tangent = tangent[run.counted]
            recorded.append(self._of_recorded(run, vector, tangent, polarizations[number]))
            jacobian = np.zeros((q.size, len(self.names)), dtype=np.float32)
            jacobian[:, :size] = tangent
            if self.lag is not None:
                jacobian[:, self.lag] = later[number][run.counted]
            jacobians.append(jacobian)
        if self.known_centring is None:
            _centre(jacobians, centred)
        for number, (run, q, jacobian) in enumerate(zip(self.runs, centred, jacobians, strict=True)):
            jacobian *= (self.law_at(vector, q)[1] / (scale * run.noise))[:, None].astype(np.float32)
            for power in range(1, self.order + 1):
                jacobian[:, size + power - 1] = q**power / run.noise
            place, columns = self._own(number)
            jacobian[:, place : place + self.per_run] = columns[run.counted] / run.noise
        both = [np.vstack(pair) if pair[1].size else pair[0] for pair in zip(jacobians, recorded, strict=True)]
        return self._compared(vector, polarizations), both

    def _of_recorded(self, run: MeasuredRun, vector: Array, tangent: Any, polarization: Array) -> Any:
        """Jacobian of what is left of a recorded polarization [shape (n, p)]; no rows where there is none."""
        if not run.is_polarized:
            return np.empty((0, len(self.names)), dtype=np.float32)
        found = np.zeros((len(tangent), len(self.names)), dtype=np.float32)
        found[:, : self.law.start] = np.float32(vector[self.polarization_scale]) * tangent
        found[:, self.polarization_scale] = polarization[run.counted]
        return _alone(run, found)

    def _later(self, vector: Array, voltages: Sequence[Array], polarizations: Sequence[Array]) -> list[Array]:
        """dP/d(lag) of each run [C/(m^2 s)]."""
        if self.lag is None:
            return []
        moved = vector.copy()
        moved[self.lag] += self._lag_step
        others = self.base.polarization(vector[: self.law.start], self.voltages(moved))
        return [(other - here) / self._lag_step for other, here in zip(others, polarizations, strict=True)]

    def with_law_guess(self, vector: Array) -> Array:
        """The vector with law and offsets fitted to the polarization that it gives, the rest as it is."""
        size = self.law.start
        polarizations = self._polarizations(vector)
        mean, scale = self.centring(polarizations)
        rows, targets = [], []
        for number, (run, polarization) in enumerate(zip(self.runs, polarizations, strict=True)):
            row = np.zeros((run.time.size, len(self.names) - size))
            for power in range(1, min(self.order, 2) + 1):
                row[:, power - 1] = ((polarization - mean) / scale) ** power
            place, columns = self._own(number)
            row[:, place - size] = columns[:, 0]
            rows.append(row[run.counted] / run.noise)
            targets.append(run.measured[run.counted] / run.noise)
        found = vector.copy()
        lag = None if self.lag is None else vector[self.lag]
        found[size:] = np.linalg.lstsq(np.vstack(rows), np.concatenate(targets), rcond=None)[0]
        if self.polarization_scale is not None:
            found[self.polarization_scale] = self._scale_guess(polarizations)
        if self.lag is not None and lag is not None:
            found[self.lag] = lag
        return found

    def _scale_guess(self, polarizations: Sequence[Array]) -> float:
        """What recorded polarizations are of those of the base, by least squares [-]."""
        pairs = [(run, p) for run, p in zip(self.runs, polarizations, strict=True) if run.is_polarized]
        modelled = np.concatenate([_alone(run, p[run.counted]) for run, p in pairs])
        recorded = np.concatenate([_alone(run, run.polarization[run.counted]) for run, _ in pairs])
        return float(modelled @ recorded / max(float(modelled @ modelled), 1e-300))

    def with_law_of(self, vector: Array, other: IdentifiedProblem, found: Array) -> Array:
        """The vector with law, lag, offsets and drifts of another problem with as many runs, whose centring differs.

        A law of lower order is carried as it is, one of higher order without its highest powers.
        """
        size = other.law.start
        old_mean, old_scale = other.centring(other.base.polarization(found[:size], other.voltages(found)))
        behind = np.concatenate((np.zeros(self.order), found[other.law.stop :]))
        carried = np.concatenate((vector[: self.law.start], behind))
        mean, scale = self.centring(self.base.polarization(carried[: self.law.start], self.voltages(carried)))
        inner = np.polynomial.Polynomial([(mean - old_mean) / old_scale, scale / old_scale])
        law = np.zeros(max(self.order, other.order) + 1)
        coefficients = np.polynomial.Polynomial([0.0, *found[other.law]])(inner).coef
        law[: coefficients.size] = coefficients
        carried[self.law] = law[1 : self.order + 1]
        carried[self.offsets :: self.per_run] += law[0]
        return carried

    def prior(self) -> tuple[Array, Array]:
        """Rows and targets of the base's regularisation over the whole vector."""
        rows, targets = self.base.regularisation()
        return np.hstack([rows, np.zeros((rows.shape[0], len(self.names) - rows.shape[1]))]), targets


def _alone(run: MeasuredRun, values: Any) -> Any:
    """A polarization at the counted samples over its noise, less what one that is recorded has beside it."""
    slow = run.beyond_polarization.astype(values.dtype, copy=False)
    return (values - slow @ (slow.T @ values)) / values.dtype.type(run.polarization_noise)


def _centre(jacobians: Sequence[Any], centred: Sequence[Array]) -> None:
    """Turn dP/dvector into scale times dq/dvector, in place: mean and scale of P change with the vector, too."""
    count = sum(q.size for q in centred)
    mean = sum(jacobian.sum(axis=0, dtype=float) for jacobian in jacobians) / count
    growth = sum(q.astype(np.float32) @ jacobian for q, jacobian in zip(centred, jacobians, strict=True)) / count
    for q, jacobian in zip(centred, jacobians, strict=True):
        jacobian -= mean.astype(np.float32)
        jacobian -= np.outer(q.astype(np.float32), growth.astype(np.float32))


def rms_of(parts: Sequence[Array]) -> float:
    """Root of the mean square over all parts."""
    count = sum(part.size for part in parts)
    return math.sqrt(sum(float(part @ part) for part in parts) / count) if count else 0.0
