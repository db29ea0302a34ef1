"""Pasts of runs from rest beside a lattice: a few reversals, where a free occupancy is dozens of unknowns a run.

An occupancy explains whatever a run begins with, and what is missing as well as that; the density beside it is hardly
determined. Beside the reversals of a declared fit the same lattice left 1.8 x the noise of a run that it had left at
25 x with 91 occupancies a run.
"""

from __future__ import annotations

from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from pzt_ros.diagnosis.data import FIT, SELECTION, RunData
from pzt_ros.diagnosis.flexible_lattice import FlexibleHysteresis
from pzt_ros.diagnosis.histories import refitted_from
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.less_effects import ceramic_alone
from pzt_ros.diagnosis.poling import peaks, poled_start
from pzt_ros.parallel import Workers
from pzt_ros.sysid.history_search import best_of
from pzt_ros.sysid.run import Start
from pzt_ros.sysid.start import CountedPart, thinned_part

_CLEAN = 1.1  # rms over noise of a run from rest whose past is not asked for
_SEARCHED = 1_000  # samples that a search looks at
_BEYOND = 1.5  # times as long as it takes the drive to both its ends: what no past reaches tells the zero of a run


def with_pasts_sought(found: Hypothesis, workers: Workers) -> Hypothesis:
    """With other pasts of the runs from rest that are not described, beside the density as it is; if that is better."""
    asked = not_described(found)
    if not asked:
        return found
    starts = workers.map(_past_of, repeat(ceramic_alone(found)), asked)
    other = refitted_from(found, dict(zip(asked, starts, strict=True)), 0)
    return min(found, other, key=lambda each: each.total)


def not_described(found: Hypothesis) -> list[int]:
    """Indices of the runs whose past may be another: they begin at rest, count from there, and are not described."""
    ceramic = found.staged.ceramic
    assert isinstance(ceramic, FlexibleHysteresis)
    own = [n for n, run in enumerate(found.staged.runs) if not (ceramic.unknown_start[n] or run.since)]
    return [n for n in own if found.ratios[n] > _CLEAN]


def _past_of(found: Hypothesis, number: int) -> Start:
    """The past of a run that its samples ask for: as it is, none, one or two reversals, or poled and left."""
    run, chain = found.staged.runs[number], found.staged.chain_at(found.vector, number)
    picks = _telling(run)
    part = thinned_part(CountedPart(run.record, picks, int(picks[-1]) + 1))
    curves = run.nuisances(picks) if run.has_nuisances else np.empty((picks.size, 0))
    here = found.staged.ceramic.start_of(found.vector, number)
    poled = [poled_start(found, number, peak) for peak in peaks(found)]
    return best_of(chain, part, [here, *poled], curves)


def _telling(run: RunData) -> NDArray[np.intp]:
    """Samples of a run that its past reaches, and some more [shape (n,)]."""
    picks, drive = run.picks[FIT] if FIT in run.picks else run.picks[SELECTION], run.record.voltage
    reached = _BEYOND * max(int(np.argmin(drive)), int(np.argmax(drive)))
    early = picks[picks <= reached]
    picks = early if early.size >= _SEARCHED else picks
    return picks[:: -(-picks.size // _SEARCHED)]
