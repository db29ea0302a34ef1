"""The least-squares problem: free parameters of the chain and prior reversals of each run, against its displacement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.parameters import FreeParameter, with_values
from pzt_ros.sysid.run import Start, free_run, rms
from pzt_ros.sysid.start import CountedPart, voltage_bounds

STEP = 1e-3
"""Difference step of the coordinates: a share of the value or of the range; the integration's noise is far below it."""


@dataclass
class Problem:
    """Residuals and Jacobian over all runs, in coordinates without unit.

    The vector is: the free parameters, then run by run the prior reversals as a share of the voltages allowed. The
    offset of each run is solved exactly by taking out the mean.

    Attributes:
        chain: with the values that are not free.
        free: parameters that may move.
        parts: the counted samples of each run.
        starts: the history of each run; how many prior reversals it has is fixed here.
        progress: is told the number of the evaluation and the rms [m].
    """

    chain: Chain
    free: Sequence[FreeParameter]
    parts: Sequence[CountedPart]
    starts: Sequence[Start]
    progress: Callable[[int, float], None] = lambda number, error: None
    evaluations: int = field(default=0, init=False)

    @property
    def begin(self) -> Array:
        """The vector that stands for the chain and the histories as given."""
        return np.array(
            [p.to_scaled(p.value) for p in self.free]
            + [
                (voltage - low) / (high - low)
                for part, start in zip(self.parts, self.starts, strict=True)
                for low, high in [voltage_bounds(part.record)]
                for voltage in start.prior_voltages
            ]
        )

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest vector."""
        limits = [p.scaled_bounds for p in self.free]
        limits += [(0.0, 1.0) for start in self.starts for _ in start.prior_voltages]
        return np.array([low for low, _ in limits]), np.array([high for _, high in limits])

    def chain_at(self, vector: Array) -> Chain:
        """The chain with the free parameters of the vector."""
        return with_values(self.chain, self.free, [p.to_si(float(v)) for p, v in zip(self.free, vector, strict=False)])

    def starts_at(self, vector: Array) -> list[Start]:
        """The histories of the vector; their offsets are as they were."""
        left = [float(share) for share in vector[len(self.free) :]]
        starts = []
        for part, start in zip(self.parts, self.starts, strict=True):
            low, high = voltage_bounds(part.record)
            shares = [left.pop(0) for _ in start.prior_voltages]
            starts.append(replace(start, prior_voltages=tuple(low + share * (high - low) for share in shares)))
        return starts

    def residual_of(self, number: int, vector: Array) -> Array:
        """Measurement minus model of one run, its mean taken out [m, shape (n,)]."""
        part, start = self.parts[number], self.starts_at(vector)[number]
        model = free_run(self.chain_at(vector), part.record, replace(start, offset=0.0), part.picks, part.end)
        difference = part.displacement - model.displacement
        return difference - difference.mean()

    def residuals(self, vector: Array) -> list[Array]:
        """Of every run."""
        found = [self.residual_of(number, vector) for number in range(len(self.parts))]
        self.evaluations += 1
        self.progress(self.evaluations, rms(np.concatenate(found)))
        return found

    def jacobians(self, vector: Array, central: bool = False) -> list[Array]:
        """d(residual)/d(vector) of every run by differences [each shape (n, p)].

        Args:
            vector: where.
            central: two-sided and better by an order, where the bounds leave room; twice as slow.
        """
        here = self.residuals(vector)
        found = [np.zeros((residual.size, vector.size)) for residual in here]
        low, high = self.bounds
        for column in range(vector.size):
            up, down = vector.copy(), vector.copy()
            up[column] = min(vector[column] + STEP, high[column])
            down[column] = max(vector[column] - STEP, low[column])
            for number in self._runs_of(column):
                above = self._allowed(number, up)
                below = self._allowed(number, down) if central or above is None else None
                left = (here[number], vector) if below is None else (below, down)
                right = (here[number], vector) if above is None else (above, up)
                step = right[1][column] - left[1][column]
                if step > 0.0:
                    found[number][:, column] = (right[0] - left[0]) / step
        return found

    def _allowed(self, number: int, vector: Array) -> Array | None:
        """Residual of one run, or None where a link refuses the combination of values."""
        try:
            return self.residual_of(number, vector)
        except BenchError:
            return None

    def _runs_of(self, column: int) -> Sequence[int]:
        """Runs on which a coordinate acts: all for a parameter, its own for a prior reversal."""
        if column < len(self.free):
            return range(len(self.parts))
        owners = [number for number, start in enumerate(self.starts) for _ in start.prior_voltages]
        return [owners[column - len(self.free)]]


def distinguishable(problem: Problem) -> tuple[list[FreeParameter], list[FreeParameter]]:
    """Free parameters that act on these runs in a way of their own, and those that the ones before them can stand for.

    Raises:
        BenchError: none of them acts on the displacement at all.
    """
    jacobian = np.vstack(problem.jacobians(problem.begin, central=True))
    basis: list[Array] = []
    kept, held = [], []
    for parameter, column in zip(problem.free, jacobian.T, strict=False):
        size = float(np.linalg.norm(column))
        rest = column.copy()
        for direction in basis:
            rest -= (direction @ rest) * direction
        if size > 0.0 and np.linalg.norm(rest) > 0.01 * size:
            basis.append(rest / np.linalg.norm(rest))
            kept.append(parameter)
        else:
            held.append(parameter)
    if not kept:
        names = ", ".join(p.name for p in problem.free)
        raise BenchError(f"none of {names} changes the displacement in these runs; free others in the chain's 'free:'")
    return kept, held
