"""What was found, as a report states it: the effects that were added, and every candidate with what became of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.data import SCORE
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.reached import Reached
from pzt_ros.diagnosis.report import FoundEffect, Tried
from pzt_ros.effects.table import EFFECT_OF

_INFLATION = 10.0  # of gains where a probability is made of them: residuals are no white noise


def found_effects(reached: Reached) -> tuple[FoundEffect, ...]:
    """The effects that stand alone, each with the error before and after it was added, and as the model has them."""
    chosen, former = reached.branch, reached.before
    alone = [candidate for step in chosen.steps if not step.tied for candidate in step.accepted]
    final = reached.model.notes["fit"]["parameters"]
    found = []
    for candidate, now in zip(chosen.added, reached.errors[1:], strict=True):
        if candidate in alone:
            mark = f"{candidate.name}."
            own = {name.removeprefix(mark): value for name, value in final.items() if name.startswith(mark)}
            place = EFFECT_OF[candidate.cause].place
            found.append(
                FoundEffect(candidate.cause, place, former.test, now.test, own, _probability(candidate, chosen))
            )
            former = now
    return tuple(found)


def _probability(candidate: Candidate, chosen: Branch) -> float:
    """Against the best of the other candidates and against nothing, by what they gain where nothing was fitted."""
    step = next(step for step in chosen.steps if candidate in step.accepted)
    rivals = [c for c in step.candidates if c.cause != candidate.cause]
    gain = min(candidate.fit_gain, candidate.selection_gain)
    others = [min(c.fit_gain, c.selection_gain) for c in rivals]
    odds = [math.exp(min(0.5 * (other - gain) / _INFLATION, 0.0)) for other in (0.0, *others)]
    return min(candidate.share, 1.0) ** 0.5 / (1.0 + sum(odds))


def tried_candidates(branches: Sequence[Branch]) -> list[Tried]:
    """Every candidate of every search with what became of it, those that were not refitted last in their round."""
    found = []
    for branch in branches:
        for number, step in enumerate(branch.steps, start=1):
            for candidate in step.candidates:
                accepted = candidate in step.accepted
                found.append(
                    Tried(
                        number,
                        branch.density,
                        candidate.name,
                        _test_rms(candidate.after),
                        candidate.fit_gain,
                        candidate.selection_gain,
                        candidate.fit_share,
                        candidate.selection_share,
                        accepted and not step.tied,
                        _why(candidate, step),
                    )
                )
            nan = math.nan
            found += [
                Tried(number, branch.density, name, nan, nan, nan, nan, nan, False, why)
                for name, why in step.refused.items()
            ]
    return found


def _why(candidate: Candidate, step: Step) -> str:
    here, there = max(candidate.fit_share, 0.0), max(candidate.selection_share, 0.0)
    shares = f"{here:.0%} of the excess where it was fitted"
    shares += f", {there:.0%} where not" if candidate.before.choosing else ""
    if candidate.name in step.tied:
        return f"{shares}; as good as {', '.join(name for name in step.tied if name != candidate.name)}"
    if candidate in step.accepted:
        return f"{shares}; {step.verdict}"
    if step.accepted:
        first = step.accepted[0]
        plainer = first.cause == candidate.cause and first.unknowns < candidate.unknowns
        return f"{shares}; {first.name} explains {'as much with fewer unknowns' if plainer else 'more'}"
    return f"{shares}; {step.verdict}"


def _test_rms(hypothesis: Hypothesis) -> float:
    """On the test runs, or on the train runs where there are none [m]."""
    runs = hypothesis.staged.runs
    tested = [number for number, run in enumerate(runs) if SCORE in run.picks] or list(range(len(runs)))
    outputs = hypothesis.staged.outputs(hypothesis.vector, tested)
    left = [runs[number].record.displacement - out[0] for number, out in zip(tested, outputs, strict=True)]
    return math.sqrt(float(np.mean(np.concatenate([(r - r.mean()) ** 2 for r in left]))))
