"""Whether a stream of blocks is whole: each begins where the one before ended."""

from __future__ import annotations

from pzt_ros.blocks import Block

MISSING = "blocks missing in the bag"
"""How the recorder counts them in what it says of itself."""


class Continuity:
    """Looks at the blocks of one topic, one after the other.

    Run time stands still while nothing is put out, so that there is no gap between two blocks of a run but for one that
    was lost. A block that begins before the end of the last one belongs to another run.
    """

    def __init__(self) -> None:
        self._expected: float | None = None

    def take(self, block: Block) -> int:
        """How many blocks are missing before this one."""
        time = block.time
        period = float(time[-1] - time[0]) / (len(block) - 1) if len(block) > 1 else 0.0
        expected, self._expected = self._expected, float(time[-1]) + period
        if expected is None or period <= 0.0:
            return 0
        return max(0, round((float(time[0]) - expected) / (period * len(block))))

    def pause(self) -> None:
        """What comes next may come later."""
        self._expected = None
