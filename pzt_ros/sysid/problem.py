"""The least-squares problem: free parameters of the chain and prior reversals of each run, against its displacement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import repeat

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.parallel import IN_THIS_PROCESS, Workers
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.fading import beyond_reading
from pzt_ros.sysid.history_shares import share_bounds, shares_of, with_shares
from pzt_ros.sysid.parameters import FreeParameter, with_values
from pzt_ros.sysid.run import Start, free_run, rms
from pzt_ros.sysid.start import CountedPart, dying_out

STEP = 1e-3
"""Difference step of the coordinates: a share of the value or of the range; the integration's noise is far below it."""


@dataclass
class Problem:
    """Residuals and Jacobian over all runs, in coordinates without unit.

    The vector is: the free parameters, then run by run the prior reversals as a share of the voltages allowed. The
    offset of each run, and what dies out in it, are solved exactly by taking them out.

    Attributes:
        chain: with the values that are not free.
        free: parameters that may move.
        parts: the counted samples of each run.
        starts: the history of each run; how many prior reversals it has is fixed here.
        progress: is told the number of the evaluation and the rms [m].
        workers: run the chain, a run and a step at a time.
    """

    chain: Chain
    free: Sequence[FreeParameter]
    parts: Sequence[CountedPart]
    starts: Sequence[Start]
    progress: Callable[[int, float], None] = lambda number, error: None
    workers: Workers = IN_THIS_PROCESS
    evaluations: int = field(default=0, init=False)

    @property
    def begin(self) -> Array:
        """The vector that stands for the chain and the histories as given."""
        return np.array(
            [p.to_scaled(p.value) for p in self.free]
            + [
                share
                for part, start in zip(self.parts, self.starts, strict=True)
                for share in shares_of(part.record, start)
            ]
        )

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest vector."""
        limits = [p.scaled_bounds for p in self.free]
        for part, start in zip(self.parts, self.starts, strict=True):
            limits += share_bounds(part.record, start)
        return np.array([low for low, _ in limits]), np.array([high for _, high in limits])

    def chain_at(self, vector: Array) -> Chain:
        """The chain with the free parameters of the vector."""
        return _valued(self.chain, self.free, vector)

    def starts_at(self, vector: Array) -> list[Start]:
        """The histories of the vector; their offsets are as they were."""
        left = [float(share) for share in vector[len(self.free) :]]
        pairs = zip(self.parts, self.starts, strict=True)
        return [with_shares(start, part.record, [left.pop(0) for _ in range(start.unknowns)]) for part, start in pairs]

    def residuals(self, vector: Array) -> list[Array]:
        """Measurement minus model of every run, its mean and what dies out taken out [m, each shape (n,)]."""
        starts = self.starts_at(vector)
        found = list(
            self.workers.map(_misfit, repeat(self.chain), repeat(self.free), repeat(vector), self.parts, starts)
        )
        self.evaluations += 1
        self.progress(self.evaluations, rms(np.concatenate(found)))
        return found

    def jacobians(self, vector: Array, central: bool = False) -> list[Array]:
        """d(residual)/d(vector) of every run by differences [each shape (n, p)].

        Args:
            vector: where.
            central: two-sided and better by an order, where the bounds leave room; twice as slow.
        """
        return self.linearise(vector, central)[1]

    def linearise(self, vector: Array, central: bool = False) -> tuple[list[Array], list[Array]]:
        """Residual of every run, and its Jacobian."""
        here = self.residuals(vector)
        found = [np.zeros((residual.size, vector.size)) for residual in here]
        places = [(number, column) for column in range(vector.size) for number in self._runs_of(column)]
        ups = self._moved(vector, places, STEP)
        again = [place for place, up in zip(places, ups, strict=True) if central or up is None]
        downs = dict(zip(again, self._moved(vector, again, -STEP), strict=True))
        for (number, column), up in zip(places, ups, strict=True):
            middle = (vector[column], here[number])
            (low, below), (high, above) = downs.get((number, column)) or middle, up or middle
            if high > low:
                found[number][:, column] = (above - below) / (high - low)
        return here, found

    def _moved(self, vector: Array, places: Sequence[tuple[int, int]], step: float) -> list[tuple[float, Array] | None]:
        """The moved coordinate and the residual there, by run and column; None where a bound or a link forbids it."""
        low, high = self.bounds
        vectors = [vector.copy() for _ in places]
        for moved, (_, column) in zip(vectors, places, strict=True):
            moved[column] = min(max(vector[column] + step, low[column]), high[column])
        parts = [self.parts[number] for number, _ in places]
        starts = [self.starts_at(moved)[number] for moved, (number, _) in zip(vectors, places, strict=True)]
        found = self.workers.map(_misfit_or_none, repeat(self.chain), repeat(self.free), vectors, parts, starts)
        return [
            (float(moved[column]), residual) if residual is not None and moved[column] != vector[column] else None
            for (_, column), moved, residual in zip(places, vectors, found, strict=True)
        ]

    def _runs_of(self, column: int) -> Sequence[int]:
        """Runs on which a coordinate acts: all for a parameter, its own for what is unknown of a history."""
        if column < len(self.free):
            return range(len(self.parts))
        owners = [number for number, start in enumerate(self.starts) for _ in range(start.unknowns)]
        return [owners[column - len(self.free)]]


def _valued(chain: Chain, free: Sequence[FreeParameter], vector: Array) -> Chain:
    return with_values(chain, free, [p.to_si(float(v)) for p, v in zip(free, vector, strict=False)])


def _misfit(chain: Chain, free: Sequence[FreeParameter], vector: Array, part: CountedPart, start: Start) -> Array:
    """Measurement minus model of one run, its mean and what dies out taken out [m, shape (n,)]."""
    model = free_run(_valued(chain, free, vector), part.record, start.without_reading, part.picks, part.end)
    return beyond_reading(part.displacement - model.displacement, dying_out(chain, part))


def _misfit_or_none(
    chain: Chain, free: Sequence[FreeParameter], vector: Array, part: CountedPart, start: Start
) -> Array | None:
    """The same, or None where a link refuses the combination of values."""
    try:
        return _misfit(chain, free, vector, part, start)
    except BenchError:
        return None


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
