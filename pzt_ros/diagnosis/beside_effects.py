"""Names that a search found, on a density that is identified beside them.

What a declared density, or a Gaussian one, is off by hides what an effect leaves. To search anew on an identified one
takes minutes; to identify it beside what was found takes one fit, and a refit without each name says whether it is
needed there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.elimination import is_law_as_good, without
from pzt_ros.diagnosis.flexible import fit_flexible, fit_rate_independent, tells_all
from pzt_ros.diagnosis.from_rest import on_whole_runs
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted, total_of, without_effects
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.diagnosis.strain_laws import STRAIN_LAW
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.effects.table import CONFOUNDED, EFFECT_OF, LATE
from pzt_ros.parallel import Workers

Identify = Callable[[Hypothesis, Progress, Workers], Hypothesis]
"""From a fitted model to a density in its ceramic's place."""

_KINDS: tuple[Identify, ...] = (fit_rate_independent, fit_flexible)
_TURNS, _COMES_DOWN = 3, 0.9  # that an effect and a density are fitted, and what has to be left each time at most
_IDENTIFIED = "explains {share:.0%} of the excess on a density that was identified beside it"


@dataclass
class BesideEffects:
    """Densities beside what a search has found so far.

    Attributes:
        search: on a flexible base.
        asked: of an effect beside the declared one.
        told: where it told all, while the search went on.
    """

    search: Search
    asked: Thresholds
    told: Branch | None = None

    def tell_soon(self, steps: Sequence[Step]) -> bool:
        """Whether it tells all, asked as soon as one effect explains nearly all: what is left may be the density's."""
        last = steps[-1]
        is_near = last.after.fit.ratio <= self.asked.polishable
        if last.accepted and last.accepted[-1].share > self.asked.whole and is_near:
            self.told = self.on_density(steps)
        return self.told is not None

    def on_density(self, steps: Sequence[Step], kinds: Sequence[Identify] = _KINDS) -> Branch | None:
        """The same names where nothing is left beside them; None where something is, or one of them is not needed.

        Args:
            steps: of a search.
            kinds: of densities that are tried.
        """
        final = steps[-1].after
        if not final.effects or any(step.tied for step in steps) or final.fit.ratio > self.asked.in_sight:
            return None
        for identify in kinds:
            found = identify(final, self.search.progress, self.search.workers)
            if tells_all(found, self.asked):
                whole = self._on_whole_runs(found, found.effects[0], identify) if len(found.effects) == 1 else found
                branch = self.judged(whole)
                return branch if branch is not None and branch.explains(self.asked) else None
        return None

    def on_own_densities(
        self, found: Mapping[str, Hypothesis], identify: Identify = fit_flexible, others: Sequence[str] = ()
    ) -> Branch | None:
        """The best of effects each on a density identified beside it; None where something is left beside each.

        Args:
            found: by the name of an effect, each of another cause: it beside a density that is wrong, or has bent.
            identify: one.
            others: names that are tried on the density of one that is as late as they are.
        """
        tried = self._in_turn(found, identify, others)
        told = {name: there for name, there in tried.items() if tells_all(there, self.asked)}
        if not told:
            return None
        best, *others = sorted(told, key=lambda name: told[name].total)
        branch = self.judged(self._on_whole_runs(told[best], best, identify), tried=frozenset(tried))
        if branch is None or not branch.explains(self.asked):
            return None
        (step,) = branch.steps
        others += [STRAIN_LAW] if self._may_be_law(step) else []
        tied = (*(step.tied or (best,)), *others) if others else step.tied
        return replace(branch, steps=(replace(step, tied=tied),))

    def _may_be_law(self, step: Step) -> bool:
        """Whether what was named is a sensor's curve, and a strain law with one more power explains as much."""
        is_curve = step.accepted[0].cause == SensorNonlinearity.kind
        return is_curve and is_law_as_good(step.before, step.after, self.search.thresholds)

    def _in_turn(
        self, found: Mapping[str, Hypothesis], identify: Identify, others: Sequence[str] = ()
    ) -> dict[str, Hypothesis]:
        """The best of each effect and a density fitted in turn, each beside the other, until little is gained.

        Once one leaves nothing, only those go on that leave hardly anything, either: a drift came from 1.5 to 1.4 x in
        40 s where a bias field had left the noise. Those that promise nothing, or come after the time, are not there.
        """
        done: dict[str, list[Hypothesis]] = {name: [] for name in found}
        going = {name: beside for name, beside in found.items() if beside.effects}
        while going:
            for name, beside in going.items():
                if not self.search.limit.is_over():
                    done[name].append(identify(beside, self.search.progress, self.search.workers))
            is_told = any(tells_all(each, self.asked) for turns in done.values() for each in turns)
            most = self.asked.near_floor if is_told else math.inf
            lately = {name: done[name][-1] for name in going if self._goes_on(done[name], most)}
            anew = {name: self._refitted(here, others) for name, here in lately.items()}
            going = {name: beside for name, beside in anew.items() if beside.effects}
        best: dict[str, Hypothesis] = {}
        for each in sorted((each for turns in done.values() for each in turns), key=total_of):
            best.setdefault(each.effects[0], each)
        return best

    def _refitted(self, found: Hypothesis, others: Sequence[str]) -> Hypothesis:
        """The effect on its density, or another that is as late, where that leaves less there.

        For the other, too, that density is nearly right: beside skewed thresholds with a lag of 10 x a bandwidth on a
        lattice of its own left 1.4 x, on a common one less than the lag, and the lag on its own the noise.
        """
        bare, (name, *_) = without_effects(found), found.effects
        alike = [each for each in others if {name, each} <= LATE]
        return self.search.with_best(bare, (name, *alike))

    def _goes_on(self, turns: Sequence[Hypothesis], most: float) -> bool:
        """Whether a further turn of an effect and its density may leave less, and it is worth its time.

        Args:
            turns: that were done.
            most: rms over noise of a run that the last may have left.
        """
        if not turns or len(turns) >= _TURNS or self.search.limit.is_over():
            return False
        *former, here = turns
        comes_down = all(here.total <= _COMES_DOWN * each.total for each in former)
        return comes_down and not tells_all(here, self.asked) and max(here.ratios) <= most

    def _on_whole_runs(self, found: Hypothesis, name: str, identify: Identify) -> Hypothesis:
        """The same on all samples, where that leaves nothing, either: the effect was what a past had seemed to be."""
        if not any(run.since for run in found.staged.runs):
            return found
        counted = fitted(on_whole_runs(found.staged), found.vector, found.effects)
        begun = {name: self.search.with_effects(without_effects(counted), [name])}
        whole = self._in_turn(begun, identify).get(name)
        return whole if whole is not None and tells_all(whole, self.asked) else found

    def judged(self, found: Hypothesis, tried: frozenset[str] = frozenset()) -> Branch | None:
        """Each name against the same density refitted without it, and without those that were found after it.

        Args:
            found: with effects.
            tried: names that are not asked whether they tie, for they were tried on a density of their own.
        """
        search, after = self.search, found
        search.progress("refitting without " + ", ".join(found.effects))
        steps: list[Step] = []
        for name in reversed(found.effects):
            before = without(after, name)
            candidate = Candidate(name, before, after) if before else None
            if candidate is None or not search.is_significant(candidate) or not search.is_enough(candidate):
                return None
            rivals = {each for pair in CONFOUNDED if candidate.cause in pair for each in pair & EFFECT_OF.keys()}
            known = {EFFECT_OF[each].reported for each in (*found.effects, *tried)}
            alike = search.still_tied(candidate, sorted(rivals - known))
            why = _IDENTIFIED.format(share=candidate.share)
            steps.insert(
                0, Step(candidate.before, (candidate,), {}, (candidate,), (name, *alike) if alike else (), why)
            )
            after = candidate.before
        return Branch("identified", after, tuple(steps))
