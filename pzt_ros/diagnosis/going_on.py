"""Effects that go on from run to run, or begin anew in each: which of the two it is, asked once more where a fit ended.

A base that was fitted without such an effect has made up pasts for what it does between runs, so a screen beside it
sees least of the truth. A fatigue that went on was taken for one that begins anew, at 1.03 x the noise where the other
is at 1.003, and predicted to 2 x.
"""

from __future__ import annotations

from pzt_ros.diagnosis.finish import finished
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.effects.table import EFFECT_OF

_STEPS = 12


def counted_otherwise(found: Hypothesis) -> Hypothesis:
    """With its last effect going on from run to run instead of beginning anew, or the reverse, if that leaves less."""
    if not found.effects or not EFFECT_OF[found.effects[-1]].goes_on:
        return found
    counted = {each.kind for each in found.staged.given}
    other = found.staged.counted(found.vector, counted ^ {found.effects[-1]})
    tried = fitted(other, found.vector, found.effects, _STEPS)
    return finished(tried, True) if tried.total < found.total else found
