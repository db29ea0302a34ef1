"""How coercive and interaction fields are distributed over the domains, and the rules that replace a density by nodes.

A rule turns a density into nodes [V/m] and weights [-]; the weights are what the rule makes of the integral of the
density, so their sum tells what the rule has cut off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array

Nodes = tuple[Array, Array]
"""Fields [V/m] and their weights [-], each of shape (n,)."""

THESIS_CUT = 3.0
"""The thesis' program ends its ranges at 3 sigma."""


@dataclass(frozen=True)
class _Bell:
    """What densities with one peak are made of.

    Attributes:
        centre: where it is densest, unless that is cut off [V/m].
        spread: b = 2 sigma^2 [V^2/m^2]; 0 means that all domains have the field `centre`.
        lower: there is nothing below this field [V/m]; 0 for coercive fields.
    """

    centre: float
    spread: float
    lower: float = -math.inf

    @property
    def sigma(self) -> float:
        """Standard deviation of the normal that it comes from [V/m]."""
        return math.sqrt(self.spread / 2)

    @property
    def peak(self) -> float:
        """The field of the highest density [V/m]."""
        return max(self.centre, self.lower)


@dataclass(frozen=True)
class Gaussian(_Bell):
    """exp(-(E - centre)^2/spread), cut off below `lower` and normalised (3.12, 3.14)."""

    @property
    def mass(self) -> float:
        """The share of the unclipped bell above `lower` [-]."""
        return float(special.ndtr((self.centre - self.lower) / self.sigma))

    def support(self, cut: float) -> tuple[float, float]:
        """Ends of the range kept when the bell is cut at `cut` sigma [V/m]."""
        reach = cut * self.sigma
        return max(self.lower, self.centre - reach), self.centre + reach

    def at(self, fields: Array) -> Array:
        """Density at `fields` [m/V]."""
        bell = np.exp(-((fields - self.centre) ** 2) / self.spread) / math.sqrt(math.pi * self.spread)
        return np.where(fields >= self.lower, bell / self.mass, 0.0)

    def below(self, fields: Array) -> Array:
        """Share of the domains below `fields` [-]."""
        share: Array = special.ndtr((fields - self.centre) / self.sigma)
        return np.maximum(share - (1.0 - self.mass), 0.0) / self.mass

    def quantile(self, share: Array) -> Array:
        """The field below which lies a `share` of the domains [V/m]."""
        below_lower = 1.0 - self.mass
        return self.centre + self.sigma * special.ndtri(below_lower + share * self.mass)

    def widened(self, sigma: float) -> Gaussian:
        """The same at its densest field, at least so wide."""
        return self if self.sigma >= sigma else replace(self, centre=self.peak, spread=2 * sigma**2)


@dataclass(frozen=True)
class Bent(_Bell):
    """A bell of another shape: E = centre + sigma h(z) of a normal z, cut off below `lower` and at 6 sigma.

    Skewed, h = (exp(s z) - exp(-s^2))/s, it is the lognormal density, shifted; with tails, h = sinh(r z)/r, S_U of
    Johnson (Biometrika 36, 1949), at r = 0.5 close to a logistic, beyond to Student's; with both, the tails of what is
    skewed. The tail is r^2, below 0 that of the inverse, which is flatter than a Gaussian: so the density goes straight
    with it about 0. Lopsided, it is 1 + l times as wide above its centre and 1 - l times below, and densest there still
    (Fernandez and Steel, J. Am. Stat. Assoc. 93, 1998).

    Attributes:
        skew, tail: s and r^2 [-].
        lopsided: l, between -1 and 1 [-].
    """

    skew: float = 0.0
    tail: float = 0.0
    lopsided: float = 0.0

    def support(self, cut: float) -> tuple[float, float]:
        """Ends of the range kept when z is cut at `cut` sigma [V/m]."""
        low, high = np.clip(self._widths * self._bent(np.array([-cut, cut])) + self.centre, *self._ends)
        return float(low), float(high)

    def at(self, fields: Array) -> Array:
        """Density at `fields` [m/V]."""
        first, last = self._shares
        inside = np.clip(fields, *self._ends)
        z, growth = self._straight(inside)
        bell = np.exp(-0.5 * z**2) * growth / (math.sqrt(2 * math.pi) * self.sigma)
        return np.where(inside == fields, bell / (last - first), 0.0)

    def below(self, fields: Array) -> Array:
        """Share of the domains below `fields` [-]."""
        first, last = self._shares
        return (self._whole_below(np.clip(fields, *self._ends)) - first) / (last - first)

    def quantile(self, share: Array) -> Array:
        """The field below which lies a `share` of the domains [V/m]."""
        first, last = self._shares
        whole, side = first + np.asarray(share) * (last - first), self.lopsided
        is_above = whole > (1 - side) / 2
        z = special.ndtri(np.where(is_above, (whole + side) / (1 + side), whole / (1 - side)))
        below, above = self._widths
        return self.centre + np.where(is_above, above, below) * self._bent(z)

    def widened(self, sigma: float) -> Bent:
        """The same, at least so wide."""
        return self if self.sigma >= sigma else replace(self, spread=2 * sigma**2)

    @property
    def _widths(self) -> Array:
        """Sigma below and above the centre [V/m, shape (2,)]."""
        return self.sigma * np.array([1 - self.lopsided, 1 + self.lopsided])

    @property
    def _ends(self) -> tuple[float, float]:
        """What is farther out than a drive reaches would only make a grid larger [V/m]."""
        below, above = _FARTHEST * self._widths
        return max(self.lower, self.centre - float(below)), self.centre + float(above)

    @cached_property
    def _shares(self) -> tuple[float, float]:
        """Shares of the whole density up to both ends [-]."""
        first, last = self._whole_below(np.array(self._ends))
        return float(first), float(last)

    def _whole_below(self, fields: Array) -> Array:
        """Share of the whole density, without ends, below some fields [-]."""
        share, side = special.ndtr(self._straight(fields)[0]), self.lopsided
        return np.where(fields > self.centre, share * (1 + side) - side, share * (1 - side))

    def _bent(self, z: Array) -> Array:
        """h(z) [-]."""
        s, r = self.skew, math.sqrt(abs(self.tail))
        h = np.asarray((np.expm1(s * z) - math.expm1(-(s**2))) / s) if s else z
        if not r:
            return h
        return np.asarray((np.sinh(np.minimum(r * h, _FAR)) if self.tail > 0 else np.arcsinh(r * h)) / r)

    def _straight(self, fields: Array) -> tuple[Array, Array]:
        """z at some fields, and dz/dh; infinitely far out, and 0, where there is none."""
        below, above = self._widths
        z = (fields - self.centre) / np.where(fields > self.centre, above, below)
        s, r = self.skew, math.sqrt(abs(self.tail))
        growth = np.ones_like(z)
        if r and self.tail > 0:
            z, growth = np.arcsinh(r * z) / r, 1.0 / np.hypot(1.0, r * z)
        elif r:
            z, growth = np.sinh(r * z) / r, np.cosh(r * z)
        if not s:
            return z, growth
        shifted = s * z + math.exp(-(s**2))
        inside = np.maximum(shifted, _NOTHING)
        return np.log(inside) / s, np.where(shifted > _NOTHING, growth / inside, 0.0)


_FARTHEST = 6.0  # sigma
_NOTHING = 1e-300
_FAR = 300.0  # whose hyperbolic sine is a number still


@dataclass(frozen=True)
class Table:
    """Any density, given at some fields and linear between them; zero outside.

    Attributes:
        field: at least two, increasing [V/m].
        weight: density there, to any scale: it is normalised when it is used.

    Raises:
        BenchError: fields that do not increase, weights below zero, or nothing in it.
    """

    field: tuple[float, ...]
    weight: tuple[float, ...]

    def __post_init__(self) -> None:
        fields, weights = np.asarray(self.field), np.asarray(self.weight)
        if fields.size < 2 or fields.size != weights.size:
            raise BenchError(
                f"density table: {fields.size} fields with {weights.size} weights; give two or more of each"
            )
        if not np.all(np.diff(fields) > 0) or not np.all(np.isfinite(fields)):
            raise BenchError("density table: the fields do not increase; sort them and drop doubles")
        if not np.all(weights >= 0) or not np.all(np.isfinite(weights)) or not np.any(weights > 0):
            raise BenchError(
                "density table: weights must be finite, not below 0 and not all 0; check the fit it came from"
            )

    @property
    def spread(self) -> float:
        """A table has no b: it never shrinks to one node and asks for no finer spacing [V^2/m^2]."""
        return math.inf

    @property
    def peak(self) -> float:
        """The field of the highest density [V/m]."""
        return self.field[int(np.argmax(self.weight))]

    def _cumulative(self) -> Array:
        fields, weights = np.asarray(self.field), np.asarray(self.weight)
        pieces = np.diff(fields) * (weights[1:] + weights[:-1]) / 2
        return np.concatenate(([0.0], np.cumsum(pieces)))

    def support(self, cut: float) -> tuple[float, float]:
        """First and last field of the table, whatever `cut` [V/m]."""
        return self.field[0], self.field[-1]

    def below(self, fields: Array) -> Array:
        """Share of the domains below `fields` [-], exact: the density is linear between the fields of the table."""
        known = np.asarray(self.field)
        every = np.union1d(known, np.clip(fields, known[0], known[-1]))
        at = self.at(every)
        sums = np.concatenate(([0.0], np.cumsum(np.diff(every) * (at[1:] + at[:-1]) / 2)))
        return np.interp(fields, every, sums)

    def widened(self, sigma: float) -> Table:
        """Itself: what it holds is as wide as it is."""
        return self

    def at(self, fields: Array) -> Array:
        """Density at `fields` [m/V]."""
        area = self._cumulative()[-1]
        return np.interp(fields, self.field, self.weight, left=0.0, right=0.0) / area

    def quantile(self, share: Array) -> Array:
        """The field below which lies a `share` of the domains [V/m]."""
        cumulative = self._cumulative()
        wanted = np.asarray(share) * cumulative[-1]
        k = np.clip(np.searchsorted(cumulative, wanted, side="right") - 1, 0, len(self.field) - 2)
        fields, weights = np.asarray(self.field), np.asarray(self.weight)
        slope = (weights[k + 1] - weights[k]) / (fields[k + 1] - fields[k])
        rest = wanted - cumulative[k]
        # the root of slope/2 s^2 + weight s = rest in the form that also holds for slope = 0
        root = np.sqrt(np.maximum(weights[k] ** 2 + 2 * slope * rest, 0.0))
        return fields[k] + 2 * rest / np.maximum(weights[k] + root, np.finfo(float).tiny)


@dataclass(frozen=True)
class ThresholdDensity:
    """Any density of switching thresholds, as it is identified: given on a grid, bilinear between, zero outside.

    A domain switches up at a = E_c - E_e and down at b = -E_c - E_e, so only a >= b counts; coercive and interaction
    field need not be independent of each other.

    Attributes:
        up_fields, down_fields: two or more of each, increasing [V/m].
        weights: density at each up field (a row each) and down field, to any scale: it is normalised when it is used.

    Raises:
        BenchError: fields that do not increase, weights that are below zero or do not fit, or nothing where a > b.
    """

    up_fields: tuple[float, ...]
    down_fields: tuple[float, ...]
    weights: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        for name, fields in (("up", np.asarray(self.up_fields)), ("down", np.asarray(self.down_fields))):
            if fields.size < 2 or not np.all(np.diff(fields) > 0) or not np.all(np.isfinite(fields)):
                raise BenchError(
                    f"threshold density: the {fields.size} {name} fields do not increase; give two or more, sorted"
                )
        rows, columns = len(self.up_fields), len(self.down_fields)
        if len(self.weights) != rows or any(len(row) != columns for row in self.weights):
            raise BenchError(
                f"threshold density: the weights are not {rows} rows of {columns}; give one row for each up field"
            )
        weights = np.asarray(self.weights)
        if not np.all(weights >= 0) or not np.all(np.isfinite(weights)):
            raise BenchError("threshold density: weights must be finite and not below 0; check the fit they came from")
        above = np.asarray(self.up_fields)[:, None] > np.asarray(self.down_fields)
        if not np.any(weights[above] > 0):
            raise BenchError(
                "threshold density: no weight where a domain switches up at a higher field than down; swap the axes?"
            )

    @property
    def spacing(self) -> float:
        """The smallest distance of two fields [V/m]."""
        return float(min(np.min(np.diff(self.up_fields)), np.min(np.diff(self.down_fields))))

    def at(self, up: Array, down: Array) -> Array:
        """Density, to the scale of the weights; `up` and `down` of one shape [V/m]."""
        corner, parts = np.zeros((2, *np.shape(up)), dtype=np.intp), np.zeros((2, *np.shape(up)))
        inside = up >= down
        for axis, (fields, at) in enumerate(((self.up_fields, up), (self.down_fields, down))):
            known = np.asarray(fields)
            corner[axis] = np.clip(np.searchsorted(known, at, side="right") - 1, 0, known.size - 2)
            parts[axis] = (at - known[corner[axis]]) / np.diff(known)[corner[axis]]
            inside = inside & (at >= known[0]) & (at <= known[-1])
        (i, j), (s, t), w = corner, parts, np.asarray(self.weights)
        low = (1 - t) * w[i, j] + t * w[i, j + 1]
        high = (1 - t) * w[i + 1, j] + t * w[i + 1, j + 1]
        return np.where(inside, (1 - s) * low + s * high, 0.0)


Density = Gaussian | Bent | Table


def gauss_legendre(density: Density, below: int, above: int, cut: float = THESIS_CUT) -> Nodes:
    """Gauss-Legendre nodes, the range cut at `cut` sigma and split at the peak (thesis 3.2.2)."""
    if density.spread == 0:
        return np.array([density.peak]), np.ones(1)
    low, high = density.support(cut)
    parts = [_legendre(low, density.peak, below), _legendre(density.peak, high, above)]
    fields, weights = (np.concatenate(both) for both in zip(*parts, strict=True))
    return fields, weights * density.at(fields)


def _legendre(low: float, high: float, count: int) -> Nodes:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    half = (high - low) / 2
    return low + half * (1 + nodes), half * weights


def thesis_constant(density: Density) -> float:
    """By how much the thesis' constant C exceeds the exact one [-].

    For the clipped bell the program divides by the share between 0 and infinity minus the lower 3 sigma tail, whether
    or not that tail is clipped away; for the interaction field by the whole. What lies beyond is lost: a sum of 0.9973.
    """
    if not isinstance(density, Gaussian) or density.spread == 0 or math.isinf(density.lower):
        return 1.0
    return density.mass / (density.mass - float(special.ndtr(-THESIS_CUT)))


def equal_probability(density: Density, count: int) -> Nodes:
    """Nodes at the middle quantiles of `count` equally likely classes: best for up to 32 nodes (methods.md 1.4)."""
    if density.spread == 0:
        return np.array([density.peak]), np.ones(1)
    return density.quantile((np.arange(count) + 0.5) / count), np.full(count, 1.0 / count)


def equally_spaced(density: Density, spacing: float, cut: float = 4.5) -> Nodes:
    """Nodes `spacing` [V/m] apart.

    They are an even number and lie symmetrically in the support, so that none is at the middle; of a lopsided density
    none is at its centre; or, where the density starts with a jump, they lie from there on (a jump at the upper end of
    a table is met to within a node only).
    """
    if density.spread == 0:
        return np.array([density.peak]), np.ones(1)
    low, high = density.support(cut)
    count = 2 * max(1, math.ceil((high - low) / (2 * spacing)))
    at_low, at_peak = density.at(np.array([low, density.peak]))
    jump = at_low > 0.02 * at_peak
    start = low if jump else (low + high - count * spacing) / 2
    if isinstance(density, Bent) and density.lopsided and not jump:
        start = density.centre - spacing * math.ceil((density.centre - low) / spacing)
        count = math.ceil((high - start) / spacing)
    fields: Array = start + (np.arange(count, dtype=np.float64) + 0.5) * spacing
    weights = spacing * density.at(fields)
    if jump:  # the midpoint rule misses spacing^2/24 times the slope at an end where the density does not fade out
        weights[:2] *= (25 / 24, 23 / 24)
    return fields, weights
