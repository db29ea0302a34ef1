"""Effects taken out again: what one explained before others were found, these or the strain law may explain as well."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pzt_ros.diagnosis.candidates import Candidate, Step, share_of
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.finish import finished
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.identifiability import DENSITY
from pzt_ros.diagnosis.refinement import REFIT_STEPS, taken_on
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.strain_laws import STRAIN_LAW, with_free_law
from pzt_ros.effects.bias_field import BiasField
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.effects.strain_polarization_hysteresis import StrainPolarizationHysteresis
from pzt_ros.effects.table import reported
from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array, Rest, Signals

_STAYS = 0.05  # share of a bias field by which it changes in a run that hardly changes it


def without(found: Hypothesis, name: str) -> Hypothesis | None:
    """Refitted without one of its effects, from where it is; None where the model cannot be evaluated there."""
    plain, kept = found.staged.without(name)
    others = tuple(each for each in found.effects if each != name)
    try:
        return finished(fitted(plain, found.vector[kept], others, REFIT_STEPS), True)
    except BenchError:  # a drive that the effect kept within the range of a table may leave it
        return None


def needed_only(
    steps: list[Step],
    is_needed: Callable[[Candidate], bool],
    anew: Callable[[Hypothesis], Hypothesis] | None = None,
) -> list[Step]:
    """The steps, or one in their place with what is needed of several effects.

    The first of them explained most without the others, and may be none: a drift, which makes up for much, came before
    the bias field that explained all; another had stood for a creep and a hysteresis, and was kept beside both, at a
    bound and with an error fifty times its value. Of two, the last may tie with a strain law: what came before it had
    stood for that.

    Args:
        steps: of a search.
        is_needed: whether an effect shows itself beside the others, in what it leaves of them and without it.
        anew: a base fitted anew, where it had bent for the effects; none where it does not.
    """
    final, tied = steps[-1].after, steps[-1].tied
    is_law = len(steps) == len(final.effects) == 2 and STRAIN_LAW in tied and not steps[0].tied
    if len(final.effects) < 2 or (any(step.tied for step in steps) and not is_law):
        return steps
    for name in final.effects[:-1]:
        bare = without(final, name)
        bare = anew(bare) if anew is not None and bare is not None else bare
        step = _at_once(steps[0], bare) if bare is not None and not is_needed(Candidate(name, bare, final)) else None
        if step is not None:
            return needed_only([replace(step, tied=tied)], is_needed, anew)
    return steps


def _at_once(begin: Step, found: Hypothesis) -> Step | None:
    """A step that adds all effects of a hypothesis, each to what is left without it and those after it.

    None where one of those cannot be evaluated.
    """
    added: list[Candidate] = []
    here, (_, *later) = found, found.effects
    for name in reversed(later):
        before = without(here, name)
        if before is None:
            return None
        added.insert(0, Candidate(name, before, here))
        here = before
    added.insert(0, Candidate(found.effects[0], begin.before, here))
    others = [each for each in begin.candidates if each.name not in found.effects]
    verdict = f"explains {share_of(begin.before, found):.0%} of the excess, what else was found adds hardly anything"
    return replace(begin, candidates=(*added, *others), accepted=tuple(added), tied=(), verdict=verdict)


def is_law_as_good(bare: Hypothesis, curved: Hypothesis, asked: Thresholds) -> bool:
    """Whether a free strain law leaves hardly more than a sensor's curve does; `bare` is the model without either.

    A law that ends a power below the true one does not come to the floor that the curve, which has five more, comes to.
    """
    law = with_free_law(bare)
    left = bare if law is None else taken_on(law, asked)  # a law that is free already has no power to add
    gained = bare.total - curved.total
    return left.total - curved.total <= max(asked.law_tie, asked.law_share * gained)


def law_in_question(steps: list[Step], asked: Thresholds) -> list[Step]:
    """The steps, with a sensor's curve left open that a strain law explains as well beside the effects found later."""
    final, curve = steps[-1].after, SensorNonlinearity.kind
    named = [place for place, step in enumerate(steps) if curve in [each.name for each in step.accepted]]
    if not named or steps[named[0]].tied or final.effects == (curve,):
        return steps
    bare = without(final, curve)
    if bare is None or not is_law_as_good(bare, final, asked):
        return steps
    place = named[0]
    return [*steps[:place], *_left_open(steps[place], curve, (curve, STRAIN_LAW)), *steps[place + 1 :]]


def hysteresis_in_question(steps: list[Step], asked: Thresholds) -> list[Step]:
    """The steps, with a hysteresis of the strain left open that the base may lack itself.

    Elements that slip, and relays that know no rate, are few or coarse; a hysteresis beside them that does not explain
    all may be one of theirs.
    """
    if max(steps[-1].after.ratios) <= asked.floor or not steps[-1].after.staged.ceramic.knows_no_rate:
        return steps
    name = StrainPolarizationHysteresis.kind
    opened = [[step] if step.tied else _left_open(step, name, (name, DENSITY)) for step in steps]
    return [step for parts in opened for step in parts]


def in_question(steps: Sequence[Step]) -> list[Step]:
    """The steps of a search that has ended, with what cannot stand alone left open."""
    return groups_in_question(bias_in_question(steps))


def bias_in_question(steps: Sequence[Step]) -> list[Step]:
    """The steps, with a bias field that stays as it is left open on an identified density: it is where that lies.

    Beside a lattice that correlated thresholds had bent 12.5 V were named that never changed, with nothing hidden.
    """
    final = steps[-1].after if steps else None
    if final is None or isinstance(final.staged.ceramic, DeclaredHysteresis) or not _has_constant_bias(final):
        return [*steps]
    opened = [[step] if step.tied else _left_open(step, BiasField.kind, (BiasField.kind, DENSITY)) for step in steps]
    return [step for parts in opened for step in parts]


def groups_in_question(steps: Sequence[Step]) -> list[Step]:
    """The steps, with a name left open that belongs to a group found before: none of a group is named.

    Beside tilted thresholds a curve tied with a bias field, beside it a current limit was found, and a bias field that
    was not there.
    """
    found: list[Step] = []
    for step in steps:
        groups = [former.tied for former in found if former.tied]
        parts = [step]
        for name in [] if step.tied else [each.name for each in step.accepted]:
            group = next((each for each in groups if reported(name) in map(reported, each)), None)
            if group is not None:
                parts = [new for part in parts for new in _left_open(part, name, group)]
        found += parts
    return found


def _has_constant_bias(found: Hypothesis) -> bool:
    """Whether there is a bias field that hardly changes in any run."""
    links = [link for link in found.staged.chain_at(found.vector).links if isinstance(link, BiasField)]
    courses = [_course(link, run.record.time) for link in links for run in found.staged.runs]
    return bool(courses) and all(np.std(each) <= _STAYS * abs(np.mean(each)) for each in courses)


def _course(bias: BiasField, time: Array) -> Array:
    """What a bias field does to a drive at rest [V, shape (n,)]."""
    return bias.invert(bias.init(Rest()), Signals(time=time, voltage=np.zeros_like(time)))[1].voltage


def _left_open(step: Step, name: str, tied: tuple[str, ...]) -> list[Step]:
    """A step with one of its effects tied in a group; two that it added at once become two steps."""
    if name not in [each.name for each in step.accepted]:
        return [step]
    parts = [replace(step, candidates=(each,), accepted=(each,)) for each in step.accepted]
    parts[0] = replace(parts[0], candidates=step.candidates)
    return [replace(part, tied=tied) if part.accepted[0].name == name else part for part in parts]
