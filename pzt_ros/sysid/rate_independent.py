"""The Preisach model over several runs at once, with its tangent: a base hysteresis that knows no time.

Polarization is linear in everything that is sought, so the tangent is exact wherever it is taken. Where switching does
not depend on the rate, the identified lattice gets there only with a thermal field of 0, which its lines do not allow:
a sum of plays, simulated at 8 to 600 V/s, left 2.5 x the noise there, and 1.0 here.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from pzt_ros.errors import BenchError
from pzt_ros.physics.link import State
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.sysid.identified import MARGIN, STEEPEST, asked_of, span_of
from pzt_ros.sysid.remembered import Remembered

SUSCEPTIBILITY, WEIGHTS = 0, 1
"""Coordinates: what does not switch, then the weights of the hats that the drive can move."""

_PLAYS = 100
_MOST_COLUMNS = 7.5e7  # numbers in the columns of all runs up to which these are remembered: 0.3 GB


class RateIndependentHysteresis:
    """Voltage at the ceramic to polarization for several runs at once, with its tangent.

    Attributes:
        names: of the coordinates.
        start: first guess; may be replaced.
        lower, upper: bounds in the fit's coordinates.
        field_range: lowest and highest field that any run reaches [V/m].
        before: voltages that each run went through before its first sample [V, each shape (k,)]; none at first.
        weight_strength, sum_strength, smoothness_strength, rotation_strength: as IdentifiedHysteresis.
    """

    def __init__(
        self,
        times: Sequence[Array],
        layer_thickness: float,
        field_range: tuple[float, float],
        *,
        unknown_start: Sequence[bool],
        resolution: int = 10,
        initial: str = "virgin",
        total: float = 0.26,
        fine_lines: int = 0,
    ) -> None:
        """
        Args:
            times: sample times of each run [s].
            layer_thickness: [m].
            field_range: lowest and highest field that any run reaches [V/m].
            unknown_start: of each run; none may be.
            resolution: coarse cells over the range; the density has about half their square of weights.
            initial: see Preisach.
            total: sum of weights [C/m^2].
            fine_lines: has no meaning here.

        Raises:
            BenchError: an empty range of field, a run without samples or with an unknown start.
        """
        span = span_of(field_range, Preisach.kind)
        if any(unknown_start) or any(time.size < 2 for time in times):
            raise BenchError("preisach: every run needs two samples and a start that is known")
        self.times, self.layer_thickness, self.total, self.initial = list(times), layer_thickness, total, initial
        self.unknown_start, self.field_range = list(unknown_start), field_range
        self.before = [np.empty(0)] * len(self.times)
        low, high = field_range[0] - MARGIN * span, field_range[1] + MARGIN * span
        self.coercive = np.linspace(0.0, 0.5 * (high - low), resolution + 1)
        self.interaction = np.linspace(low, high, resolution + 1)
        reach = np.abs(self.interaction - 0.5 * (low + high))[None, :] + self.coercive[:, None]
        self.moved = reach <= 0.5 * (high - low) + 1e-6 * span  # hats farther out are hardly moved
        self._inside = reach[self.moved] <= 0.5 * span
        self.weight_strength, self.smoothness_strength, self.rotation_strength = 0.1, 3.0, 0.0
        self.sum_strength = 1e3
        even = np.ones(self.moved.shape)
        even[[0, -1]] = 0.5
        self._even: Array = total * even / even[self.moved].sum()
        self.names = ["preisach.susceptibility"]
        self.names += [f"weight {r} {e}" for r, e in np.argwhere(self.moved)]
        self.start = np.concatenate(([0.2 * total / span], self._even[self.moved]))
        self.lower, self.upper = np.zeros(self.start.size), np.full(self.start.size, np.inf)
        self.upper[SUSCEPTIBILITY] = STEEPEST * total / span
        is_little = sum(time.size for time in times) * self.start.size <= _MOST_COLUMNS
        self._known_columns: Remembered[NDArray[np.float32]] = Remembered(len(times) if is_little else 0)

    @property
    def shared(self) -> int:
        """Coordinates that belong to all runs: every one."""
        return len(self.names)

    @property
    def polarized(self) -> slice:
        """Coordinates in units of polarization."""
        return slice(SUSCEPTIBILITY, self.shared)

    @property
    def occupancies(self) -> slice:
        """Where unknown starts would stand in the vector."""
        return slice(len(self.names), len(self.names))

    def finest(self, vector: Array) -> float:
        """Lines that a fine lattice would need: there is none."""
        return 0.0

    def for_runs(self, times: Sequence[Array], unknown_start: Sequence[bool]) -> RateIndependentHysteresis:
        """The same for other runs.

        Raises:
            BenchError: a run with an unknown start.
        """
        if any(unknown_start):
            raise BenchError("preisach: every run needs a start that is known")
        other = copy.copy(self)
        other.times, other.unknown_start, other.start = list(times), list(unknown_start), self.start.copy()
        other.before = [np.empty(0)] * len(other.times)
        return other

    def carried(self, former: RateIndependentHysteresis, vector: Array) -> Array:
        """The vector of another resolution over the same range: every hat gets what the old density had under it."""
        if former.moved.shape == self.moved.shape:
            return vector
        density = RegularGridInterpolator((former.coercive, former.interaction), former._table(vector) / former._even)
        nodes = np.argwhere(self.moved)
        fields = np.column_stack((self.coercive[nodes[:, 0]], self.interaction[nodes[:, 1]]))
        weights = density(fields) * self._even[self.moved]
        return np.concatenate((vector[:WEIGHTS], weights, vector[former.shared :]))

    def link(self, vector: Array) -> Preisach:
        """The model of a vector."""
        return Preisach(
            layer_thickness=self.layer_thickness,
            susceptibility=max(float(vector[SUSCEPTIBILITY]), 0.0),
            plays=float(_PLAYS),
            initial=self.initial,
            coercive=tuple(float(field) for field in self.coercive),
            interaction=tuple(float(field) for field in self.interaction),
            weights=tuple(float(weight) for weight in self._table(vector).ravel()),
        )

    def polarization(self, vector: Array, voltages: Sequence[Array]) -> list[Array]:
        """P of each run whose voltage is given [C/m^2, each shape (n,)].

        Raises:
            BenchError: as Preisach.step.
        """
        link, found = self.link(vector), []
        for run in asked_of(voltages):
            _, out = link.step(self._begun(link, run, voltages[run]), Signals(self.times[run], voltages[run]))
            found.append(out.polarization)
        return found

    def tangent(self, vector: Array, voltages: Sequence[Array]) -> tuple[list[Array], list[Any]]:
        """P of each run whose voltage is given, and dP/dvector [each shape (n, p), float32].

        Raises:
            BenchError: as Preisach.step.
        """
        link = self.link(vector)
        jacobians = [self._columns_of(link, run, voltages[run]) for run in asked_of(voltages)]
        return self.polarization(vector, voltages), jacobians

    def _columns_of(self, link: Preisach, run: int, voltage: Array) -> NDArray[np.float32]:
        """dP/dvector of a run [shape (n, p)]: P is linear in what a fit finds, so that its steps ask for it again."""
        key = b"%d " % self.before[run].size + self.before[run].tobytes() + voltage.tobytes()
        return self._known_columns.get(key, lambda: self._columns_anew(link, run, voltage))

    def _columns_anew(self, link: Preisach, run: int, voltage: Array) -> NDArray[np.float32]:
        columns = np.empty((voltage.size, len(self.names)), dtype=np.float32)
        up = link.columns(self._begun(link, run, voltage), self.times[run], voltage)
        columns[:, WEIGHTS:] = up[:, self.moved.ravel()]
        columns[:, WEIGHTS:] *= 2.0
        columns[:, WEIGHTS:] -= 1.0
        columns[:, SUSCEPTIBILITY] = voltage / self.layer_thickness
        columns.setflags(write=False)
        return columns

    def _table(self, vector: Array) -> Array:
        """Polarization of every hat, those that never move included [C/m^2, shape (coercive, interaction)]."""
        weights = np.zeros(self.moved.shape)
        weights[self.moved] = np.maximum(vector[WEIGHTS : self.shared], 0.0)
        return weights

    def _begun(self, link: Preisach, run: int, voltage: Array) -> State:
        """What a run starts from; when it went through what was before is all the same."""
        way = np.append(self.before[run], voltage[0])
        time = np.full(way.size, float(self.times[run][0]))
        return link.step(link.init(Rest(time[0], float(way[0]))), Signals(time, way))[0]

    def regularisation(self) -> tuple[Array, Array]:
        """Rows [shape (m, p)] and targets [shape (m,)] of what is believed before the data, in units of the noise."""
        relative = 1.0 / self._even[self.moved]
        size = relative.size
        rows: list[Array] = [self.weight_strength * np.eye(size) * relative]
        rows.append(np.where(self._inside, self.sum_strength / self.total, 0.0)[None, :])  # others set no scale
        rows.append(self.smoothness_strength * self._differences(2, (0, 1)) * relative)
        if self.rotation_strength > 0.0:
            rows.append(self.rotation_strength * self._differences(1, (1,)) * relative)
        among = np.vstack(rows)
        targets = np.zeros(len(among))
        targets[size] = self.sum_strength / self.total * float(self._even[self.moved] @ self._inside)
        return np.hstack((np.zeros((len(among), WEIGHTS)), among)), targets

    def _differences(self, order: int, axes: Sequence[int]) -> Array:
        """Differences of an order along coercive (0) or interaction field (1) [shape (m, weights)]."""
        place = np.full(self.moved.shape, -1)
        place[self.moved] = np.arange(self.moved.sum())
        factors = (-1.0, 1.0) if order == 1 else (1.0, -2.0, 1.0)
        rows = []
        for axis in axes:
            along = place if axis == 1 else place.T
            for line in along:
                for first in range(line.size - order):
                    places = line[first : first + order + 1]
                    if np.all(places >= 0):
                        row = np.zeros(self.moved.sum())
                        row[places] = factors
                        rows.append(row)
        return np.array(rows)
