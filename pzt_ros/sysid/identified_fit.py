"""The identified lattice and a strain law fitted to measured runs; how fine and how smooth is left to held-out samples.

The search is on thinned runs; resolution, prior and order of the law are compared on runs that only choose, or else on
the last part of each, which it has not seen. Runs that choose should go elsewhere than those that are fitted: between
loops of one amplitude any density and law will do (diagnosis-methods.md 0.4). Only the steps with what was chosen are
on every sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.parallel import one_blas_thread
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.gauss_newton import Solution, solve
from pzt_ros.sysid.identified import IdentifiedHysteresis
from pzt_ros.sysid.identified_problem import IdentifiedBase, IdentifiedProblem, MeasuredRun, rms_of
from pzt_ros.sysid.thinning import thinned

_AS_GOOD = 1.01  # error over the least one that still counts as equal: the stronger prior is taken then
_FEW_STEPS, _MOST_STEPS, _LAST_STEPS, _GAIN = 6, 30, 8, 1e-3
_HOPELESS = 1.3  # error over the least one from which on stronger priors are not tried


@dataclass(frozen=True)
class Choice:
    """One resolution, prior and law, and how it did: residual over noise where it was fitted and where it was not."""

    resolution: int
    rotation: float
    order: int
    train: float
    held_out: float

    @property
    def both(self) -> float:
        """What is compared: a prior that the fitted part contradicts is no better for a short part that chooses."""
        return math.hypot(self.train, self.held_out)


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
    def link(self) -> Ferroelectric:
        """Voltage at the ceramic to polarization."""
        return self.problem.base.link(self.vector)

    @property
    def centring(self) -> tuple[float, float]:
        """Mean and scale of the polarization that the law is written in [C/m^2]."""
        return _centring(self.problem, self.vector)

    @property
    def law(self) -> Array:
        """Coefficients of 1, P, P^2, ... with P in C/m^2; the first without the offsets of the runs."""
        mean, scale = self.centring
        centred = np.polynomial.Polynomial([-mean / scale, 1.0 / scale])
        coefficients = np.polynomial.Polynomial([0.0, *self.vector[self.problem.law]])
        return np.asarray(coefficients(centred).coef, dtype=np.float64)

    def settled(self, run: MeasuredRun) -> tuple[IdentifiedProblem, Array]:
        """The same model for another run: only its start, offset and drift are fitted, to its counted samples."""
        return _settled(self.problem, self.vector, run, _MOST_STEPS)

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
        orders: of the law from polarization to measurement; compared. 1 where polarization is what was measured.
        smoothness: strength of the prior on the density's second differences.
        lag, drift: whether the measurement may be late, and each run drift.
        initial: of runs whose start is known.
        held_out: share of each run, at its end, that chooses where no other runs do.
        fine_lines: of the fine lattice over what is driven, during the search and at most at the end.
        voltage_range: that the density has to cover [V]; None: what the runs reach.
        base: what is identified, the lattice or another.
        believed: shares of a lattice's hats on its grid, with which it stays where the runs do not tell.
        progress: is told what is being done and the residual over noise.
    """

    layer_thickness: float
    resolutions: Sequence[int] = (8, 14)
    rotations: Sequence[float] = (0.0, 1.0, 10.0, 100.0)
    orders: Sequence[int] = (3,)
    smoothness: float = 1.0
    lag: bool = False
    drift: bool = False
    initial: str = "virgin"
    held_out: float = 0.25
    fine_lines: tuple[int, int] = (80, 200)
    voltage_range: tuple[float, float] | None = None
    base: Callable[..., IdentifiedBase] = IdentifiedHysteresis
    believed: Callable[[Array], Array] | None = None
    progress: Callable[[str, float], None] = lambda what, error: None

    def only(self, choice: Choice) -> IdentifiedFit:
        """The same with nothing left to compare."""
        return replace(self, resolutions=(choice.resolution,), rotations=(choice.rotation,), orders=(choice.order,))

    def fit(self, runs: Sequence[MeasuredRun], choosing: Sequence[MeasuredRun] = ()) -> IdentifiedResult:
        """Find everything together.

        Args:
            runs: that are fitted.
            choosing: further runs whose counted samples choose resolution, prior and law, and are not fitted. Where
                neither these nor a part of a run chooses, the last part of each run does.

        Raises:
            BenchError: nothing to fit, or a run that is not driven.
        """
        _refuse_still(runs)
        with one_blas_thread():
            return self._finished(self._compared(runs, choosing), runs)

    def tried(self, runs: Sequence[MeasuredRun], choosing: Sequence[MeasuredRun] = ()) -> float:
        """Residual over noise of the first resolution, prior and law, on thinned runs: enough to compare two fits.

        Raises:
            BenchError: as `fit`.
        """
        _refuse_still(runs)
        first = replace(self, resolutions=self.resolutions[:1], rotations=self.rotations[:1], orders=self.orders[:1])
        with one_blas_thread():
            return first._compared(runs, choosing).best[0].both

    def _compared(self, runs: Sequence[MeasuredRun], choosing: Sequence[MeasuredRun]) -> Comparison:
        """Resolutions, priors and laws, on thinned runs."""
        training = [_thinned(run) for run in runs]
        compared = len(self.resolutions) * len(self.rotations) * len(self.orders)
        if compared > 1 and not choosing and not any(run.chooses is not None for run in runs):
            training = [self._divided(run) for run in training]
        comparison = Comparison(self, training, [_thinned(run) for run in choosing])
        resolution, *finer = self.resolutions
        order, *higher = sorted(self.orders)
        comparison.compare((resolution, rotation, order) for rotation in sorted(self.rotations))
        best = comparison.best[0]
        comparison.compare((resolution, best.rotation, other) for other in higher)
        best = comparison.best[0]
        comparison.compare((other, best.rotation, best.order) for other in finer)
        best = comparison.best[0]
        if best.resolution != resolution:  # a coarse grid is even anyway: two humps only show on a finer one
            weaker = sorted((each for each in self.rotations if each < best.rotation), reverse=True)
            comparison.compare((best.resolution, rotation, best.order) for rotation in weaker)
        return comparison

    def _finished(self, comparison: Comparison, runs: Sequence[MeasuredRun]) -> IdentifiedResult:
        """The best of a comparison, fitted to all counted samples of the runs."""
        choice, problem, vector = comparison.best
        steps, lines = comparison.steps, self.fine_lines[0]
        lines = min(max(lines, math.ceil(problem.base.finest(vector))), self.fine_lines[1])
        stages = (([_thinned(run) for run in runs], "thinned runs", _MOST_STEPS), (runs, "all samples", _LAST_STEPS))
        for counted, what, most_steps in stages:
            former, problem = problem, self._problem(counted, choice, lines)
            begin = problem.with_law_of(vector, former, vector)
            solution = self._solved(problem, begin, f"resolution {choice.resolution}, {what}", most_steps)
            steps, vector = steps + solution.steps, solution.vector
        choices = [choice, *(other for other, _, _ in comparison.found if other is not choice)]
        return IdentifiedResult(problem, vector, solution.residuals, choices, steps)

    def _divided(self, run: MeasuredRun) -> MeasuredRun:
        """The run with the last part of its counted samples choosing instead."""
        early = _early(run.counted, 1.0 - self.held_out)
        return replace(run, counted=early, chooses=run.counted & ~early)

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

    def _problem(self, runs: Sequence[MeasuredRun], choice: Choice, fine_lines: int) -> IdentifiedProblem:
        voltages = [run.voltage for run in runs]
        reached = (min(float(v.min()) for v in voltages), max(float(v.max()) for v in voltages))
        low, high = self.voltage_range or reached
        base = self.base(
            [run.time for run in runs],
            self.layer_thickness,
            (low / self.layer_thickness, high / self.layer_thickness),
            resolution=choice.resolution,
            unknown_start=[run.unknown_start for run in runs],
            initial=self.initial,
            fine_lines=fine_lines,
        )
        base.rotation_strength, base.smoothness_strength = choice.rotation, self.smoothness
        if self.believed is not None and isinstance(base, IdentifiedHysteresis):
            base.believe(self.believed(base.grid))
        return IdentifiedProblem(base, runs, order=choice.order, lag=self.lag, drift=self.drift)


class Comparison:
    """Choices that were fitted to the same thinned runs, each from where the one before ended.

    Attributes:
        found: every choice with its problem and vector.
        steps: of all searches together.
    """

    def __init__(self, fit: IdentifiedFit, training: Sequence[MeasuredRun], choosing: Sequence[MeasuredRun]) -> None:
        self.fit, self.training, self.choosing = fit, training, choosing
        self.found: list[_Found] = []
        self.steps = 0

    @property
    def best(self) -> _Found:
        """The strongest prior, the simplest law, then the coarsest grid, of those about as good as the best."""
        least = min(choice.both for choice, _, _ in self.found)
        good = [each for each in self.found if each[0].both <= _AS_GOOD * least]
        return min(good, key=lambda each: (-each[0].rotation, each[0].order, each[0].resolution))

    def compare(self, wanted: Iterable[tuple[int, float, int]]) -> None:
        """Fit resolutions, priors and orders one after the other, until one is hopeless."""
        for resolution, rotation, order in wanted:
            choice = Choice(resolution, rotation, order, math.nan, math.nan)
            problem = self.fit._problem(self.training, choice, self.fit.fine_lines[0])
            what = f"resolution {resolution}, rotation prior {rotation:g}, law of order {order}"
            begin = self._begin(problem)
            solution = self.fit._solved(problem, begin, what)
            self.steps += solution.steps
            held_out = self._held_out(problem, solution.vector)
            self.fit.progress("held out", held_out)
            choice = replace(choice, train=rms_of(solution.residuals), held_out=held_out)
            self.found.append((choice, problem, solution.vector))
            if choice.both > _HOPELESS * min(choice.both for choice, _, _ in self.found):
                break

    def _begin(self, problem: IdentifiedProblem) -> Array:
        if not self.found:
            return self.fit._begun(problem)
        _, former, vector = self.best
        return _carried(former, problem, vector)

    def _held_out(self, problem: IdentifiedProblem, vector: Array) -> float:
        """Residual over noise in the runs, and parts of the fitted runs, that choose."""
        late = []
        for run in self.choosing:
            elsewhere, settled = _settled(problem, vector, run, _FEW_STEPS)
            late += elsewhere.residuals(settled)
        for run, model in zip(problem.runs, problem.predict(vector), strict=True):
            if run.chooses is not None:
                late.append((model - run.measured)[run.chooses] / run.noise)
        return rms_of(late)


def _refuse_still(runs: Sequence[MeasuredRun]) -> None:
    if not runs or any(np.ptp(run.voltage) == 0.0 or not np.any(run.counted) for run in runs):
        raise BenchError("identified lattice: each run needs a voltage that moves and samples that count")


def _centring(problem: IdentifiedProblem, vector: Array) -> tuple[float, float]:
    """Mean and scale of the polarization that the law is written in [C/m^2]."""
    polarizations = problem.base.polarization(vector[: problem.law.start], problem.voltages(vector))
    return problem.centring(polarizations)


def _settled(
    problem: IdentifiedProblem, vector: Array, run: MeasuredRun, most_steps: int
) -> tuple[IdentifiedProblem, Array]:
    """A fitted model for another run: only its start, offset and drift are fitted, to its counted samples."""
    base = problem.base.for_runs([run.time], [run.unknown_start])
    other = IdentifiedProblem(base, [run], order=problem.order, lag=problem.lag is not None, drift=problem.per_run > 1)
    other.known_centring = _centring(problem, vector)
    start = other.start.copy()
    shared = base.shared
    start[:shared] = vector[:shared]
    start[other.law] = vector[problem.law]
    start[other.offsets] = float(np.mean(run.measured[run.counted]))
    lower, upper = other.lower.copy(), other.upper.copy()
    fixed = [*range(shared), *range(other.law.start, other.law.stop)]
    if other.lag is not None and problem.lag is not None:
        start[other.lag] = vector[problem.lag]
        fixed.append(other.lag)
    if other.polarization_scale is not None and problem.polarization_scale is not None:
        start[other.polarization_scale] = vector[problem.polarization_scale]
        fixed.append(other.polarization_scale)
    lower[fixed] = upper[fixed] = start[fixed]
    found = solve(other, start, lower, upper, most_steps=most_steps, tolerance=1e-4, prior=other.prior())
    return other, found.vector


def _early(counted: Any, share: float) -> Any:
    """The first part of the counted samples."""
    places = np.flatnonzero(counted)
    early = np.zeros_like(counted)
    early[places[: math.ceil(share * places.size)]] = True
    return early


def _thinned(run: MeasuredRun) -> MeasuredRun:
    """The run with fewer samples."""
    kept = thinned(run.time, run.voltage)
    return replace(
        run,
        time=run.time[kept],
        voltage=run.voltage[kept],
        measured=run.measured[kept],
        counted=run.counted[kept],
        chooses=None if run.chooses is None else run.chooses[kept],
        polarization=run.polarization[kept] if run.is_polarized else run.polarization,
    )


def _carried(former: IdentifiedProblem, problem: IdentifiedProblem, vector: Array) -> Array:
    """The vector of a former problem for one with another grid over the same range, or another law."""
    if former.base.shared == problem.base.shared and former.order == problem.order:
        return vector
    return problem.with_law_of(problem.base.carried(former.base, vector), former, vector)
