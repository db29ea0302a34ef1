"""The search for effects on one base after another, and which of them is believed."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from functools import partial

from pzt_ros.diagnosis.beside_effects import BesideEffects
from pzt_ros.diagnosis.bottom import to_the_bottom
from pzt_ros.diagnosis.bouc_wen_base import elements_beside
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate, Step, share_of
from pzt_ros.diagnosis.density_alone import density_alone
from pzt_ros.diagnosis.elements import EFFECTS_ON_ELEMENTS, Elements
from pzt_ros.diagnosis.elimination import in_question, without
from pzt_ros.diagnosis.flexible_preisach import FlexiblePreisach
from pzt_ros.diagnosis.from_rest import hardly_moved, is_taken_for_virgin, poled_beside
from pzt_ros.diagnosis.histories import without_histories
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.diagnosis.identified_densities import Densities, on_densities, on_relays
from pzt_ros.diagnosis.kinetics import with_declared_kinetics
from pzt_ros.diagnosis.likeliest import beside_likeliest, on_lattice_first, on_lattice_soon, on_own_relays
from pzt_ros.diagnosis.lopsided import lopsided_instead
from pzt_ros.diagnosis.past_instead import past_instead, poled_instead
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.shaped import is_shaped, shaped
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.diagnosis.strain_laws import with_free_law
from pzt_ros.diagnosis.time_limit import TimeLimit
from pzt_ros.diagnosis.undeclared import Bases
from pzt_ros.diagnosis.whole_runs import of_whole_runs, on_all_samples, whole_instead
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.parallel import Workers
from pzt_ros.physics.polycrystal import Polycrystal

_PAIR = 2  # effects that were added at once
_SHAPED = 2  # effects beside which shapes are freed
_COMES_DOWN = 0.98  # what has to be left of a base's misfit for the search to begin anew


def branches_of(
    bases: Bases, asked: Thresholds, progress: Progress, workers: Workers, limit: TimeLimit
) -> list[Branch]:
    """The searches on every base that was worth it, the declared one first, with the names that can be trusted."""
    on_flexible = Search(asked.on_flexible(), progress=progress, workers=workers, limit=limit)
    if isinstance(bases.declared.staged.ceramic, FlexiblePreisach):  # which was found because nothing was declared
        found = [on_relays(bases.declared, on_flexible)]
    else:
        on_lattice = dataclasses.replace(on_flexible, thresholds=asked.on_lattice())
        asked = asked.on_shaped() if is_shaped(bases.declared) else asked
        found = _searched(bases, asked, progress, workers, limit)
        found = [density_alone(branch, on_lattice) for branch in found]
    found = [on_all_samples(branch, on_flexible) for branch in found]
    found = [dataclasses.replace(branch, steps=tuple(in_question(branch.steps))) for branch in found]
    return [_trusted(branch, found, asked, limit) for branch in found]


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


def _is_near(found: Hypothesis, asked: Thresholds) -> bool:
    """Whether what is left is near the noise in every run, and in all hardly more than that."""
    return max(found.ratios) < asked.near_floor and found.over_noise <= asked.plainer


def _is_as_near_as_a_past(found: Hypothesis, declared: Hypothesis, asked: Thresholds) -> bool:
    """Whether no more is left beside unknown pasts than the few reversals are off by that stand for them."""
    return declared.staged.has_past and max(found.ratios) < asked.near_floor


def _searched(bases: Bases, asked: Thresholds, progress: Progress, workers: Workers, limit: TimeLimit) -> list[Branch]:
    """On the declared base and, where that leaves something, on others.

    Where one of those leaves far less without an effect than the declared one with its best, the declared density is
    wrong: more effects beside it would stand for what it lacks, so until then only those are tried that promise much.
    Where the runs are one loop, effects beside the declared density say no more than another density does. Where the
    time is up, what was searched until then has to do.
    """
    declared = bases.declared
    if _is_as_near_as_a_past(declared, declared, asked) or limit.is_over():
        return [_on_declared(declared, ())]
    on_flexible = Search(asked.on_flexible(), progress=progress, workers=workers, limit=limit)
    densities = Densities(bases, on_flexible)
    search = Search(
        asked,
        progress=progress,
        workers=workers,
        limit=limit,
        origins=lambda: _origins(declared) if bases.is_known else iter(()),
        sooner=lambda: with_declared_kinetics(declared),
        is_lost=lambda: declared.fit.ratio > asked.in_sight and densities.leave_far_less(asked),
    )
    on_elements = dataclasses.replace(
        on_flexible,
        thresholds=asked.on_elements(),
        effects=EFFECTS_ON_ELEMENTS,
        identify=partial(elements_beside, progress=progress, settled=asked.settled),
    )
    elements = Elements(declared, on_elements)
    is_open = not (bases.is_known or search.at_floor(declared) or search.blind(declared))
    own = _on_own_relays_soon(elements, densities, search) if is_open else None
    if own is not None:
        return [_on_declared(declared, ()), own]
    if is_open and elements.tell(asked):
        return [_on_declared(declared, ()), elements.branch]  # of few numbers, and searched in seconds
    own = on_lattice_first(elements, densities, search) if is_open else None
    if own is not None:
        return [_on_declared(declared, ()), own]
    is_asked = bases.relays is not None and not (limit.is_over() or search.blind(declared))
    if is_asked and densities.tell_first(elements, asked):
        return [_on_declared(declared, ()), densities.on_relays]
    if limit.is_over():
        return [_on_declared(declared, ()), *elements.searched, *densities.searched]
    if _may_hide_a_past(bases, elements, asked):
        found = search.beside(declared)
        search = dataclasses.replace(search, known=(declared, found))
        base = poled_instead(found, asked)
        if base is not None:
            return _begun_anew(bases._replace(declared=base, relays=None), search)
    sooner = _sooner(bases, elements, densities, search)
    if sooner or limit.is_over():
        return [_on_declared(declared, ()), *(sooner or (*elements.searched, *densities.searched))]
    return _beside_effects(bases, elements, densities, search)


def _begun_anew(bases: Bases, search: Search) -> list[Branch]:
    return _searched(bases, search.thresholds, search.progress, search.workers, search.limit)


def _beside_effects(bases: Bases, elements: Elements, densities: Densities, search: Search) -> list[Branch]:
    """On the declared base with effects; begun anew where one shows another past, or a better place, of that base."""
    declared, asked, limit = bases.declared, search.thresholds, search.limit
    beside = BesideEffects(dataclasses.replace(search, thresholds=asked.on_flexible()), asked)
    trial = dataclasses.replace(search, thresholds=asked.on_trial(), is_told=beside.tell_soon)
    first = _first_far_off(declared, trial)
    own = on_lattice_soon(first.candidates, densities, search) if first and _leaves_much(first, search) else None
    if first and own:
        return [_on_declared(declared, (first,)), own]
    steps = trial.continued([first], declared) if first else trial.run(declared)
    if beside.told is not None:
        return [_on_declared(declared, tuple(steps)), beside.told]
    base = whole_instead(steps, search)
    if base is not None:
        return _begun_anew(bases._replace(declared=base, relays=None, is_whole=True), search)
    if not search.explains(steps, declared) and limit.is_over():
        return [_on_declared(declared, tuple(steps)), *elements.searched, *densities.searched]
    is_far_off = not search.explains(steps, declared) and steps[-1].after.fit.ratio > asked.in_sight
    base = lopsided_instead(declared, steps, search)
    if base is not None:
        shapes = dataclasses.replace(search, thresholds=asked.on_shaped())
        return _begun_anew(bases._replace(declared=base, relays=None), shapes)
    are_shapes_all = is_far_off and _shapes_come_down([steps[0].after], search)
    on_shapes = _on_shapes(declared, shaped(declared), search) if are_shapes_all else None
    if on_shapes is not None:
        return [on_shapes]
    base = None if bases.is_whole or search.explains(steps, declared) else past_instead(steps, asked)
    if base is not None and not limit.is_over():
        return _begun_anew(bases._replace(declared=base, relays=None), search)
    if not search.explains(steps, declared) and densities.lattice_is_all(steps[-1].after, asked):
        return [_on_declared(declared, tuple(steps)), *on_densities(densities, asked)]
    is_asked = is_far_off and first is None and not limit.is_over()
    own = beside_likeliest(steps[0].candidates, densities, search) if is_asked else None
    if own is not None:
        return [_on_declared(declared, tuple(steps)), own]
    better = _better(declared, steps)
    if better is not declared and not limit.is_over():  # what it had not come down by may be all that was explained
        return _begun_anew(bases._replace(declared=better), search)
    return _ended(declared, steps, beside, elements, densities, search)


def _ended(
    declared: Hypothesis,
    steps: list[Step],
    beside: BesideEffects,
    elements: Elements,
    densities: Densities,
    search: Search,
) -> list[Branch]:
    """Two effects at once, other laws and shapes, readings that wander, and where that is not all the other bases."""
    asked, limit = search.thresholds, search.limit
    if not search.explains(steps, declared) and search.is_half_told(steps):
        # minutes sooner than by way of every other base
        undecided = dataclasses.replace(steps[0], accepted=(), tied=())
        paired = search.with_pair([undecided], declared)
        poled = None if search.explains(paired, declared) else _on_poled(paired, search)
        if poled is not None:
            return [poled]
        steps = paired if search.explains(paired, declared) else steps
    freer = _on_free_law(declared, steps, search) or _on_free_shape(declared, steps, search)
    if freer is not None:
        return [freer]
    on_density = None if search.explains(steps, declared) else beside.on_density(steps)
    if on_density is not None:
        return [_on_declared(declared, tuple(steps)), on_density]
    is_as_near = _is_as_near_as_a_past(steps[-1].after, declared, asked)
    if declared.fit.ratio <= asked.reachable and not is_as_near:
        steps = search.with_wandering(steps, declared)
    branch = _on_declared(declared, tuple(steps))
    is_named_near = branch.final.effects and _is_near(branch.final, asked)
    if search.explains(steps, declared) or is_named_near or is_as_near:
        return [branch]  # no other could leave so much less that it were believed instead
    if limit.is_over():
        return [branch, *elements.searched, *densities.searched]
    return _with_others(branch, elements, densities, search)


def _sooner(bases: Bases, elements: Elements, densities: Densities, search: Search) -> list[Branch]:
    """Bases that are tried sooner than effects beside a declared one that leaves much, if one of them tells what it is.

    In one hold elements take minutes; relays say nothing of one loop.
    """
    declared, asked = bases.declared, search.thresholds
    blind, left = search.blind(declared), declared.fit.ratio
    takes_all = not search.at_floor(declared) and any(each.takes_all for each in blind)
    if takes_all or (not bases.is_known and densities.lattice_outdoes(elements, asked)):
        return on_densities(densities, asked)
    if left > (asked.reachable if blind else asked.elements_sooner):
        own = None if blind else _on_own_relays_soon(elements, densities, search)
        if own is not None:
            return [own]
        if elements.tell(asked):
            return [elements.branch]
    if blind or left <= asked.rateless_sooner:
        return []
    if not densities.tell(asked):
        own = None if elements.leave_much(asked) else on_own_relays(elements, densities, asked)
        return [own] if own else []
    others = [] if densities.on_relays.explains(asked) else elements.branches(densities.on_relays.final, asked)
    return [densities.on_relays, *others]


def _first_far_off(declared: Hypothesis, trial: Search) -> Step | None:
    """The first step of a search, where it begins farther from the noise than two effects of 3 x leave a base."""
    return trial.step(declared) if declared.fit.ratio > trial.thresholds.lattice_asked else None


def _leaves_much(first: Step, search: Search) -> bool:
    """Whether so much is left beside the best effect that its density may be wrong."""
    is_near = first.after.fit.ratio <= search.thresholds.in_sight or search.explains([first], first.before)
    return not (is_near or search.limit.is_over())


def _on_own_relays_soon(elements: Elements, densities: Densities, search: Search) -> Branch | None:
    """The likeliest effects each on relays of its own, where elements are too few to come near: theirs take minutes."""
    is_asked = elements.leave_much(search.thresholds) and not search.limit.is_over()
    return on_own_relays(elements, densities, search.thresholds) if is_asked else None


def _with_others(branch: Branch, elements: Elements, densities: Densities, search: Search) -> list[Branch]:
    """The branch on the declared base and those on others, it with further effects where none of those tells all."""
    declared, steps, asked = branch.base, branch.steps, search.thresholds
    others = elements.branches(branch.final, asked)
    if not any(other.explains(asked) for other in others):
        others += on_densities(densities, asked)
    told = [other for other in others if other.explains(asked) or _outdoes(other, steps, search)]
    if any(not other.is_all_seen for other in told):
        return [branch, *others]
    if told:  # a density that was fitted to all says little against two effects beside the declared one, but to a group
        paired = search.with_pair(steps, declared)
        is_decided = search.explains(paired, declared) and not any(step.tied for step in paired)
        return [_on_declared(declared, tuple(paired)) if is_decided else branch, *others]
    longer = search.continued([step for step in steps if step.accepted] or steps, declared)
    if others[-1].steps:
        longer = search.with_pair(longer, declared)  # two at once takes longest: so last
    return [dataclasses.replace(branch, steps=tuple(longer)), *others]


def _on_declared(declared: Hypothesis, steps: tuple[Step, ...]) -> Branch:
    if is_shaped(declared):
        return Branch("shaped", declared, steps)
    is_many = any(isinstance(link, Polycrystal) for link in declared.staged.chain.links)
    return Branch("gaussian" if is_many else "none", declared, steps)


def _on_poled(steps: Sequence[Step], search: Search) -> Branch | None:
    """Two names beside runs from rest that were poled before, where they tell nearly all there and each is needed."""
    found = steps[-1].after
    beside = poled_beside(found) if len(steps[-1].accepted) == _PAIR else None
    if beside is None or beside.excess > search.thresholds.outdone * found.excess:
        return None
    search.progress("refitting without " + ", ".join(beside.effects))
    first, second = beside.effects
    without_second, without_first = without(beside, second), without(beside, first)
    base = without(without_second, first) if without_second else None
    if without_first is None or without_second is None or base is None:
        return None
    needed = Candidate(first, without_first, beside), Candidate(second, without_second, beside)
    if not all(search.is_significant(each) and search.is_needed(each) for each in needed):
        return None
    pair = Candidate(first, base, without_second), needed[1]
    verdict = f"explains {share_of(base, beside):.0%} of the excess together, poled before"
    branch = _on_declared(base, (Step(base, pair, {}, pair, (), verdict),))
    return branch if branch.is_told(search.thresholds) else None


def _may_hide_a_past(bases: Bases, elements: Elements, asked: Thresholds) -> bool:
    """Whether a polycrystal that nobody declared is too far off for names, and no stage without a rate is far nearer.

    A search for effects beside others would take minutes, and so would a lattice.
    """
    declared = bases.declared
    if bases.is_known or declared.fit.ratio <= asked.finishable or not is_taken_for_virgin(declared):
        return False
    others = [elements.base, *([bases.relays] if bases.relays is not None else [])]
    return all(other.excess > asked.outdone * declared.excess for other in others)


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
    return of_whole_runs(branch, search) if search.explains(branch.steps, base) else None


def _on_free_shape(declared: Hypothesis, steps: Sequence[Step], search: Search) -> Branch | None:
    """The search beside densities that are no Gaussians, where that is all that is missing, or that beside an effect.

    Two shapes say what an identified density needs hundreds of weights for, which bend for an effect as well.
    """
    final = steps[-1].after
    base = declared if search.at_floor(final) else shaped(declared)
    if base is declared:
        return None
    helps = base.excess <= search.thresholds.shaped_less * declared.excess
    found = [final, *(each.after for each in steps[-1].candidates[:_SHAPED] if each.after is not final)]
    return _on_shapes(declared, base, search) if helps or _shapes_come_down(found, search) else None


def _shapes_come_down(found: Sequence[Hypothesis], search: Search) -> bool:
    """Whether free shapes take what is left beside one of these effects to the noise."""
    on_shapes = Search(search.thresholds.on_shaped())
    return any(map(on_shapes.at_floor, search.workers.map(shaped, [each for each in found if each.effects])))


def _on_shapes(declared: Hypothesis, base: Hypothesis, search: Search) -> Branch | None:
    """The search on a base with free shapes, where those leave less than the declared one and it explains all."""
    if base is declared:
        return None
    base, search = exact(base), dataclasses.replace(search, thresholds=search.thresholds.on_shaped())
    steps = () if search.at_floor(base) else tuple(search.run(base))
    branch = _on_declared(base, steps)
    return of_whole_runs(branch, search) if search.explains(branch.steps, base) else None


def _better(declared: Hypothesis, steps: Sequence[Step]) -> Hypothesis:
    """The base from where an effect had taken it, or taken to its bottom; as it is where that gains too little."""
    instead = steps[0].base_instead
    if instead is not None and instead.total <= _COMES_DOWN * declared.total:
        return instead
    return to_the_bottom(declared) if any(step.accepted for step in steps) else declared


def _origins(declared: Hypothesis) -> Iterator[Hypothesis]:
    """Where else the search for a first effect may start: without made-up histories, and at the values as declared.

    Poled runs have histories that nobody made up; the base is hardly moved from those values then.
    """
    place = hardly_moved(declared) or without_histories(declared)
    if place is not None:
        yield place
    yield fitted(declared.staged, declared.staged.start, most_steps=0)


def _outdoes(other: Branch, steps: Sequence[Step], search: Search) -> bool:
    """Whether another base leaves far less than a search did, without an effect or with one that tells nearly all."""
    return search.is_outdone(steps, other.final if other.is_told(search.thresholds) else other.base)


def _trusted(branch: Branch, found: Sequence[Branch], asked: Thresholds, limit: TimeLimit) -> Branch:
    """The branch without its names where too much is left beside them, or other bases were not tried that may tell.

    Where the time was up no names stand beside a base that leaves less, be it with a name that is not told, either: a
    hysteresis beside heavy tails needed a sensor's curve on the declared base, and none on the lattice.
    """
    if limit.has_cut and not (branch.is_heard or branch.explains(asked) or _is_told_best(branch, found, asked)):
        return branch.without_names("the time was up before all was tried")
    if branch.may_be_named(asked):
        return branch
    left = branch.final.fit.ratio
    unchecked = "" if branch.final.choosing else " without a test run"
    return branch.without_names(
        f"{left:.2g} x the noise is left in the end: with so much unexplained no name is to be trusted{unchecked}"
    )


def _is_told_best(branch: Branch, found: Sequence[Branch], asked: Thresholds) -> bool:
    """Whether its effects tell nearly all, and no other leaves less."""
    least = min(each.final.over_noise for each in found)
    return branch.is_told(asked) and branch.final.over_noise <= asked.plainer * least
