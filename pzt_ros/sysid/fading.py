"""What dies out in the displacement of a run, whatever it was: a structure's memory of a past that nobody recorded."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pzt_ros.physics.signals import Array

_TIMES = 0.1 * np.power(4.0, np.arange(5.0))  # s, to 26


def fading_curves(time: Array, longest: float = math.inf, since: int = 0) -> Array:
    """What dies out from one of some times on [s, shape (n,)], in `longest` [s] at most [1, shape (n, k)]."""
    return _curves(np.maximum(time - time[since], 0.0), _TIMES[longest >= _TIMES])


def fading_course(time: Array, begin: float, sizes: Sequence[float]) -> Array:
    """What is left at some times [s, shape (n,)] of curves of some sizes at the begin of a run [s; m] [m, (n,)]."""
    course: Array = _curves(time - begin, _TIMES[: len(sizes)]) @ np.asarray(sizes)
    return course


def beyond_reading(left: Array, curves: Array) -> Array:
    """What is left [m, shape (n,)] when an offset and curves [shape (n, k)] are taken out of it."""
    basis = np.linalg.qr(curves - curves.mean(axis=0))[0]
    centred = left - left.mean()
    return centred - basis @ (basis.T @ centred)


def _curves(since: Array, times: Array) -> Array:
    curves: Array = np.exp(-since[:, np.newaxis] / times)
    return curves
