"""A base whose relaxation time ran far from what was declared, fitted anew with that held.

Relays that heat alone moves creep with the logarithm of time. So a base fitted without a relaxation or a drift may take
to that in their place, at a relaxation time of ps, and no refit with the effect finds its way back from there.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted

_HELD = "relaxation_time"
_FAR, _FAR_BESIDE_PASTS = 3.0, 1.0  # of its logarithm; pasts make up for what is missing, and it need not go so far
_STEPS = 40
_WORSE = 4.0  # times what the base leaves: it needs what it ran to


def with_declared_kinetics(declared: Hypothesis) -> list[Hypothesis]:
    """The declared model fitted with its relaxation time as declared; nothing where it stayed near or has to go."""
    staged, ceramic = declared.staged, declared.staged.ceramic
    if not isinstance(ceramic, DeclaredHysteresis):
        return []
    places = [k for k, each in enumerate(ceramic.coordinates) if each.field == _HELD and each.is_log]
    far = _FAR_BESIDE_PASTS if staged.has_past else _FAR
    if not any(abs(declared.vector[k] - ceramic.start[k]) > far for k in places):
        return []
    kept = [each for k, each in enumerate(ceramic.coordinates) if k not in places]
    fewer = DeclaredHysteresis(ceramic.model, ceramic.quick, kept, ceramic.records, ceramic.starts, ceramic.gain)
    held = dataclasses.replace(staged, ceramic=fewer)
    vector = staged.start
    vector[np.delete(np.arange(vector.size), places)] = exact(fitted(held, held.start, most_steps=_STEPS)).vector
    nowhere_exact = dataclasses.replace(staged, ceramic=ceramic.with_starts(ceramic.starts))
    there = fitted(nowhere_exact, vector, most_steps=0)
    return [there] if there.total <= _WORSE * declared.total else []
