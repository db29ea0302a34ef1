"""The decaying drive that the thesis has before every run, where nobody said how large it was.

It leaves loops a twentieth of itself apart, and as the first rise wipes them out each is a valley of the misfit. So it
is no unknown of a fit but sought on a grid, on the base and again beside an effect that the base had made up for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.physics.parametrized import Parametrized

UNKNOWN = {"drive_before": "of unknown amplitude"}
"""Notes of a chain for which it is sought."""

_COARSE = np.geomspace(0.6, 1.8, 31)  # over the largest field
_FINE = np.linspace(0.97, 1.03, 13)  # over the best of these
_CLEAN = 1.02  # rms over noise up to which it is not sought
_STEPS = 20


def with_best_amplitude(found: Hypothesis) -> Hypothesis:
    """Refitted with the amplitude that leaves least, where it is not known and something is left."""
    is_sought = UNKNOWN.items() <= found.staged.chain.notes.items()
    if not is_sought or max(found.ratios) <= _CLEAN or all(run.begins_driven for run in found.staged.runs):
        return found
    thickness = next(each.layer_thickness for each in found.staged.chain.links if isinstance(each, Parametrized))
    highest = max(float(np.max(np.abs(run.record.voltage))) for run in found.staged.runs)
    tried = _COARSE * highest / thickness
    for _ in range(2):
        best = min((_at(found, float(amplitude), 0) for amplitude in tried), key=lambda each: each.total)
        amplitude = _amplitude_of(best)
        found = min(_at(found, amplitude, _STEPS), found, key=lambda each: each.total)
        tried = _FINE * amplitude
    return found


def _at(found: Hypothesis, amplitude: float, steps: int) -> Hypothesis:
    ceramic: Any = found.staged.ceramic
    model = replace(ceramic.model, virgin_amplitude=amplitude)
    other = DeclaredHysteresis(model, model, ceramic.coordinates, ceramic.records, ceramic.starts)
    return fitted(replace(found.staged, ceramic=other), found.vector, found.effects, steps)


def _amplitude_of(found: Hypothesis) -> float:
    ceramic: Any = found.staged.ceramic
    return float(ceramic.model.virgin_amplitude)
