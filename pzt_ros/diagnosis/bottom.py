"""Fits near the noise taken on with tangents of the model itself, to where they come down no more.

The front model that a search moves in its place is corrected where the model was last asked, not in how it changes. So
in a valley, such as where a lag and a relaxation time make up for one another, a search may end on a slope: a bandwidth
with a second pole was left at none of it, with 2 % of the excess, two steps from its values to 1 %. Another effect that
had come down by chance was named in its place. And on some drives the front model decides on what is a reversal: a
difference of two decisions is no tangent, and a base that stays 1 % above the noise for that has any effect explain it.
"""

from __future__ import annotations

import dataclasses

from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.errors import BenchError

_NEAR_NOISE = 1.1  # rms over noise of a run up to which the last percent counts
_NEAR_WITH_EFFECT = 2.0  # the same of a refit with an effect that may be all that is missing
_STEPS, _COMES_DOWN = 4, 0.998  # at most, and what has to be left of the cost each time


def to_the_bottom(found: Hypothesis) -> Hypothesis:
    """A fit near the noise taken on by single exact steps, for as long as it comes down by them."""
    near = _NEAR_WITH_EFFECT if found.effects else _NEAR_NOISE
    ceramic = found.staged.ceramic
    if not isinstance(ceramic, DeclaredHysteresis) or ceramic.quick is ceramic.model:
        return found
    exactly = ceramic.with_model(ceramic.model)
    for _ in range(_STEPS):
        if max(found.ratios) > near:
            break
        try:
            moved = fitted(dataclasses.replace(found.staged, ceramic=exactly), found.vector, found.effects, 1)
            there = fitted(found.staged.exact_at(moved.vector), moved.vector, found.effects, 0)
        except BenchError:  # more domains than are wise, where nothing but the front model can go
            break
        if there.solution.cost >= _COMES_DOWN * found.solution.cost:
            break
        found = there
    return found
