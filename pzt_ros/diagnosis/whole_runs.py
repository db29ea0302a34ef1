"""Effects that were taken for pasts: told where no past seemed to reach, and asked of whole runs.

Where the first samples of runs do not count, because a past that nobody recorded seemed to reach them, an effect may be
what hid there. On a ceramic that was never driven it then tells nearly all of every sample, and the search begins anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pzt_ros.diagnosis.beside_effects import BesideEffects
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Step
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.elimination import without
from pzt_ros.diagnosis.flexible import fit_rate_independent
from pzt_ros.diagnosis.flexible_preisach import FlexiblePreisach
from pzt_ros.diagnosis.from_rest import as_virgin, on_whole_runs
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.diagnosis.search import Search
from pzt_ros.physics.polycrystal import Polycrystal

_STEPS = 40


def of_whole_runs(branch: Branch, search: Search) -> Branch:
    """A search anew on the base that was never driven, where its effect tells nearly all there and explains all."""
    base = whole_instead(branch.steps, search)
    if base is None:
        return branch
    there = replace(branch, base=base, steps=tuple(search.run(base)))
    return there if search.explains(there.steps, base) else branch


def whole_instead(steps: Sequence[Step], search: Search) -> Hypothesis | None:
    """The base that was never driven, where one effect tells nearly all of what seemed to be that of pasts.

    None where there is no such effect, or the time is up.
    """
    effects = steps[-1].after.effects if steps else ()
    if len(effects) != 1 or search.limit.is_over():
        return None
    beside = whole_beside(steps[-1].after)
    if beside is None or max(beside.ratios) > search.thresholds.near_floor:
        return None
    return without(beside, *effects)


def whole_beside(found: Hypothesis) -> Hypothesis | None:
    """A model with effects fitted to all samples of runs of a ceramic that was never driven; None where all count.

    A curve of the sensor of 10 x had been taken for pasts: where none reaches a declared ceramic left 5.4 x, and the
    curve, told from those samples alone, 2 x of a run that was fitted no sample of.
    """
    if not found.effects or not any(run.since for run in found.staged.runs):
        return None
    begun = as_virgin(found)
    return exact(fitted(begun.staged, begun.vector, begun.effects, most_steps=_STEPS))


def on_all_samples(branch: Branch, search: Search) -> Branch:
    """The branch on all samples, where nothing is left of those, either; else itself.

    Relays and elements count what the declared base did, which may have taken what it lacks for pasts. A hysteresis of
    the strain beside plays was named with 2 x the noise left of whole runs, and 6.7 x of those that score, which began
    where no sample counted; relays fitted beside it to all samples left the noise of every run.
    """
    final = branch.final
    if any(step.tied or not step.accepted for step in branch.steps) or search.limit.is_over():
        return branch
    ceramic, runs = final.staged.ceramic, final.staged.runs
    is_declared = isinstance(ceramic, DeclaredHysteresis) and isinstance(ceramic.model, Polycrystal)
    if is_declared or not any(run.since for run in runs) or any(run.wander for run in runs):
        return branch
    whole = fitted(on_whole_runs(final.staged), final.vector, final.effects, _STEPS)
    if isinstance(ceramic, FlexiblePreisach):
        whole = fit_rate_independent(whole, search.progress, search.workers)
    if max(whole.ratios) > search.thresholds.near_floor:
        return branch
    there = BesideEffects(search, search.thresholds).judged(whole) if final.effects else replace(branch, base=whole)
    if there is None or not there.explains(search.thresholds):
        return branch
    return replace(branch, base=there.base, steps=there.steps)
