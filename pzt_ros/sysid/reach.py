"""How far into a run its past reaches: until the drive has been at both its ends (return-point memory)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pzt_ros.physics.signals import Array

_CLOSE = 0.05  # of the span of a drive, to its ends: what lies beyond switches seldom, and stays as it is until then
_LEAST = 0.2  # of the samples that count, which have to be left


def first_unreached(voltage: Array, picks: NDArray[np.intp]) -> int:
    """The first sample that no past reaches; 0 where few of those that count would be left.

    Args:
        voltage: of the whole run [V, shape (n,)].
        picks: indices of the samples that count.
    """
    drive = voltage[: picks[-1] + 1]
    low, high, margin = float(drive.min()), float(drive.max()), _CLOSE * float(np.ptp(drive))
    since = max(int(np.argmax(drive <= low + margin)), int(np.argmax(drive >= high - margin)))
    return since if np.count_nonzero(picks >= since) >= _LEAST * picks.size else 0
