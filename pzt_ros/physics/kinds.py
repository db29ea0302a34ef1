"""Domains of one kind: how their coercive fields are distributed, and their interaction fields for each of those."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pzt_ros.physics.density import Density, Table
from pzt_ros.physics.signals import Array

_NARROWEST = 0.2  # of the interaction fields' width, however far below its reference a coercive field is


@dataclass(frozen=True)
class Kind:
    """A share of the domains; those with twice the coercive field may feel wider interaction fields.

    Attributes:
        share: of all domains [-].
        coercive, interaction: densities of both fields; the latter at the coercive field `reference`.
        growth: k; at E_c the interaction fields are 1 + k (E_c/reference - 1) times as wide [-].
        reference: [V/m].
    """

    share: float
    coercive: Density
    interaction: Density
    growth: float = 0.0
    reference: float = 1.0

    def widening(self, coercive_fields: Array) -> Array:
        """By how much the interaction fields are wider at some coercive fields [-]."""
        if not self.growth:
            return np.ones_like(coercive_fields)
        return np.maximum(1.0 + self.growth * (coercive_fields / self.reference - 1.0), _NARROWEST)

    def widened(self, sigma: float) -> Kind:
        """The same, both densities at least so wide [V/m]."""
        return replace(self, coercive=self.coercive.widened(sigma), interaction=self.interaction.widened(sigma))

    def ends(self, cut: float) -> tuple[float, float, float, float]:
        """Lowest and highest coercive field, lowest and highest interaction field, cut at `cut` sigma [V/m]."""
        first, highest = _ends(self.coercive, cut)
        low, high = _ends(self.interaction, cut)
        widening = float(self.widening(np.array([first, highest])).max())
        return first, highest, widening * low, widening * high

    def shares(self, coercive_fields: Array, interaction_fields: Array, step: float) -> Array:
        """Of the domains within half a step of each pair of fields [-]; a row per coercive field."""
        rows = self.share * np.diff(self.coercive.below(_edges(coercive_fields, step)))
        edges, width = _edges(interaction_fields, step), self.widening(coercive_fields)
        columns = np.array([np.diff(self.interaction.below(edges / each)) for each in width])
        return rows[:, None] * columns / (rows.sum() / self.share * columns.sum(axis=1, keepdims=True))

    def at(self, coercive_field: Array, interaction_field: Array) -> Array:
        """f(E_c, E_e), both fields of one shape [m^2/V^2]."""
        width = self.widening(coercive_field)
        return self.share * self.coercive.at(coercive_field) * self.interaction.at(interaction_field / width) / width

    def sampled(self, coercive_fields: Array, interaction_fields: Array) -> tuple[Array, Array]:
        """f(E_c, E_e) [m^2/V^2], and its integral over E_e from below [m/V]; a row per coercive field, even grids."""
        rows = _sampled(self.coercive, coercive_fields)[0][:, None] * self.share
        if not self.growth:
            density, below = _sampled(self.interaction, interaction_fields)
            return rows * density, rows * below
        width = self.widening(coercive_fields)[:, None]
        if isinstance(self.interaction, Table):
            both = [_sampled(self.interaction, interaction_fields / each) for each in width[:, 0]]
            density, below = (np.array(part) for part in zip(*both, strict=True))
        else:
            density, below = _sampled(self.interaction, interaction_fields / width)
        return rows * density / width, rows * below


def _ends(density: Density, cut: float) -> tuple[float, float]:
    return density.support(cut) if density.spread > 0 else (density.peak, density.peak)


def _edges(middles: Array, step: float) -> Array:
    return np.append(middles - step / 2, middles[-1] + step / 2)


def _sampled(density: Density, grid: Array) -> tuple[Array, Array]:
    """Density and cumulative share on an even grid."""
    if not isinstance(density, Table):
        return density.at(grid), density.below(grid)
    # a table may have features below the step: what counts is the share between two points
    step = grid[1] - grid[0]
    edges = np.concatenate((grid - step / 2, [grid[-1] + step / 2]))
    edges[0] = max(edges[0], grid[0])
    return np.diff(density.below(edges)) / np.diff(edges), density.below(grid)
