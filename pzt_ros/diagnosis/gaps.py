"""Samples missing where the drive turned: between its rows a run is taken as straight, and there it was not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pzt_ros.records import Record

_MISSING = 1.5  # of the usual step of time: a longer one lacks samples
_EVEN = 0.9  # of all steps that are the usual one, from which a run counts as evenly sampled
_LOST = 0.01  # of the drive's span: so much of a turn has to be lost to matter
_AFTER = 3.0  # gaps' lengths after one, until the ceramic has forgotten what the record lacks


def lost_turns(record: Record) -> NDArray[np.bool_]:
    """Samples that follow a gap in which the drive turned, so that no model can know them [shape (n,)].

    The lost tip of a turn is as high as the slopes on both sides differ. A run that is not evenly sampled, as a logger
    writes that stores changes only, is straight between its rows and has none.
    """
    time, voltage = record.time, record.voltage
    lost = np.zeros(time.size, dtype=bool)
    steps = np.diff(time)
    usual = float(np.median(steps))
    if np.mean(np.abs(steps - usual) < 0.1 * usual) < _EVEN:
        return lost
    slopes = np.diff(voltage) / steps
    gaps = np.flatnonzero(steps[1:-1] > _MISSING * usual) + 1
    tips = 0.25 * np.abs(slopes[gaps + 1] - slopes[gaps - 1]) * steps[gaps]
    for gap in gaps[tips > _LOST * float(np.ptp(voltage))]:
        lost |= (time > time[gap]) & (time <= time[gap + 1] + _AFTER * steps[gap])
    return lost
