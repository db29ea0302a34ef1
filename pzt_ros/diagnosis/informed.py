"""Effects weighed on a density that was fitted to what chose, too.

A density without a formula is determined only where the fitted runs went. What it is off by elsewhere is excess on the
part that chooses, and beside much of that an effect explains a small share of it, however much it explains of the runs
that were fitted. Fitted to both, the density is off by little with the effect and without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pzt_ros.diagnosis.candidates import Candidate
from pzt_ros.diagnosis.final_fit import fitted_to_all
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.stiffer import held_by
from pzt_ros.parallel import Workers


def informed(candidates: Sequence[Candidate], workers: Workers) -> list[Candidate]:
    """The same effects beside one base, all fitted to both kinds of parts, the best first; nothing chooses any more."""
    base = candidates[0].before
    before, *afters = workers.map(fitted_to_all, [base, *(_held_alike(each.after, base) for each in candidates)])
    found = [replace(each, before=before, after=after) for each, after in zip(candidates, afters, strict=True)]
    return sorted(found, key=lambda each: each.after.total)


def _held_alike(found: Hypothesis, base: Hypothesis) -> Hypothesis:
    """With the prior of the base on its density: a candidate may have got a stronger one, and would explain less."""
    theirs: Any = found.staged.ceramic  # `Hysteresis` says nothing of priors: few have one
    ours: Any = base.staged.ceramic
    return replace(found, staged=replace(found.staged, ceramic=held_by(theirs, ours.rotation_strength)))
