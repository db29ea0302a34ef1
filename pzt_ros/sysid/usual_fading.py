"""What dies out in a run of a stage that was driven before, weighed against what died out in the fitted runs.

A record tells slow curves badly from an offset, so the slowest were left out, and what they leave went into those. All
runs of a stage that is poled alike begin alike: what its fitted runs had of each curve says what to expect of another.
Three creeping stages were predicted to 1.3 to 2.6 x the noise in the half of a run that was not looked at; now to 1.0.
Where fitted runs do not agree, their slowest curves stand for something else, and led 8 x astray.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pzt_ros.physics.chain import Chain
from pzt_ros.sysid.covariance import effective_samples
from pzt_ros.sysid.fading import fading_curves
from pzt_ros.sysid.run import Start, rms
from pzt_ros.sysid.start import CountedPart, misfit_at

_FEWEST = 2  # runs that say how large what dies out is
_MORE = 2.0  # times their spread, which few tell: of 1, 2 and 4 this predicted three stages best
_LEAST = 0.1  # of the noise: no spread is less
_AGREE = 0.5  # spread of the slowest curve over its mean up to which the fitted runs agree


def with_usual_fading(chain: Chain, part: CountedPart, found: Start, fitted: Sequence[Start], noise: float) -> Start:
    """The start with its offset and what dies out fitted anew, each curve expected as in the fitted runs.

    Args:
        chain: of the stage.
        part: of the run that may be looked at.
        found: its start; as it is where nothing dies out in it, or runs are too few, or too much unlike one another, to
            say what to expect.
        fitted: starts of the runs that the chain was fitted to.
        noise: of the displacement [m].
    """
    curves = fading_curves(part.record.time)[part.picks]
    known = np.array([each.fading for each in fitted if len(each.fading) == curves.shape[1]])
    if not found.fading or len(known) < _FEWEST:
        return found
    mean, spread = known.mean(axis=0), known.std(axis=0, ddof=1)
    if spread[-1] > _AGREE * abs(mean[-1]):
        return found
    left = misfit_at(chain, part, found.without_reading)
    columns = np.column_stack((np.ones(left.size), curves))
    free = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
    seen = max(noise, rms(free) * math.sqrt(free.size / effective_samples(free)))
    weight = seen / (_MORE * spread + _LEAST * noise)
    rows = np.vstack((columns, np.column_stack((np.zeros(weight.size), np.diag(weight)))))
    targets = np.concatenate((left, weight * mean))
    offset, *sizes = np.linalg.lstsq(rows, targets, rcond=None)[0]
    return replace(found, offset=float(offset), fading=tuple(float(size) for size in sizes))
