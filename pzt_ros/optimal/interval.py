"""One interval of the grid: Radau IIA collocation with a field linear over it, and how its stages depend on its ends.

The three stage equations are solved by Newton's method from where the last plan's sensitivities put the stages, so one
step is the rule; the same factors give the sensitivities, and a plan is always a trajectory of the model.
"""

from __future__ import annotations

import math
from typing import Final

from numba import njit

from pzt_ros.optimal.law import Material, switching
from pzt_ros.optimal.radau import MATRIX, NODES
from pzt_ros.physics.compiling import WITHIN
from pzt_ros.physics.signals import Array

# A plan is one array with a row for each interval and a last row for the end of the horizon.
FIELD: Final = 0  # at the beginning of the interval [V/m]
X: Final = 1  # phase fraction there
STAGE: Final = 2  # x+ at the three Radau points; the last one is the end of the interval
BY_X: Final = 5  # derivatives of the three by x+ at the beginning,
BY_LEFT: Final = 8  # by the field there [m/V],
BY_RIGHT: Final = 11  # and by the field at the end [m/V]
FEED: Final = 14  # feedback law for the field at the end: step [V/m],
GAIN_X: Final = 15  # gain on a change of x+ [V/m]
GAIN_LEFT: Final = 16  # and on a change of the field at the beginning; the last row holds the law of the first field
COLUMNS: Final = 17

_STEPS = 12
_CLOSE = 3e-5  # a Newton step so small leaves an error of its square

_A11, _A12, _A13 = (float(a) for a in MATRIX[0])
_A21, _A22, _A23 = (float(a) for a in MATRIX[1])
_A31, _A32, _A33 = (float(a) for a in MATRIX[2])
_C1, _C2, _ = (float(c) for c in NODES)


@njit(**WITHIN, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def collocate(row: Array, law: Array, m: Material, h: float, right: float) -> bool:
    """Solve the stages of one interval from the guess that `row` holds, with their sensitivities; False if it fails.

    Args:
        row: of the plan, shape (COLUMNS,); FIELD, X and STAGE are read, STAGE to BY_RIGHT are written.
        law: barrier law of the interval, shape (8,).
        m: the material.
        h: length of the interval [s].
        right: field at its end [V/m].
    """
    left, x = row[FIELD], row[X]
    e1, e2 = left + _C1 * (right - left), left + _C2 * (right - left)
    x1, x2, x3 = row[STAGE], row[STAGE + 1], row[STAGE + 2]
    for _ in range(_STEPS):
        f1, j1, g1 = switching(law, m, x1, e1)
        f2, j2, g2 = switching(law, m, x2, e2)
        f3, j3, g3 = switching(law, m, x3, right)
        f1, f2, f3 = h * f1, h * f2, h * f3
        j1, j2, j3 = h * j1, h * j2, h * j3
        # M = I - h A diag(f_x), inverted by its adjugate
        m11, m12, m13 = 1.0 - _A11 * j1, -_A12 * j2, -_A13 * j3
        m21, m22, m23 = -_A21 * j1, 1.0 - _A22 * j2, -_A23 * j3
        m31, m32, m33 = -_A31 * j1, -_A32 * j2, 1.0 - _A33 * j3
        i11, i12, i13 = m22 * m33 - m23 * m32, m13 * m32 - m12 * m33, m12 * m23 - m13 * m22
        i21, i22, i23 = m23 * m31 - m21 * m33, m11 * m33 - m13 * m31, m13 * m21 - m11 * m23
        i31, i32, i33 = m21 * m32 - m22 * m31, m12 * m31 - m11 * m32, m11 * m22 - m12 * m21
        per = 1.0 / (m11 * i11 + m12 * i21 + m13 * i31)
        r1 = x + _A11 * f1 + _A12 * f2 + _A13 * f3 - x1
        r2 = x + _A21 * f1 + _A22 * f2 + _A23 * f3 - x2
        r3 = x + _A31 * f1 + _A32 * f2 + _A33 * f3 - x3
        d1 = (i11 * r1 + i12 * r2 + i13 * r3) * per
        d2 = (i21 * r1 + i22 * r2 + i23 * r3) * per
        d3 = (i31 * r1 + i32 * r2 + i33 * r3) * per
        x1, x2, x3 = x1 + d1, x2 + d2, x3 + d3
        largest = max(abs(d1), abs(d2), abs(d3))
        if not largest < math.inf:
            return False
        if largest <= _CLOSE:
            row[STAGE], row[STAGE + 1], row[STAGE + 2] = x1, x2, x3
            row[BY_X] = (i11 + i12 + i13) * per
            row[BY_X + 1] = (i21 + i22 + i23) * per
            row[BY_X + 2] = (i31 + i32 + i33) * per
            g1, g2, g3 = h * g1 * per, h * g2 * per, h * g3 * per
            l1, l2 = (1.0 - _C1) * g1, (1.0 - _C2) * g2
            g1, g2 = _C1 * g1, _C2 * g2
            a1, a2, a3 = _A11 * l1 + _A12 * l2, _A21 * l1 + _A22 * l2, _A31 * l1 + _A32 * l2
            row[BY_LEFT] = i11 * a1 + i12 * a2 + i13 * a3
            row[BY_LEFT + 1] = i21 * a1 + i22 * a2 + i23 * a3
            row[BY_LEFT + 2] = i31 * a1 + i32 * a2 + i33 * a3
            a1 = _A11 * g1 + _A12 * g2 + _A13 * g3
            a2 = _A21 * g1 + _A22 * g2 + _A23 * g3
            a3 = _A31 * g1 + _A32 * g2 + _A33 * g3
            row[BY_RIGHT] = i11 * a1 + i12 * a2 + i13 * a3
            row[BY_RIGHT + 1] = i21 * a1 + i22 * a2 + i23 * a3
            row[BY_RIGHT + 2] = i31 * a1 + i32 * a2 + i33 * a3
            return True
    return False
