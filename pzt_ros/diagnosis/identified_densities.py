"""Densities in place of a declared one: relays that know no rate, a lattice; with the effects beside them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

from pzt_ros.diagnosis.beside_effects import BesideEffects
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.elements import Elements
from pzt_ros.diagnosis.final_fit import fitted_to_all
from pzt_ros.diagnosis.flexible import fit_flexible, fit_rate_independent, tells_all
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.own_densities import on_own_lattices
from pzt_ros.diagnosis.reach_of_pasts import told_beyond_pasts
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.undeclared import Bases
from pzt_ros.diagnosis.wandering_instead import wandering_instead
from pzt_ros.effects.strain_polarization_hysteresis import StrainPolarizationHysteresis


@dataclass(frozen=True)
class Densities:
    """Densities in place of a declared one, identified and searched when they are first asked for.

    To identify one takes seconds, and minutes to search for effects on a base that was wrong.

    Attributes:
        known: the fitted declared model, and relays that were identified before.
        search: on a flexible base.
    """

    known: Bases
    search: Search

    @property
    def declared(self) -> Hypothesis:
        """The fitted declared model."""
        return self.known.declared

    @property
    def searched(self) -> list[Branch]:
        """The searches that were asked for."""
        return [self.on_relays] if "on_relays" in self.__dict__ else []

    @cached_property
    def relays(self) -> Hypothesis:
        """Those that know no rate, without an effect."""
        search = self.search
        if self.known.relays is not None:
            return self.known.relays
        found = fit_rate_independent(self.declared, search.progress, search.workers)
        return told_beyond_pasts(found, search.thresholds, search.progress, search.workers)

    @cached_property
    def on_relays(self) -> Branch:
        """The search on them."""
        return on_relays(self.relays, self.search)

    @property
    def lattice(self) -> Hypothesis:
        """Domains that know a rate, without an effect."""
        return self._lattice[0]

    @property
    def lattice_takes(self) -> float:
        """How long it took to identify [s]; beside an effect it takes no less."""
        return self._lattice[1]

    @cached_property
    def _lattice(self) -> tuple[Hypothesis, float]:
        limit = self.search.limit
        begun = limit.spent
        return fit_flexible(self.declared, self.search.progress, self.search.workers), limit.spent - begun

    @property
    def on_lattice(self) -> Search:
        """A search on a lattice."""
        return dataclasses.replace(self.search, thresholds=self.search.thresholds.on_lattice())

    @cached_property
    def at_a_glance(self) -> tuple[Candidate, ...]:
        """The likeliest effects on a lattice, from refits that do not go on for long."""
        glance = dataclasses.replace(self.search, thresholds=self.search.thresholds.at_a_glance())
        return tuple(each for each in glance.beside(self.lattice) if glance.is_significant(each))

    def tell(self, asked: Thresholds) -> bool:
        """Whether relays without a rate leave little without an effect, and tell nearly all with one or without."""
        base = self.relays
        if base.fit.ratio > asked.rateless_tells:
            return False
        if base.excess > asked.rateless_outdone * self.declared.excess:
            return False
        is_told = self.on_relays.explains(asked) or self._are_relays_told(asked)
        return is_told and self.on_relays.may_be_named(asked)

    def _are_relays_told(self, asked: Thresholds) -> bool:
        """Whether effects tell nearly all that they leave, or all of what was fitted."""
        branch = self.on_relays
        return branch.is_told(self.search.thresholds) or _tells_what_was_fitted(branch.steps, asked)

    def tell_first(self, elements: Elements, asked: Thresholds) -> bool:
        """Whether relays that leave little more than the declared base tell nearly all with an effect, and that less.

        An effect hides which of the two a stage is more like. On relays a search takes seconds, for they are linear in
        their density and ask for no pasts of runs from rest; on a polycrystal whose density is another, minutes.

        Args:
            elements: that slip; where they leave less they are searched first.
            asked: of an effect.
        """
        base = self.relays
        if base.excess > asked.rateless_as_near * self.declared.excess:
            return False
        if elements.base.excess <= base.excess:
            return False
        branch = self.on_relays
        is_told = self._are_relays_told(asked) and branch.may_be_named(asked)
        return is_told and self.search.with_effects(self.declared, branch.final.effects).total > branch.final.total

    def lattice_outdoes(self, elements: Elements, asked: Thresholds) -> bool:
        """Whether only a lattice comes near the noise, so that no search beside another base is worth its time.

        Beyond what is finishable no name comes of an effect beside the declared base, and that tries them for minutes.
        A large effect leaves a lattice far off, too, but not as far as bases that lack more.

        Args:
            elements: that slip.
            asked: of an effect.
        """
        if self.declared.fit.ratio <= asked.finishable or self.relays.fit.ratio <= asked.in_sight:
            return False
        if elements.base.excess <= asked.outdone * self.declared.excess:
            return False  # they are searched in seconds
        others = min(self.relays.excess, self.declared.excess)
        return self.lattice.fit.ratio <= asked.lattice_sooner and self.lattice.excess < asked.lattice_outdone * others

    def lattice_leads(self, elements: Elements, asked: Thresholds) -> bool:
        """Whether a lattice leaves less than all others, which are far from the noise.

        Relays that leave less than a polycrystal say that the stage knows no rate; a lattice would be identified in
        vain.

        Args:
            elements: that slip.
            asked: of an effect.
        """
        declared, relays = self.declared, self.relays
        if declared.fit.ratio <= asked.lattice_asked or relays.excess < declared.excess:
            return False
        least = min(declared.excess, elements.base.excess)
        return self.lattice.excess <= asked.lattice_leads * least

    def lattice_is_all(self, found: Hypothesis, asked: Thresholds) -> bool:
        """Whether a lattice without an effect leaves far less than effects beside the declared base, which are far off.

        Where it does not describe every run, what is missing has bent it, and is sought beside it.

        Args:
            found: where a search for effects beside that base ended.
            asked: of an effect.
        """
        if found.over_noise <= asked.in_sight**2:
            return False
        return self.lattice.excess <= asked.lattice_is_all * found.excess

    def leave_far_less(self, asked: Thresholds) -> bool:
        """Whether one of them leaves so much less without an effect that the declared density is wrong."""
        most = asked.outdone * self.declared.excess
        return self.relays.excess < most or self.lattice.excess < most


def on_densities(densities: Densities, asked: Thresholds) -> list[Branch]:
    """The identified densities that are worth it, with the search on each that leaves something.

    Relays that know no rate need no lattice beside them where they explain all, or nearly all of what is missing. Where
    they leave hardly more than a lattice, that was bent to make up for an effect, or for the rate that it cannot lose.
    """
    search, rateless = densities.search, densities.relays
    if search.at_floor(rateless):
        return [densities.on_relays]
    if search.limit.is_over():
        return densities.searched or [Branch("identified", rateless, ())]
    flexible = densities.lattice
    is_clean = flexible.fit.ratio <= asked.floor  # hardly anything is left there in which an effect could show itself
    found: list[Branch] = []
    if rateless.total < asked.rateless * flexible.total and not is_clean:
        found = [densities.on_relays]
        if found[0].explains(asked) or found[0].is_told(search.thresholds):
            return found
    lattice = densities.on_lattice
    foretold = _foretold(flexible, lattice) if is_clean and not search.at_floor(flexible) else None
    if foretold is not None:
        return [*found, foretold]
    seen = _on_all_seen(flexible, asked, lattice)
    if is_clean or seen.explains(asked):
        return [*found, seen]
    alone = _on_density(flexible, lattice)
    tells_more = bool(seen.final.effects) and seen.may_be_named(asked) and not alone.final.effects
    return [*found, seen if tells_more else alone]  # without a name, how well it fits what it saw says nothing


def _foretold(flexible: Hypothesis, search: Search) -> Branch | None:
    """The search on a density that is clean where it was fitted and off where not, if it ends near the noise in both.

    A density that bends for an effect describes the runs that it was fitted to, and no others: a hysteresis of the
    strain of 3 x was no more than 1 % of their noise. Where it is only undetermined, no effect that is fitted with it
    mends that.
    """
    steps = search.run(flexible)
    branch = Branch("identified", flexible, tuple(steps))
    is_near = max(branch.final.ratios) <= search.thresholds.near_floor
    return branch if is_near and branch.final.effects else None


def on_relays(relays: Hypothesis, search: Search) -> Branch:
    """The search on relays that know no rate, where they leave anything.

    Pasts that were sought without an effect have bent for it, and so has the density beside them: both are sought anew
    beside what was found.
    """
    has_past = relays.staged.has_past
    if search.at_floor(relays) or (has_past and tells_all(relays, search.thresholds)):
        return Branch("identified", relays, ())
    if not has_past:
        identify = partial(fit_rate_independent, progress=search.progress, workers=search.workers)
        hidden = frozenset({StrainPolarizationHysteresis.kind})
        asked = search.thresholds.on_relays()
        is_told = partial(_tells_what_was_fitted, asked=asked)
        search = dataclasses.replace(
            search, thresholds=asked, identify=identify, hidden=hidden, is_at_bottom=True, is_told=is_told
        )
        return _on_relays_from_rest(relays, search)
    branch = _on_density(relays, search)
    if branch.explains(search.thresholds) or search.limit.is_over():
        return branch
    return BesideEffects(search, search.thresholds).on_density(branch.steps, (fit_rate_independent,)) or branch


def _tells_what_was_fitted(steps: Sequence[Step], asked: Thresholds) -> bool:
    """Whether effects beside relays leave hardly more than noise of the runs that were fitted.

    Those show no further effect then, and what others are left at is how little these tell of the density: a mode of
    4 x left 1.1 x of what was fitted and 3.6 x of what chose, and lost its name when the time for more effects was up.
    """
    return bool(steps) and bool(steps[-1].after.effects) and steps[-1].after.fit.ratio <= asked.near_floor


def _on_relays_from_rest(relays: Hypothesis, search: Search) -> Branch:
    """The search on relays identified beside each effect; where that leaves little, yet something, two at once.

    No density is off by that then. A creep had taken the places of a delay and a drift, and left 1.2 x the noise.
    """
    branch, asked = _on_density(relays, search), search.thresholds
    is_near = asked.floor < branch.final.fit.ratio <= asked.rateless_nameable
    if not is_near or branch.explains(asked) or not branch.steps[0].accepted:  # two were tried where none was enough
        return branch
    undecided = dataclasses.replace(branch.steps[0], accepted=(), tied=())
    paired = search.with_pair([undecided], relays)
    return dataclasses.replace(branch, steps=tuple(paired)) if search.explains(paired, relays) else branch


def _on_density(base: Hypothesis, search: Search) -> Branch:
    """The search on a density; two effects at once are not sought beside one that explains nearly all.

    What is left then is what the density is off by, or the shape of the effect: beside a fatigue of 10 x a drift and a
    bias field were named.
    """
    branch = Branch("identified", base, tuple(search.run(base)))
    if branch.is_told(search.thresholds) or search.is_told(branch.steps):
        return branch
    wandering = wandering_instead(branch, search)
    if wandering is not None:
        return wandering
    return dataclasses.replace(branch, steps=tuple(search.with_pair(branch.steps, base)))


def _on_all_seen(flexible: Hypothesis, asked: Thresholds, on_lattice: Search) -> Branch:
    """The search on a density that was fitted to what chooses, too, if it has to bend for both.

    A density that few runs determine takes up what an effect does there, and what chooses then shows what it is off by
    rather than the effect. Beside nothing that is missing it comes down to the noise in all that is seen.
    """
    search = dataclasses.replace(on_lattice, thresholds=asked.on_all_seen())
    if search.at_floor(flexible) or search.limit.is_over():
        return Branch("identified", flexible, ())
    search.progress("identifying the density from what chooses, too")
    seen = fitted_to_all(flexible)
    if search.at_floor(seen):
        return Branch("identified", seen, (), is_all_seen=True)
    first = search.step(seen)
    has_bent = flexible.fit.ratio > asked.floor and first.after.fit.ratio > asked.doubtful
    own = on_own_lattices(flexible, first, BesideEffects(on_lattice, asked)) if has_bent else None
    return own or Branch("identified", seen, tuple(search.continued([first], seen)), is_all_seen=True)
