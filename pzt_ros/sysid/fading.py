"""What dies out in the displacement of a run, whatever it was: a structure's memory of a past that nobody recorded."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pzt_ros.physics.signals import Array

_TIMES = 0.1 * 4.0 ** np.arange(5)  # s, to 26


def fading_curves(time: Array, longest: float = math.inf) -> Array:
    """What dies out from the first of some times on [s, shape (n,)], in `longest` [s] at most [1, shape (n, k)]."""
    times = _TIMES[longest >= _TIMES]
    curves: Array = np.exp(-(time - time[0])[:, np.newaxis] / times)
    return curves


def fading_course(time: Array, begin: float, sizes: Sequence[float]) -> Array:
    """What is left at some times [s, shape (n,)] of curves of some sizes at the begin of a run [s; m] [m, (n,)]."""
    times = _TIMES[: len(sizes)]
    course: Array = np.exp(-(time - begin)[:, np.newaxis] / times) @ np.asarray(sizes)
    return course
