"""Where a drive turns."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from pzt_ros.physics.signals import Array

_signal: Any = signal  # SciPy carries no types


def turning_points(voltage: Array, least: float) -> NDArray[np.intp]:
    """Samples at which a drive turns by at least `least` [V], in their order [shape (n,)]; its ends are none."""
    found = [_signal.find_peaks(sign * voltage, prominence=least)[0] for sign in (1.0, -1.0)]
    return np.sort(np.concatenate(found))
