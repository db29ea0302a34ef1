"""The search for effects on one base after another, and which of them is believed."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from pzt_ros.diagnosis.bottom import to_the_bottom
from pzt_ros.diagnosis.bouc_wen_base import fit_bouc_wen
from pzt_ros.diagnosis.candidates import Step, share_of
from pzt_ros.diagnosis.final_fit import fitted_to_all
from pzt_ros.diagnosis.flexible import fit_flexible, fit_rate_independent
from pzt_ros.diagnosis.histories import without_histories
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.kinetics import with_declared_kinetics
from pzt_ros.diagnosis.refinement import taken_on
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.diagnosis.strain_laws import with_free_law
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.parallel import Workers
from pzt_ros.physics.polycrystal import Polycrystal

_COMES_DOWN = 0.98  # what has to be left of a base's misfit for the search to begin anew


@dataclass(frozen=True)
class Branch:
    """The search on one base.

    Attributes:
        density: of its domains: "gaussian" as declared, "identified" from the runs, "none" where it has one or none.
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

    def without_names(self, but: str) -> Branch:
        """The same with every name taken back, and why."""
        steps = [
            dataclasses.replace(step, before=self.base, accepted=(), tied=(), verdict=f"{step.verdict}, but {but}")
            for step in self.steps
        ]
        return dataclasses.replace(self, steps=tuple(steps))

    def explains(self, asked: Thresholds) -> bool:
        """Whether nothing is left that would have to be explained."""
        return Search(asked).explains(self.steps, self.base)


def branches_of(declared: Hypothesis, asked: Thresholds, progress: Progress, workers: Workers) -> list[Branch]:
    """The searches on every base that was worth it, the declared one first, with the names that can be trusted."""
    return [_trusted(branch, asked) for branch in _searched(declared, asked, progress, workers)]


def chosen_of(branches: Sequence[Branch], asked: Thresholds) -> Branch:
    """The first that explains all, or the one with the least misfit.

    Where the declared density leaves hardly more than another, its few unknowns speak for it: they predict other runs
    better. Against one that explains all they do so only near the noise and together with an effect.
    """
    explaining = [branch for branch in branches if branch.explains(asked)]
    declared, best = branches[0], min(explaining[:1] or branches, key=lambda branch: branch.final.over_noise)
    plainer = declared.final.over_noise <= asked.plainer * best.final.over_noise
    is_named = any(step.accepted for step in declared.steps) and max(declared.final.ratios) < asked.near_floor
    return declared if plainer and (is_named or not explaining) else best


def _is_near(found: Hypothesis, other: float, asked: Thresholds) -> bool:
    """Whether what is left is near the noise in every run, and in all hardly more than another leaves."""
    return max(found.ratios) < asked.near_floor and found.over_noise <= asked.plainer * other


def _searched(declared: Hypothesis, asked: Thresholds, progress: Progress, workers: Workers) -> list[Branch]:
    """On the declared base and, where that leaves something, on others.

    Where one of those leaves far less without an effect than the declared one with its best, the declared density is
    wrong: more effects beside it would stand for what it lacks, so until then only those are tried that promise much.
    Where the runs are one loop, effects beside the declared density say no more than another density does.
    """
    if declared.staged.has_past:  # what is left of a past must not be won by an effect
        declared = taken_on(declared, asked)
    densities = _Densities(declared, Search(asked.on_flexible(), progress=progress, workers=workers))
    search = Search(
        asked,
        progress=progress,
        workers=workers,
        origins=lambda: _origins(declared),
        sooner=lambda: with_declared_kinetics(declared),
        is_lost=lambda: declared.fit.ratio > asked.in_sight and densities.leave_far_less(asked),
    )
    blind = search.blind(declared)
    if not search.at_floor(declared) and any(each.takes_all for each in blind):
        return [_on_declared(declared, ()), *_on_densities(densities, asked)]
    elements = _Elements(declared, Search(asked.on_elements(), progress=progress, workers=workers))
    # they are tried sooner than effects there; in one hold they take minutes
    if declared.fit.ratio > (asked.reachable if blind else asked.elements_sooner) and elements.tell(asked):
        return [_on_declared(declared, ()), elements.branch]
    if not blind and declared.fit.ratio > asked.rateless_sooner and densities.tell(asked):
        others = [] if densities.on_relays.explains(asked) else elements.branches(densities.on_relays.final, asked)
        return [_on_declared(declared, ()), densities.on_relays, *others]
    steps = dataclasses.replace(search, thresholds=asked.on_trial()).run(declared)
    better = _better(declared, steps)
    if better is not declared:  # what it had not come down by may be all that was explained
        return _searched(better, asked, progress, workers)
    if not search.explains(steps, declared) and search.is_half_told(steps):
        # minutes sooner than by way of every other base
        undecided = dataclasses.replace(steps[0], accepted=(), tied=())
        paired = search.with_pair([undecided], declared)
        steps = paired if search.explains(paired, declared) else steps
    lawful = _on_free_law(declared, steps, search)
    if lawful is not None:
        return [lawful]
    if declared.fit.ratio <= asked.reachable:
        steps = search.with_wandering(steps, declared)
    branch = _on_declared(declared, tuple(steps))
    if search.explains(steps, declared) or (branch.final.effects and _is_near(branch.final, 1.0, asked)):
        return [branch]  # no other could leave so much less that it were believed instead
    others = elements.branches(branch.final, asked)
    if not any(other.explains(asked) for other in others):
        others += _on_densities(densities, asked)
    told = [other for other in others if other.explains(asked) or _outdoes(other, steps, search)]
    if any(not other.is_all_seen for other in told):
        return [branch, *others]
    if told:  # a density that was fitted to all says little against two effects beside the declared one
        paired = search.with_pair(steps, declared)
        return [_on_declared(declared, tuple(paired)) if search.explains(paired, declared) else branch, *others]
    steps = search.continued([step for step in steps if step.accepted] or steps, declared)
    if others[-1].steps:
        steps = search.with_pair(steps, declared)  # two at once takes longest: so last
    return [dataclasses.replace(branch, steps=tuple(steps)), *others]


def _on_declared(declared: Hypothesis, steps: tuple[Step, ...]) -> Branch:
    is_many = any(isinstance(link, Polycrystal) for link in declared.staged.chain.links)
    return Branch("gaussian" if is_many else "none", declared, steps)


def _on_free_law(declared: Hypothesis, steps: Sequence[Step], search: Search) -> Branch | None:
    """The search beside a strain law with more powers, where that is all that is missing beside an effect.

    An effect takes up what a wrong law leaves, and so do its rivals: a lag of 3 x beside another law tied with a
    bandwidth and a mode, and is named beside the right one.
    """
    final, curve = steps[-1].after, SensorNonlinearity.kind  # which is a strain law itself
    if search.at_floor(final) or curve in final.effects:
        return None
    found = [final, *(each.after for each in steps[-1].candidates)]
    freed = search.workers.map(with_free_law, [each for each in found if each.effects and curve not in each.effects])
    if not any(there is not None and search.at_floor(there) for there in freed):
        return None
    base = with_free_law(declared)
    if base is None:
        return None
    search = dataclasses.replace(search, thresholds=search.thresholds.on_free_law())
    branch = dataclasses.replace(_on_declared(base, tuple(search.run(base))), has_free_law=True)
    return branch if search.explains(branch.steps, base) else None


def _better(declared: Hypothesis, steps: Sequence[Step]) -> Hypothesis:
    """The base from where an effect had taken it, or taken to its bottom; as it is where that gains too little."""
    instead = steps[0].base_instead
    if instead is not None and instead.total <= _COMES_DOWN * declared.total:
        return instead
    return to_the_bottom(declared) if any(step.accepted for step in steps) else declared


def _origins(declared: Hypothesis) -> Iterator[Hypothesis]:
    """Where else the search for a first effect may start: without made-up histories, and at the values as declared."""
    plain = without_histories(declared)
    if plain is not None:
        yield plain
    yield fitted(declared.staged, declared.staged.start, most_steps=0)


@dataclass(frozen=True)
class _Elements:
    """Elements that slip in place of a declared density, fitted and searched when they are first asked for.

    Attributes:
        declared: the fitted declared model.
        search: on elements.
    """

    declared: Hypothesis
    search: Search

    @cached_property
    def base(self) -> Hypothesis | None:
        """Without an effect; None where a run has a past."""
        return fit_bouc_wen(self.declared, self.search.progress)

    @cached_property
    def branch(self) -> Branch:
        """The search on it, which has to be there."""
        assert self.base is not None
        return self._searched(self.base, self.search)

    def tell(self, asked: Thresholds) -> bool:
        """Whether they explain all, or leave far less than the declared base and are searched to near the noise."""
        base = self.base
        if base is None or base.excess > asked.elements_outdone * self.declared.excess:
            return False
        is_far_better = base.excess <= asked.outdone * self.declared.excess
        is_near = is_far_better and self.branch.final.fit.ratio <= asked.rateless_nameable
        return is_near or self.branch.explains(asked)

    def branches(self, found: Hypothesis, asked: Thresholds) -> list[Branch]:
        """The search on elements, where they leave far less than another base beside the same effects or without any.

        A large effect hides by how much they are better, and leads them astray where they are fitted without it: then
        the search begins with what they are beside it.
        """
        if self.base is None:
            return []
        beside = fit_bouc_wen(found, self.search.progress) if found.effects else None
        if beside is not None and beside.excess <= asked.outdone * found.excess:
            place = _bare(beside)
            return [self._searched(self.base, dataclasses.replace(self.search, sooner=lambda: [place]))]
        return [self.branch] if self.base.excess <= asked.outdone * self.declared.excess else []

    @staticmethod
    def _searched(base: Hypothesis, search: Search) -> Branch:
        return Branch("none", base, () if search.at_floor(base) else tuple(search.with_pair(search.run(base), base)))


def _bare(found: Hypothesis) -> Hypothesis:
    """The base where its effects had taken it."""
    staged, vector = found.staged, found.vector
    for name in found.effects:
        staged, kept = staged.without(name)
        vector = vector[kept]
    return fitted(staged, vector, most_steps=0)


@dataclass(frozen=True)
class _Densities:
    """Densities in place of a declared one, identified and searched when they are first asked for.

    To identify one takes seconds, and minutes to search for effects on a base that was wrong.

    Attributes:
        declared: the fitted declared model.
        search: on a flexible base.
    """

    declared: Hypothesis
    search: Search

    @cached_property
    def relays(self) -> Hypothesis | None:
        """Those that know no rate, without an effect; None where a run has a past."""
        return fit_rate_independent(self.declared, self.search.progress)

    @cached_property
    def on_relays(self) -> Branch:
        """The search on them, which have to be there."""
        assert self.relays is not None
        at_floor = self.search.at_floor(self.relays)
        return Branch("identified", self.relays, ()) if at_floor else _on_density(self.relays, self.search)

    @cached_property
    def lattice(self) -> Hypothesis:
        """Domains that know a rate, without an effect."""
        return fit_flexible(self.declared, self.search.progress)

    def tell(self, asked: Thresholds) -> bool:
        """Whether relays without a rate leave little without an effect, and tell nearly all with one or without."""
        base = self.relays
        if base is None or base.fit.ratio > asked.nameable:
            return False
        if base.excess > asked.rateless_outdone * self.declared.excess:
            return False
        is_told = self.on_relays.explains(asked) or _is_told(self.on_relays, self.search)
        return is_told and _may_be_named(self.on_relays, asked)

    def leave_far_less(self, asked: Thresholds) -> bool:
        """Whether one of them leaves so much less without an effect that the declared density is wrong."""
        most = asked.outdone * self.declared.excess
        return (self.relays is not None and self.relays.excess < most) or self.lattice.excess < most


def _on_densities(densities: _Densities, asked: Thresholds) -> list[Branch]:
    """The identified densities that are worth it, with the search on each that leaves something.

    Relays that know no rate need no lattice beside them where they explain all, or nearly all of what is missing. Where
    they leave hardly more than a lattice, that was bent to make up for an effect, or for the rate that it cannot lose.
    """
    search, rateless = densities.search, densities.relays
    progress, workers = search.progress, search.workers
    if rateless is not None and search.at_floor(rateless):
        return [densities.on_relays]
    flexible = densities.lattice
    is_clean = flexible.fit.ratio <= asked.floor  # hardly anything is left there in which an effect could show itself
    found: list[Branch] = []
    if rateless is not None and rateless.total < asked.rateless * flexible.total and not is_clean:
        found = [densities.on_relays]
        if found[0].explains(asked) or _is_told(found[0], search):
            return found
    lattice = dataclasses.replace(search, thresholds=asked.on_lattice())
    foretold = _foretold(flexible, lattice) if is_clean and not search.at_floor(flexible) else None
    if foretold is not None:
        return [*found, foretold]
    seen = _on_all_seen(flexible, asked, progress, workers)
    if is_clean or seen.explains(asked):
        return [*found, seen]
    alone = _on_density(flexible, lattice)
    tells_more = bool(seen.final.effects) and _may_be_named(seen, asked) and not alone.final.effects
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


def _on_density(base: Hypothesis, search: Search) -> Branch:
    """The search on a density; two effects at once are not sought beside one that explains nearly all.

    What is left then is what the density is off by, or the shape of the effect: beside a fatigue of 10 x a drift and a
    bias field were named.
    """
    branch = Branch("identified", base, tuple(search.run(base)))
    if _is_told(branch, search):
        return branch
    return dataclasses.replace(branch, steps=tuple(search.with_pair(branch.steps, base)))


def _is_told(branch: Branch, search: Search) -> bool:
    """Whether its effects tell nearly all that its base leaves."""
    return bool(branch.final.effects) and share_of(branch.base, branch.final) > search.thresholds.whole


def _outdoes(other: Branch, steps: Sequence[Step], search: Search) -> bool:
    """Whether another base leaves far less than a search did, without an effect or with one that tells nearly all."""
    return search.is_outdone(steps, other.final if _is_told(other, search) else other.base)


def _on_all_seen(flexible: Hypothesis, asked: Thresholds, progress: Progress, workers: Workers) -> Branch:
    """The search on a density that was fitted to what chooses, too, if it has to bend for both.

    A density that few runs determine takes up what an effect does there, and what chooses then shows what it is off by
    rather than the effect. Beside nothing that is missing it comes down to the noise in all that is seen.
    """
    search = Search(asked.on_all_seen(), progress=progress, workers=workers)
    if search.at_floor(flexible):
        return Branch("identified", flexible, ())
    progress("identifying the density from what chooses, too")
    seen = fitted_to_all(flexible)
    steps = [] if search.at_floor(seen) else search.run(seen)
    return Branch("identified", seen, tuple(steps), is_all_seen=True)


def _trusted(branch: Branch, asked: Thresholds) -> Branch:
    """The branch without its names where too much is left beside them."""
    if _may_be_named(branch, asked):
        return branch
    left = branch.final.fit.ratio
    unchecked = "" if branch.final.choosing else " without a test run"
    return branch.without_names(
        f"{left:.2g} x the noise is left in the end: with so much unexplained no name is to be trusted{unchecked}"
    )


def _may_be_named(branch: Branch, asked: Thresholds) -> bool:
    """Whether what is left lets names be trusted; a tie claims less than a name, so less is asked of it."""
    left = branch.final.fit.ratio
    knows_no_rate = branch.base.staged.ceramic.knows_no_rate
    if left > (asked.rateless_nameable if knows_no_rate else asked.nameable):
        return False
    alone = any(step.accepted and not step.tied for step in branch.steps)
    if alone and not branch.final.choosing and left > asked.unchecked_nameable:
        return False
    return left <= asked.doubtful or not alone or share_of(branch.base, branch.final) >= asked.pair_share
