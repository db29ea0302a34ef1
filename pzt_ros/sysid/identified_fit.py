"""The identified lattice and a strain law fitted to measured runs; how fine and how smooth is left to held-out samples.

The search is on thinned runs; resolution and prior are compared on the last part of each, which it has not seen. Only
the steps with what was chosen are on every sample.
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
from pzt_ros.sysid.gauss_newton import Solution, solve
from pzt_ros.sysid.identified import WEIGHTS, IdentifiedHysteresis
from pzt_ros.sysid.identified_problem import IdentifiedProblem, MeasuredRun, rms_of
from pzt_ros.sysid.thinning import kept_samples

_STEP, _TOLERANCE = 0.02, 0.0005  # of the range of voltage: thinned runs
_FEWEST = 1500  # samples that a thinned run keeps at least, holds too
_AS_GOOD = 1.02  # validation error over the least one that still counts as equal: the stronger prior is taken then
_FEW_STEPS, _MOST_STEPS, _GAIN = 6, 30, 1e-3
_HOPELESS = 1.3  # validation error over the least one from which on stronger priors are not tried


@dataclass(frozen=True)
class Choice:
    """One resolution and prior, and how it did: residual over noise in the training and in the held-out part."""

    resolution: int
    rotation: float
    train: float
    held_out: float


_Found = tuple[Choice, IdentifiedProblem, Array]


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
        return np.asarray(coefficients(centred).coef, dtype=np.float64)

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
        found = solve(problem, start, lower, upper, most_steps=_MOST_STEPS, tolerance=1e-4, prior=problem.prior())
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
        fine_lines: of the fine lattice during the search, and at most at the end.
        voltage_range: that the density has to cover [V]; None: what the runs reach.
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
    fine_lines: tuple[int, int] = (100, 200)
    voltage_range: tuple[float, float] | None = None
    progress: Callable[[str, float], None] = lambda what, error: None

    def fit(self, runs: Sequence[MeasuredRun]) -> IdentifiedResult:
        """Find everything together.

        Raises:
            BenchError: nothing to fit, or a run that is not driven.
        """
        if not runs or any(np.ptp(run.voltage) == 0.0 or not np.any(run.counted) for run in runs):
            raise BenchError("identified lattice: each run needs a voltage that moves and samples that count")
        training, lines = [self._training(run) for run in runs], self.fine_lines[0]
        found: list[_Found] = []
        steps, problem, vector = 0, None, np.empty(0)
        for resolution in self.resolutions:
            for rotation in sorted(self.rotations):
                former, problem = problem, self._problem(training, resolution, rotation, lines)
                begin = self._begun(problem) if former is None else _carried(former, problem, vector)
                solution = self._solved(problem, begin, f"resolution {resolution}, rotation prior {rotation:g}")
                steps, vector = steps + solution.steps, solution.vector
                held_out = _held_out(problem, vector)
                found.append((Choice(resolution, rotation, rms_of(solution.residuals), held_out), problem, vector))
                self.progress("held out", held_out)
                if held_out > _HOPELESS * min(choice.held_out for choice, _, _ in found):
                    break
        choice, problem, vector = _best(found)
        lines = min(max(lines, math.ceil(problem.base.finest(vector))), self.fine_lines[1])
        for counted, what in (([_thinned(run) for run in runs], "thinned runs"), (runs, "all samples")):
            former, problem = problem, self._problem(counted, choice.resolution, choice.rotation, lines)
            begin = problem.with_law_of(vector, former, vector)
            solution = self._solved(problem, begin, f"resolution {choice.resolution}, {what}")
            steps, vector = steps + solution.steps, solution.vector
        choices = [choice, *(other for other, _, _ in found if other is not choice)]
        return IdentifiedResult(problem, vector, solution.residuals, choices, steps)

    def _training(self, run: MeasuredRun) -> MeasuredRun:
        """The run thinned, its last part not counted."""
        thinned = _thinned(run)
        return thinned.part(_early(thinned.counted, 1.0 - self.held_out))

    def _begun(self, problem: IdentifiedProblem) -> Array:
        """Where a few steps lead from the better of two starts, poled and undecided."""
        reached = []
        for occupancy in (1.0, 0.5) if any(problem.base.unknown_start) else (0.5,):
            begin = problem.start.copy()
            begin[problem.base.occupancies] = occupancy
            begin = problem.with_law_guess(begin)
            reached.append(self._solved(problem, begin, f"occupancy {occupancy:g} at the start", _FEW_STEPS))
        return min(reached, key=lambda solution: solution.cost).vector

    def _solved(self, problem: IdentifiedProblem, begin: Array, what: str, most_steps: int = _MOST_STEPS) -> Solution:
        count = sum(int(np.count_nonzero(run.counted)) for run in problem.runs)
        return solve(
            problem,
            begin,
            problem.lower,
            problem.upper,
            most_steps=most_steps,
            tolerance=_GAIN,
            prior=problem.prior(),
            progress=lambda step, cost: self.progress(what, math.sqrt(cost / count)),
        )

    def _problem(
        self, runs: Sequence[MeasuredRun], resolution: int, rotation: float, fine_lines: int
    ) -> IdentifiedProblem:
        voltages = [run.voltage for run in runs]
        reached = (min(float(v.min()) for v in voltages), max(float(v.max()) for v in voltages))
        low, high = self.voltage_range or reached
        base = IdentifiedHysteresis(
            [run.time for run in runs],
            self.layer_thickness,
            (low / self.layer_thickness, high / self.layer_thickness),
            resolution=resolution,
            unknown_start=[run.unknown_start for run in runs],
            initial=self.initial,
            fine_lines=fine_lines,
        )
        base.rotation_strength, base.smoothness_strength = rotation, self.smoothness
        return IdentifiedProblem(base, runs, order=self.order, lag=self.lag, drift=self.drift)


def _held_out(problem: IdentifiedProblem, vector: Array) -> float:
    """Residual over noise after the counted samples of each run."""
    late = []
    for run, model in zip(problem.runs, problem.predict(vector), strict=True):
        begin = int(np.flatnonzero(run.counted)[-1]) + 1
        late.append((model - run.measured)[begin:] / run.noise)
    return rms_of(late)


def _best(found: Sequence[_Found]) -> _Found:
    """The strongest prior, then the coarsest grid, among those about as good as the best on held-out samples."""
    least = min(choice.held_out for choice, _, _ in found)
    good = [each for each in found if each[0].held_out <= _AS_GOOD * least]
    return min(good, key=lambda each: (-each[0].rotation, each[0].resolution))


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


def _carried(former: IdentifiedProblem, problem: IdentifiedProblem, vector: Array) -> Array:
    """The vector of a former problem for one with another grid over the same range."""
    if former.base.grid.size == problem.base.grid.size:
        return vector
    link = former.base.link(vector)
    weights = np.empty(node_count(problem.base.grid.size))
    hats = hats_of(link.lines, problem.base.grid)
    accumulate(link.relays.weight, hats, np.zeros((hats.size, 2, (link.lines.size + 1) // 2)), weights)
    behind = WEIGHTS + node_count(former.base.grid.size)
    finer = np.concatenate((vector[:WEIGHTS], weights, vector[behind:]))
    return problem.with_law_of(finer, former, vector)
