"""Whether what test runs leave is their pasts', which only the half of each told that comes before what scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pzt_ros.diagnosis.data import SCORE, SELECTION, Picks, RunData
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact_here, fitted
from pzt_ros.diagnosis.remains import remains_of
from pzt_ros.diagnosis.wandering import less_wandering
from pzt_ros.physics.signals import Array


def is_of_pasts(
    found: Hypothesis, runs: Sequence[RunData], residuals: Sequence[Array], floors: tuple[float, float]
) -> bool:
    """Whether nothing would be left if all of each test run had told its past, as all of each train run did.

    A past that the first half tells badly goes on in the second, where it looks like something missing: of an
    examiner's null inside minor loops 1.1 x the noise was left where pasts were told and 2.3 x where not, and 1.12 x of
    that run in hindsight. Only what belongs to a test run alone moves.

    Args:
        found: the end of a diagnosis.
        runs: as they were divided.
        residuals: of its prediction, of every run [m].
        floors: as `remains_of` has them.
    """
    staged = found.staged
    late = [n for n, run in enumerate(runs) if SCORE in run.picks and staged.ceramic.places_of(n)]
    if not late or not isinstance(staged.ceramic, DeclaredHysteresis):  # an occupancy would explain any run
        return False
    told = [replace(run, picks=_all_of(whole)) for run, whole in zip(staged.runs, runs, strict=True)]
    begun = fitted(replace(staged, runs=told), found.vector, found.effects, most_steps=0)
    seen = fitted(exact_here(begun).staged, begun.vector, found.effects, most_steps=0)
    outputs = seen.staged.outputs(seen.vector, late)
    left = {n: runs[n].record.displacement - out for n, (out, _) in zip(late, outputs, strict=True)}
    instead = [left.get(number, residual) for number, residual in enumerate(residuals)]
    return not remains_of(runs, less_wandering(found, instead), *floors).present


def _all_of(run: RunData) -> dict[str, Picks]:
    """Its parts, what scores among what tells its past."""
    if SCORE not in run.picks:
        return dict(run.picks)
    return {SELECTION: np.concatenate((run.picks[SELECTION], run.picks[SCORE]))}
