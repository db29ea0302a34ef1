"""A polycrystal whose densities are no Gaussians, but skewed, or with tails, as the runs show them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted, total_of
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.sysid.parameters import BEYOND_GAUSSIANS, LOPSIDED, SHAPES

_STEPS = 40
_NEAR = 1.1  # rms over noise where it was fitted, from which shapes are sought from elsewhere, too
_CLEAN = 1.05  # rms over noise of every run up to which nothing is asked
_FAR_LESS = 0.1
"""Share of the excess that shapes may leave for the declared Gaussians to be wrong: a skewed or a boxy density left
0.001 and 0.005 of it, effects of 3 and 10 x beside Gaussians 0.54 and more."""


def shaped(found: Hypothesis, shapes: Sequence[str] = SHAPES) -> Hypothesis:
    """Fitted with the shapes of both densities free; as it is where there are none, or they are no better.

    Gaussians may have run far for what they lack: from a coercive field of 1 V/m a skewed density left 3.5 x, from
    where the chain was declared 1.03 x.
    """
    held, staged, ceramic = _held(found, shapes), found.staged, found.staged.ceramic
    if not held:
        return found
    assert isinstance(ceramic, DeclaredHysteresis)
    freed, known = ceramic.with_free(held), len(ceramic.coordinates)
    vector = np.concatenate((found.vector[:known], freed.start[known : known + len(held)], found.vector[known:]))
    free = dataclasses.replace(staged, ceramic=freed)
    other = fitted(free, vector, found.effects, _STEPS)
    if not found.effects and other.fit.ratio > _NEAR:
        other = min(other, fitted(free, free.start, most_steps=_STEPS), key=total_of)
    other = exact(other) if staged.given else other  # what goes on from run to run is counted by the density
    return min(other, found, key=total_of)


def lopsided(found: Hypothesis) -> Hypothesis:
    """The same with interaction fields that may prefer a direction, too: of those Gaussians left 21 x, these 1.1 x."""
    return shaped(found, (*SHAPES, LOPSIDED))


def may_be_lopsided(found: Hypothesis) -> bool:
    """Whether it has interaction fields that are held symmetric."""
    return bool(_held(found, [LOPSIDED]))


def _held(found: Hypothesis, shapes: Sequence[str]) -> list[str]:
    """Those of some shapes that a polycrystal has and that are not free."""
    ceramic = found.staged.ceramic
    if not isinstance(ceramic, DeclaredHysteresis) or not isinstance(ceramic.model, Polycrystal):
        return []
    return [shape for shape in shapes if shape not in [each.field for each in ceramic.coordinates]]


def far_better_shaped(found: Hypothesis) -> Hypothesis:
    """The same where that leaves far less of what was fitted, and no run has a past; else as it is.

    A run that only chooses may lack its own past, which says nothing of a density.
    """
    if max(found.ratios) <= _CLEAN or found.staged.has_past:
        return found
    other = shaped(found)
    return other if other.fit.excess <= _FAR_LESS * found.fit.excess else found


def is_shaped(found: Hypothesis) -> bool:
    """Whether shapes of its densities are free."""
    ceramic = found.staged.ceramic
    free = ceramic.coordinates if isinstance(ceramic, DeclaredHysteresis) else ()
    return any(each.field in BEYOND_GAUSSIANS for each in free)
