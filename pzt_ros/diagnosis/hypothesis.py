"""One answer to what the stage is made of: a base, effects, their fitted values, and how far it is from the runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pzt_ros.diagnosis.data import SELECTION
from pzt_ros.diagnosis.staged import Staged
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.covariance import effective_samples
from pzt_ros.sysid.gauss_newton import Solution, solve

_CORRECTIONS, _MOST_CORRECTIONS = 2, 4
_CREEPS = (1.05, 1.5)  # rms over noise between which it is worth more: in a valley, or it would be farther off
_STEPS = 8
_STAYS = 0.01  # change of coordinates, that is 1 % of a parameter
_OWN_STEPS, _OWN_TOLERANCE = 20, 1e-3  # of what belongs to a test run alone


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
    def beside(self) -> str:
        """What is tried with it is said to be tried so; empty without effects."""
        return f" beside {', '.join(self.effects)}" if self.effects else ""

    @property
    def jacobians(self) -> list[Array]:
        """Of the runs that were fitted, where the fit ended; too large to be kept for every candidate.

        In the precision of the tangent, which is half the size for an identified density.
        """
        return self.staged.linearise(self.solution.vector)[1]

    @cached_property
    def selection_residuals(self) -> list[Array]:
        """Misfit of the parts that choose."""
        numbers = self.choosing
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
    def choosing(self) -> list[int]:
        """Indices of the runs with a part that chooses."""
        return [number for number, run in enumerate(self.staged.runs) if SELECTION in run.picks]

    @cached_property
    def ratios(self) -> list[float]:
        """Rms over noise of every run, on the part that is fitted or chooses."""
        residuals = dict(zip(self.staged.fitted, self.solution.residuals, strict=True))
        residuals.update(zip(self.choosing, self.selection_residuals, strict=True))
        return [float(np.sqrt(np.mean(np.square(residuals[number])))) for number in range(len(self.staged.runs))]

    @property
    def total(self) -> float:
        """Mean square over both kinds of parts, each counted alike; what candidates are ranked by."""
        return self.fit.total / self.fit.samples + self.selection.total / max(self.selection.samples, 1)

    def total_at(self, ratio: float) -> float:
        """What `total` is of the same parts with so much of the noise left in each."""
        return ratio**2 * (2.0 if self.selection.samples else 1.0)

    @property
    def over_noise(self) -> float:
        """`total` over what the noise alone leaves."""
        return self.total / self.total_at(1.0)

    @property
    def excess(self) -> float:
        """Of `total` over what the noise alone leaves; never so little that it could not be divided by."""
        return max(self.total - self.total_at(1.0), 1e-4)


def fitted(staged: Staged, start: Array, effects: tuple[str, ...] = (), most_steps: int = 20) -> Hypothesis:
    """Fit a staged model from a start.

    Raises:
        BenchError: the model cannot be evaluated at the start.
    """
    low, high = staged.bounds
    alone = staged.for_one_search()
    solution = solve(alone, start, low, high, most_steps=most_steps, tolerance=1e-5, prior=staged.prior)
    vector = _with_own_values(staged, solution.vector)
    return Hypothesis(staged, solution, vector, effects)


def total_of(found: Hypothesis) -> float:
    """What fits of one model, or candidates, are ranked by [-]."""
    return found.total


def without_effects(found: Hypothesis) -> Hypothesis:
    """The base where its effects had taken it."""
    return fitted(*found.staged.without_all(found.effects, found.vector), most_steps=0)


def exact(found: Hypothesis) -> Hypothesis:
    """The same fitted with its ceramic exact where the fit ended, until that is where it stays.

    A fit along a tangent may promise what the model does not keep, so a step that makes it worse is taken back. Where
    the misfit is far larger than what the ceramic is off by, it stays as it is.
    """
    return found if found.fit.ratio > found.staged.far else exactly(found)


def exactly(found: Hypothesis) -> Hypothesis:
    """The same, however far it is."""
    best = exact_here(found)
    for count in range(_MOST_CORRECTIONS):
        if best is found or (count >= _CORRECTIONS and not _creeps(best)):
            break
        moved = fitted(best.staged, best.vector, best.effects, _STEPS)
        if np.max(np.abs(moved.solution.vector - best.solution.vector)) < _STAYS:
            return moved
        there = exact_here(moved)
        if there.solution.cost >= best.solution.cost:
            break
        best = there
    return best


def _creeps(found: Hypothesis) -> bool:
    low, high = _CREEPS
    return low < found.fit.ratio <= high


def exact_here(found: Hypothesis) -> Hypothesis:
    """The hypothesis as it is, exact there; itself where it is exact everywhere."""
    staged = found.staged.exact_at(found.vector)
    if staged is found.staged:
        return found
    return fitted(staged, found.vector, found.effects, most_steps=0)


def _with_own_values(staged: Staged, vector: Array) -> Array:
    """What belongs to a test run alone, fitted to its selection part within its bounds with all else held."""
    found = vector.copy()
    own = staged.ceramic.start.size
    low, high = staged.bounds
    rows, targets = staged.prior
    for number in (number for number, run in enumerate(staged.runs) if SELECTION in run.picks):
        places = staged.ceramic.places_of(number)
        places += [own + k for k, each in enumerate(staged.coordinates) if each.run == number]
        if not places:
            continue
        alone, held = _OwnValues(staged.for_one_search(), found, number, places), rows[:, places]
        about = targets - rows @ found + held @ found[places]
        bounds = low[places], high[places]
        best = solve(
            alone, found[places], *bounds, most_steps=_OWN_STEPS, tolerance=_OWN_TOLERANCE, prior=(held, about)
        )
        found[places] = best.vector
    return found


@dataclass(frozen=True)
class _OwnValues:
    """What a test run's selection part says of the unknowns that belong to it alone; a `gauss_newton.Problem`.

    Attributes:
        staged: the model.
        vector: of all unknowns.
        number: of the run.
        places: of its own unknowns in the vector.
    """

    staged: Staged
    vector: Array
    number: int
    places: list[int]

    def residuals(self, own: Array) -> list[Array]:
        outputs = self.staged.outputs(self._with(own), [self.number])
        return [self.staged.runs[self.number].misfit(SELECTION, *outputs[0])]

    def linearise(self, own: Array) -> tuple[list[Array], list[Array]]:
        residuals, jacobians = self.staged.jacobians(self._with(own), [self.number], SELECTION)
        return residuals, [jacobians[0][:, self.places]]

    def _with(self, own: Array) -> Array:
        vector = self.vector.copy()
        vector[self.places] = own
        return vector
