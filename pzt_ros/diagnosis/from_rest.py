"""How runs from rest begin: in the ceramic's own initial state, or poled once and left, as most benches do.

Whoever pairs a stage with a recorder has moved it before. Its ceramic then stands at 0 V on its way back from the last
peak, and has crept there for as long as it waited; the first rise of a run tells the two apart by tens of times the
noise. Parameters fitted to a wrong one defend it: of a stage that had been poled a virgin ceramic left 19 x the noise
from any start, and no reversal that was sought beside it helped; fitted from where the chain was declared, poled and
left seconds ago, it leaves 1.05 x.
"""

from __future__ import annotations

import dataclasses

from pzt_ros.diagnosis.histories import refitted_from
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.sysid.run import Start, typical_leg

_CLEAN = 1.05  # rms over noise of every run up to which nothing is asked
_FAR_LESS, _LESS = 0.1, 0.5
"""Share of the excess that pasts may leave, or something else is what is missing; and the same where nothing was
declared, so that a wrong past is likelier than a right start."""

_FEW_STEPS, _STEPS = 16, 40  # of the fit, before and after it leaves less
_WAIT = 10.0  # usual legs since the ceramic was left; a fit finds how long
_OTHER_WAY = 0.3  # of the highest voltage, from which a drive to the other side may have poled it


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
        refitted_from(declared, {number: _poled(virgin, number, volts) for number in numbers}, _FEW_STEPS)
        for volts in _peaks(virgin)
    ]
    best = min(tried, key=lambda each: each.total)
    if best.total >= virgin.total:
        return virgin
    best = fitted(best.staged, best.vector, most_steps=_STEPS)
    most = _FAR_LESS if is_declared else _LESS
    return best if best.excess <= most * virgin.excess else virgin


def _peaks(found: Hypothesis) -> list[float]:
    """Where a ceramic may have been poled [V]: at the end of the drive that is farthest from 0 V, or at both."""
    drives = [run.record.voltage for run in found.staged.runs]
    ends = [max(float(drive.max()) for drive in drives), min(float(drive.min()) for drive in drives)]
    farthest = max(abs(end) for end in ends)
    return [end for end in ends if abs(end) > _OTHER_WAY * farthest]


def _poled(found: Hypothesis, number: int, volts: float) -> Start:
    """The past of a run; how long ago it was says nothing of a ceramic that knows no rate."""
    leg = typical_leg(found.staged.runs[number].record)
    return Start((volts,), leg, approach=None if found.staged.ceramic.knows_no_rate else _WAIT * leg)
