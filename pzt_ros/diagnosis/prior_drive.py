"""The decaying drive that the thesis has before every run, where nobody said how large it was.

It leaves loops a twentieth of itself apart, and as the first rise wipes them out each is a valley of the misfit. So it
is no unknown of a fit but sought on a grid, on the base and again beside an effect that the base had made up for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pzt_ros.diagnosis.data import highest_voltage
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
    runs, ceramic = found.staged.runs, found.staged.ceramic
    is_sought = UNKNOWN.items() <= found.staged.chain.notes.items() and not all(run.begins_driven for run in runs)
    if not is_sought or max(found.ratios) <= _CLEAN:
        return found
    if not (isinstance(ceramic, DeclaredHysteresis) and isinstance(ceramic.model, Parametrized)):
        return found  # another base beside the same chain's notes
    largest = highest_voltage(runs) / ceramic.model.layer_thickness
    best, tried = found, [float(each) * largest for each in _COARSE]
    for _ in range(2):
        amplitude = min(tried, key=lambda each: _at(best, ceramic, each, 0).total)
        best = min(_at(best, ceramic, amplitude, _STEPS), best, key=lambda each: each.total)
        tried = [float(each) * amplitude for each in _FINE]
    return best


def _at(found: Hypothesis, ceramic: DeclaredHysteresis, amplitude: float, steps: int) -> Hypothesis:
    changes: dict[str, Any] = {"virgin_amplitude": amplitude}
    other = ceramic.with_model(replace(ceramic.model, **changes))
    return fitted(replace(found.staged, ceramic=other), found.vector, found.effects, steps)
