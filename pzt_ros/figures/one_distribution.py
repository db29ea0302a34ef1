"""The parametrized model with one distribution: coercive fields only (3.23), or interaction fields only (3.31).

`physics.parametrized` is the combined model (3.34, 3.35), in which the barrier goes on at a reversal where it was. With
one distribution it jumps there: to 0 with coercive fields only, by twice the coercive field with interaction fields
only. So neither is a special case of it, and both are integrated here, for the figures.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import integrate, special

from pzt_ros.figures.loads import Load
from pzt_ros.physics.density import Gaussian
from pzt_ros.physics.signals import Array
from pzt_ros.physics.single_crystal import SingleCrystal

Slope = Callable[[float, float], float]
"""dx/dt [1/s] from the field [V/m] and x+ [-]."""

_integrate: Any = integrate  # SciPy carries no types

_TOLERANCE = 1e-7
_LONGEST_STEP = 1e5  # [V/m]; no front is jumped over
_EDGE = 1e-14  # keeps the inverse error function finite at saturation


def interaction_only(load: Load, crystal: SingleCrystal, density: Gaussian, fraction: float) -> Array:
    """x+ [-] with interaction fields only: barriers E_c - E_e(x) upwards and -E_c - E_e(x) downwards (3.31).

    No reversal point matters: barriers are functions of x alone.
    """

    def slope(field: float, x: float) -> float:
        interaction = _above(density, x)
        return _rate(crystal, field + interaction) * (1 - x) - _rate(crystal, -field - interaction) * x

    return _follow(load, lambda up, start: slope, fraction)


def without_history(load: Load, crystal: SingleCrystal, density: Gaussian, fraction: float) -> Array:
    """x+ [-] of the model of chapter 4: coercive fields only, E_c(x) upwards and E_c(1 - x) downwards, no memory."""

    def slope(field: float, x: float) -> float:
        up, down = _coercive(density, x), _coercive(density, 1 - x)
        return _rate(crystal, field, up) * (1 - x) - _rate(crystal, -field, down) * x

    return _follow(load, lambda up, start: slope, fraction)


def coercive_only(load: Load, crystal: SingleCrystal, density: Gaussian, fraction: float) -> Array:
    """x+ [-] with coercive fields only and the history of reversals (3.23).

    Behind a reversal the barrier starts from 0. In the single crystal's ODE, which has one barrier for both ways, it
    would let domains fall back over the reversal point until the field has passed 0, and x would stick there in
    ever smaller turns; so domains switch here in the direction of the field only.
    """
    lower, upper = [0.0], [1.0]
    went_up = None

    def branch(up: bool, start: float) -> Slope:
        nonlocal went_up
        _close(lower, upper, start)
        if up is not went_up:
            (lower if up else upper).append(start)
        went_up = up
        if up:
            pairs = list(zip(reversed(lower), reversed(upper), strict=False))
            return lambda field, x: _rate(crystal, field, _coercive(density, x - _base(pairs, x, 1.0))) * (1 - x)
        pairs = list(zip(reversed(upper), reversed(lower), strict=False))
        return lambda field, x: -_rate(crystal, -field, _coercive(density, _base(pairs, x, -1.0) - x)) * x

    return _follow(load, branch, fraction)


def _close(lower: list[float], upper: list[float], x: float) -> None:
    """Forget the reversal points of loops that were closed on the way to x."""
    while len(lower) > 1 and len(upper) > 1 and not lower[-1] < x < upper[-1]:
        lower.pop()
        upper.pop()


def _base(pairs: list[tuple[float, float]], x: float, sign: float) -> float:
    """The reversal point from which the branch at x comes: that of the innermost loop that x has not closed."""
    return next((base for base, end in pairs if sign * x < sign * end), pairs[-1][0])


def _coercive(density: Gaussian, share: float) -> float:
    """The coercive field below which lies a share of the domains [V/m]."""
    below = 1.0 - density.mass
    return density.centre + density.sigma * float(special.ndtri(below + min(max(share, 0.0), 1.0) * density.mass))


def _above(density: Gaussian, share: float) -> float:
    """The interaction field above which lies a share of the domains [V/m]."""
    return -density.sigma * float(special.ndtri(min(max(share, _EDGE), 1.0 - _EDGE)))


def _rate(crystal: SingleCrystal, field: float, barrier: float | None = None) -> float:
    """How often a domain switches along a field over a barrier, by default the crystal's [1/s] (3.10)."""
    z = (field - (crystal.coercive_field if barrier is None else barrier)) / crystal.thermal_width
    return 0.0 if z < -26.0 else float(crystal.rate_factor / special.erfcx(z))


def _follow(load: Load, branch: Callable[[bool, float], Slope], fraction: float) -> Array:
    """Integrate leg by leg; `branch` gives the slope of a leg from its direction and the x it starts from."""
    x = np.empty_like(load.field)
    x[0] = fraction
    for part in load.legs:
        x[part] = _leg(load.time[part], 1e6 * load.field[part], branch, float(x[part.start]))
    return x


def _leg(time: Array, field: Array, branch: Callable[[bool, float], Slope], start: float) -> Array:
    per_second = (field[-1] - field[0]) / (time[-1] - time[0])
    slope = branch(per_second > 0, start)

    def derivative(t: float, x: Array) -> list[float]:
        return [slope(field[0] + per_second * (t - time[0]), float(x[0]))]

    found = _integrate.solve_ivp(
        derivative,
        (time[0], time[-1]),
        [start],
        "Radau",
        time,
        rtol=_TOLERANCE,
        atol=_TOLERANCE,
        max_step=_LONGEST_STEP / abs(per_second),
    )
    return np.clip(found.y[0], 0.0, 1.0)


def polarization(load: Load, crystal: SingleCrystal, x: Array) -> Array:
    """P = E/E_1 + (2x - 1) P_T [C/m^2] (3.20)."""
    return 1e6 * load.field / crystal.reciprocal_permittivity + (2 * x - 1) * crystal.domain_polarization
