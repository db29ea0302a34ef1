"""Small changes on their way through the chain: what a fit's tangent at the ceramic does to what is measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pzt_ros.physics.signals import ABSENT, Array, Signals

Columns = Any
"""A column for each change [shape (n, p), float32 or float64]; most are wanted for a search only."""

_ALONG = 1e-5  # of the largest polarization: how far a difference goes along a change


@dataclass(frozen=True)
class Change:
    """What each of some unknowns changes, per unit of it [every array: shape (n, p), SI per unit of the unknown].

    Attributes:
        polarization, displacement, strain_polarization: of the signals of that name; absent where those are.
    """

    polarization: Columns
    displacement: Columns = field(default_factory=lambda: ABSENT)
    strain_polarization: Columns = field(default_factory=lambda: ABSENT)

    @property
    def straining(self) -> Columns:
        """Of the polarization that strain links go by."""
        return self.strain_polarization if self.strain_polarization.size else self.polarization


def by_differences(passed: Callable[[Signals], Signals], signals: Signals, change: Change) -> Change:
    """What changes of signals do to what `passed` makes of them: a difference along each column."""
    here = passed(signals)
    known = [name for name in vars(change) if getattr(here, name).size]
    found = {name: np.zeros_like(change.polarization, order="F") for name in known}  # filled by columns
    largest = max(float(np.max(np.abs(signals.polarization), initial=0.0)), 1e-6)
    for k in range(change.polarization.shape[1]):
        along = {name: column[:, k] for name, column in vars(change).items() if column.size}
        size = float(np.max(np.abs(along["polarization"]), initial=0.0))
        if size == 0.0:
            continue
        step = _ALONG * largest / size
        there = passed(signals.replace(**{n: getattr(signals, n) + step * along[n] for n in along}))
        for name in known:
            found[name][:, k] = (getattr(there, name) - getattr(here, name)) / step
    return Change(**found)


def scaled(slope: Array, columns: Columns) -> Columns:
    """Columns times one factor for each sample [shape (n,)], in their own precision."""
    return columns * slope.astype(columns.dtype)[:, None]
