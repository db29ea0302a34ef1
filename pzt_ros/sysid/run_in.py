"""The first moments of a record that begins in motion, which no model can know.

Links with a memory of their own, a lag, a bandwidth, a mode, begin at rest in a model; in a stage driven before that
they are under way. After five of the longest time constants that such links have nothing is left of the difference: of
a bandwidth of 3 x the noise it was 30 x at the first sample of a sine, and pasts were sought to make up for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pzt_ros.physics.chain import Chain
from pzt_ros.records import Record
from pzt_ros.sysid.run import begins_driven

_LASTS = 0.05  # s: five times 10 ms
_MOST = 0.1  # of a run
_MOVES = 0.01  # of the drive's span within that time; less is rest


def running_in(record: Record) -> NDArray[np.bool_]:
    """Samples at the beginning of a run that is in motion there already [shape (n,)]."""
    since = record.time - record.time[0]
    early: NDArray[np.bool_] = since < min(_LASTS, _MOST * float(since[-1]))
    moves = np.ptp(record.voltage[early]) > _MOVES * np.ptp(record.voltage) if np.any(early) else False
    return early if begins_driven(record) and moves else np.zeros_like(early)


def fades(chain: Chain, record: Record, poled: bool = False) -> bool:
    """Whether a run begins with what a link of the chain remembers of a past that nobody recorded.

    Args:
        chain: of the stage.
        record: of the run.
        poled: whether that was driven before, though it begins at rest.
    """
    return (poled or begins_driven(record)) and any(link.remembers for link in chain.links)
