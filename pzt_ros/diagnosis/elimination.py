"""Effects taken out again: what one explained before others were found, these or the strain law may explain as well."""

from __future__ import annotations

from dataclasses import replace

from pzt_ros.diagnosis.candidates import Candidate, Step, share_of
from pzt_ros.diagnosis.finish import finished
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.identifiability import DENSITY
from pzt_ros.diagnosis.refinement import REFIT_STEPS, taken_on
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.strain_laws import STRAIN_LAW, with_free_law
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.effects.strain_polarization_hysteresis import StrainPolarizationHysteresis
from pzt_ros.errors import BenchError


def without(found: Hypothesis, name: str) -> Hypothesis | None:
    """Refitted without one of its effects, from where it is; None where the model cannot be evaluated there."""
    plain, kept = found.staged.without(name)
    others = tuple(each for each in found.effects if each != name)
    try:
        return finished(fitted(plain, found.vector[kept], others, REFIT_STEPS), True)
    except BenchError:  # a drive that the effect kept within the range of a table may leave it
        return None


def second_alone(steps: list[Step], asked: Thresholds) -> list[Step]:
    """The steps, or one in their place with the second of two effects alone, where the first adds little beside it."""
    begin, final = steps[0], steps[-1].after
    first, *later = final.effects or ("",)
    if len(later) != 1 or any(step.tied for step in steps):
        return steps
    alone = without(final, first)
    if alone is None or share_of(alone, final) >= asked.share:
        return steps
    candidate = Candidate(later[0], begin.before, alone)
    others = [each for each in begin.candidates if each.name != candidate.name]
    verdict = f"explains {candidate.share:.0%} of the excess, {first} hardly more beside it"
    return [replace(begin, candidates=(candidate, *others), accepted=(candidate,), verdict=verdict)]


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
    return [*steps[:place], *_left_open(steps[place], curve, STRAIN_LAW), *steps[place + 1 :]]


def hysteresis_in_question(steps: list[Step], asked: Thresholds) -> list[Step]:
    """The steps, with a hysteresis of the strain left open that the base may lack itself.

    Elements that slip, and relays that know no rate, are few or coarse; a hysteresis beside them that does not explain
    all may be one of theirs.
    """
    if max(steps[-1].after.ratios) <= asked.floor or not steps[-1].after.staged.ceramic.knows_no_rate:
        return steps
    opened = [[step] if step.tied else _left_open(step, StrainPolarizationHysteresis.kind, DENSITY) for step in steps]
    return [step for parts in opened for step in parts]


def _left_open(step: Step, name: str, other: str) -> list[Step]:
    """A step with one of its effects tied with something else; two that it added at once become two steps."""
    if name not in [each.name for each in step.accepted]:
        return [step]
    parts = [replace(step, candidates=(each,), accepted=(each,)) for each in step.accepted]
    parts[0] = replace(parts[0], candidates=step.candidates)
    return [replace(part, tied=(name, other)) if part.accepted[0].name == name else part for part in parts]
