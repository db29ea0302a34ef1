"""The identified lattice over several runs at once, with its tangent: the flexible base hysteresis of a fit.

Polarization is linear in the weights of the hats and in the occupancy at the start of a run, and both kinds of columns
come out of one pass (diagnosis-methods.md 1 b3, 4); relaxation time and thermal field are differences of a pass each.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.parallel import side_by_side
from pzt_ros.physics import identified_lattice_kernel as kernel
from pzt_ros.physics.identified_hats import gathered, hat_sums, hats_of, node_count, nodes_of
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import ABSENT, Array, Rest
from pzt_ros.sysid.thinning import telling_samples

LOG_TIME, LOG_WIDTH, LOG_SETTLING, SUSCEPTIBILITY, WEIGHTS = 0, 1, 2, 3, 4
"""Coordinates: ln tau, ln d, ln of the settling time, then as named; the occupancies follow the weights."""

MARGIN = 0.15  # of the driven range: thermal activation switches thresholds beyond it
_KINETICS = ("relaxation_time", "thermal_field", "settling_time")
_SCALARS = (*_KINETICS, "susceptibility")
_LEAST_SETTLING, _MOST_SETTLING = 0.01, 1e4  # of the sampling time, of the longest run
_FINE_ENOUGH = 0.35  # distance of the fine lines over d: at 0.55 runs that were not fitted are off by up to the noise
_COARSEST = 0.8  # distance of the fine lines over d: beyond, the staircase shows (5e-4 at 1)
STEEPEST = 300.0  # slope of what does not switch, over that of all domains: without a bound it ran to 1e42
_LEAST_TIME = 1.01e-9  # [s]; the link's own bound
_DIFFERENCE = 1e-4  # of a logarithm
_STEP = 0.5  # of the thermal field, between two samples at which a change of kinetics is looked at
_FINE = 160


class IdentifiedHysteresis:
    """Voltage at the ceramic to polarization for several runs at once, with its tangent.

    A law behind it should be one of the centred polarization while it is fitted, see identified_problem.

    Attributes:
        names: of the coordinates.
        driven_lines: lines of the fine lattice over what is driven and its margins.
        start: first guess; may be replaced.
        lower, upper: bounds in the fit's coordinates.
        weight_strength: ridge: a weight of its share of an even density counts as this much of the noise's rms.
        sum_strength: of the sum of weights that are switched both ways, which a scale behind it could stand for: held
            together with those that stay as they are, it let the former shrink, and every prior on them with it.
        smoothness_strength: of second differences of the density, over that of an even one.
        rotation_strength: of differences of the density along constant coercive field; 0: none.
        occupancy_strength: of the distance from 1/2 of an unknown occupancy.
        kinetics_strength: of the three logarithms about `start`: holds them where the runs do not tell.
        believed: weights over those of an even density from which ridge, smoothness and rotation count what differs
            [-, shape (nodes,)]; none of them unless `believe` was asked to.
    """

    def __init__(
        self,
        times: Sequence[Array],
        layer_thickness: float,
        field_range: tuple[float, float],
        *,
        unknown_start: Sequence[bool],
        resolution: int = 10,
        occupancy_resolution: int = 12,
        initial: str = "virgin",
        total: float = 0.26,
        fine_lines: int = 120,
        workers: int = 2,
    ) -> None:
        """
        Args:
            times: sample times of each run [s].
            layer_thickness: [m].
            field_range: lowest and highest field that any run reaches [V/m].
            unknown_start: of each run; otherwise it starts as `initial` says.
            resolution: coarse cells over the range; the density has about half their square of weights.
            occupancy_resolution: the same for an unknown start.
            initial: see IdentifiedLattice.
            total: sum of weights [C/m^2].
            fine_lines: lines of the fine lattice over what is driven and its margins; a grid that reaches farther has
                as many more. Bounds the thermal field from below.
            workers: threads.

        Raises:
            BenchError: an empty range of field, a run without samples.
        """
        low, high = field_range
        span = span_of(field_range, "identified lattice")
        if len(times) != len(unknown_start) or any(time.size < 2 for time in times):
            raise BenchError("identified lattice: every run needs two samples and a word on its start")
        self.times, self.layer_thickness, self.total = list(times), layer_thickness, total
        self.unknown_start, self.initial, self.driven_lines = list(unknown_start), initial, fine_lines
        self.grid = np.concatenate(
            ([low - MARGIN * span], np.linspace(low, high, resolution + 1), [high + MARGIN * span])
        )
        if initial == "virgin" and not all(unknown_start):
            self.grid = _symmetric(self.grid)
        self.occupancy_size = occupancy_resolution + 1
        self.workers = workers
        self.weight_strength, self.smoothness_strength, self.rotation_strength = 0.1, 3.0, 0.0
        self.sum_strength, self.occupancy_strength, self.kinetics_strength = 1e3, 1.0, 0.1
        fine = self.grid[0] + (np.arange(_FINE) + 0.5) / _FINE * (self.grid[-1] - self.grid[0])
        sums = hat_sums(hats_of(fine, self.grid))
        self._even = total * sums / sums.sum()
        self.believed: Array = np.zeros(self._even.size)
        self._describe(low, high)

    def believe(self, shares: Array) -> None:
        """Begin with a density, and stay with it where the runs do not tell.

        Args:
            shares: of its hats, in any unit [shape (nodes,)].

        Raises:
            BenchError: none of it is switched both ways in the range of field.
        """
        inside = self._inside
        switched = float(inside @ shares)
        if not switched > 0.0:
            low, high = self.field_range
            raise BenchError(f"identified lattice: nothing of the density switches in {low:.6g} to {high:.6g} V/m")
        scale = float(inside @ self._even) / switched
        self.believed = scale * shares / self._even
        self.start[WEIGHTS : self.shared] = scale * shares

    def _describe(self, low: float, high: float) -> None:
        self.field_range, span = (low, high), high - low
        nodes, starts = nodes_of(self.grid.size), node_count(self.occupancy_size)
        unknown = [run for run, is_unknown in enumerate(self.unknown_start) if is_unknown]
        self.names = [f"identified_lattice.{name}" for name in _SCALARS]
        self.names += [f"weight {up} {down}" for up, down in nodes]
        self.names += [f"run {run} occupancy {node}" for run in unknown for node in range(starts)]
        step = float(np.median(np.concatenate([np.diff(time) for time in self.times])))
        longest = max(float(time[-1] - time[0]) for time in self.times)
        finest = self._driven / (self.driven_lines * _COARSEST)
        count, free = len(self.names), starts * len(unknown)
        self.lower, self.upper = np.zeros(count), np.full(count, np.inf)
        self.lower[LOG_TIME], self.upper[LOG_TIME] = math.log(max(1e-7 * step, _LEAST_TIME)), math.log(100.0 * longest)
        self.lower[LOG_WIDTH], self.upper[LOG_WIDTH] = math.log(finest), math.log(0.25 * span)
        self.lower[LOG_SETTLING], self.upper[LOG_SETTLING] = (
            math.log(_LEAST_SETTLING * step),
            math.log(_MOST_SETTLING * longest),
        )
        settling = math.log(10.0 * step)
        self.upper[SUSCEPTIBILITY] = STEEPEST * self.total / span
        if not any(self.unknown_start):
            self.lower[LOG_SETTLING] = self.upper[LOG_SETTLING] = settling
        self.upper[count - free :] = 1.0
        even_slope = 0.2 * self.total / span
        self.start = np.concatenate(
            ([math.log(step), math.log(0.03 * span), settling, even_slope], self._even, np.full(free, 0.5))
        )
        self.start = np.clip(self.start, self.lower, self.upper)

    @property
    def fine_lines(self) -> int:
        """Lines of the fine lattice over the whole grid."""
        return round(self.driven_lines * (self.grid[-1] - self.grid[0]) / self._driven)

    @property
    def _inside(self) -> Array:
        """1 for every hat that is switched both ways, 0 for the others [shape (nodes,)]."""
        low, high = self.field_range
        within = (self.grid >= low) & (self.grid <= high)
        return np.array([float(within[up] and within[down]) for up, down in nodes_of(self.grid.size)])

    @property
    def _driven(self) -> float:
        """What is driven, with its margins [V/m]."""
        return (1.0 + 2.0 * MARGIN) * (self.field_range[1] - self.field_range[0])

    def for_runs(self, times: Sequence[Array], unknown_start: Sequence[bool]) -> IdentifiedHysteresis:
        """The same lattice, coordinates, bounds and strengths for other runs."""
        other = copy.copy(self)
        other.times, other.unknown_start = list(times), list(unknown_start)
        other._describe(*self.field_range)
        shared = self.shared
        for name in ("start", "lower", "upper"):
            getattr(other, name)[:shared] = getattr(self, name)[:shared]
        return other

    @property
    def shared(self) -> int:
        """How many coordinates belong to all runs."""
        return WEIGHTS + node_count(self.grid.size)

    def carried(self, former: IdentifiedHysteresis, vector: Array) -> Array:
        """The vector of another resolution over the same range and the same runs, or of a grid without some lines."""
        at = np.searchsorted(self.grid, former.grid).clip(max=self.grid.size - 1)
        if np.array_equal(self.grid[at], former.grid):
            own = {node: number for number, node in enumerate(nodes_of(self.grid.size))}
            weights = np.zeros(len(own))
            weights[[own[at[up], at[down]] for up, down in nodes_of(former.grid.size)]] = former.weights(vector)
        else:
            link = former.link(vector)
            weights = gathered(link.relays.weight, hats_of(link.lines, self.grid))
        return np.concatenate((vector[:WEIGHTS], weights, vector[former.shared :]))

    def link(self, vector: Array) -> IdentifiedLattice:
        """The lattice of a vector."""
        return IdentifiedLattice(
            layer_thickness=self.layer_thickness,
            relaxation_time=math.exp(vector[LOG_TIME]),
            thermal_field=math.exp(vector[LOG_WIDTH]),
            settling_time=math.exp(vector[LOG_SETTLING]),
            susceptibility=max(float(vector[SUSCEPTIBILITY]), 0.0),
            fine_lines=float(self.fine_lines),
            initial=self.initial,
            grid=tuple(float(field) for field in self.grid),
            weights=tuple(float(weight) for weight in self.weights(vector)),
        )

    def finest(self, vector: Array) -> float:
        """Lines of the fine lattice, over what is driven, that the thermal field of a vector asks for."""
        return float(self._driven / (_FINE_ENOUGH * math.exp(vector[LOG_WIDTH])))

    def weights(self, vector: Array) -> Array:
        """Polarization of each hat [C/m^2]."""
        return np.maximum(vector[WEIGHTS : self.shared], 0.0)

    def occupancy(self, vector: Array, run: int) -> Array:
        """x+ at the start of a run, for Rest [-]; absent where the start is known."""
        place = self._places(run)
        return np.clip(vector[place], 0.0, 1.0) if place.stop > place.start else ABSENT

    @property
    def polarized(self) -> slice:
        """Coordinates in units of polarization."""
        return slice(SUSCEPTIBILITY, self.shared)

    @property
    def occupancies(self) -> slice:
        """Where the occupancies of all runs stand in the vector."""
        return slice(self.shared, len(self.names))

    def _places(self, run: int) -> slice:
        """Where the occupancy of a run stands in the vector."""
        size = node_count(self.occupancy_size)
        begin = self.shared + size * sum(self.unknown_start[:run])
        return slice(begin, begin + size * int(self.unknown_start[run]))

    def polarization(self, vector: Array, voltages: Sequence[Array]) -> list[Array]:
        """P of each run [C/m^2, each shape (n,)].

        Raises:
            BenchError: as IdentifiedLattice.step.
        """
        link = self.link(vector)
        _ = link.relays  # cached here, not in every thread
        asked = asked_of(voltages)
        return self._together([partial(self._run, link, vector, run, self.times[run], voltages[run]) for run in asked])

    def tangent(self, vector: Array, voltages: Sequence[Array]) -> tuple[list[Array], list[Any]]:
        """P of each run, and dP/dvector [each shape (n, p), float32].

        Raises:
            BenchError: as IdentifiedLattice.step.
        """
        link, asked = self.link(vector), asked_of(voltages)
        changed = [
            dataclasses.replace(link, **{name: getattr(link, name) * math.exp(_DIFFERENCE)}) for name in _KINETICS
        ]
        for each in (link, *changed):
            _ = each.relays
        jacobians = [np.zeros((self.times[run].size, len(self.names)), dtype=np.float32) for run in asked]
        pairs = zip(asked, jacobians, strict=True)
        tasks = [partial(self._linearised, link, changed, vector, run, voltages[run], each) for run, each in pairs]
        return self._together(tasks), jacobians

    def _linearised(
        self,
        link: IdentifiedLattice,
        changed: Sequence[IdentifiedLattice],
        vector: Array,
        run: int,
        voltages: Array,
        jacobian: Any,
    ) -> Array:
        """Fill the columns of a run; returns P.

        Those of the kinetics, which bend, are taken on fewer samples; not so the others, along which weights that make
        up for one another go far: with all of them good to 3e-4 the steps of a fit no longer led down.
        """
        polarization, time = self._columns(link, vector, run, voltages, jacobian), self.times[run]
        kept = telling_samples(time, voltages, _STEP * link.thermal_field * self.layer_thickness, polarization)
        known = changed if self.unknown_start[run] else changed[:LOG_SETTLING]
        here, *moved = (self._run(each, vector, run, time[kept], voltages[kept]) for each in (link, *known))
        for column, there in enumerate(moved):
            jacobian[:, column] = np.interp(time, time[kept], (there - here) / _DIFFERENCE)
        return polarization

    def _together(self, tasks: Sequence[Callable[[], Array]]) -> list[Array]:
        return side_by_side(lambda task: task(), tasks, self.workers)

    def _rest(self, vector: Array, run: int, voltages: Array) -> Rest:
        """What a run starts from."""
        return Rest(float(self.times[run][0]), float(voltages[0]), occupancy=self.occupancy(vector, run))

    def _begun(self, link: IdentifiedLattice, vector: Array, run: int, voltages: Array) -> State:
        """The state that a run starts from."""
        return link.init(self._rest(vector, run, voltages))

    def _run(self, link: IdentifiedLattice, vector: Array, run: int, time: Array, voltages: Array) -> Array:
        state = self._begun(link, vector, run, voltages)
        polarization, phase_fraction = np.empty(voltages.size), np.empty(voltages.size)
        bad = kernel.run(state, link.relays, time, voltages, polarization, phase_fraction)
        _check(bad, run, time, voltages)
        return polarization

    def _columns(self, link: IdentifiedLattice, vector: Array, run: int, voltages: Array, jacobian: Any) -> Array:
        """Fill the columns that are linear; returns P."""
        hats, place = link.hats, self._places(run)
        starts = hats_of(link.lines, np.linspace(self.grid[0], self.grid[-1], self.occupancy_size))
        columns = jacobian[:, WEIGHTS : WEIGHTS + node_count(hats.size)]
        polarization = np.empty(voltages.size)
        left = link.left_of_start(self._rest(vector, run, voltages)) if self.unknown_start[run] else ABSENT
        bad = kernel.run_columns(
            self._begun(link, vector, run, voltages),
            left,
            link.relays,
            self.times[run],
            voltages,
            polarization,
            jacobian,
            hats,
            WEIGHTS,
            starts,
            place.start,
        )
        _check(bad, run, self.times[run], voltages)
        columns *= (2.0 / hat_sums(hats)).astype(np.float32)
        columns -= 1.0
        jacobian[:, place] *= 2.0
        jacobian[:, SUSCEPTIBILITY] = voltages / self.layer_thickness
        return polarization

    def regularisation(self) -> tuple[Array, Array]:
        """Rows [shape (m, p)] and targets [shape (m,)] of what is believed before the data, in units of the noise."""
        count, nodes = len(self.names), node_count(self.grid.size)
        blocks: list[tuple[Array, Array]] = []

        def add(strengths: Array, places: slice, target: Array) -> None:
            rows = np.zeros((strengths.shape[0], count))
            rows[:, places] = strengths
            blocks.append((rows, strengths @ target))

        weights = slice(WEIGHTS, WEIGHTS + nodes)
        relative, believed = np.diag(1.0 / self._even), self.believed * self._even
        kinetics = slice(LOG_TIME, LOG_SETTLING + 1)
        add(self.kinetics_strength * np.eye(3), kinetics, self.start[kinetics])
        add(self.weight_strength * relative, weights, believed)
        add(self.sum_strength / self.total * self._inside[None, :], weights, self._even)
        for strength, rows in (
            (self.smoothness_strength, _curvatures(self.grid.size)),
            (self.rotation_strength, _rotations(self.grid.size)),
        ):
            if strength > 0.0:
                add(strength * rows @ relative, weights, believed)
        free = count - WEIGHTS - nodes
        add(self.occupancy_strength * np.eye(free), slice(count - free, count), np.full(free, 0.5))
        return np.vstack([rows for rows, _ in blocks]), np.concatenate([target for _, target in blocks])


def _symmetric(grid: Array) -> Array:
    """The grid with a line more where it is not symmetric about 0: a virgin relay may switch once and never back."""
    reach = max(-grid[0], grid[-1])
    lower, upper = ([-reach] if -reach < grid[0] else []), ([reach] if reach > grid[-1] else [])
    return np.concatenate((lower, grid, upper))


def span_of(field_range: tuple[float, float], model: str) -> float:
    """How far a range of field reaches [V/m].

    Raises:
        BenchError: not at all; `model` is named.
    """
    low, high = field_range
    if not (math.isfinite(high - low) and high > low):
        raise BenchError(f"{model}: field range {low:.6g} to {high:.6g} V/m is empty; drive the runs")
    return high - low


def asked_of(voltages: Sequence[Array]) -> list[int]:
    """The runs whose voltage is given."""
    return [run for run, voltage in enumerate(voltages) if voltage.size]


def _rotations(size: int) -> Array:
    """Differences between nodes next to each other along constant coercive field [shape (m, nodes)]."""
    return _stencils(size, (((0, 0), -1.0), ((1, 1), 1.0)))


def _curvatures(size: int) -> Array:
    """Second differences along both thresholds [shape (m, nodes)]."""
    along_up = (((-1, 0), 1.0), ((0, 0), -2.0), ((1, 0), 1.0))
    along_down = (((0, -1), 1.0), ((0, 0), -2.0), ((0, 1), 1.0))
    return np.vstack([_stencils(size, along_up), _stencils(size, along_down)])


def _stencils(size: int, stencil: Sequence[tuple[tuple[int, int], float]]) -> Array:
    """A row with the factors of the stencil wherever all its nodes are on the grid."""
    place = {node: number for number, node in enumerate(nodes_of(size))}
    rows = []
    for up, down in place:
        nodes = [((up + right, down + above), factor) for (right, above), factor in stencil]
        if all(node in place for node, _ in nodes):
            row = np.zeros(len(place))
            for node, factor in nodes:
                row[place[node]] = factor
            rows.append(row)
    return np.array(rows)


def _check(bad: int, run: int, time: Array, voltages: Array) -> None:
    if bad >= 0:
        raise BenchError(
            f"identified lattice: run {run}, sample {bad} ({time[bad]:.9g} s, {voltages[bad]:.6g} V) is not finite,"
            " beyond 1 GV/m, or not after the one before; drop or sort it"
        )
