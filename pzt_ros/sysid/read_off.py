"""The numbers of a formula read off an identified density: where a fit of them may start.

From as far off as a chain is declared such a fit ends in a valley: of two kinds of domains it left 3 to 9 x the noise,
from what a lattice had told of them 1.0 x. What a lattice tells well is the Everett function, how much switches between
two fields; what it lacks is how much would switch beyond those that were driven. So the formula's Everett function is
fitted to the lattice's where both fields were reached, of any size.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pzt_ros.errors import BenchError
from pzt_ros.physics.domains import Domains
from pzt_ros.physics.identified_hats import gathered, hat_sums, hats_of, relay_thresholds, spread_out
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameters_of
from pzt_ros.sysid.parameters import SECOND

BELLS = ("coercive_field", "coercive_field_spread", "interaction_field_spread")
"""What every formula has."""

_LINES = 160  # of thresholds, over a whole grid, at which a formula's density is taken
_LEAST = 1e-3  # of the upper bound, for what moves by its logarithm
_SCALE = 0.3  # of a logarithm, or of a shape
_EVALUATIONS = 60  # at most, each with its differences
_FIELDS, _NARROWER = ((1.6, 0.7), (2.0, 1.0), (0.5, 1.0), (2.0, 0.5)), 0.5
"""Where a second kind is sought from: its field and the first's, and all spreads, over those of one kind alone."""

_SHARE = 0.3  # of the second kind


def shares_of(polycrystal: Domains, grid: Array) -> Array:
    """What the hats of a lattice weigh as the densities of a polycrystal have it [any unit, shape (nodes,)]."""
    lines = _lines(grid)
    up, down = relay_thresholds(lines)
    kinds = [kind.widened(float(lines[1] - lines[0])) for kind in polycrystal.kinds]
    weight = np.sum([kind.at(0.5 * (up - down), -0.5 * (up + down)) for kind in kinds], axis=0)
    return gathered(weight, hats_of(lines, grid))


def _lines(grid: Array) -> Array:
    return np.linspace(grid[0], grid[-1], _LINES)


def read_off(
    lattice: IdentifiedLattice, driven: tuple[float, float], like: Domains, fields: Sequence[str]
) -> tuple[dict[str, float], float]:
    """Values of a formula's numbers [SI], and how far off they are, rms of the largest share.

    Args:
        lattice: as it was identified.
        driven: lowest and highest field of the runs [V/m].
        like: whose numbers these are, and where they are sought from.
        fields: that are free besides those of every formula.

    Raises:
        BenchError: the lattice tells of nothing that switches between two of its lines within that.
    """
    told = _Told(lattice, driven)
    bells = told.fitted(like, BELLS)[0]
    starts: list[dict[str, Any]] = [bells]
    if set(SECOND) <= set(fields):
        field, *spreads = (bells[each] for each in BELLS)
        widths = [_NARROWER * each for each in spreads]
        starts = [
            dict(zip((*BELLS, *SECOND), (first * field, *widths, _SHARE, second * field, *widths), strict=True))
            for second, first in _FIELDS
        ]
    tried = [told.fitted(dataclasses.replace(like, **start), (*BELLS, *fields)) for start in starts]
    return min(tried, key=lambda each: each[1])


class _Told:
    """What a lattice tells: its Everett function over pairs of lines between fields that were reached."""

    def __init__(self, lattice: IdentifiedLattice, driven: tuple[float, float]) -> None:
        self.grid = np.asarray(lattice.grid)
        self.span, self.farthest = driven[1] - driven[0], max(map(abs, driven))
        up, down = np.tril_indices(self.grid.size)
        inside = (self.grid >= driven[0]) & (self.grid <= driven[1])
        self.chosen: NDArray[np.bool_] = inside[up] & inside[down] & (up > down)
        self.everett_of_lattice = self.everett(self._smoothed(np.asarray(lattice.weights)))
        largest = np.max(self.everett_of_lattice, initial=0.0)
        if not largest > 0.0:
            raise BenchError(
                f"nothing of the density switches between {driven[0]:.3g} and {driven[1]:.3g} V/m; drive it farther"
            )
        self.target = self.everett_of_lattice / largest

    def _smoothed(self, weights: Array) -> Array:
        """What hats weigh of the lattice's density, as they do of a formula's: no more is seen of either."""
        lines = _lines(self.grid)
        hats, density = hats_of(lines, self.grid), np.empty(lines.size**2 // 4)
        spread_out(weights / hat_sums(hats), hats, density)
        return gathered(density, hats)

    def everett(self, shares: Array) -> Array:
        """How much switches up below one line and down above another, for the pairs that are chosen."""
        size = self.grid.size
        table = np.zeros((size, size))
        table[np.tril_indices(size)] = shares
        table = np.cumsum(np.cumsum(table[:, ::-1], axis=1)[:, ::-1], axis=0)
        return table[np.tril_indices(size)][self.chosen]

    def most(self, field: str) -> float:
        """What is larger no run tells: the farthest field, and a spread as wide as what was driven [SI]."""
        return 2.0 * self.span**2 if field.endswith("spread") else self.farthest

    def fitted(self, like: Domains, fields: Sequence[str]) -> tuple[dict[str, float], float]:
        """Values of some fields, and the rms of what they leave, from where they are."""
        declared = parameters_of(like)  # what is positive moves by its logarithm, but for a share
        is_log = {each: declared[each].lower >= 0.0 and each != SECOND[0] for each in fields}
        bounds = [
            (_LEAST * self.most(f), self.most(f)) if is_log[f] else (declared[f].lower, declared[f].upper)
            for f in fields
        ]
        scaled = [math.log if is_log[f] else float for f in fields]
        lower, upper = (np.array([to(b[k]) for to, b in zip(scaled, bounds, strict=True)]) for k in (0, 1))
        start = [min(max(getattr(like, f), b[0]), b[1]) for f, b in zip(fields, bounds, strict=True)]

        def values(vector: Array) -> dict[str, Any]:
            return {f: math.exp(v) if is_log[f] else float(v) for f, v in zip(fields, vector, strict=True)}

        def left(vector: Array) -> Array:
            here = self.everett(shares_of(dataclasses.replace(like, **values(vector)), self.grid))
            return here * (here @ self.target) / max(float(here @ here), np.finfo(float).tiny) - self.target

        begin = np.clip([to(v) for to, v in zip(scaled, start, strict=True)], lower, upper)
        found = least_squares(left, begin, bounds=(lower, upper), x_scale=_SCALE, max_nfev=_EVALUATIONS)
        return values(np.clip(found.x, lower, upper)), float(np.sqrt(np.mean(np.square(found.fun))))


def kinetics_of(
    lattice: IdentifiedLattice, driven: tuple[float, float], like: Domains, shares: dict[str, Any]
) -> dict[str, float]:
    """Relaxation time, permittivity and volume of a domain as the lattice has them, beside a formula's numbers [SI].

    P of the lattice is to any scale; the formula's has a domain's polarization.
    """
    told = _Told(lattice, driven)
    formula = told.everett(shares_of(dataclasses.replace(like, **shares), told.grid))
    here = told.everett_of_lattice
    step = (told.grid[-1] - told.grid[0]) / (_LINES - 1)
    scale = like.domain_polarization * step**2 * float(formula @ here) / float(here @ here)
    reciprocal = (
        1.0 / (scale * lattice.susceptibility) if lattice.susceptibility > 0.0 else like.reciprocal_permittivity
    )
    wide = dataclasses.replace(like, reciprocal_permittivity=reciprocal)
    volume = like.domain_volume * (wide.thermal_width / lattice.thermal_field) ** 2
    return {
        "relaxation_time": lattice.relaxation_time,
        "reciprocal_permittivity": reciprocal,
        "domain_volume": volume,
    }
