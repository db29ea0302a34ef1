"""Names that a search found, on a density that is identified beside them.

What a declared density, or a Gaussian one, is off by hides what an effect leaves. To search anew on an identified one
takes minutes; to identify it beside what was found takes one fit, and a refit without each name says whether it is
needed there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.elimination import without
from pzt_ros.diagnosis.flexible import fit_flexible, fit_rate_independent, tells_all
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.effects.table import CONFOUNDED, EFFECT_OF

Identify = Callable[[Hypothesis, Progress], Hypothesis]
"""From a fitted model to a density in its ceramic's place."""

_KINDS: tuple[Identify, ...] = (fit_rate_independent, fit_flexible)
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
            found = identify(final, self.search.progress)
            if tells_all(found, self.asked):
                branch = self._judged(found)
                return branch if branch is not None and branch.explains(self.asked) else None
        return None

    def _judged(self, found: Hypothesis) -> Branch | None:
        """Each name against the same density refitted without it, and without those that were found after it."""
        search, after = self.search, found
        search.progress("refitting without " + ", ".join(found.effects))
        steps: list[Step] = []
        for name in reversed(found.effects):
            before = without(after, name)
            candidate = Candidate(name, before, after) if before else None
            if candidate is None or not search.is_significant(candidate) or not search.is_enough(candidate):
                return None
            rivals = {each for pair in CONFOUNDED if name in pair for each in pair & EFFECT_OF.keys()}
            alike = [each for each in sorted(rivals - {*found.effects}) if search.still_ties(candidate, each)]
            why = _IDENTIFIED.format(share=candidate.share)
            steps.insert(
                0, Step(candidate.before, (candidate,), {}, (candidate,), (name, *alike) if alike else (), why)
            )
            after = candidate.before
        return Branch("identified", after, tuple(steps))
