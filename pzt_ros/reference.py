"""What is asked of the stage: one block of reference, and the time stamps of blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pzt_ros.physics.signals import Array

VOLTAGE, DISPLACEMENT = "voltage", "displacement"


@dataclass(frozen=True)
class Reference:
    """One block of what is asked of the stage.

    Attributes:
        quantity: "voltage" (goes straight to the amplifier) or "displacement" (a controller sees to it).
        time: sample times [s, shape (n,)].
        values: [V or m, shape (n,)].
        controller: to be active from this block on; empty for no change.
    """

    quantity: str
    time: Array
    values: Array
    controller: str = ""


def block_times(block: int, block_size: int, sample_rate: float) -> Array:
    """Sample times [s, shape (block_size,)] of block number `block`; the first sample of block 0 is at 0 s."""
    first = block * block_size
    return np.arange(first, first + block_size) / sample_rate
