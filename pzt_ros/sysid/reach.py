"""How far into a run its past reaches: until the drive has been at both its ends (return-point memory)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pzt_ros.physics.signals import Array

CLOSE = 0.05
"""Of the span of a drive, to its ends: what lies beyond switches seldom, and stays as it is until then."""
_LEAST = 0.2  # of the samples that count, which have to be left


def first_unreached(voltage: Array, picks: NDArray[np.intp], close: float = CLOSE) -> int:
    """The first sample that no past reaches; 0 where few of those that count would be left.

    Args:
        voltage: of the whole run [V, shape (n,)].
        picks: indices of the samples that count.
        close: how close to both its ends the drive has to come, over its span [-].
    """
    drive = voltage[: picks[-1] + 1]
    low, high, margin = float(drive.min()), float(drive.max()), close * float(np.ptp(drive))
    since = max(int(np.argmax(drive <= low + margin)), int(np.argmax(drive >= high - margin)))
    return since if np.count_nonzero(picks >= since) >= _LEAST * picks.size else 0
