"""Another past of runs from rest in place of the one that a base has, where an effect beside it shows that."""

from __future__ import annotations

from collections.abc import Sequence

from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.elimination import without
from pzt_ros.diagnosis.from_rest import poled_beside
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.reach_of_pasts import unreached_beside
from pzt_ros.diagnosis.settings import Thresholds

_TRIED = 3  # effects beside which a ceramic may have been poled
_FAR_BEHIND = 5.0  # times the excess that the best leaves, beyond which another is not what hides a past


def past_instead(steps: Sequence[Step], asked: Thresholds) -> Hypothesis | None:
    """The base with its runs from rest poled before, or without what a past reaches, where an effect shows that."""
    poled = poled_instead(steps[0].candidates, asked) if steps[-1].after.fit.ratio > asked.in_sight else None
    return _unreached_instead(steps[0].candidates, asked) if poled is None else poled


def poled_instead(candidates: Sequence[Candidate], asked: Thresholds) -> Hypothesis | None:
    """The base with its runs from rest poled before, where that leaves far less beside one of the effects tried.

    An effect hides a past, and a past an effect. Of a mode of 8 x the noise on a stage that had been poled a virgin
    ceramic left 12 x, whose densities bent for both, and a poled one 4.1 x; on stages that were never driven 1.0 times
    as much as before and more.
    """
    for each in _likeliest(candidates):
        beside = poled_beside(each.after)
        is_near = beside is not None and beside.fit.ratio <= asked.reachable
        if beside is not None and is_near and beside.excess <= asked.outdone * each.after.excess:
            return without(beside, each.name)
    return None


def _unreached_instead(candidates: Sequence[Candidate], asked: Thresholds) -> Hypothesis | None:
    """The base of what no past reaches, where that leaves far less beside one of the effects tried."""
    for each in _likeliest(candidates):
        beside = unreached_beside(each.after, asked.outdone)
        if beside is not None:
            return without(beside, each.name)
    return None


def _likeliest(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Those that explain most where they were fitted; not what is far behind, where one tells nearly all."""
    least = min((each.after.excess for each in candidates), default=0.0)
    near = [each for each in candidates if each.after.excess <= _FAR_BEHIND * least]
    return sorted(near, key=lambda candidate: -candidate.fit_share)[:_TRIED]
