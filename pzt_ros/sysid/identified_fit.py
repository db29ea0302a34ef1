"""The identified lattice and a strain law fitted to measured runs; how fine and how smooth is left to held-out samples.

A search on thinned runs comes first, then steps on every sample. Resolution and prior are compared on the last part of
each run, which that search has not seen, in the linear model at its end: that costs no further passes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.identified_hats import accumulate, hats_of, node_count
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.gauss_newton import bounded_minimum, normal_equations, solve
from pzt_ros.sysid.identified import LOG_WIDTH, WEIGHTS, IdentifiedHysteresis
from pzt_ros.sysid.identified_problem import IdentifiedProblem, MeasuredRun, rms_of
from pzt_ros.sysid.thinning import kept_samples

_STEP, _TOLERANCE = 0.02, 0.0005  # of the range of voltage: thinned runs
_FEWEST = 1500  # samples that a thinned run keeps at least, holds too
_TRUST = 1e-6  # damping of the linear model when priors are compared
_AS_GOOD = 1.02  # validation error over the least one that still counts as equal: the stronger prior is taken then


@dataclass(frozen=True)
class Choice:
    """One resolution and prior, and how it did: residual over noise in the training and in the held-out part."""

    resolution: int
    rotation: float
    train: float
    held_out: float


@dataclass(frozen=True)
class IdentifiedResult:
    """What the fit found.

    Attributes:
        problem, vector: the last one, over all counted samples, and where it ended.
        residuals: (model - measured)/noise at the counted samples of each run.
        choices: everything that was compared; the chosen one first.
        steps: of the searches together.
    """

    problem: IdentifiedProblem
    vector: Array
    residuals: list[Array]
    choices: list[Choice]
    steps: int

    @property
    def link(self) -> IdentifiedLattice:
        """Voltage at the ceramic to polarization."""
        return self.problem.base.link(self.vector)

    @property
    def centring(self) -> tuple[float, float]:
        """Mean and scale of the polarization that the law is written in [C/m^2]."""
        problem = self.problem
        size = problem.law.start
        return problem.centring(problem.base.polarization(self.vector[:size], problem.voltages(self.vector)))

    @property
    def law(self) -> Array:
        """Coefficients of 1, P, P^2, ... with P in C/m^2; the first without the offsets of the runs."""
        mean, scale = self.centring
        centred = np.polynomial.Polynomial([-mean / scale, 1.0 / scale])
        coefficients = np.polynomial.Polynomial([0.0, *self.vector[self.problem.law]])
        found: Array = coefficients(centred).coef
        return found

    def settled(self, run: MeasuredRun) -> tuple[IdentifiedProblem, Array]:
        """The same model for another run: only its start, offset and drift are fitted, to its counted samples."""
        base = self.problem.base.for_runs([run.time], [run.unknown_start])
        lag, drift = self.problem.lag is not None, self.problem.per_run > 1
        problem = IdentifiedProblem(base, [run], order=self.problem.order, lag=lag, drift=drift)
        problem.known_centring = self.centring
        start = problem.start.copy()
        shared = WEIGHTS + node_count(base.grid.size)
        start[:shared] = self.vector[:shared]
        start[problem.law] = self.vector[self.problem.law]
        start[problem.offsets] = float(np.mean(run.measured[run.counted]))
        lower, upper = problem.lower.copy(), problem.upper.copy()
        fixed = [*range(shared), *range(problem.law.start, problem.law.stop)]
        if problem.lag is not None and self.problem.lag is not None:
            start[problem.lag] = self.vector[self.problem.lag]
            fixed.append(problem.lag)
        lower[fixed] = upper[fixed] = start[fixed]
        found = solve(problem, start, lower, upper, most_steps=15, tolerance=1e-4, prior=problem.prior())
        return problem, found.vector

    def predict(self, run: MeasuredRun) -> Array:
        """The measurement of another run as the model has it, at every sample; see `settled`."""
        problem, vector = self.settled(run)
        return problem.predict(vector)[0]


@dataclass(frozen=True)
class IdentifiedFit:
    """Least squares of runs with unknown history on a density without a formula.

    Attributes:
        layer_thickness: [m].
        resolutions: coarse cells over the range that are compared.
        rotations: strengths of the prior that makes the density even along constant coercive field; compared.
        smoothness: strength of the prior on its second differences.
        order: of the law from polarization to measurement; 1 where polarization is what was measured.
        lag, drift: whether the measurement may be late, and each run drift.
        initial: of runs whose start is known.
        held_out: share of each run, at its end, that chooses.
        most_lines: of the fine lattice.
        progress: is told what is being done and the residual over noise.
    """

    layer_thickness: float
    resolutions: Sequence[int] = (8, 14)
    rotations: Sequence[float] = (0.0, 1.0, 10.0, 100.0)
    smoothness: float = 1.0
    order: int = 3
    lag: bool = False
    drift: bool = False
    initial: str = "virgin"
    held_out: float = 0.25
    most_lines: int = 160
    progress: Callable[[str, float], None] = lambda what, error: None

    def fit(self, runs: Sequence[MeasuredRun]) -> IdentifiedResult:
        """Find everything together.

        Raises:
            BenchError: nothing to fit, or a run that is not driven.
        """
        if not runs or any(np.ptp(run.voltage) == 0.0 or not np.any(run.counted) for run in runs):
            raise BenchError("identified lattice: each run needs a voltage that moves and samples that count")
        train = [run.part(_early(run.counted, 1.0 - self.held_out)) for run in runs]
        found: list[tuple[Choice, Array]] = []
        steps, vector, former = 0, None, None
        for resolution in self.resolutions:
            problem = self._problem([_thinned(run) for run in train], resolution, 0.0)
            begin = problem.with_law_guess(problem.start) if vector is None else _finer(problem, former, vector)
            solution = solve(
                problem,
                begin,
                problem.lower,
                problem.upper,
                most_steps=30,
                tolerance=1e-3,
                prior=problem.prior(),
                progress=self._tell(f"resolution {resolution}, thinned runs", problem),
            )
            steps, vector, former = steps + solution.steps, solution.vector, problem
            found += self._compared(runs, train, resolution, vector)
        choice, vector = self._best(found)
        problem = self._problem(runs, choice.resolution, choice.rotation)
        solution = solve(
            problem,
            vector,
            problem.lower,
            problem.upper,
            most_steps=12,
            tolerance=1e-3,
            prior=problem.prior(),
            progress=self._tell(f"resolution {choice.resolution}, all samples", problem),
        )
        choices = [choice, *(other for other, _ in found if other is not choice)]
        return IdentifiedResult(problem, solution.vector, solution.residuals, choices, steps + solution.steps)

    def _problem(self, runs: Sequence[MeasuredRun], resolution: int, rotation: float) -> IdentifiedProblem:
        voltages = [run.voltage for run in runs]
        low, high = min(v.min() for v in voltages), max(v.max() for v in voltages)
        base = IdentifiedHysteresis(
            [run.time for run in runs],
            self.layer_thickness,
            (float(low) / self.layer_thickness, float(high) / self.layer_thickness),
            resolution=resolution,
            unknown_start=[run.unknown_start for run in runs],
            initial=self.initial,
            most_lines=self.most_lines,
        )
        base.rotation_strength, base.smoothness_strength = rotation, self.smoothness
        return IdentifiedProblem(base, runs, order=self.order, lag=self.lag, drift=self.drift)

    def _tell(self, what: str, problem: IdentifiedProblem) -> Callable[[int, float], None]:
        count = sum(int(np.count_nonzero(run.counted)) for run in problem.runs)
        return lambda step, cost: self.progress(what, math.sqrt(cost / count))

    def _compared(
        self, runs: Sequence[MeasuredRun], train: Sequence[MeasuredRun], resolution: int, vector: Array
    ) -> list[tuple[Choice, Array]]:
        """Every prior at this resolution: the vector it leads to in the linear model, and its errors there."""
        problem = self._problem(runs, resolution, 0.0)
        residuals, jacobians = problem.linearise(vector)
        early = [part.counted[run.counted] for part, run in zip(train, runs, strict=True)]
        gram, gradient = normal_equations(
            [r[e] for r, e in zip(residuals, early, strict=True)], [j[e] for j, e in zip(jacobians, early, strict=True)]
        )
        found = []
        for rotation in self.rotations:
            rows, targets = self._problem(runs, resolution, rotation).prior()
            full, slope = gram + rows.T @ rows, gradient + rows.T @ (rows @ vector - targets)
            length = np.sqrt(np.maximum(np.diag(full), 1e-300))
            scaled = full / np.outer(length, length) + _TRUST * np.eye(length.size)
            low, high = (problem.lower - vector) * length, (problem.upper - vector) * length
            step = bounded_minimum(scaled, slope / length, low, high) / length
            after = [r + j @ step for r, j in zip(residuals, jacobians, strict=True)]
            errors = [rms_of([a[e == side] for a, e in zip(after, early, strict=True)]) for side in (True, False)]
            found.append((Choice(resolution, rotation, *errors), vector + step))
            self.progress(f"resolution {resolution}, rotation prior {rotation:g}, held out", errors[1])
        return found

    def _best(self, found: Sequence[tuple[Choice, Array]]) -> tuple[Choice, Array]:
        """The strongest prior, then the coarsest grid, among those about as good as the best on held-out samples."""
        least = min(choice.held_out for choice, _ in found)
        good = [pair for pair in found if pair[0].held_out <= _AS_GOOD * least]
        return min(good, key=lambda pair: (-pair[0].rotation, pair[0].resolution))


def _early(counted: Any, share: float) -> Any:
    """The first part of the counted samples."""
    places = np.flatnonzero(counted)
    early = np.zeros_like(counted)
    early[places[: math.ceil(share * places.size)]] = True
    return early


def _thinned(run: MeasuredRun) -> MeasuredRun:
    """The run with fewer samples."""
    span, duration = float(np.ptp(run.voltage)), float(run.time[-1] - run.time[0])
    kept = kept_samples(run.time, run.voltage, _STEP * span, duration / _FEWEST, _TOLERANCE * span)
    return replace(
        run,
        time=run.time[kept],
        voltage=run.voltage[kept],
        measured=run.measured[kept],
        counted=run.counted[kept],
    )


def _finer(problem: IdentifiedProblem, former: IdentifiedProblem | None, vector: Array) -> Array:
    """The vector of a former problem carried over to one with another grid over the same range."""
    assert former is not None
    link = former.base.link(vector)
    weights = np.empty(node_count(problem.base.grid.size))
    hats = hats_of(link.lines, problem.base.grid)
    accumulate(link.relays.weight, hats, np.zeros((hats.size, 2, (link.lines.size + 1) // 2)), weights)
    behind = WEIGHTS + node_count(former.base.grid.size)
    return np.concatenate((vector[: LOG_WIDTH + 2], weights, vector[behind:]))
