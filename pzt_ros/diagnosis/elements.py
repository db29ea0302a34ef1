"""Elements that slip in place of a declared ceramic, with the effects beside them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from pzt_ros.diagnosis.bouc_wen_base import fit_bouc_wen
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.hypothesis import Hypothesis, without_effects
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.wandering_instead import wandering_instead
from pzt_ros.effects.bias_field import BiasField
from pzt_ros.effects.table import EFFECTS

EFFECTS_ON_ELEMENTS = tuple(effect for effect in EFFECTS if effect.link is not BiasField)
"""Elements that slip know no field at which nothing is displaced, so a bias is only where a run finds them."""


@dataclass(frozen=True)
class Elements:
    """Elements that slip in place of a declared density, fitted and searched when they are first asked for.

    Attributes:
        declared: the fitted declared model.
        search: on elements.
    """

    declared: Hypothesis
    search: Search

    @cached_property
    def base(self) -> Hypothesis:
        """Without an effect."""
        return fit_bouc_wen(self.declared, self.search.progress)

    @cached_property
    def first(self) -> Step:
        """The first step of the search on it."""
        return self.search.step(self.base)

    @cached_property
    def branch(self) -> Branch:
        """The search on it."""
        return self._searched(self.base, self.search, self.__dict__.get("first"))

    @property
    def searched(self) -> list[Branch]:
        """The searches that were asked for."""
        return [self.branch] if "branch" in self.__dict__ else []

    @property
    def tried(self) -> Sequence[Candidate]:
        """The refits of that step, where the search was begun."""
        begun = [self.first] if "first" in self.__dict__ else [step for each in self.searched for step in each.steps]
        return begun[0].candidates if begun else ()

    def leave_much(self, asked: Thresholds) -> bool:
        """Whether they leave far less than the declared base, and yet much beside each effect: they are too few."""
        if self.search.at_floor(self.base) or self.base.excess > asked.outdone * self.declared.excess:
            return False
        best = min(self.first.candidates, key=lambda each: each.after.total, default=None)
        return best is not None and best.after.fit.ratio > asked.rateless_nameable

    def tell(self, asked: Thresholds) -> bool:
        """Whether they explain all, or leave far less than the declared base and are searched to near the noise."""
        base = self.base
        if base.excess > asked.elements_outdone * self.declared.excess:
            return False
        is_far_better = base.excess <= asked.outdone * self.declared.excess
        is_near = is_far_better and self.branch.final.fit.ratio <= asked.rateless_nameable
        return is_near or self.branch.explains(asked)

    def branches(self, found: Hypothesis, asked: Thresholds) -> list[Branch]:
        """The search on elements, where they leave far less than another base beside the same effects or without any.

        A large effect hides by how much they are better, and leads them astray where they are fitted without it: then
        the search begins with what they are beside it.
        """
        beside = fit_bouc_wen(found, self.search.progress) if found.effects else None
        if beside is not None and beside.excess <= asked.outdone * found.excess:
            place = without_effects(beside)
            return [self._searched(self.base, dataclasses.replace(self.search, sooner=lambda: [place]))]
        return [self.branch] if self.base.excess <= asked.outdone * self.declared.excess else []

    @staticmethod
    def _searched(base: Hypothesis, search: Search, first: Step | None = None) -> Branch:
        if search.at_floor(base):
            return Branch("none", base, ())
        branch = Branch("none", base, tuple(search.continued([first], base) if first else search.run(base)))
        wandering = wandering_instead(branch, search)
        return wandering or dataclasses.replace(branch, steps=tuple(search.with_pair(branch.steps, base)))
