"""Ticks of the graph as its recorder heard them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pzt_ros.bags.reader import open_bag


def ticks_in(bag: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """When each block of truth was heard [ns], and how long the amplifier's next block took after it [ms]."""
    opened = open_bag(bag)
    asked = np.array([when for when, _ in opened.messages("/stage/truth")])
    answered = np.array([when for when, _ in opened.messages("/stage/applied")])
    following = np.searchsorted(answered, asked, side="right")
    known = following < len(answered)
    return asked[known], 1e-6 * (answered[following[known]] - asked[known])
