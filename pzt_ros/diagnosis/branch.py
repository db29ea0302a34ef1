"""The search for effects on one base: what it found, and whether that is to be believed."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from pzt_ros.diagnosis.candidates import Candidate, Step, share_of
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.effects.table import EFFECT_OF


@dataclass(frozen=True)
class Branch:
    """The search on one base.

    Attributes:
        density: of its domains: "gaussian" as declared, "shaped" where skew and tails are free, "identified" where all
            of it is, "none" where it has one or none.
        base: without an effect.
        steps: of the search.
        is_all_seen: whether it was fitted to what chooses, too.
        has_free_law: whether its strain law has more powers than were declared.
    """

    density: str
    base: Hypothesis
    steps: tuple[Step, ...]
    is_all_seen: bool = False
    has_free_law: bool = False

    @property
    def final(self) -> Hypothesis:
        """Where it ended."""
        return self.steps[-1].after if self.steps else self.base

    @property
    def added(self) -> tuple[Candidate, ...]:
        """Every effect that was added, in their order."""
        return tuple(each for step in self.steps for each in step.accepted)

    @property
    def last_step(self) -> int:
        """Place of the last step that added anything; 0 where none did."""
        return max((place for place, step in enumerate(self.steps) if step.accepted), default=0)

    def without_names(self, but: str, since: int = 0) -> Branch:
        """The same with every name taken back that was added by a step from there on, and why."""
        before = self.steps[since].before if since else self.base
        steps = [
            dataclasses.replace(step, before=before, accepted=(), tied=(), verdict=f"{step.verdict}, but {but}")
            for step in self.steps[since:]
        ]
        return dataclasses.replace(self, steps=(*self.steps[:since], *steps))

    def explains(self, asked: Thresholds) -> bool:
        """Whether nothing is left that would have to be explained."""
        return Search(asked).explains(self.steps, self.base)

    def remains_floor(self, asked: Thresholds) -> float:
        """Rms over noise up to which nothing remains of a run, whether it was fitted or not.

        Shapes of a density, and pasts that nobody recorded, come near the noise with a few numbers.
        """
        if self.density == "shaped" or self.final.staged.has_past:
            return asked.near_floor
        return asked.flexible_remains if self.density == "identified" else asked.floor

    def slow_floor(self, asked: Thresholds) -> float:
        """The same of slow means; of anything where a few numbers, which are off by something slow, stand for much."""
        few = self.density == "shaped" or self.final.staged.has_past
        return math.inf if few else asked.slow_remains

    def is_told(self, asked: Thresholds) -> bool:
        """Whether its effects tell nearly all that its base leaves."""
        return bool(self.final.effects) and share_of(self.base, self.final) > asked.whole

    @property
    def is_heard(self) -> bool:
        """Whether all it names has a frequency of its own, so that what is left says nothing against it."""
        effects, is_tied = self.final.effects, any(step.tied for step in self.steps)
        return bool(effects) and not is_tied and all(EFFECT_OF[name].has_own_frequency for name in effects)

    def may_be_named(self, asked: Thresholds) -> bool:
        """Whether what is left lets names be trusted; a tie claims less than a name, so less is asked of it."""
        if self.is_heard:
            return True
        left = self.final.fit.ratio
        knows_no_rate = self.base.staged.ceramic.knows_no_rate
        if left > (asked.rateless_nameable if knows_no_rate else asked.nameable):
            return False
        alone = any(step.accepted and not step.tied for step in self.steps)
        if alone and not self.final.choosing and left > asked.unchecked_nameable:
            return False
        return left <= asked.doubtful or not alone or share_of(self.base, self.final) >= asked.pair_share
