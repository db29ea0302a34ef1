"""How runs from rest begin: in the ceramic's own initial state, or poled once and left, as most benches do.

Whoever pairs a stage with a recorder has moved it before. Its ceramic then stands at 0 V on its way back from the last
peak, and has crept there for as long as it waited; the first rise of a run tells the two apart by tens of times the
noise. Parameters fitted to a wrong one defend it: of a stage that had been poled a virgin ceramic left 19 x the noise
from any start, and no reversal that was sought beside it helped; fitted from where the chain was declared, poled and
left seconds ago, it leaves 1.05 x.
"""

from __future__ import annotations

import dataclasses

from pzt_ros.diagnosis.data import seen_through
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.histories import refitted_from
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.diagnosis.poling import peaks, poled_anew, poled_start
from pzt_ros.diagnosis.staged import Staged
from pzt_ros.sysid.run import Start

_CLEAN = 1.05  # rms over noise of every run up to which nothing is asked
_FAR_LESS, _LESS_LATELY, _LESS = 0.1, 0.25, 0.5
"""Share of the excess that pasts may leave, or something else is what is missing; the same of pasts that were lately;
and where nothing was declared, so that a wrong past is likelier than a right start. Poled and with a creep of 20 x the
noise 0.12 was left; never driven, of plays and of elements that slip 0.13 to 0.25, poled long ago, and with an effect
on the right structure 0.44 and more."""

_LATELY = 1e3  # usual legs since a stage was left, at most

_FIRST_STEPS, _FEW_STEPS, _STEPS = 8, 16, 40  # of the fit, before and after it leaves less


def as_poled(virgin: Hypothesis, is_declared: bool = True) -> Hypothesis:
    """Fitted from where the chain was declared, its runs from rest poled before, where that leaves far less.

    Args:
        virgin: fitted with every run starting where it begins.
        is_declared: whether its chain was. If not, runs that begin driven may have been poled, too: pasts are sought
            for them later, and beside values that nobody declared there is nothing to seek them with.
    """
    numbers = [number for number, run in enumerate(virgin.staged.runs) if not (is_declared and run.begins_driven)]
    if max(virgin.ratios) <= _CLEAN or not numbers:
        return virgin
    runs = [dataclasses.replace(r, poled=not r.begins_driven) for r in virgin.staged.runs]
    declared = dataclasses.replace(
        virgin, staged=dataclasses.replace(virgin.staged, runs=runs), vector=virgin.staged.start
    )
    tried = [
        refitted_from(declared, {number: poled_start(virgin, number, volts) for number in numbers}, _FEW_STEPS)
        for volts in peaks(virgin)
    ]
    best = min(tried, key=lambda each: each.total)
    if best.total >= virgin.total:
        return virgin
    best = fitted(best.staged, best.vector, best.effects, _STEPS)
    most = (_LESS_LATELY if _were_lately(best) else _FAR_LESS) if is_declared else _LESS
    return best if best.excess <= most * virgin.excess else virgin


def as_virgin(found: Hypothesis) -> Hypothesis:
    """The same with its runs from rest on a ceramic that was never driven, not fitted yet."""
    starts = {number: Start() for number, run in enumerate(found.staged.runs) if not run.begins_driven}
    return refitted_from(dataclasses.replace(found, staged=on_whole_runs(found.staged)), starts, 0)


def on_whole_runs(staged: Staged) -> Staged:
    """The same with all samples of its runs counted, none of these taken for poled."""
    runs = [dataclasses.replace(run.uncut, poled=False) for run in staged.runs]
    return dataclasses.replace(staged, runs=seen_through(staged.chain, runs))


def is_taken_for_virgin(found: Hypothesis) -> bool:
    """Whether every run begins at rest, and none is taken for one of a ceramic that was poled before."""
    staged = found.staged
    poled = any(run.poled for run in staged.runs)
    return isinstance(staged.ceramic, DeclaredHysteresis) and not (staged.has_past or poled)


def poled_beside(found: Hypothesis) -> Hypothesis | None:
    """A model with effects fitted with its runs from rest poled before; None where it has a past, or that is no better.

    Beside an effect that is missing, what a poled ceramic leaves says little: a creep and a current limit hid it, the
    two of them left 2.0 x the noise on a virgin one.
    """
    staged = found.staged
    if not (found.effects and is_taken_for_virgin(found)):
        return None
    poled = [dataclasses.replace(run, poled=True) for run in staged.runs]
    begun = dataclasses.replace(staged, runs=seen_through(staged.chain, poled))
    tried = []
    for volts in peaks(found):
        pasts = {number: poled_start(found, number, volts) for number in range(len(poled))}
        tried.append(refitted_from(dataclasses.replace(found, staged=begun), pasts, _FEW_STEPS))
    best = min(tried, key=lambda each: each.total)
    if best.total >= found.total:
        return None
    return exact(fitted(best.staged, best.vector, best.effects, most_steps=_STEPS))


def _were_lately(found: Hypothesis) -> bool:
    """Whether all runs that were poled were so a short while ago: what is missing elsewhere asks for years."""
    pasts = (found.staged.ceramic.start_of(found.vector, n) for n, run in enumerate(found.staged.runs) if run.poled)
    return all(past.approach is not None and past.approach <= _LATELY * past.leg for past in pasts)


def hardly_moved(poled: Hypothesis) -> Hypothesis | None:
    """Fitted from where the chain was declared by a few steps only; None where its runs were not poled before.

    A poled ceramic without an effect that it has may go far before it ends: to 3 times the coercive field and 12 times
    the reciprocal permittivity beside a creep, from where no refit found back. The first steps bring the pasts about.
    """
    staged = poled.staged
    if not isinstance(staged.ceramic, DeclaredHysteresis):
        return None
    begin, pasts = dataclasses.replace(poled, vector=staged.start), poled_anew(poled)
    return refitted_from(begin, pasts, _FIRST_STEPS) if pasts else None
