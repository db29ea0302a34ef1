"""Samples that no past reaches: what nobody recorded before a run acts no more once the drive was at both its ends.

A stage that was left within minor loops begins with a past of more reversals than a search finds, and parameters that
are fitted to wrong pasts defend those: of a stage that eight reversals had left where it was, nothing missing, two
reversals before each run left 1.7 x the noise and the best effect 4.8 x. Where no past reaches, the same model left
1.00 x of every run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from pzt_ros.diagnosis.data import FIT, SELECTION, RunData, seen_through
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.flexible import fit_rate_independent, tells_all
from pzt_ros.diagnosis.histories import refitted_from, with_other_pasts
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.parallel import IN_THIS_PROCESS, Workers
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.reach import first_unreached
from pzt_ros.sysid.run import Start

_CLEAN = 1.05  # rms over noise of every run up to which nothing is asked
_LESS = 0.75
"""Share of the excess that may be left where no past reaches: of stages that had been poled, and were fitted so, 0.78
and more; of one left within minor loops 0.001, and 0.4 to 0.6 where a creep was missing as well."""
_FAR_LESS = 0.1  # share of the excess of relays that they may leave where no past reaches for it to be of pasts
_PASTS_LEAVE = 0.25  # share of the excess that short pasts may leave of the samples that a past reaches
_HARMLESS = 1.01  # times what is left of a run without its past
_STEPS = 40


def where_no_past_reaches(virgin: Hypothesis, found: Hypothesis, workers: Workers) -> Hypothesis:
    """Fitted to the samples that no past of its runs from rest reaches, where that leaves far less; else as found.

    Short pasts have to describe a good deal of the other samples then, or something else is missing there.

    Args:
        virgin: fitted with every run starting where it begins.
        found: the same, or its runs poled before.
        workers: look for the pasts side by side.
    """
    if max(found.ratios) <= _CLEAN or virgin.staged.has_past:
        return found
    other = _fitted_beyond(virgin, (virgin.staged.start, virgin.vector))
    is_less = other is not None and other.excess <= _LESS * found.excess
    return other if other is not None and is_less and _has_pasts(other, virgin.staged.runs, workers) else found


def told_beyond_pasts(relays: Hypothesis, asked: Thresholds, progress: Progress, workers: Workers) -> Hypothesis:
    """Relays identified where no past of runs from rest reaches, where they leave nothing there, or far less.

    Of runs from rest one may begin on a virgin stage and another after cycles. What switches once, on the first way
    up, no other shows, and no density foretells it: of plays in which nothing was hidden relays left 1.3 x of the runs
    that had been cycled and 10 x of those that had not. With a mode of 4 x beside such a stage they left 76 x of a run
    from rest, and 4.1 x where no past reaches: what is missing is to be seen only there.
    """
    staged = relays.staged
    if tells_all(relays, asked) or staged.has_past or any(run.since for run in staged.runs):
        return relays
    runs = [counted_where_no_past_reaches(run) for run in staged.runs]
    beyond = dataclasses.replace(staged, runs=seen_through(staged.chain, runs))
    there = fit_rate_independent(fitted(beyond, relays.vector, relays.effects, most_steps=0), progress, workers)
    return there if tells_all(there, asked) or there.excess <= _FAR_LESS * relays.excess else relays


def unreached_beside(found: Hypothesis, share: float) -> Hypothesis | None:
    """A model with effects fitted to the samples that no past of its runs from rest reaches.

    Without the effect, pasts that were taken for others may leave hardly more than none. None where it leaves more than
    a share of the excess, or short pasts do not describe the other samples.
    """
    staged = found.staged
    if not found.effects or staged.has_past or any(run.since for run in staged.runs):
        return None
    if not isinstance(staged.ceramic, DeclaredHysteresis):
        return None
    other = _fitted_beyond(refitted_from(found, dict.fromkeys(range(len(staged.runs)), Start()), 0), ())
    is_less = other is not None and other.excess <= share * found.excess
    return other if other is not None and is_less and _has_pasts(other, staged.runs, IN_THIS_PROCESS) else None


def _fitted_beyond(pastless: Hypothesis, places: Sequence[Array]) -> Hypothesis | None:
    """The best fit from some places, or from where it is, to what no past reaches; None if that is all there is."""
    staged = pastless.staged
    runs = [counted_where_no_past_reaches(run) for run in staged.runs]
    if not any(run.since for run in runs):
        return None
    beyond = dataclasses.replace(staged, runs=seen_through(staged.chain, runs))
    tried = [fitted(beyond, each, pastless.effects, _STEPS) for each in places or (pastless.vector,)]
    return min(tried, key=lambda each: each.total)


def _has_pasts(found: Hypothesis, runs: Sequence[RunData], workers: Workers) -> bool:
    """Whether short pasts describe a good deal of the samples that it was not fitted to, or else more is missing."""
    whole = dataclasses.replace(found.staged, runs=seen_through(found.staged.chain, runs))
    pastless = fitted(whole, found.vector, found.effects, most_steps=0)
    return with_other_pasts(pastless, workers).excess <= _PASTS_LEAVE * pastless.excess


def with_short_pasts(found: Hypothesis, workers: Workers = IN_THIS_PROCESS) -> Hypothesis:
    """A model of samples that no past reaches with short pasts of its runs, beside all else as it is.

    They count for nothing there, but a prediction of another run begins from the like. Not so a past that spoils what
    counts: relays that were up before, and a later peak a little higher, lost a run from 1.2 to 24 x by one.
    """
    runs = found.staged.runs
    if not any(run.since for run in runs):
        return found
    whole = dataclasses.replace(found.staged, runs=[run.uncut for run in runs])
    beside = with_other_pasts(fitted(whole, found.vector, found.effects, most_steps=0), workers)
    back = fitted(dataclasses.replace(beside.staged, runs=runs), beside.vector, found.effects, most_steps=0)
    worse = [number for number in range(len(runs)) if back.ratios[number] > _HARMLESS * found.ratios[number]]
    former = {number: found.staged.ceramic.start_of(found.vector, number) for number in worse}
    return refitted_from(back, former, 0) if worse else back


def counted_where_no_past_reaches(run: RunData) -> RunData:
    """The run without the samples that a past reaches; as it is where few would be left."""
    since = first_unreached(run.record.voltage, run.picks[FIT] if FIT in run.picks else run.picks[SELECTION])
    return dataclasses.replace(run.counted_from(since), poled=True) if since else run
