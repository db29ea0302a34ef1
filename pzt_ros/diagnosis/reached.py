"""Where a diagnosis ends: the last fits, the models that are written down, and the errors that they make."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import repeat
from typing import NamedTuple

from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.data import SCORE, RunData
from pzt_ros.diagnosis.final_fit import fitted_to_all, identified_beside_effects, is_identified
from pzt_ros.diagnosis.formula import formula_again
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.outcome import Errors, errors_from, errors_of, model_of
from pzt_ros.diagnosis.reach_of_pasts import with_short_pasts
from pzt_ros.diagnosis.remarks import BESIDE, FORMULA, INSTEAD, UNSTEADY, WORSE
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.time_limit import TimeLimit
from pzt_ros.diagnosis.unsteady import is_unsteady
from pzt_ros.diagnosis.wandering import less_wandering
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.parallel import Workers
from pzt_ros.physics.chain import Chain

_WORSENS = "it makes the prediction of what scores worse"


class Reached(NamedTuple):
    """Where a diagnosis ends: the names that hold, the last fit, chains without and with them, and their errors.

    Attributes:
        errors: without any effect, and with each one more that was added.
    """

    branch: Branch
    final: Hypothesis
    baseline: Chain
    model: Chain
    errors: tuple[Errors, ...]
    remarks: tuple[str, ...]

    @property
    def before(self) -> Errors:
        """Without an effect."""
        return self.errors[0]

    @property
    def after(self) -> Errors:
        """With all of them."""
        return self.errors[-1]


def reached_of(
    runs: Sequence[RunData],
    chosen: Branch,
    declared: Hypothesis,
    asked: Thresholds,
    command: str,
    workers: Workers,
    limit: TimeLimit,
) -> Reached:
    """The ends of a branch, fitted for the last time; names with which the prediction of what scores is worse go.

    Of several steps the last goes where it is worse than with the names before. A straight drift does not go before it
    was tried as readings that wander; a tone that is there may only be unsteady.

    Args:
        runs: as they were divided.
        chosen: the branch.
        declared: the base that was fitted first, whose densities may do beside names.
        asked: of an effect.
        command: that asked for the report.
        workers: fit side by side.
        limit: after which no density is identified or declared anew.
    """
    reached = _fitted_last(runs, chosen, declared, asked, command, workers, not limit.is_over())
    before, former, after = _foretold(reached, runs)
    if not any(SCORE in run.picks for run in runs) or after <= asked.worsens * min(before, former):
        return reached
    if not any(run.wander for run in chosen.final.staged.runs):  # a drift foretells wrongly what goes its own way
        steps = Search(asked, workers=workers).with_last_drift_wandering(chosen.steps, chosen.base)
        if steps:
            drifting = dataclasses.replace(chosen, steps=tuple(steps))
            return reached_of(runs, drifting, declared, asked, command, workers, limit)
    last = chosen.last_step
    if last and after > asked.worsens * former:
        names = " and ".join(each.name.replace("_", " ") for each in chosen.steps[last].accepted)
        remark = BESIDE.format(names=names, before=former * 1e9, after=after * 1e9)
        reached = reached_of(runs, chosen.without_names(_WORSENS, last), declared, asked, command, workers, limit)
        return reached._replace(remarks=(remark, *reached.remarks))
    is_there = chosen.is_heard and is_unsteady(reached.model, runs, reached.before.residuals, reached.after.residuals)
    remark = (UNSTEADY if is_there else WORSE).format(before=before * 1e9, after=after * 1e9)
    if is_there:
        return reached._replace(remarks=(remark,))
    nameless = chosen.without_names(_WORSENS)
    reached = _fitted_last(runs, nameless, declared, asked, command, workers, not limit.is_over())
    return reached._replace(remarks=(remark,))


def _fitted_last(
    runs: Sequence[RunData],
    chosen: Branch,
    declared: Hypothesis,
    asked: Thresholds,
    command: str,
    workers: Workers,
    anew: bool,
) -> Reached:
    """The ends of a branch, with every name that it found."""
    final = formula_again(chosen.final, declared, asked, workers) if anew else chosen.final
    ends = [final] if chosen.final is chosen.base else [chosen.base, final]
    fits = list(workers.map(last_fit, ends, repeat(runs), repeat(asked), repeat(anew)))
    baseline, model = model_of(fits[0], "baseline", command), model_of(fits[-1], "model", command)
    before, *after = workers.map(errors_of, [baseline, model][: len(ends)], repeat(runs))
    with_less = [each.after for each in chosen.added[:-1]]
    between = workers.map(_errors_with, with_less, repeat(runs), repeat(asked), repeat(anew))
    remarks = _of_density(is_identified(chosen.final), is_identified(fits[-1]))
    return Reached(chosen, fits[-1], baseline, model, (before, *between, *after), remarks)


def _errors_with(found: Hypothesis, runs: Sequence[RunData], asked: Thresholds, anew: bool) -> Errors:
    return errors_of(model_of(last_fit(found, runs, asked, anew), "step", ""), runs)


def _foretold(reached: Reached, runs: Sequence[RunData]) -> tuple[float, float, float]:
    """Rms on what scores [m] without any effect, without those of the last step, and with all.

    What tells its own frequency needs no other to be there; then the second is the first.
    """
    chosen = reached.branch
    last = chosen.steps[chosen.last_step].accepted if chosen.steps else ()
    is_tone = all(EFFECT_OF[each.name].has_own_frequency for each in last)
    former = reached.errors[0 if is_tone else len(chosen.added) - len(last)]
    before, beside, after = (
        errors_from(less_wandering(chosen.final, each.residuals), runs).score
        for each in (reached.before, former, reached.after)
    )
    return before, beside, after


def _of_density(was_identified: bool, is_identified: bool) -> tuple[str, ...]:
    """What to remark where the model's density is of another kind than the one that told its names."""
    if was_identified == is_identified:
        return ()
    return (INSTEAD,) if is_identified else (FORMULA,)


def last_fit(found: Hypothesis, runs: Sequence[RunData], asked: Thresholds, anew: bool = True) -> Hypothesis:
    """As it is written down, fitted to all that may be seen where that changes it, its density identified anew or not.

    Declared densities have too few parameters; what goes on from run to run is known best by the last of them.
    """
    found = identified_beside_effects(found, runs, asked) if anew else found
    return with_short_pasts(fitted_to_all(found) if is_identified(found) or found.staged.given else found)
