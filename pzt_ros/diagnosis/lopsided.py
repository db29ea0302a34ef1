"""Interaction fields that prefer a direction, where that is what looks like a bias field or a curve of the sensor."""

from __future__ import annotations

from collections.abc import Sequence

from pzt_ros.diagnosis.base import with_pasts
from pzt_ros.diagnosis.candidates import Step
from pzt_ros.diagnosis.elimination import without
from pzt_ros.diagnosis.from_rest import as_virgin
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.shaped import lopsided, may_be_lopsided
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.effects.bias_field import BiasField
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.effects.table import reported
from pzt_ros.parallel import Workers

_ALIKE = frozenset({BiasField.kind, SensorNonlinearity.kind})


def lopsided_instead(declared: Hypothesis, steps: Sequence[Step], search: Search) -> Hypothesis | None:
    """The base with such fields, where they leave far less than it, and less than any bias field beside it.

    A curve of the sensor and a bias field come near such a direction, and it near them: of one that left 21 x a curve
    left 6 x, and it 1.1 x. So it is asked where one of these was found, or effects do not leave the noise.
    """
    asked, found = search.thresholds, steps[-1].after
    if not may_be_lopsided(declared) or search.limit.is_over():
        return None
    if search.at_floor(found) and not _ALIKE & {reported(name) for name in found.effects}:
        return None
    search.progress("fitting interaction fields that prefer a direction")
    base = min((lopsided(place) for place in _places(declared)), key=lambda each: each.total)
    biased = [each.after for each in steps[0].candidates if each.cause == BiasField.kind]
    is_less = base.excess <= asked.outdone * declared.excess
    is_told_better = found.fit.ratio <= asked.in_sight and base.total >= found.total
    if not is_less or is_told_better or any(base.excess > asked.lopsided_less * each.excess for each in biased):
        place = _hidden_by(steps, search)
        return None if place is None else _beside(place, search)
    return exact(base) if base.staged.has_past else with_pasts(base, search.progress, search.workers)


def _hidden_by(steps: Sequence[Step], search: Search) -> Hypothesis | None:
    """The base beside one effect, no bias field, that explains enough and leaves something, but is no longer far off.

    Where a curve and a bias field tie, which such fields look like, it is what explains nearly all beside those,
    without them: a current limit of 10 x beside tilted thresholds.
    """
    if search.limit.is_over():
        return None
    asked, last, place = search.thresholds, steps[-1], steps[-1].after
    most = asked.in_sight
    is_alike = frozenset(map(reported, steps[0].tied)) >= _ALIKE
    if is_alike and last is not steps[0] and last.candidates and last.candidates[0].fit_share > asked.whole:
        bare = without(last.candidates[0].after, steps[0].tied[0])
        place, most = (place, most) if bare is None else (bare, asked.reachable)
    if len(place.effects) != 1 or reported(*place.effects) == BiasField.kind:
        return None
    return None if search.at_floor(place) or place.fit.ratio > most else place


def _beside(found: Hypothesis, search: Search) -> Hypothesis | None:
    """The base with such fields, where they take what one effect leaves to the noise, and no bias field does as much.

    An effect of 10 x that is there hides by how much they are better without it: of a curve beside tilted thresholds
    Gaussians left 7 x, of which it explained 92 %, such fields without it no less, and beside it the noise.
    """
    asked = search.thresholds
    search.progress("fitting interaction fields that prefer a direction" + found.beside)
    there = exact(lopsided(found))
    if max(there.ratios) > asked.flexible_remains:
        return None
    biased = search.with_effects(found, [BiasField.kind])
    if there.excess > asked.lopsided_less * biased.excess:
        return None
    return without(there, *found.effects)


def lopsided_undeclared(
    found: Hypothesis, virgin: Hypothesis, asked: Thresholds, progress: Progress, workers: Workers
) -> Hypothesis:
    """A polycrystal that nobody declared with such fields, where it is too far off for names without and that is less.

    On a stage that was never driven they look as if it had been poled. A hum of 10 x beside them was sought for minutes
    beside relays and a lattice: a virgin polycrystal left 16 x, a poled one 9.7, and with such fields 8.9, the hum.

    Args:
        found: fitted, its runs poled before or not.
        virgin: the same with every run starting where it begins.
        asked: of an effect.
        progress: is told what is being done.
        workers: for the fit of a bias field.
    """
    if virgin.staged.has_past or found.fit.ratio <= asked.finishable:
        return found
    base = lopsided(virgin)
    if base.excess > asked.lopsided_outdone * virgin.excess or base.total >= found.total:
        return found
    biased = Search(asked, progress=progress, workers=workers).with_effects(virgin, [BiasField.kind])
    return base if base.excess <= asked.lopsided_less * biased.excess else found


def _places(declared: Hypothesis) -> list[Hypothesis]:
    """Where such fields may start: on a virgin ceramic where runs begin at rest, and with the pasts that were found."""
    poled = any(run.poled for run in declared.staged.runs)
    if declared.staged.has_past:
        return [declared]
    return [as_virgin(declared), *([declared] if poled else [])]
