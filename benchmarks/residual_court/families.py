"""Families of truth: from the voltage at the ceramic to its polarization and to displacement without any effect.

`gaussian` is what the library can represent; every other family is wrong on purpose. A truth also knows its tangents,
so that an effect can be scaled by what is left of it after the base has adapted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from . import operators, relays

Array = NDArray[np.float64]

LAYER = 1e-4
"""Thickness of a layer [m]: 150 V is 1.5 MV/m."""

AREA = 2e-3
"""Electrodes of the actuator [m^2]."""

STROKE = 12e-6
"""Displacement from the largest to the smallest voltage of a run [m]."""

DOMAIN_POLARIZATION = 0.26
"""P_T [C/m^2]."""

_NUDGE = 0.01  # relative change of a parameter for its tangent
_LOWEST, _HIGHEST = -0.45, 1.55  # field that any drive of the court stays within [MV/m]


class Truth(Protocol):
    """One specimen.

    Attributes:
        name: of the family.
        parameters: true values by name.
    """

    name: str
    parameters: Mapping[str, float]

    def polarization(self, time: Array, voltage: Array, bias: Array | float, current: float) -> tuple[Array, Array]:
        """P [C/m^2], and the voltage that the ceramic got [V].

        Args:
            bias: field that adds to the applied one [V/m].
            current: limit of the amplifier [A], infinite for none.
        """

    def displacement(self, polarization: Array) -> Array:
        """Strain law times active length [m]."""

    def tangents(self, time: Array, voltage: Array) -> tuple[Array, Array]:
        """Change of displacement and of polarization for each parameter twice as large, both shape (n, k)."""


@dataclass(frozen=True)
class StrainLaw:
    """y = gain p^2 (1 + cubic (p/P_T) + quartic (p/P_T)^2)."""

    gain: float = 2e-4
    cubic: float = 0.0
    quartic: float = 0.0

    def of(self, p: Array) -> Array:
        """Displacement [m] of a polarization [C/m^2]."""
        u = p / DOMAIN_POLARIZATION
        return self.gain * p**2 * (1 + self.cubic * u + self.quartic * u**2)

    def slope(self, p: Array) -> Array:
        """dy/dp [m^3/C]."""
        u = p / DOMAIN_POLARIZATION
        return self.gain * p * (2 + 3 * self.cubic * u + 4 * self.quartic * u**2)


@dataclass(frozen=True)
class RelayTruth:
    """Thermally activated domains of any density, and a strain law.

    Parameters: those of the density [MV/m], `relaxation_time` [s], `thermal_width` [MV/m], `susceptibility`
    [C/m^2 per MV/m].
    """

    name: str
    density: str
    parameters: Mapping[str, float]
    law: StrainLaw

    def _grid(self, field: Array, variants: list[Mapping[str, float]], spacing: float) -> relays.Grid:
        low, high = min(_LOWEST, float(field.min())), max(_HIGHEST, float(field.max()))
        return relays.grid_for(self.density, variants, low, high, self.parameters["thermal_width"], spacing)

    def polarization(self, time: Array, voltage: Array, bias: Array | float, current: float) -> tuple[Array, Array]:
        """See Truth."""
        p, bias_field = self.parameters, 1e-6 * np.asarray(bias)
        wanted = 1e-6 * voltage / LAYER + bias_field
        grid = self._grid(wanted, [p], relays.SPACING)
        limit = (p["susceptibility"] / DOMAIN_POLARIZATION, current / (2 * AREA * DOMAIN_POLARIZATION))
        share, field = relays.respond(grid, time, wanted, p["thermal_width"], p["relaxation_time"], limit)
        reached = (field - bias_field) * 1e6 * LAYER if np.isfinite(current) else voltage
        return self._summed(share[0], field), reached

    def _summed(self, share: Array, field: Array) -> Array:
        return DOMAIN_POLARIZATION * (2 * share - 1) + self.parameters["susceptibility"] * field

    def displacement(self, polarization: Array) -> Array:
        """See Truth."""
        return self.law.of(polarization)

    def tangents(self, time: Array, voltage: Array) -> tuple[Array, Array]:
        """See Truth; gain, cubic law, P shifted for good, and every parameter of the density and the kinetics."""
        field, p = 1e-6 * voltage / LAYER, self.parameters
        shape = [name for name in p if name not in ("relaxation_time", "thermal_width", "susceptibility")]
        grid = self._grid(field, [p, *(self._nudged(name) for name in shape)], relays.COARSE_SPACING)
        width, time_constant = p["thermal_width"], p["relaxation_time"]
        share, _ = relays.respond(grid, time, field, width, time_constant)
        base = self._summed(share[0], field)
        single = replace(grid, weights=grid.weights[:1], fixed=grid.fixed[:1])
        wider, _ = relays.respond(single, time, field, (1 + _NUDGE) * width, time_constant)
        slower, _ = relays.respond(single, time, field, width, (1 + _NUDGE) * time_constant)
        unit = 2 * DOMAIN_POLARIZATION / _NUDGE
        changes = [unit * (each - share[0]) for each in (*share[1:], wider[0], slower[0])]
        frozen = np.full_like(field, DOMAIN_POLARIZATION)
        dp = np.column_stack([*changes, p["susceptibility"] * field, frozen, 0.5 * base])
        dy = self.law.slope(base)[:, None] * dp
        if self.law.cubic or self.law.quartic:
            u = base / DOMAIN_POLARIZATION
            dy = np.column_stack([dy, self.law.of(base) * u, self.law.of(base) * u**2])
            dp = np.column_stack([dp, np.zeros((base.size, 2))])
        return dy, dp

    def _nudged(self, name: str) -> dict[str, float]:
        step = _NUDGE * (self.parameters[name] or 1.0)
        return {**self.parameters, name: self.parameters[name] + step}


@dataclass(frozen=True)
class OperatorTruth:
    """An operator on the voltage; its output in units of the stroke is displacement, and P by a straight line.

    Parameters: those of the operator, and `curvature` of y over its output.
    """

    name: str
    parameters: Mapping[str, float]
    gain: float = STROKE

    def _output(self, voltage: Array) -> Array:
        p, u = self.parameters, voltage / 150.0
        if self.name == "play_sum":
            radii = 0.8 * (np.arange(30) + 0.5) / 30
            weights = np.exp(-radii / p["memory"])
            return p["loop"] * operators.play_sum(u, radii, weights / weights.sum()) + (1 - p["loop"]) * u
        if self.name == "bouc_wen":
            return u + p["loop"] * operators.bouc_wen(u, 1.0, p["beta"], p["gamma"]) * p["beta"]
        if self.name == "maxwell_slip":
            slips = sum(operators.dahl(u, k, k * r) for k, r in ((0.5, p["slip"]), (0.3, 3 * p["slip"])))
            return u + p["loop"] * np.asarray(slips) + 0.1 * u * np.asarray(slips)
        return (1 - p["loop"]) * u + p["loop"] * operators.wedge_preisach(u, p["low"], p["high"])

    def polarization(self, time: Array, voltage: Array, bias: Array | float, current: float) -> tuple[Array, Array]:
        """See Truth; a bias shifts the voltage, a current limit the rate of the output."""
        reached = voltage
        if np.isfinite(current):
            reached = _limited(voltage, self._output(voltage), time, current / (AREA * DOMAIN_POLARIZATION))
        return DOMAIN_POLARIZATION * self._output(reached + LAYER * np.asarray(bias)), reached

    def displacement(self, polarization: Array) -> Array:
        """See Truth."""
        h = polarization / DOMAIN_POLARIZATION
        return self.gain * (h + self.parameters["curvature"] * h**2)

    def tangents(self, time: Array, voltage: Array) -> tuple[Array, Array]:
        """See Truth."""
        base = DOMAIN_POLARIZATION * self._output(voltage)
        changes, bent = [base], [self.gain * (base / DOMAIN_POLARIZATION) ** 2]
        for name, value in self.parameters.items():
            if name != "curvature":
                nudged = replace(self, parameters={**self.parameters, name: value + _NUDGE * (value or 1.0)})
                changes.append((DOMAIN_POLARIZATION * nudged._output(voltage) - base) / _NUDGE)
        step = 1e-5
        slope = (self.displacement(base + step) - self.displacement(base - step)) / (2 * step)
        dp = np.column_stack([*changes, *(np.zeros_like(each) for each in bent)])
        dy = np.column_stack([slope[:, None] * np.column_stack(changes), *bent])
        return dy, dp


def _limited(voltage: Array, output: Array, time: Array, fastest: float) -> Array:
    """Voltage slowed down so that C(V) dV/dt keeps the current limit; C from upward and downward branches."""
    change, rise = np.diff(output), np.diff(voltage)
    moving = np.abs(rise) > 1e-6
    reached = voltage.copy()
    upper, lower = (_capacity(voltage[1:], change, rise, moving & (sign * rise > 0)) for sign in (1, -1))
    for k in range(1, voltage.size):
        wish = voltage[k] - reached[k - 1]
        place = min(max(int((reached[k - 1] + 50.0) / 5.0), 0), 41)
        most = fastest * (time[k] - time[k - 1]) / (upper if wish > 0 else lower)[place]
        reached[k] = reached[k - 1] + min(max(wish, -most), most)
    return reached


def _capacity(voltage: Array, change: Array, rise: Array, chosen: NDArray[np.bool_]) -> Array:
    """Mean d(output)/dV in classes of 5 V from -50 V on; where there is nothing, the mean of all."""
    place = np.clip(((voltage[chosen] + 50.0) / 5.0).astype(int), 0, 41)
    way = np.bincount(place, rise[chosen], 42)
    gone = np.bincount(place, change[chosen], 42)
    mean = gone.sum() / way.sum() if way.sum() else 1.0
    return np.where(np.abs(way) > 5.0, gone / np.where(way == 0, 1.0, way), mean)
