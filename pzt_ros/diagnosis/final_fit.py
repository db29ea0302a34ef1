"""The last fit, when everything is chosen: the parts that chose are fitted, too, and only the score part stays unseen.

A density without a formula is determined only where the runs go. On measured minor loops the part that chose knows
more about them than the runs that were fitted: with it the end of the run of a PICMA stack is predicted to 0.28 % of
the span instead of 0.65 % (docs/measured.md).

How fine it is, how firmly it is held and of which order its law is, was chosen before the effects were found, for which
it had to bend. So it is identified once more beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from pzt_ros.diagnosis.data import FIT, SELECTION, RunData
from pzt_ros.diagnosis.elsewhere import from_elsewhere
from pzt_ros.diagnosis.flexible import fit_flexible, fit_rate_independent
from pzt_ros.diagnosis.flexible_lattice import FlexibleHysteresis
from pzt_ros.diagnosis.flexible_preisach import FlexiblePreisach
from pzt_ros.diagnosis.formula import identified_about, is_formula_off
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.errors import BenchError

_STEPS = 6
_IDENTIFIED_BY: dict[type, Callable[[Hypothesis, Progress], Hypothesis]] = {
    FlexibleHysteresis: fit_flexible,
    FlexiblePreisach: fit_rate_independent,
}


def identified_beside_effects(found: Hypothesis, runs: Sequence[RunData], asked: Thresholds) -> Hypothesis:
    """The model from elsewhere, its density identified anew, where that leaves less of all parts; else as it is.

    A density with a formula is as it was declared where it leaves no more than noise, or far more than that.

    Args:
        found: fitted to the parts that chose or not.
        runs: as they were divided.
        asked: of an effect.
    """
    staged = found.staged
    if not found.effects or any(run.wander for run in staged.runs):
        return found
    identify = _IDENTIFIED_BY.get(type(staged.ceramic))
    if identify is None:
        return identified_about(found) if is_formula_off(found, asked) else found
    divided = [replace(run, picks=whole.picks) for run, whole in zip(staged.runs, runs, strict=True)]
    begun = found if found.choosing else _refitted(found, divided)
    if not begun.choosing:
        return found
    best = begun
    with suppress(BenchError):  # what the effects leave of the drive or the readings may not tell a density
        best = from_elsewhere(begun, asked)
        best = min((best, identify(best, lambda text: None)), key=lambda each: each.total)
    return found if best is begun else best


def is_identified(found: Hypothesis) -> bool:
    """Whether its density has no formula."""
    return type(found.staged.ceramic) in _IDENTIFIED_BY


def fitted_to_all(found: Hypothesis) -> Hypothesis:
    """The same model fitted to all that may be seen, from where it is."""
    if not found.choosing:
        return found
    return _refitted(found, [_all_fitted(run) for run in found.staged.runs])


def _refitted(found: Hypothesis, runs: Sequence[RunData]) -> Hypothesis:
    """The same model fitted to other parts of its runs, from where it is."""
    staged = replace(found.staged, runs=runs).exact_at(found.vector)
    return exact(fitted(staged, found.vector, found.effects, _STEPS))


def _all_fitted(run: RunData) -> RunData:
    """With what chose as a part to fit."""
    seen = [run.picks[part] for part in (FIT, SELECTION) if part in run.picks]
    others = {part: picks for part, picks in run.picks.items() if part not in (FIT, SELECTION)}
    return replace(run, picks={FIT: np.concatenate(seen), **others})
