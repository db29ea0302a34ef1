"""Where the parametrized model with one distribution stands, compiled: barriers and rates over how much has switched.

The unknown is the position w of the barrier in its Gaussian, B = centre + sqrt(b) w. The share of domains that have
switched since the branch began is (erfc(-w) - below)/mass, which is (3.22) and (3.29) in one, so both tails are exact
and no inverse erfc is needed but where a branch begins.

With coercive fields only, the memory is a stack of x+ alone: the barrier of a branch starts from 0 (3.23).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from pzt_ros.physics.kinetics import erfcx_positive, switching_rate
from pzt_ros.physics.signals import Array

compiled = njit(cache=True, error_model="numpy", nogil=True)
"""Division by zero gives inf or NaN. No fast math: step and inverse agree to the bit."""

COERCIVE: Final = 0
COERCIVE_WITHOUT_HISTORY: Final = 1
INTERACTION: Final = 2


class Material(NamedTuple):
    """The numbers of the model in SI."""

    distribution: int
    centre: float  # of the barriers [V/m]
    slope: float  # sqrt(b) [V/m]
    below: float  # erfc(-w) of barrier 0, below which no coercive field lies; 0 for interaction fields
    lowest: float  # w there
    thermal_width: float
    relaxation_time: float
    domain_polarization: float
    reciprocal_permittivity: float
    layer_thickness: float
    accuracy: float


# The state is one flat array: these numbers, then the stack of x+ where the branches began.
TIME: Final = 0  # of the last sample [s]
FIELD: Final = 1  # there [V/m]
X: Final = 2  # phase fraction x+
W: Final = 3  # barrier
F: Final = 4  # rate at which domains switch in the direction of the branch [1/s]
STEP: Final = 5  # internal step to try next [s]
STEEPNESS: Final = 6  # dP/dE that the inverse found last [F/m]
COUNT: Final = 7  # points on the stack
CHANGES: Final = 8  # of the stack, ever
DIRECTION: Final = 9  # of the branch: +1 up, -1 down
BASE: Final = 10  # x+ where it began
TAKEN: Final = 11  # share of domains that pointed its way already then
W_END: Final = 12  # where it closes its loop
STACK: Final = 13

DEPTH: Final = 512
"""Points that fit: 256 nested loops; beyond, the innermost loop is forgotten."""
SIZE: Final = STACK + DEPTH

HARDEST: Final = 6.0
"""Largest w: 1e-17 of the domains have higher barriers, too few for x+ to know."""

_TWO_BY_SQRT_PI = 2.0 / math.sqrt(math.pi)
_UNMOVED = 1e-14  # of x+: a branch so short was none


@compiled
def _rate(z: float) -> tuple[float, float]:
    """Transition rate times tau, 1/erfcx(z), and its derivative [-] (3.9, 3.10)."""
    rate = switching_rate(z)
    return rate, max(rate * (_TWO_BY_SQRT_PI * rate - 2.0 * z), 0.0)


@compiled
def inverse_erfc(y: float) -> float:
    """w with erfc(w) = y [-], for 0 <= y <= 2 but not beyond HARDEST: a rational start, then Halley's method."""
    tail = max(min(y, 2.0 - y), 1e-17)
    t = math.sqrt(-2.0 * math.log(0.5 * tail))
    w = math.sqrt(0.5) * (t - (2.30753 + 0.27061 * t) / (1.0 + t * (0.99229 + 0.04481 * t)))
    for _ in range(3):
        gauss = math.exp(-w * w)
        erfc = gauss * erfcx_positive(abs(w))
        step = ((erfc if w >= 0.0 else 2.0 - erfc) - tail) / (_TWO_BY_SQRT_PI * gauss)
        w += step / (1.0 - w * step)
    w = min(w, HARDEST)
    return w if y <= 1.0 else -w


@compiled
def position(m: Material, share: float, rest: float) -> float:
    """w where a share of all domains has switched and the rest has not, from whichever is smaller."""
    mass = 2.0 - m.below
    w = inverse_erfc(mass * rest) if mass * rest < 1.0 else -inverse_erfc(mass * share + m.below)
    return min(max(w, m.lowest), HARDEST)


@compiled
def evaluate(m: Material, w: float, field: float, taken: float) -> tuple[float, float, float, float]:
    """Share since the branch began, its dw [-]; rate f of switching [1/s], its dw; the field [V/m] counts forwards."""
    mass, width = 2.0 - m.below, m.thermal_width
    gauss = math.exp(-w * w)
    tail = gauss * erfcx_positive(abs(w))
    erfc, complement = (tail, 2.0 - tail) if w >= 0.0 else (2.0 - tail, tail)
    share, share_w = (complement - m.below) / mass, _TWO_BY_SQRT_PI * gauss / mass
    ahead = erfc / mass - taken

    rate, rate_z = _rate((field - m.centre - m.slope * w) / width)
    f = rate * ahead
    f_w = -rate_z * m.slope / width * ahead - rate * share_w
    if m.distribution != COERCIVE:
        if m.distribution == INTERACTION:  # the barriers keep a distance of 2 E_c (3.31)
            back, per_w = w, m.slope / width
            z = (-field - m.centre + m.slope * w) / width
        else:  # chapter 4: the way back has the barrier of its own share, E_c(1 - x)
            back = position(m, ahead, share)
            inside = m.lowest < back < HARDEST
            per_w = m.slope / width * math.exp(back * back - w * w) if inside else 0.0
            z = (-field - m.centre - m.slope * back) / width
        rate, rate_z = _rate(z)
        f -= rate * (1.0 - ahead)
        f_w -= rate_z * per_w * (1.0 - ahead) + rate * share_w
    return share, share_w, f / m.relaxation_time, f_w / m.relaxation_time


@compiled
def refresh(state: Array, m: Material) -> None:
    """Recompute the rate, after what it depends on has changed."""
    _, _, state[F], _ = evaluate(m, state[W], state[DIRECTION] * state[FIELD], state[TAKEN])


@compiled
def follow_branch(state: Array, m: Material) -> None:
    """Go on from the present x+ along the branch between the two topmost points of the stack."""
    count = int(state[COUNT])
    base, end = state[STACK + count - 1], state[STACK + count - 2]
    up = count % 2 == 0
    direction = 1.0 if up else -1.0
    state[DIRECTION], state[BASE] = direction, base
    state[TAKEN] = base if up else 1.0 - base
    share = direction * (state[X] - base)
    state[W] = position(m, share, 1.0 - share)
    reach = direction * (end - base)
    state[W_END] = position(m, reach, 1.0 - reach) if count >= 4 else math.inf  # saturation is never passed
    refresh(state, m)


@compiled
def turn(state: Array, m: Material) -> None:
    """Begin a branch the other way at the present x+; if the last one has led nowhere, take it back instead."""
    count = int(state[COUNT])
    if count > 2 and abs(state[X] - state[BASE]) <= _UNMOVED:
        count -= 1
    else:
        if count == DEPTH:
            count -= 2
        state[STACK + count] = min(max(state[X], 0.0), 1.0)
        count += 1
    state[COUNT] = count
    state[CHANGES] += 1.0
    follow_branch(state, m)


@compiled
def close_loop(state: Array, m: Material) -> None:
    """The loop is closed: forget its two points and go on along the branch that it interrupted."""
    state[X] = state[STACK + int(state[COUNT]) - 2]
    state[COUNT] -= 2.0
    state[CHANGES] += 1.0
    follow_branch(state, m)


@compiled
def fresh_state(m: Material, phase_fraction: float) -> Array:
    """At time 0 and field 0, on the way up from x+ = 0."""
    state = np.zeros(SIZE)
    state[STACK], state[STACK + 1] = 1.0, 0.0
    state[COUNT] = 2.0
    state[STEP] = math.inf
    state[X] = phase_fraction
    follow_branch(state, m)
    return state


@compiled
def polarization(state: Array, m: Material) -> float:
    """P = E/E1 + (2x - 1) P_T [C/m^2] (3.20)."""
    return state[FIELD] / m.reciprocal_permittivity + (2.0 * state[X] - 1.0) * m.domain_polarization
