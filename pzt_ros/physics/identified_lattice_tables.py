"""What every line of thresholds does in a substep of the identified lattice: attempts and rates, from one table.

Compiled, and free of branches so that loops over lines become SIMD; equations in identified_lattice_kernel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy import special

from pzt_ros.physics.kinetics import exponential, switching_rate
from pzt_ros.physics.signals import Array

TO_THE_BIT = {"nnan", "ninf", "nsz"}
"""Fastmath of loops whose ends depend on what is known: nothing that rounds otherwise in SIMD than in a loop's rest."""

_FIRST, _LAST, _PER_UNIT = -11.0, 13.0, 32
_LEVEL = 1e-4  # climb in units of d below which the rate at the middle is exact enough
_STEEP = 12.0  # from here on 1/erfcx is sqrt(pi) (z + 1/(2z)) to 1e-5
_ROOT_PI = math.sqrt(math.pi)
CLOSEST, WIDEST = 1e-4, 1e3
"""Spacings of the lines [d] for which a table is of reasonable size."""

KNOWN, MET_UP, MET_DOWN, UP, DOWN_EVEN, DOWN_ODD, MANY_UP, MANY_DOWN, P0, Q0, P1, Q1, TABLES = range(13)
"""Tables over the lines: attempts since the other way was possible, exp(-attempts) and attempts in a step, rates at its
start and end. KNOWN: the field where this was so: every x is 1 in the rows before .., 0 in the columns from .. on.
"""


class Relays(NamedTuple):
    """The relays and what they have in common.

    Attributes:
        lines: thresholds over d, ascending, equally spaced [-, shape (n,)].
        weight: polarization of each relay [C/m^2, shape (n*n//4,)].
        width: thermal width d [V/m].
        attempt_rate: 1/tau [1/s].
        susceptibility: of what does not switch [C/(V m)].
        offset: frozen polarization [C/m^2].
        layer_thickness: [m].
        field_step: longest substep in units of d [-].
        attempts: Phi and its derivatives, see `attempts_table`.
    """

    lines: Array
    weight: Array
    width: float
    attempt_rate: float
    susceptibility: float
    offset: float
    layer_thickness: float
    field_step: float
    attempts: Array


def attempts_table(spacing: float) -> Array:
    """Phi, h Phi' and h^2 Phi'' for z = -11, -11 + h, ... 13, where h divides the spacing of the lines [d].

    All lines then lie at the same place between two nodes, m nodes apart: shape (2, 3, m + 1, k), with falling z and
    with rising z, by place and then by spacing; place m is place 0 of the next spacing.
    """
    places = math.ceil(spacing * _PER_UNIT)
    count = math.ceil((_LAST - _FIRST) / spacing) + 1
    z = _FIRST + spacing * (np.arange(count) + np.arange(places + 1)[:, None] / places)
    rate, h = 1 / special.erfcx(z), spacing / places
    phi = -0.5 * _ROOT_PI * special.log_ndtr(-math.sqrt(2.0) * z)
    rising = np.stack([phi, h * rate, h * h * rate * (2 / _ROOT_PI * rate - 2 * z)])
    return np.stack([rising[..., ::-1], rising])


@njit(cache=True, inline="always", error_model="numpy")
def _place(relays, u, sign):  # type: ignore[no-untyped-def]
    """Where z = sign (u - line) lies: which table, column of line 0, place, and weights of the nodes there and next."""
    spacing = relays.lines[1] - relays.lines[0]
    _, _, places, count = relays.attempts.shape
    far = (sign * (u - relays.lines[0]) - _FIRST) / spacing
    column = math.floor(far)
    along = (far - column) * (places - 1)
    place = min(int(along), places - 2)
    t = along - place
    rest = 1.0 - t
    value, slope, next_slope = rest * rest * (1.0 + 2.0 * t), rest * rest * t, -rest * t * t
    up = sign > 0.0
    return 0 if up else 1, count - 1 - column if up else column, place, value, 1.0 - value, slope, next_slope


@njit(cache=True, error_model="numpy", fastmath=TO_THE_BIT)
def _fill_steep(many, relays, u, sign, clock, first, end):  # type: ignore[no-untyped-def]
    """Attempts of lines first ... end - 1, which the field is far beyond; u is its mean."""
    for k in range(first, end):
        z = sign * (u - relays.lines[k])
        many[k] = clock * _ROOT_PI * (z + 0.5 / z)


@njit(cache=True, error_model="numpy", fastmath=TO_THE_BIT)
def _fill_attempts(many, relays, u0, u1, sign, clock, first, end):  # type: ignore[no-untyped-def]
    """Attempts of lines first ... end - 1 while the field goes from u0 to u1 in `clock` relaxation times."""
    climb, lines, table = sign * (u1 - u0), relays.lines, relays.attempts
    middle = 0.5 * (u0 + u1)
    if abs(climb) < _LEVEL:
        for k in range(first, end):
            many[k] = clock * switching_rate(sign * (middle - lines[k]))
        return
    farthest = (min(sign * u0, sign * u1) - _STEEP - sign * lines[0]) / (lines[1] - lines[0])  # in lines from line 0
    if sign > 0.0:
        begin, stop = int(min(max(math.ceil(farthest), first), end)), end
        _fill_steep(many, relays, middle, sign, clock, first, begin)
    else:
        begin, stop = first, int(min(max(math.floor(-farthest) + 1, first), end))
        _fill_steep(many, relays, middle, sign, clock, stop, end)
    way, column0, p0, f0, g0, s0, n0 = _place(relays, u0, sign)
    _, column1, p1, f1, g1, s1, n1 = _place(relays, u1, sign)
    scale = clock / climb
    for k in range(begin, stop):
        i0, i1 = np.uint64(column0 + k), np.uint64(column1 + k)  # unsigned: a sign to look at would prevent SIMD
        before = f0 * table[way, 0, p0, i0] + g0 * table[way, 0, p0 + 1, i0]
        before += s0 * table[way, 1, p0, i0] + n0 * table[way, 1, p0 + 1, i0]
        after = f1 * table[way, 0, p1, i1] + g1 * table[way, 0, p1 + 1, i1]
        after += s1 * table[way, 1, p1, i1] + n1 * table[way, 1, p1 + 1, i1]
        many[k] = max((after - before) * scale, 0.0)


@njit(cache=True, error_model="numpy", fastmath=TO_THE_BIT)
def _fill_rates(rates, relays, u, sign, first, last):  # type: ignore[no-untyped-def]
    """1/erfcx(sign (u - line)) for lines first ... last."""
    table = relays.attempts
    way, column, p, f, g, s, n = _place(relays, u, sign)
    per_h = (table.shape[2] - 1) / (relays.lines[1] - relays.lines[0])
    for k in range(first, last + 1):
        i = np.uint64(column + k)
        rate = f * table[way, 1, p, i] + g * table[way, 1, p + 1, i]
        rates[k] = per_h * (rate + s * table[way, 2, p, i] + n * table[way, 2, p + 1, i])


@njit(cache=True, error_model="numpy", fastmath=TO_THE_BIT)
def fill_tables(work, relays, u0, u1, clock, up_from, up_end, down_from, down_end, first, last):  # type: ignore[no-untyped-def]
    """All tables of a substep for the lines that switch; rates at its ends only for lines first ... last."""
    _fill_attempts(work[MANY_UP], relays, u0, u1, 1.0, clock, up_from, up_end)
    _fill_attempts(work[MANY_DOWN], relays, u0, u1, -1.0, clock, down_from, down_end)
    for k in range(up_from, up_end):
        work[UP, k] = exponential(-work[MANY_UP, k])
        work[MET_UP, k] = work[MET_UP, k] + work[MANY_UP, k] if k < down_from else 0.0
    for k in range((down_from + 1) // 2, (down_end + 1) // 2):
        work[DOWN_EVEN, k] = exponential(-work[MANY_DOWN, 2 * k])
    for k in range(down_from // 2, down_end // 2):
        work[DOWN_ODD, k] = exponential(-work[MANY_DOWN, 2 * k + 1])
    for k in range(down_from, down_end):
        work[MET_DOWN, k] = work[MET_DOWN, k] + work[MANY_DOWN, k] if k >= up_end else 0.0
    _fill_rates(work[P0], relays, u0, 1.0, first, last)
    _fill_rates(work[P1], relays, u1, 1.0, first, last)
    _fill_rates(work[Q0], relays, u0, -1.0, first, last)
    _fill_rates(work[Q1], relays, u1, -1.0, first, last)
