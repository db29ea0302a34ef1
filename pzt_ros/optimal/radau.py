"""The 3-stage Radau IIA method: order 5, L-stable, its last stage is the end of the interval (Hairer, Wanner IV.5)."""

from __future__ import annotations

import numpy as np

_S6 = np.sqrt(6.0)

NODES = np.array([(4.0 - _S6) / 10.0, (4.0 + _S6) / 10.0, 1.0])
"""c, as shares of the interval [shape (3,)]."""

MATRIX = np.array(
    [
        [(88.0 - 7.0 * _S6) / 360.0, (296.0 - 169.0 * _S6) / 1800.0, (-2.0 + 3.0 * _S6) / 225.0],
        [(296.0 + 169.0 * _S6) / 1800.0, (88.0 + 7.0 * _S6) / 360.0, (-2.0 - 3.0 * _S6) / 225.0],
        [(16.0 - _S6) / 36.0, (16.0 + _S6) / 36.0, 1.0 / 9.0],
    ]
)
"""A [shape (3, 3)]."""

WEIGHTS = MATRIX[2]
"""b: the method is stiffly accurate."""

STAGES = 3
