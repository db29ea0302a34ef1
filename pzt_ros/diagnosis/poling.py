"""The past of a run from rest whose ceramic was poled once and left: a peak of the drive, and how long ago it was."""

from __future__ import annotations

import numpy as np

from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.sysid.run import Start, typical_leg

_WAIT = 10.0  # usual legs since the ceramic was left; a fit finds how long
_OTHER_WAY = 0.3  # of the highest voltage, from which a drive to the other side may have poled it


def peaks(found: Hypothesis) -> list[float]:
    """Where a ceramic may have been poled [V]: at the end of the drive that is farthest from 0 V, or at both."""
    drives = [run.record.voltage for run in found.staged.runs]
    ends = [max(float(drive.max()) for drive in drives), min(float(drive.min()) for drive in drives)]
    farthest = max(abs(end) for end in ends)
    return [end for end in ends if abs(end) > _OTHER_WAY * farthest]


def poled_start(found: Hypothesis, number: int, volts: float) -> Start:
    """A run's past at a peak [V] and ten usual legs ago [s], which says nothing of a ceramic that knows no rate."""
    leg = typical_leg(found.staged.runs[number].record)
    return Start((volts,), leg, approach=None if found.staged.ceramic.knows_no_rate else _WAIT * leg)


def poled_anew(found: Hypothesis) -> dict[int, Start]:
    """The pasts of the runs that were poled, as a search for them begins, by run; of the end that they were left at."""
    ceramic = found.staged.ceramic
    pasts = {n: ceramic.start_of(found.vector, n) for n, run in enumerate(found.staged.runs) if run.poled}
    left = [start.prior_voltages[0] for start in pasts.values() if start.prior_voltages]
    if not left:
        return {}
    volts = min(peaks(found), key=lambda peak: abs(peak - float(np.median(left))))
    return {number: poled_start(found, number, volts) for number in pasts}
