"""Which effects are worth a refit: the signature of each, with what the base can absorb of it taken out.

To correlate the residual with raw signatures names the wrong effect in every second case; after projection, none of 96
(diagnosis-methods.md, finding 1). All that is judged here is judged again after the joint refit.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import optimize

from pzt_ros.diagnosis.coordinates import Coordinate, of_effect
from pzt_ros.diagnosis.counts import counts_before
from pzt_ros.diagnosis.data import FIT, SELECTION, RunData, seen_through
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.staged import Staged
from pzt_ros.effects.effect import Effect
from pzt_ros.effects.insert import with_effect
from pzt_ros.errors import BenchError
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.bounded_quadratic import bounded_minimum
from pzt_ros.sysid.covariance import triangle_of
from pzt_ros.sysid.gauss_newton import cost_at

_optimize: Any = optimize  # SciPy carries no types

_AT_BOUND = 0.02  # of the way to the other bound
_SIMPLEX = 0.3  # of a coordinate: a third more or less of a time or a frequency
_SHAPES = 30  # that are tried at most
_FEW_SHAPES = 10  # the same where each costs a pass through the ceramic
_SLOWEST = 10.0  # time constant over the longest run
_FASTEST = 5.0  # time constant over the step between samples
_SHARES = (1.0, 0.5, 0.2, 0.0)  # of the way to where the line leads, at which a refit may start
_RIDGE = 1e-10  # of columns of length 1, where bounds hold some of them
_LONGEST_SHIFT = 0.5  # of an unknown of the ceramic: a refit that starts with parameters e times larger may not start


@dataclass(frozen=True)
class Prospect:
    """A candidate before its refit.

    Attributes:
        effect: which.
        link: of the effect, in the shape that was tried.
        given: what is known of single runs beside it.
        staged: the model with the effect in it.
        without: the base where it was, in the effect's shape but none of it.
        start: where the linear prediction puts base and effect.
        total: as `Hypothesis.total`, predicted linearly.
        screened: unknowns of the hypothesis that was screened, which come first in each vector.
        coarse: where it was refined from, if that led to a bound: a linear prediction may have its best place where no
            refit comes back from.
    """

    effect: Effect
    link: Link
    given: tuple[Coordinate, ...]
    staged: Staged
    without: Array
    start: Array
    total: float
    screened: int
    coarse: Prospect | None = None

    def best_start(self) -> Array:
        """Of a few vectors on the way to `start` the one of least cost: the prediction may lead too far.

        A limit is there or not. Until the base has moved with it, it may cost more than none, and then a refit stays at
        none; so it starts with all of it where that can be evaluated.

        Raises:
            BenchError: the model cannot be evaluated at any.
        """
        tried = [self.without + share * (self.start - self.without) for share in _SHARES]
        costs = [cost_at(self.staged, vector, *self.staged.prior) for vector in tried]
        if not math.isfinite(min(costs)):
            raise BenchError(f"{self.effect.name}: the model cannot be evaluated where a refit would start")
        if self.effect.limits and math.isfinite(costs[0]):
            return tried[0]
        return tried[int(np.argmin(costs))]

    def beginning_at(self, found: Array) -> Prospect:
        """The same with the base as in a vector of another refit beside it."""
        base = found[: self.screened]
        without, start = (np.concatenate((base, each[base.size :])) for each in (self.without, self.start))
        return replace(self, without=without, start=start, coarse=None)


def _at_bound(shape: Sequence[Coordinate], link: Link) -> bool:
    """Whether a parameter that moves by ratios is as large or as small as it may be."""
    for each in shape:
        low, high = each.bounds
        value = each.scaled(getattr(link, each.field))
        if each.is_log and min(value - low, high - value) < _AT_BOUND * (high - low):
            return True
    return False


class Screen:
    """The tangent space of a hypothesis, on the parts that are fitted and on those that choose."""

    def __init__(self, hypothesis: Hypothesis) -> None:
        self.hypothesis = hypothesis
        staged = hypothesis.staged
        self._fitted = staged.fitted
        self._choosing = hypothesis.choosing
        residual = np.concatenate(hypothesis.solution.residuals)
        self._left = np.concatenate(hypothesis.selection_residuals) if self._choosing else np.zeros(0)
        self._ahead = self._selection_jacobian()
        self._rows, _ = staged.prior
        self._own = self._own_directions()
        parts = (*hypothesis.jacobians, self._rows)  # what no run tells the prior knows: both make a length
        self._length = np.linalg.norm(np.vstack([np.linalg.norm(part, axis=0) for part in parts]), axis=0) + 1e-300
        parts = tuple(part / self._length for part in parts)
        _, s, vt = np.linalg.svd(triangle_of(parts))
        sound = s > 1e-7 * s[0]
        self._back = vt[sound].T / s[sound]
        self._q = np.vstack([part @ self._back for part in parts])
        self._fitted_samples = residual.size
        padded = np.concatenate((residual, np.zeros(len(self._rows))))
        self._absorbed = self._q.T @ padded
        self._rest = padded - self._q @ self._absorbed
        self.outputs = staged.outputs(hypothesis.vector, range(len(staged.runs)))

    @cached_property
    def _polarizations(self) -> list[Array]:
        return self.hypothesis.staged.polarizations(self.hypothesis.vector)

    def _selection_jacobian(self) -> Array:
        staged = self.hypothesis.staged
        if not self._choosing:
            return np.zeros((0, staged.start.size))
        parts = staged.jacobians(self.hypothesis.vector, self._choosing, SELECTION)[1]
        return np.vstack(parts, dtype=float)

    def _own_directions(self) -> Array:
        """What the histories of the runs that choose can make of the misfit there [orthonormal, shape (n, q)].

        Unknowns that a prior holds are left where they are.
        """
        ceramic = self.hypothesis.staged.ceramic
        own = [place for number in self._choosing for place in ceramic.places_of(number)]
        free = [place for place in own if not np.any(self._rows[:, place])]
        found: Array = np.linalg.qr(self._ahead[:, free])[0]
        return found

    @cached_property
    def _fading(self) -> Screen:
        """The same for an effect that remembers, without what that does to runs with a past that nobody recorded.

        With it in the misfit of the base the screen did not see a creep of stages that were left within minor loops.
        """
        found = self.hypothesis
        runs = [replace(run, fades=run.poled or run.begins_driven) for run in found.staged.runs]
        return Screen(fitted(replace(found.staged, runs=runs), found.vector, found.effects, most_steps=0))

    def best(self, effect: Effect) -> Prospect | None:
        """The start of an effect that promises most; None where none can be evaluated."""
        prospects = []
        for values in effect.starts:
            link = dataclasses.replace(effect.link(), **values, **self._spanned(effect))
            for given in self._given(effect, link):
                with suppress(BenchError):
                    prospects.append(self._prospect(effect, link, given))
        return min((p for p in prospects if np.isfinite(p.total)), key=lambda p: p.total, default=None)

    def _spanned(self, effect: Effect) -> dict[str, float]:
        """What an effect has to know of where the displacement goes."""
        low = min(float(displacement.min()) for displacement, _ in self.outputs)
        high = max(float(displacement.max()) for displacement, _ in self.outputs)
        return dict(zip(effect.spans, (0.5 * (low + high), 0.5 * (high - low)), strict=False))

    def _given(self, effect: Effect, link: Link) -> list[tuple[Coordinate, ...]]:
        """What single runs may be known to begin with: nothing, or what the runs before have left."""
        counted = counts_before(effect.goes_on, link, self._polarizations) if effect.goes_on else ()
        return [(), counted] if counted else [()]

    def refined(self, prospect: Prospect) -> Prospect:
        """The same effect in the shape that promises most, sought from the one given: a grid is too coarse.

        Effects before the ceramic stay as they are: each of their shapes costs a pass through it. Not so limits: they
        do nothing, or too much, but in a narrow range that is easily missed.
        """
        effect = prospect.effect
        is_slow = prospect.staged.is_before(effect.name)
        added = prospect.staged.coordinates[len(self.hypothesis.staged.coordinates) :]
        shape = [each for each in added if each.run is None and (effect.limits or each.field not in effect.columns)]
        if (is_slow and not effect.limits) or not shape:
            return prospect
        tried = [prospect]

        def total(vector: Array) -> float:
            values = {each.field: each.si(float(value)) for each, value in zip(shape, vector, strict=True)}
            try:
                link = dataclasses.replace(prospect.link, **values)
                tried.append(self._prospect(effect, link, prospect.given))
            except BenchError:
                return math.inf
            return tried[-1].total

        first = np.array([each.scaled(each.start) for each in shape])
        bounds = [each.bounds for each in shape]
        sides = [
            _SIMPLEX if value + _SIMPLEX <= high else -_SIMPLEX for value, (_, high) in zip(first, bounds, strict=True)
        ]
        options = {
            "initial_simplex": [first, *(first + np.diag(sides))],
            "maxfev": _FEW_SHAPES if is_slow else _SHAPES,
            "xatol": 0.01,
            "fatol": 1e-6,
        }
        _optimize.minimize(total, first, method="Nelder-Mead", bounds=bounds, options=options)
        best = min((each for each in tried if np.isfinite(each.total)), key=lambda each: each.total)
        return replace(best, coarse=prospect) if _at_bound(shape, best.link) else best

    def _prospect(self, effect: Effect, link: Link, given: tuple[Coordinate, ...] = ()) -> Prospect:
        hypothesis = self.hypothesis
        runs = range(len(hypothesis.staged.runs))
        added = [self._within_sight(effect, each) for each in of_effect(effect, link, runs)]
        chain = with_effect(hypothesis.staged.chain, link)
        base = hypothesis.staged
        if _of_fading(seen_through(chain, base.runs)) != _of_fading(base.runs):
            return self._fading._prospect(effect, link, given)
        staged = replace(
            base,
            chain=chain,
            coordinates=(*base.coordinates, *added),
            given=(*base.given, *given),
        )
        shape = np.array([0.0 if each.field in effect.columns else each.scaled(each.start) for each in added])
        signatures, ahead, places = self._signatures(effect, staged, added, shape)
        limits = np.array([added[k].bounds for k in places]).T
        if effect.limits:  # half of such an effect is no effect of half the size
            limits = np.ones_like(limits)
        amounts, shift, total = self._explained(signatures, ahead, bool(effect.per_run), limits)
        low, high = staged.bounds
        without = np.clip(np.concatenate((hypothesis.vector, shape)), low, high)
        shape[places] = amounts
        longest = float(np.max(np.abs(shift[: hypothesis.staged.ceramic.start.size]), initial=0.0))
        shift = shift * min(1.0, _LONGEST_SHIFT / longest) if longest > 0.0 else shift
        start = np.clip(np.concatenate((hypothesis.vector + shift, shape)), low, high)
        return Prospect(effect, link, given, staged, without, start, total, hypothesis.vector.size)

    def _within_sight(self, effect: Effect, each: Coordinate) -> Coordinate:
        """A time within what the runs can tell: faster is a gain or a lag, slower a straight line, of any amount.

        A creep over a step or two between samples, as large as what it followed, was a sensor's lag.
        """
        if each.unit != "s" or each.field in effect.columns:
            return each
        times = [run.record.time for run in self.hypothesis.staged.runs]
        shortest = _FASTEST * min(float(np.median(np.diff(time))) for time in times)
        longest = _SLOWEST * max(float(time[-1] - time[0]) for time in times)
        lower, upper = max(each.lower, shortest), min(each.upper, longest)
        return replace(each, start=min(max(each.start, lower), upper), lower=lower, upper=upper)

    def _signatures(
        self, effect: Effect, staged: Staged, added: Sequence[Coordinate], shape: Array
    ) -> tuple[Array, Array, list[int]]:
        """What the effect does to the residuals: a column for each of its linear parameters, on both kinds of parts.

        Returns:
            Columns on what is fitted, columns on what chooses, and the places of the former among the added unknowns.
        """
        columns: list[Array] = []
        ahead: list[Array] = []
        places: list[int] = []
        for field in effect.columns:
            own = [k for k, each in enumerate(added) if each.field == field]
            vector = shape.copy()
            vector[own] = 1.0
            there = staged.outputs(np.concatenate((self.hypothesis.vector, vector)), range(len(staged.runs)))
            changes = [(a[0] - b[0], a[1] - b[1]) for a, b in zip(there, self.outputs, strict=True)]
            fitted = [staged.runs[r].change(FIT, *changes[r]) for r in self._fitted]
            choosing = [staged.runs[r].change(SELECTION, *changes[r]) for r in self._choosing]
            if field in effect.per_run:
                columns += [_only(fitted, k) for k in range(len(fitted))]
                ahead += [_only(choosing, k) for k in range(len(choosing))]
                places += [own[r] for r in self._fitted]
            else:
                columns.append(np.concatenate(fitted))
                ahead.append(np.concatenate(choosing) if choosing else np.zeros(0))
                places += own
        width = (self._left.size, 0)
        return np.column_stack(columns), np.column_stack(ahead) if ahead else np.zeros(width), places

    def _explained(self, signatures: Array, ahead: Array, per_run: bool, limits: Array) -> tuple[Array, Array, float]:
        """Amounts of the signatures within limits, how the base moves with them, and the mean square that is left."""
        padded = np.vstack((signatures, np.zeros((len(self._rows), signatures.shape[1]))))
        absorbed = self._q.T @ padded
        clear = padded - self._q @ absorbed
        amounts = _bounded(clear, -self._rest, *limits)
        moved = -(self._back @ (self._absorbed + absorbed @ amounts))
        shift: Array = (moved / self._length).astype(np.float64)
        left = (self._rest + clear @ amounts)[: self._fitted_samples]  # base and amounts moved
        total = float(left @ left) / left.size
        if self._left.size:  # a base that has far to go goes there as no line says, so this can promise but not refuse
            before = float(self._left @ self._left) / self._left.size
            total += min(self._chosen(shift, amounts, ahead, per_run), before)
        return amounts, shift, total

    def _chosen(self, shift: Array, amounts: Array, ahead: Array, per_run: bool) -> float:
        """Mean square on the parts that choose; what belongs to a run is fitted there.

        Infinite where a base that was never near the runs would go so far along a line that no number holds it.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            left = self._left + self._ahead @ shift
            if not np.all(np.isfinite(left)):
                return math.inf
            left, ahead = (each - self._own @ (self._own.T @ each) for each in (left, ahead))
            if per_run:
                amounts = np.asarray(np.linalg.lstsq(ahead, -left, rcond=1e-10)[0], dtype=float)
            left = left + ahead @ amounts
            return float(left @ left) / left.size


def _of_fading(runs: Sequence[RunData]) -> list[bool]:
    return [run.fades for run in runs]


def _bounded(columns: Array, wanted: Array, low: Array, high: Array) -> Array:
    """The amounts of columns, within bounds, whose sum comes closest to what is wanted.

    Cut off at a bound one by one they would be anywhere: some make up for others.
    """
    free = np.asarray(np.linalg.lstsq(columns, wanted, rcond=1e-10)[0], dtype=float)
    if np.all((low <= free) & (free <= high)):
        return free
    length = np.linalg.norm(columns, axis=0) + 1e-300
    scaled = columns / length
    gram = scaled.T @ scaled + _RIDGE * np.eye(length.size)
    return bounded_minimum(gram, -(scaled.T @ wanted), low * length, high * length) / length


def _only(parts: Sequence[Array], number: int) -> Array:
    """One run's column, nothing elsewhere."""
    return np.concatenate([part if k == number else np.zeros_like(part) for k, part in enumerate(parts)])
