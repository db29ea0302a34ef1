"""A polycrystal whose density was identified from measured runs instead of assumed, as a link of the chain."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics import identified_lattice_kernel as kernel
from pzt_ros.physics.identified_hats import (
    Hats,
    hat_sums,
    hats_of,
    node_count,
    nodes_of,
    relay_thresholds,
    spread_out,
)
from pzt_ros.physics.identified_lattice_tables import CLOSEST, WIDEST, Relays, attempts_table
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array, Rest
from pzt_ros.physics.switching import QUASI_STATIC_RATE, Switching
from pzt_ros.quantities import choice, parameter, table

FIELD_STEP = 0.5
"""Longest substep over d [-]: 1e-4 of x+ at any rate."""

_shared_table = lru_cache(maxsize=8)(attempts_table)

_DEFAULT_GRID = tuple(float(field) for field in np.linspace(-2e6, 2e6, 9))
_DEFAULT_WEIGHTS = tuple(
    0.04 * math.exp(-0.5 * ((up - down - 2) / 2) ** 2 - 0.5 * ((up + down - 8) / 2) ** 2) for up, down in nodes_of(9)
)


@dataclass(frozen=True, kw_only=True)
class IdentifiedLattice(Switching):
    """Voltage to polarization of relays with thermal kinetics on a fine lattice, weighted by coarse hat functions.

    The lattice is fine because thermal activation smooths over d only, the hats are coarse because a measurement tells
    no more about the density (diagnosis-methods.md 1, b3). Relays beyond the grid stay as they are: they
    are the frozen `polarization_offset`.

    State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], then x+ of every relay [-].
    """

    kind: ClassVar[str] = "identified_lattice"
    _kernel: ClassVar[Any] = kernel

    relaxation_time: float = parameter(
        1e-3, "s", "of thermally activated switching", symbol="tau_x", bounds=(1e-9, 1e6)
    )
    thermal_field: float = parameter(7e4, "V/m", "width of thermal activation", symbol="d", bounds=(1.0, 1e8))
    susceptibility: float = parameter(1.7e-8, "C/(V*m)", "of what does not switch", symbol="1/E_1", bounds=(0.0, 1e-4))
    polarization_offset: float = parameter(0.0, "C/m^2", "of domains that never switch", bounds=(-10.0, 10.0))
    fine_lines: float = parameter(
        90.0, "1", "lines of thresholds over the grid; closer than 0.35 thermal_field", bounds=(4.0, 2000.0)
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
        spacing = (self.lines[1] - self.lines[0]) / self.thermal_field
        if not CLOSEST <= spacing <= WIDEST:
            raise BenchError(
                f"{self.kind}: fine_lines are {spacing:.2g} thermal_field apart, outside {CLOSEST:g} to {WIDEST:g};"
                " look at the units of grid and thermal_field"
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
    def relays(self) -> Relays:
        """What the compiled loops need."""
        weight = np.empty(self.lines.size**2 // 4)
        spread_out(np.asarray(self.weights) / hat_sums(self.hats), self.hats, weight)
        lines = self.lines / self.thermal_field
        return Relays(
            lines=lines,
            weight=weight,
            width=self.thermal_field,
            attempt_rate=1.0 / self.relaxation_time,
            susceptibility=self.susceptibility,
            offset=self.polarization_offset,
            layer_thickness=self.layer_thickness,
            field_step=FIELD_STEP,
            attempts=_shared_table(float(lines[1] - lines[0])),
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

    @property
    def _state_size(self) -> int:
        return kernel.HEAD + self.lines.size**2 // 4

    @property
    def _numbers(self) -> Any:
        return self.relays
