"""Effects that go on from run to run, or begin anew in each: which of the two it is, asked once more where a fit ended.

A base that was fitted without such an effect has made up pasts for what it does between runs, so a screen beside it
sees least of the truth. A fatigue that went on was taken for one that begins anew, at 1.03 x the noise where the other
is at 1.003, and predicted to 2 x.
"""

from __future__ import annotations

from dataclasses import replace

from pzt_ros.diagnosis.counts import counts_before
from pzt_ros.diagnosis.finish import finished
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.staged import Staged
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.physics.signals import Array

_STEPS = 12


def counted_otherwise(found: Hypothesis) -> Hypothesis:
    """With its last effect going on from run to run instead of beginning anew, or the reverse, if that leaves less."""
    if not found.effects or not EFFECT_OF[found.effects[-1]].goes_on:
        return found
    other = _otherwise(found.staged, found.effects[-1], found.vector)
    tried = fitted(other, found.vector, found.effects, _STEPS)
    return finished(tried, True) if tried.total < found.total else found


def _otherwise(staged: Staged, kind: str, vector: Array) -> Staged:
    """The stage with an effect counted the other way."""
    others = tuple(each for each in staged.given if each.kind != kind)
    if len(others) < len(staged.given):
        return replace(staged, given=others)
    link = next(link for link in staged.chain_at(vector).links if link.kind == kind)
    given = counts_before(EFFECT_OF[kind].goes_on, link, staged.polarizations(vector))
    return replace(staged, given=(*others, *given))
