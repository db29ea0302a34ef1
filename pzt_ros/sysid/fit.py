"""Fitting a chain to measured runs: settings in the constructor, data in `fit`, a result that prints its own report."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from typing import Any

import numpy as np
from scipy import optimize

from pzt_ros.errors import BenchError
from pzt_ros.parallel import IN_THIS_PROCESS, Workers
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.covariance import correlation_length, effective_samples, parameter_covariance
from pzt_ros.sysid.history_search import PRICE, first_guesses, settle
from pzt_ros.sysid.history_shares import voltage_bounds
from pzt_ros.sysid.noise import noise_floor
from pzt_ros.sysid.parameters import FreeParameter, free_parameters, without_noise
from pzt_ros.sysid.problem import Problem, distinguishable
from pzt_ros.sysid.profile import BetterFitError, Interval, Profile
from pzt_ros.sysid.result import Estimate, FitResult, RunFit
from pzt_ros.sysid.run import Span, Start, begins_driven, check_usable, rms
from pzt_ros.sysid.spikes import without_spikes
from pzt_ros.sysid.start import CountedPart, counted_part, dying_out, with_offset

_least_squares: Any = optimize.least_squares  # SciPy carries no types

_ROUNDS = 3
_SHORT, _LONG = 12, 100  # steps of the optimizer
_REFUSED = 1e3  # residual that stands for a refused step, in units of the rms at the start
_SAMPLES_PER_PARAMETER = 5
_AT_BOUND = 1e-4  # of the range of a coordinate


@dataclass(frozen=True)
class Fit:
    """Least squares over one run or many, every counted sample of the same weight.

    Attributes:
        chain: the model; its `free:` names what may move, its values are where the search starts.
        span: the part of each run that counts; the chain runs from the first sample in any case.
        most_samples: residuals taken of each run; of a longer one evenly chosen samples.
        profile: whether to find the profile interval of each parameter, too.
        progress: is told what is being done.
        workers: run the chain, a run and a change of a parameter at a time, and find intervals, one at a time.
    """

    chain: Chain
    span: Span = Span()  # noqa: RUF009 - frozen
    most_samples: int = 20_000
    profile: bool = False
    progress: Callable[[str], None] = lambda text: None
    workers: Workers = IN_THIS_PROCESS

    def fit(self, records: Sequence[Record]) -> FitResult:
        """The parameters that describe all runs together.

        The history of each run is first left as free as it can be, then made as short as the data allow. Readings that
        stand alone do not count.

        Raises:
            BenchError: a run that cannot be fitted, a run given twice, an unknown parameter in `free:`.
        """
        chain = without_noise(self.chain)
        free = free_parameters(self.chain)
        records = [without_spikes(record)[0] for record in records]
        _check_runs(records, self.span, _SAMPLES_PER_PARAMETER * len(free))
        parts = [counted_part(record, self.span, self.most_samples) for record in records]
        guesses = list(zip(*self.workers.map(first_guesses, repeat(chain), parts), strict=True))
        problem = Problem(chain, free, parts, guesses[0], self._pass, self.workers)
        kept, held = distinguishable(problem) if "free" not in self.chain.notes else (list(free), [])
        problem.free = kept
        problem, vector = _with_best_histories(*_best_of(problem, guesses))
        intervals: list[Interval | None] = [None] * len(kept)
        if self.profile:
            vector, intervals = self._profiled(problem, vector)
        return _result(self.chain, problem, vector, held, intervals)

    def _pass(self, number: int, error: float) -> None:
        self.progress(f"pass {number}, {error * 1e9:.4g} nm rms")

    def _profiled(self, problem: Problem, vector: Array) -> tuple[Array, list[Interval | None]]:
        """Interval of each free parameter, and the vector; another one where a fit on the way was better.

        There is no interval of any where the misfit has so many valleys that no end is found.
        """
        alone = replace(problem, progress=_silent, workers=IN_THIS_PROCESS)  # what can be sent to a worker
        found: list[Interval | None] = []
        for _ in range(_ROUNDS):
            self.progress("profile: the optimum to more digits")
            profile, found = Profile(problem, vector, problem.bounds), []
            profile.problem = alone
            try:
                for interval in self.workers.map(profile.interval, range(len(problem.free))):
                    found.append(interval)
                    self.progress(f"profile: {len(found)} of {len(problem.free)} parameters")
                return profile.best.vector, found
            except BetterFitError as better:
                vector = better.args[0]
        return vector, [None] * len(problem.free)


def _silent(number: int, error: float) -> None:
    pass


def _check_runs(records: Sequence[Record], span: Span, least: int) -> None:
    if not records:
        raise BenchError("no runs to fit; name at least one CSV file or bag")
    seen: dict[str, str] = {}
    for record in records:
        check_usable(record, span, least)
        if record.sha256 in seen:
            raise BenchError(f"{record.name}: the same data as {seen[record.sha256]}; give each run once")
        seen[record.sha256] = record.name


def _best_of(problem: Problem, guesses: Sequence[Sequence[Start]]) -> tuple[Problem, Array]:
    """A short fit from each first guess of the histories, and a whole one from where the best of them came to."""
    tried = [replace(problem, starts=list(starts)) for starts in guesses]
    reached = [(each, _solve(each, _SHORT)) for each in tried]
    best, vector = min(reached, key=lambda pair: rms(np.concatenate(pair[0].residuals(pair[1]))))
    best = _restarted(best, best.chain_at(vector), best.starts_at(vector))
    return best, _solve(best, _LONG)


def _solve(problem: Problem, most_steps: int) -> Array:
    low, high = problem.bounds
    inside = np.clip(problem.begin, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
    begin = np.concatenate(problem.residuals(inside))
    scale = max(rms(begin), 1e-12)  # so that tolerances mean the same in m and um

    def residual(vector: Array) -> Array:
        try:
            return np.concatenate(problem.residuals(vector)) / scale
        except BenchError:  # a link refuses this combination of values: a step too far, to be taken back
            return np.full(begin.size, _REFUSED)

    found = _least_squares(
        residual,
        inside,
        jac=lambda vector: np.vstack(problem.jacobians(vector)) / scale,
        bounds=(low, high),
        x_scale="jac",
        xtol=1e-6,
        ftol=1e-7,
        gtol=1e-10,
        max_nfev=most_steps,
    )
    vector: Array = found.x
    return vector


def _with_best_histories(problem: Problem, vector: Array) -> tuple[Problem, Array]:
    """Look for other histories with the parameters free to adapt, fit again, and keep what is best."""
    best, best_vector = problem, vector
    for _ in range(_ROUNDS):
        chain, columns = problem.chain_at(vector), len(problem.free)
        tangents = [jacobian[:, :columns] for jacobian in problem.jacobians(vector)]
        starts = list(problem.workers.map(_settled, repeat(chain), problem.parts, tangents))
        problem = _restarted(problem, chain, starts)
        vector = _solve(problem, _LONG)
        if not _is_better(problem, vector, best, best_vector):
            break
        best, best_vector = problem, vector
    return best, best_vector


def _settled(chain: Chain, part: CountedPart, tangent: Array) -> Start:
    beside = np.column_stack((tangent, dying_out(chain, part)))
    return settle(chain, part, tangent=beside, noise=noise_floor(part.record.displacement).rms)


def _is_better(problem: Problem, vector: Array, other: Problem, other_vector: Array) -> bool:
    """Whether the fall of the misfit pays for the reversals that it took more."""
    residual, former = (np.concatenate(p.residuals(v)) for p, v in ((problem, vector), (other, other_vector)))
    if not rms(residual) > 0.0:
        return rms(former) > 0.0
    gain = effective_samples(residual) * 2.0 * math.log(rms(former) / rms(residual))
    return gain - PRICE * (vector.size - other_vector.size) > 1.0


def _restarted(problem: Problem, chain: Chain, starts: Sequence[Start]) -> Problem:
    free = [replace(p, value=float(getattr(chain.links[p.place], p.field))) for p in problem.free]
    again = replace(problem, chain=chain, free=free, starts=starts)
    again.evaluations = problem.evaluations
    return again


def _result(
    given: Chain,
    problem: Problem,
    vector: Array,
    held: Sequence[FreeParameter],
    intervals: Sequence[Interval | None],
) -> FitResult:
    residuals = problem.residuals(vector)
    covariance, undetermined = parameter_covariance(problem.jacobians(vector, central=True), residuals)
    low, high = problem.bounds
    at_bound = (vector - low < _AT_BOUND * (high - low)) | (high - vector < _AT_BOUND * (high - low))
    std = np.sqrt(np.diag(covariance))
    std[undetermined] = np.inf
    estimates = []
    for index, (parameter, interval) in enumerate(zip(problem.free, intervals, strict=True)):
        value = parameter.to_si(float(vector[index]))
        estimates.append(
            Estimate(
                parameter.name,
                value,
                float(std[index]) * abs(parameter.slope(value)),
                parameter.declared.unit,
                bool(at_bound[index]),
                interval.through(parameter.to_si) if interval is not None else None,
            )
        )
    count = len(estimates)
    chain = problem.chain_at(vector)
    starts = [with_offset(chain, part, s) for part, s in zip(problem.parts, problem.starts_at(vector), strict=True)]
    runs = [_run_fit(part, start, r) for part, start, r in zip(problem.parts, starts, residuals, strict=True)]
    return FitResult(
        chain=_with_fitted_values(given, chain),
        estimates=tuple(estimates),
        correlation=_correlation(covariance)[:count, :count],
        runs=tuple(runs),
        held=tuple(parameter.name for parameter in held),
        evaluations=problem.evaluations,
    )


def _correlation(covariance: Array) -> Array:
    std = np.sqrt(np.diag(covariance))
    std[std == 0.0] = np.inf
    correlation: Array = covariance / np.outer(std, std)
    return correlation


def _with_fitted_values(given: Chain, fitted: Chain) -> Chain:
    """The fitted links, but the sensor as it was given: its noise was only left out for the fit."""
    pairs = zip(given.links, fitted.links, strict=True)
    links = [old if old.kind == "displacement_sensor" else new for old, new in pairs]
    return replace(given, links=tuple(links))


def _run_fit(part: CountedPart, start: Start, residual: Array) -> RunFit:
    record = part.record
    counted = slice(int(part.picks[0]), part.end)
    floor = noise_floor(record.displacement[counted])
    step = float(np.mean(np.diff(record.time[part.picks])))
    return RunFit(
        name=record.name,
        sha256=record.sha256,
        start=start,
        begins_driven=begins_driven(record),
        history_at_bound=_is_at_end(start, record),
        counted_from=float(record.time[part.picks[0]]),
        counted_until=float(record.time[part.end - 1]),
        samples=int(part.picks.size),
        rms=rms(residual),
        span=float(np.ptp(record.displacement[counted])),
        noise=floor,
        correlation_time=correlation_length(residual) * step,
    )


def _is_at_end(start: Start, record: Record) -> bool:
    low, high = voltage_bounds(record)
    margin = _AT_BOUND * (high - low)
    return any(voltage < low + margin or voltage > high - margin for voltage in start.prior_voltages)
