"""Refits taken further: until they are exact, come down no more, leave a bound, or hold their density more firmly."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import repeat

import numpy as np

from pzt_ros.diagnosis.bottom import to_the_bottom
from pzt_ros.diagnosis.candidates import Candidate, gain_of
from pzt_ros.diagnosis.coordinates import coordinate
from pzt_ros.diagnosis.elsewhere import from_elsewhere
from pzt_ros.diagnosis.finish import finished
from pzt_ros.diagnosis.going_on import counted_otherwise
from pzt_ros.diagnosis.histories import with_histories_of
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.screen import Prospect
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.errors import BenchError
from pzt_ros.parallel import Workers

REFIT_STEPS = 12
_MANY, _ENOUGH, _FEW_STEPS = 100, 8_000, 3
"""Unknowns beyond which refits begin on so many samples, and the steps on all of them after that."""
_POLISHES, _COMES_DOWN = 4, 0.995  # times that the best is taken on, and what has to be left of it each time at most
_RIVAL = 0.6  # of the best one's gain
_AT_BOUND = 1e-6  # of the way to the other bound


def refits(prospects: Sequence[Prospect], effects: tuple[str, ...], workers: Workers) -> list[Hypothesis | None]:
    """Of each the best from where it begins, and from where it was refined from; None where none is possible."""
    begins = [(n, each) for n, p in enumerate(prospects) for each in (p, p.coarse) if each is not None]
    found = list(workers.map(_refit, [begin for _, begin in begins], repeat(effects)))
    reached = [
        [there for (of, _), there in zip(begins, found, strict=True) if of == n and there]
        for n in range(len(prospects))
    ]
    return [min(each, key=lambda there: there.total, default=None) for each in reached]


def _refit(begin: Prospect, effects: tuple[str, ...]) -> Hypothesis | None:
    names, steps = (*effects, begin.effect.name), REFIT_STEPS
    with suppress(BenchError):
        start = begin.best_start()
        sparse = begin.staged.sparse(_ENOUGH) if start.size > _MANY else begin.staged
        if sparse is not begin.staged:
            start, steps = fitted(sparse, start, names, steps).vector, _FEW_STEPS
        return fitted(begin.staged, start, names, steps)
    return None


def seen_as(before: Hypothesis, prospect: Prospect) -> Hypothesis:
    """What there was without an effect, its runs seen as with it: what only dies out in them is not the effect's."""
    runs = prospect.staged.runs
    if [run.fades for run in runs] == [run.fades for run in before.staged.runs]:
        return before
    return fitted(replace(before.staged, runs=runs), before.vector, before.effects, REFIT_STEPS)


def rivals_of(found: Sequence[Candidate]) -> list[Candidate]:
    """Those that gain so much of what the best gains that a ceramic that is exact could put them first.

    What chooses is not asked alone: an approximation that fails there would hide all.
    """
    where_fitted = [candidate.before.fit.total - candidate.after.fit.total for candidate in found]
    both = [candidate.before.total - candidate.after.total for candidate in found]
    return [
        candidate
        for candidate, here, there in zip(found, where_fitted, both, strict=True)
        if here >= _RIVAL * max(0.0, *where_fitted) or there >= _RIVAL * max(0.0, *both)
    ]


def polished(candidates: tuple[Candidate, ...], asked: Thresholds, workers: Workers) -> tuple[Candidate, ...]:
    """Those that explain enough at their bottom, the best taken on for as long as it comes down.

    What a refit leaves that could come further would make others look as good. Where none explains a fifth, none would
    come to half.
    """
    if max((candidate.fit_share for candidate in candidates), default=0.0) < asked.half_share:
        return tuple(sorted(candidates, key=lambda c: c.after.total))
    bent = [candidate for candidate in candidates if candidate.fit_share >= asked.share]
    afters = workers.map(to_the_bottom, workers.map(stiffened, [each.after for each in bent], repeat(asked)))
    held = {candidate.name: after for candidate, after in zip(bent, afters, strict=True)}
    tried = (replace(candidate, after=held.get(candidate.name, candidate.after)) for candidate in candidates)
    best, *others = sorted(tried, key=lambda c: c.after.total)
    there = counted_otherwise(best.after)
    places = [there]
    if _may_come_down(there, asked):
        places += off_bounds(there)
    if max(there.ratios) > asked.floor and there.fit.ratio <= asked.polishable:
        places.append(from_elsewhere(there, asked))
    lowest = min(places, key=lambda found: found.total)
    if lowest.fit.ratio <= asked.polishable:
        lowest = detailed(lowest, asked)
    best = replace(best, after=taken_on(lowest, asked))
    rivals = [candidate for candidate in others if candidate.fit_share >= asked.share]
    afters = workers.map(with_histories_of, [rival.after for rival in rivals], repeat(best.after))
    told = dict(zip(rivals, afters, strict=True))
    others = [replace(candidate, after=told.get(candidate, candidate.after)) for candidate in others]
    return tuple(sorted((best, *others), key=lambda c: c.after.total))


def taken_on(found: Hypothesis, asked: Thresholds) -> Hypothesis:
    """Refitted for as long as it comes down."""
    for _ in range(_POLISHES):
        if not _may_come_down(found, asked):
            break
        after = finished(found, True)
        if after.total > _COMES_DOWN * found.total:
            break
        found = after
    return found


def stiffened(weak: Hypothesis, asked: Thresholds) -> Hypothesis:
    """With a stronger prior on the density where that predicts better: without its effect, it had to bend for that."""
    best = weak
    may_predict_better = bool(weak.choosing) and _may_come_down(weak, asked)
    for ceramic in weak.staged.ceramic.stiffer() if may_predict_better else ():
        held = finished(fitted(replace(weak.staged, ceramic=ceramic), weak.vector, weak.effects, 0), True)
        if held.total >= best.total:  # a prior that is stronger still predicts no better, either
            break
        best = held
    return best


def off_bounds(found: Hypothesis) -> list[Hypothesis]:
    """Refitted from the middle of what its last effect has at a bound: that may only be where the search began."""
    staged = found.staged
    own, kind = staged.ceramic.start.size, found.effects[-1]
    low, high = staged.bounds
    begin = found.vector.copy()
    for place, each in enumerate(staged.coordinates, start=own):
        room = _AT_BOUND * (high[place] - low[place])
        at_bound = min(begin[place] - low[place], high[place] - begin[place]) < room
        if each.kind == kind and not each.is_log and each.run is None and at_bound:
            begin[place] = 0.5 * (low[place] + high[place])
    if np.array_equal(begin, found.vector):
        return []
    return [finished(fitted(staged, begin, found.effects, REFIT_STEPS), True)]


def detailed(found: Hypothesis, asked: Thresholds) -> Hypothesis:
    """Refitted with the details of its last effect, where the runs show them; else as it is."""
    staged, name = found.staged, found.effects[-1]
    link = next(link for link in staged.chain_at(found.vector).links if link.kind == name)
    known = {each.field for each in staged.coordinates if each.kind == name}
    details = tuple(coordinate(link, field) for field in EFFECT_OF[name].details if field not in known)
    if not details:
        return found
    freed = replace(staged, coordinates=(*staged.coordinates, *details))
    begin = np.concatenate((found.vector, [each.scaled(each.start) for each in details]))
    after = finished(fitted(freed, begin, found.effects, REFIT_STEPS), True)
    are_shown = gain_of(found.fit, after.fit) > asked.fit_gain and after.total < found.total
    return after if are_shown else found


def _may_come_down(found: Hypothesis, asked: Thresholds) -> bool:
    return max(found.ratios) > asked.unpolished and found.fit.ratio <= asked.polishable
