"""Readings that wander by chance: a room's temperature, which no model of the stage foretells and no drive repeats.

A link of a few numbers for each run dies out or goes straight on. What wanders is taken out of the misfit instead, as
an offset is: smooth curves over a few seconds, as many as a run has room for. What the stage does at the pace of its
drive stays, so a model that lacks something else does not come down to the noise beside them, but one that lacks
nothing does, and its values are no longer bent by the drift.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pzt_ros.diagnosis.data import RunData
from pzt_ros.diagnosis.histories import renewed
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.diagnosis.refinement import REFIT_STEPS, taken_on
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.run import rms, typical_leg

SPACING = 4.0
"""Over which readings may bend at the least [s]."""

BY_CHANCE = f"wanders by chance over {SPACING:g} s and more"

_FEWEST_LEGS = 6.0  # of the drive in a run that bends: slow curves beside a few ways up and down are loops


def wandering(place: Hypothesis, asked: Thresholds, most: float) -> Hypothesis | None:
    """The model fitted beside readings that wander, from a place; None where that leaves more of the noise (rms)."""
    runs = [replace(run, wander=_spacing(run)) for run in place.staged.runs]
    staged = replace(place.staged, runs=runs)
    begun = renewed(fitted(staged, place.vector, place.effects, REFIT_STEPS))  # a drift had bent the pasts
    return taken_on(exact(begun), asked) if begun.fit.ratio <= most else None


def _spacing(run: RunData) -> float:
    """Over which the readings of a run may bend [s]: not sooner than its drive crosses its range."""
    leg = typical_leg(run.record)
    duration = float(run.record.time[-1] - run.record.time[0])
    return max(SPACING, leg) if duration >= _FEWEST_LEGS * leg else math.inf


def wanders(found: Hypothesis) -> bool:
    """Whether its readings do."""
    return any(run.wander > 0.0 for run in found.staged.runs)


def less_wandering(found: Hypothesis, residuals: Sequence[Array]) -> list[Array]:
    """Residuals of all runs [m] without what wanders or dies out in them; as they are where nothing does."""
    return [left - _course(run, left) for run, left in zip(found.staged.runs, residuals, strict=True)]


def size_of(found: Hypothesis, residuals: Sequence[Array]) -> float:
    """Rms of what wanders within a run, over all runs [m]."""
    courses = [_course(run, left) for run, left in zip(found.staged.runs, residuals, strict=True)]
    return rms(np.concatenate([course - course.mean() for course in courses]))


def _course(run: RunData, residual: Array) -> Array:
    return run.wandered(residual) if run.has_nuisances else np.zeros_like(residual)
