"""Polycrystals whose two fields depend on one another, or with domains of two kinds, begun where a lattice tells them.

Shapes of two bells are no more than that. Of two kinds of domains they left 5 x the noise, of interaction fields that
grow with the coercive field 6 x, and a lattice in their place knew nothing of where no run had told: runs that score
were at 1.1 to 5 x beside it.
"""

from __future__ import annotations

from itertools import repeat
from typing import NamedTuple

import numpy as np

from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.flexible import beside_the_rest, driven
from pzt_ros.diagnosis.flexible_lattice import FlexibleHysteresis
from pzt_ros.diagnosis.histories import refitted_from
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.parallel import IN_THIS_PROCESS, Workers
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.sysid.parameters import GROWTH, LOPSIDED, SECOND, SHAPES
from pzt_ros.sysid.read_off import kinetics_of, read_off

_FORMULAS: tuple[tuple[str, ...], ...] = ((*SHAPES, LOPSIDED), (GROWTH,), SECOND)
"""What may be free: the shapes of both densities, how one depends on the other, domains of a second kind."""

_STEPS = 20
_CLEAN = 1.02  # rms over noise of every run up to which no further formula is asked
_COMES_DOWN = 0.95  # what has to be left of the misfit for one more
_NEARER = 0.6  # how much nearer to the lattice one more has to come
_AS_NEAR = 2.0  # times as far from the lattice as the nearest that a formula may be to be fitted to the runs


class _Formula(NamedTuple):
    """A formula whose numbers a lattice has told.

    Attributes:
        fields: that are free besides those of two bells.
        values: of all its numbers [SI].
        off: how far it is from the lattice there, rms of the largest share.
    """

    fields: tuple[str, ...]
    values: dict[str, float]
    off: float


def of_kinds(found: Hypothesis, declared: DeclaredHysteresis, workers: Workers = IN_THIS_PROCESS) -> Hypothesis:
    """In place of a lattice the formula that leaves least, and one more beside it as long as that leaves less.

    Args:
        found: on a lattice, with its effects.
        declared: the polycrystal whose numbers these are.
        workers: fit side by side.
    """
    best, formula = _likeliest(found, declared, _read_further(found, declared, (), workers), workers)
    while max(best.ratios) > _CLEAN:
        read = _read_further(found, declared, formula.fields, workers)
        if not read or read[0].off > _NEARER * formula.off:
            break
        further, formula = _likeliest(found, declared, read, workers)
        if further.total > _COMES_DOWN * best.total:
            break
        best = further
    return best


def _read_further(
    found: Hypothesis, declared: DeclaredHysteresis, beside: tuple[str, ...], workers: Workers
) -> list[_Formula]:
    """What may be free beside what is, as the lattice tells its numbers, the nearest first."""
    lattice, like = found.staged.ceramic.link(found.vector), declared.model
    assert isinstance(lattice, IdentifiedLattice)
    assert isinstance(like, Polycrystal)
    thickness, _, (low, high) = driven(found)
    within = low / thickness, high / thickness
    further = [(*beside, *more) for more in _FORMULAS if not set(more) <= set(beside)]
    read = workers.map(_read, repeat(lattice), repeat(within), repeat(like), further)
    return sorted(read, key=lambda formula: formula.off)


def _likeliest(
    found: Hypothesis, declared: DeclaredHysteresis, read: list[_Formula], workers: Workers
) -> tuple[Hypothesis, _Formula]:
    """The formula that leaves least of those that come near the lattice."""
    likely = [each for each in read if each.off <= _AS_NEAR * read[0].off]
    tried = workers.map(_fitted, repeat(found), repeat(declared), likely)
    there, formula = min(zip(tried, likely, strict=True), key=lambda each: each[0].total)
    return exact(there), formula


def _read(
    lattice: IdentifiedLattice, within: tuple[float, float], like: Polycrystal, fields: tuple[str, ...]
) -> _Formula:
    shares, off = read_off(lattice, within, like, fields)
    return _Formula(fields, {**shares, **kinetics_of(lattice, within, like, shares)}, off)


def _fitted(found: Hypothesis, declared: DeclaredHysteresis, formula: _Formula) -> Hypothesis:
    """To the runs, from where the lattice told its numbers."""
    lattice = found.staged.ceramic
    assert isinstance(lattice, FlexibleHysteresis)
    assert lattice.choice is not None
    held = set(formula.values) - {each.field for each in declared.coordinates} - set(formula.fields)
    values = {field: value for field, value in formula.values.items() if field not in held}
    ceramic = declared.begun_at(values).with_free(formula.fields)
    order = lattice.choice.order
    staged, start = beside_the_rest(found, ceramic, _law_beside(ceramic, found, order), order)
    own = ceramic.start.size
    start[:own] = np.clip(start[:own], ceramic.lower, ceramic.upper)
    pasts = {number: lattice.start_of(found.vector, number) for number in range(len(staged.runs))}
    return refitted_from(fitted(staged, start, found.effects, most_steps=0), pasts, _STEPS)


def _law_beside(ceramic: DeclaredHysteresis, found: Hypothesis, order: int) -> StrainLaw:
    """The law that makes the same strain of its polarization as the lattice's does of that one's."""
    former = next(link for link in found.staged.chain_at(found.vector).links if isinstance(link, StrainLaw))
    here = np.concatenate(ceramic.polarization(ceramic.start, found.staged.voltages(found.vector)))
    there = np.concatenate(found.staged.polarizations(found.vector))
    strain = np.polynomial.polynomial.polyval(there, (0.0, former.linear, former.quadratic, former.cubic))
    told = np.polynomial.Polynomial.fit(here, strain, order).convert().coef
    linear, quadratic, cubic = (*told[1:], 0.0, 0.0)[:3]
    return StrainLaw(linear=float(linear), quadratic=float(quadratic), cubic=float(cubic))
