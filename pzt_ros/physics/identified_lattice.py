"""A polycrystal whose density was identified from measured runs instead of assumed, as a link of the chain."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics import identified_lattice_kernel as kernel
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.identified_hats import (
    Hats,
    hat_sums,
    hats_of,
    node_count,
    nodes_of,
    relay_thresholds,
    spread_out,
)
from pzt_ros.physics.link import State
from pzt_ros.physics.polycrystal import FIELD_LIMIT, INVERSE_TOLERANCE, QUASI_STATIC_RATE
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import choice, parameter, table

FIELD_STEP = 0.5
"""Longest substep over d [-]: 1e-4 of x+ at any rate."""

_shared_table = lru_cache(maxsize=1)(kernel.attempts_table)

_DEFAULT_GRID = tuple(float(field) for field in np.linspace(-2e6, 2e6, 9))
_DEFAULT_WEIGHTS = tuple(
    0.04 * math.exp(-0.5 * ((up - down - 2) / 2) ** 2 - 0.5 * ((up + down - 8) / 2) ** 2) for up, down in nodes_of(9)
)


@dataclass(frozen=True, kw_only=True)
class IdentifiedLattice(Ferroelectric):
    """Voltage to polarization of relays with thermal kinetics on a fine lattice, weighted by coarse hat functions.

    The lattice is fine because thermal activation smooths over d only, the hats are coarse because a measurement tells
    no more about the density (diagnosis-methods.md 1, b3). Relays beyond the grid stay as they are: they
    are the frozen `polarization_offset`.

    State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], then x+ of every relay [-].
    """

    kind: ClassVar[str] = "identified_lattice"

    relaxation_time: float = parameter(
        1e-3, "s", "of thermally activated switching", symbol="tau_x", bounds=(1e-9, 1e6)
    )
    thermal_field: float = parameter(7e4, "V/m", "width of thermal activation", symbol="d", bounds=(1.0, 1e8))
    susceptibility: float = parameter(1.7e-8, "C/(V*m)", "of what does not switch", symbol="1/E_1", bounds=(0.0, 1e-4))
    polarization_offset: float = parameter(0.0, "C/m^2", "of domains that never switch", bounds=(-10.0, 10.0))
    fine_lines: float = parameter(
        90.0, "1", "lines of thresholds over the grid; closer than 0.55 thermal_field", bounds=(4.0, 2000.0)
    )
    settling_time: float = parameter(
        1e-3, "s", "that the voltage had rested where a run begins with a given occupancy", bounds=(1e-12, 1e9)
    )
    initial: str = choice("virgin", ("virgin", "down", "up"), "at 0 V, where no occupancy is given")
    grid: tuple[float, ...] = table(_DEFAULT_GRID, "V/m", "coarse lines of thresholds, ascending", bounds=(-1e9, 1e9))
    weights: tuple[float, ...] = table(
        _DEFAULT_WEIGHTS,
        "C/m^2",
        "polarization of the hat at each pair of coarse lines: up at line 0, 1, ... and down at 0, ... up to that line",
        bounds=(0.0, 100.0),
    )

    def __post_init__(self) -> None:
        lines = np.asarray(self.grid)
        if lines.size < 2 or not np.all(np.diff(lines) > 0.0):
            raise BenchError(
                f"{self.kind}: grid of {lines.size} fields that do not all increase; give two or more, sorted"
            )
        if len(self.weights) != node_count(lines.size):
            raise BenchError(
                f"{self.kind}: {len(self.weights)} weights for {lines.size} lines of the grid,"
                f" which have {node_count(lines.size)} pairs; give one weight each"
            )

    @cached_property
    def lines(self) -> Array:
        """Thresholds of the fine lattice [V/m]."""
        count, span = int(self.fine_lines), self.grid[-1] - self.grid[0]
        lines: Array = self.grid[0] + (np.arange(count) + 0.5) * span / count
        return lines

    @cached_property
    def hats(self) -> Hats:
        """The coarse grid as the fine lattice sees it."""
        return hats_of(self.lines, np.asarray(self.grid))

    @cached_property
    def relays(self) -> kernel.Relays:
        """What the compiled loops need."""
        weight = np.empty(self.lines.size**2 // 4)
        spread_out(np.asarray(self.weights) / hat_sums(self.hats), self.hats, weight)
        return kernel.Relays(
            lines=self.lines / self.thermal_field,
            weight=weight,
            width=self.thermal_field,
            attempt_rate=1.0 / self.relaxation_time,
            susceptibility=self.susceptibility,
            offset=self.polarization_offset,
            layer_thickness=self.layer_thickness,
            field_step=FIELD_STEP,
            attempts=_shared_table(),
        )

    def init(self, rest: Rest) -> State:
        """With `rest.occupancy` that, after `settling_time`; otherwise `initial` at 0 V, brought slowly to the rest.

        The occupancy is x+ at the pairs of equally spaced lines over the grid's range, in the order of `weights`. The
        settling draws its edge at the first field, which is sharper than a grid can be.

        Raises:
            BenchError: an occupancy whose size is that of no grid.
        """
        span = self.grid[-1] - self.grid[0]
        slope = (self.susceptibility + 2.0 * sum(self.weights) / span) / self.layer_thickness
        if rest.occupancy.size:
            state = np.concatenate(([rest.time, rest.voltage, slope], self._occupied(rest.occupancy)))
            self._settle(state, np.empty(0))
            return state
        up, down = relay_thresholds(self.lines)
        share_above = np.clip(0.5 - 0.5 * (up + down) / (self.lines[1] - self.lines[0]), 0.0, 1.0)
        start = {"virgin": share_above, "down": np.zeros(up.size), "up": np.ones(up.size)}
        duration = abs(rest.voltage) / self.layer_thickness / QUASI_STATIC_RATE
        state = np.concatenate(([rest.time - duration, 0.0, slope], start[self.initial]))
        self._run(state, np.array([rest.time]), np.array([rest.voltage]))
        return state

    def left_of_start(self, rest: Rest) -> Array:
        """How much of a given occupancy is left at the first sample, for every relay [-]."""
        left = np.ones(self.lines.size**2 // 4)
        self._settle(np.concatenate(([rest.time, rest.voltage, 1.0], np.zeros(left.size))), left)
        return left

    def _settle(self, state: State, left: Array) -> None:
        """Rest at the voltage of the state for the settling time, in place."""
        kernel.settle(state, left, self.relays, self.settling_time)

    def _occupied(self, occupancy: Array) -> Array:
        size = round((math.sqrt(8.0 * occupancy.size + 1.0) - 1.0) / 2.0)
        if size < 2 or node_count(size) != occupancy.size:
            raise BenchError(
                f"{self.kind}: an occupancy of {occupancy.size} numbers fits no grid; one of n lines has n(n+1)/2"
            )
        x = np.empty(self.lines.size**2 // 4)
        spread_out(occupancy, hats_of(self.lines, np.linspace(self.grid[0], self.grid[-1], size)), x)
        return x

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage [V] to polarization [C/m^2] and phase fraction [-].

        Raises:
            BenchError: no voltage, a sample that is not finite, time that runs back, a foreign state.
        """
        self._check_size("voltage", signals.voltage, signals.time)
        after = self._own(state)
        polarization, phase_fraction = self._run(after, signals.time, signals.voltage)
        return after, signals.replace(polarization=polarization, phase_fraction=phase_fraction)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization wanted [C/m^2] to the voltage [V] for which `step` gives it, within +-10 MV/m.

        A sample that asks for no finite polarization keeps the last voltage.

        Raises:
            BenchError: no polarization, time that runs back, a foreign state.
        """
        self._check_size("polarization", signals.polarization, signals.time)
        after = self._own(state)
        voltage, phase_fraction = np.empty(signals.time.size), np.empty(signals.time.size)
        limit = FIELD_LIMIT * self.layer_thickness
        bad = kernel.run_inverse(
            after, self.relays, signals.time, signals.polarization, voltage, phase_fraction, limit, INVERSE_TOLERANCE
        )
        if bad >= 0:
            raise BenchError(
                f"{self.kind}: time {signals.time[bad]:.9g} s at sample {bad} is not after the one before; sort it"
            )
        return after, signals.replace(voltage=voltage, phase_fraction=phase_fraction)

    def _check_size(self, name: str, values: Array, time: Array) -> None:
        """The compiled loops do not look where they read."""
        if values.size != time.size:
            raise BenchError(
                f"{self.kind}: the block has {values.size} values of {name} for {time.size} times;"
                f" put a link or a record that gives {name} before this one"
            )

    def _own(self, state: State) -> State:
        """A copy of a state that fits this link."""
        size = kernel.HEAD + self.lines.size**2 // 4
        if state.size != size:
            raise BenchError(
                f"{self.kind}: the state has {state.size} numbers, this model has {size}; start from init()"
            )
        return state.copy()

    def _run(self, state: State, time: Array, voltage: Array) -> tuple[Array, Array]:
        polarization, phase_fraction = np.empty(time.size), np.empty(time.size)
        bad = kernel.run(state, self.relays, time, voltage, polarization, phase_fraction)
        if bad >= 0:
            raise BenchError(
                f"{self.kind}: sample {bad} ({time[bad]:.9g} s, {voltage[bad]:.6g} V) is not finite, beyond"
                " 1 GV/m, or not after the one before; drop or sort it"
            )
        return polarization, phase_fraction
