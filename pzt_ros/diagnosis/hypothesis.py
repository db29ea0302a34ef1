"""One answer to what the stage is made of: a base, effects, their fitted values, and how far it is from the runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pzt_ros.diagnosis.data import SELECTION, RunData
from pzt_ros.diagnosis.staged import Staged
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.covariance import effective_samples
from pzt_ros.sysid.gauss_newton import Solution, solve

_CORRECTIONS = 2
_STAYS = 0.01  # change of coordinates, that is 1 % of a parameter


@dataclass(frozen=True)
class Misfit:
    """How far a hypothesis is from one kind of parts, in units of the noise.

    Attributes:
        total: sum of squares [-].
        samples: counted.
        effective: samples that tell something new, given how the residual remembers itself.
    """

    total: float
    samples: int
    effective: float

    @property
    def ratio(self) -> float:
        """Rms over noise."""
        return float(np.sqrt(self.total / max(self.samples, 1)))

    @property
    def excess(self) -> float:
        """Sum of squares beyond the noise; at least a ten-thousandth of it, so that it can be divided by."""
        return max(self.total - self.samples, 1e-4 * self.samples)


def misfit_of(residuals: Sequence[Array]) -> Misfit:
    """Of the residuals of some runs."""
    effective = sum(effective_samples(r) for r in residuals if r.size)
    return Misfit(sum(float(r @ r) for r in residuals), sum(r.size for r in residuals), effective)


@dataclass(frozen=True)
class Hypothesis:
    """A fitted model of all runs.

    Attributes:
        staged: the model.
        solution: of the fit, without its Jacobians; its vector lacks what `vector` has of the test runs.
        vector: the solution's, with what belongs to each test run alone fitted to its selection part.
        effects: names, in the order of adding.
    """

    staged: Staged
    solution: Solution
    vector: Array
    effects: tuple[str, ...] = ()

    @property
    def jacobians(self) -> list[Array]:
        """Of the runs that were fitted, where the fit ended; too large to be kept for every candidate."""
        return self.staged.linearise(self.solution.vector)[1]

    @cached_property
    def selection_residuals(self) -> list[Array]:
        """Misfit of the parts that choose."""
        numbers = _choosing(self.staged.runs)
        outputs = self.staged.outputs(self.vector, numbers)
        return [self.staged.runs[r].misfit(SELECTION, *out) for r, out in zip(numbers, outputs, strict=True)]

    @cached_property
    def fit(self) -> Misfit:
        """On what was fitted."""
        return misfit_of(self.solution.residuals)

    @cached_property
    def selection(self) -> Misfit:
        """On what chooses."""
        return misfit_of(self.selection_residuals)

    @property
    def total(self) -> float:
        """Mean square over both kinds of parts, each counted alike; what candidates are ranked by."""
        return self.fit.total / self.fit.samples + self.selection.total / max(self.selection.samples, 1)


def _choosing(runs: Sequence[RunData]) -> list[int]:
    return [number for number, run in enumerate(runs) if SELECTION in run.picks]


def fitted(staged: Staged, start: Array, effects: tuple[str, ...] = (), most_steps: int = 20) -> Hypothesis:
    """Fit a staged model from a start.

    Raises:
        BenchError: the model cannot be evaluated at the start.
    """
    low, high = staged.bounds
    solution = solve(staged, start, low, high, most_steps=most_steps, tolerance=1e-5, prior=staged.prior)
    vector = _with_own_values(staged, solution.vector)
    return Hypothesis(staged, replace(solution, jacobians=[]), vector, effects)


def exact(found: Hypothesis) -> Hypothesis:
    """The same fitted with its ceramic exact where the fit ended, until that is where it stays."""
    for _ in range(_CORRECTIONS):
        staged = found.staged.exact_at(found.vector)
        if staged.ceramic is found.staged.ceramic:
            break
        before = found
        found = fitted(staged, before.vector, before.effects, most_steps=4)
        if np.max(np.abs(found.solution.vector - before.solution.vector)) < _STAYS:
            break
    return found


def _with_own_values(staged: Staged, vector: Array) -> Array:
    """What belongs to a test run alone, fitted linearly to its selection part with all else held."""
    found = vector.copy()
    own = staged.ceramic.start.size
    low, high = staged.bounds
    for number in _choosing(staged.runs):
        places = staged.ceramic.places_of(number)
        places += [own + k for k, each in enumerate(staged.coordinates) if each.run == number]
        if not places:
            continue
        run = staged.runs[number]
        here = run.misfit(SELECTION, *staged.outputs(found, [number])[0])
        columns = []
        for place in places:
            moved = found.copy()
            moved[place] += 1.0
            columns.append(run.misfit(SELECTION, *staged.outputs(moved, [number])[0]) - here)
        step = np.linalg.lstsq(np.column_stack(columns), -here, rcond=None)[0]
        found[places] = np.clip(found[places] + step, low[places], high[places])
    return found
