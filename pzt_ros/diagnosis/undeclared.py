"""What a stage is taken for of which nothing was declared: a polycrystal, relays that know no rate, or one domain.

The thesis has both: many domains whose barriers have Gaussian spreads, and one that represents them all, whose barriers
follow what has switched. No density of relays bends into the loops of the latter, so beside a polycrystal no effect is
to be seen on a stage that is more like it: a lag of 2 ms was "something" at 4.4 x the noise after 165 s. What the
literature models as plays or relays has no rate at all. A Gaussian polycrystal comes to 3 x the noise of such a stage
in the end, and what it lacks there has every effect tried; relays are identified in seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from pzt_ros.diagnosis.base import begun, fit_declared, with_pasts
from pzt_ros.diagnosis.data import RunData, highest_voltage
from pzt_ros.diagnosis.flexible import fit_rate_independent, tells_all
from pzt_ros.diagnosis.from_rest import as_poled
from pzt_ros.diagnosis.grain import with_nodes
from pzt_ros.diagnosis.histories import with_histories_of
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, total_of
from pzt_ros.diagnosis.lopsided import lopsided_undeclared
from pzt_ros.diagnosis.prior_drive import UNKNOWN, with_best_amplitude
from pzt_ros.diagnosis.reach_of_pasts import told_beyond_pasts, where_no_past_reaches
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.shaped import shaped
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.diagnosis.strain_laws import as_powers
from pzt_ros.parallel import Workers
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import Link
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.sysid.parameters import free_parameters

_THICKNESS = 1e-4
_ACTIVE_LENGTH = 8e-3
_SATURATION = 1.6  # of the largest field
_POLARIZATION = 0.25  # C/m^2, about the largest
_LAWS = (1.0, 0.0), (-1.0, 0.5)  # linear and quadratic part, in units of what the square alone would be
_POWERS = ("linear", "quadratic"), ("linear", "quadratic", "cubic")
_NOTES = {"description": "One representative domain and electrostriction, scaled to the runs", **UNKNOWN}


class _Start(NamedTuple):
    """Barriers over the largest field and their spreads, on the way up and down."""

    up: float
    shape_up: float
    down: float
    shape_down: float


_STARTS = _Start(0.2, 2.5, 0.7, 1.1), _Start(0.35, 1.2, 0.35, 1.2)
"""The thesis' materials as driven to one side and to both."""


class Bases(NamedTuple):
    """What effects may be sought beside.

    Attributes:
        declared: the fitted chain, or what stands for it where none was declared.
        relays: that know no rate, where they were identified on the way.
        is_known: whether a chain was declared, so that its fit may begin anew where that was.
        is_whole: whether what seemed to be that of pasts was told by an effect, so that all samples count.
    """

    declared: Hypothesis
    relays: Hypothesis | None = None
    is_known: bool = False
    is_whole: bool = False


def fit_base(
    chain: Chain | None, runs: Sequence[RunData], asked: Thresholds, progress: Progress, workers: Workers
) -> Bases:
    """Fit the declared chain to the runs; what `fit_undeclared` finds where there is none.

    Raises:
        BenchError: as `fit_declared`.
    """
    if chain is None:
        return fit_undeclared(runs, asked, progress, workers)
    return Bases(fit_declared(chain, runs, progress, workers), is_known=True)


def fit_undeclared(runs: Sequence[RunData], asked: Thresholds, progress: Progress, workers: Workers) -> Bases:
    """Fit a polycrystal to the runs; where that leaves something, relays that leave nothing, or one domain with less.

    Args:
        runs: split into parts.
        asked: what counts as something, and as less.
        progress: is told what is being done.
        workers: look for histories side by side.
    """
    chain = default_chain(runs)
    progress("fitting a polycrystal")
    virgin = plain = begun(chain, runs)
    found = where_no_past_reaches(virgin, as_poled(virgin, is_declared=False), workers)
    nodes = with_nodes(found) if max(found.ratios) > asked.floor else found
    if max(nodes.ratios) > asked.floor:
        found = lopsided_undeclared(shaped(found), virgin, asked, progress, workers)
    found = min(nodes, found, key=total_of)
    if asked.floor < max(found.ratios) <= asked.near_floor:
        found = exact(found)  # it may be no more than what the front model is off by
    if max(found.ratios) <= asked.floor:
        return Bases(found)
    relays = fit_rate_independent(found, progress, workers)
    relays = told_beyond_pasts(relays, asked, progress, workers)
    if tells_all(relays, asked):
        return Bases(relays, relays)
    # beside pasts that nobody sought yet a polycrystal is far off, whatever the stage is
    is_rateless = not found.staged.has_past and relays.excess <= asked.rateless_outdone * found.excess
    if not is_rateless and virgin.fit.ratio > asked.reachable and found.fit.ratio > asked.finishable:
        former = chain
        progress("fitting a polycrystal with other laws of strain")
        chain, found = _with_another_law(chain, found, asked, relays)
        plain = virgin if chain is former else found
    progress("fitting one representative domain")
    domain = _one_domain(found, plain, chain, asked)
    if domain is not None and not domain.staged.has_past:
        return Bases(domain, relays)  # what was before is the drive before all runs
    found = domain or found
    if not found.staged.has_past:
        return Bases(exact(found), relays)
    return Bases(with_pasts(with_histories_of(found, relays), progress, workers), relays)


def default_chain(runs: Sequence[RunData]) -> Chain:
    """A polycrystal and electrostriction in proportion to the drive and the motion, where no chain was declared."""
    motion = max(float(np.ptp(run.record.displacement)) for run in runs)
    field = highest_voltage(runs) / _THICKNESS
    spread = 0.4 * (0.35 * field) ** 2
    ceramic = Lattice(
        coercive_field=0.35 * field,
        coercive_field_spread=spread,
        interaction_field_spread=spread,
        relaxation_time=1e-3,
        reciprocal_permittivity=field / 0.025,
        domain_volume=1e-22 * (1.5e6 / field),
        layer_thickness=_THICKNESS,
    )
    quadratic = motion / ceramic.domain_polarization**2
    law: Link = Electrostriction(coefficient=quadratic / _ACTIVE_LENGTH, active_length=_ACTIVE_LENGTH)
    if _falls(runs):
        law = StrainLaw(quadratic=-quadratic)
    return Chain(
        "default", (ceramic, law), {"description": "Gaussian polycrystal and electrostriction, scaled to the runs"}
    )


def _with_another_law(
    chain: Chain, found: Hypothesis, asked: Thresholds, relays: Hypothesis | None = None
) -> tuple[Chain, Hypothesis]:
    """The chain and its fit, with a strain that goes with other powers of P, too, where that leaves far less.

    Relays that were identified tell which, as no density of theirs can.

    No effect leaves so much beside the right law, and beside the square a density bends in vain for another: 90 x the
    noise, 9 with the linear term.
    """
    ceramic = [each.name for each in free_parameters(chain) if each.place != len(chain.links) - 1]
    for powers, laws in _laws_to_try(chain, relays):
        notes = {**chain.notes, "free": [*ceramic, *(f"{StrainLaw.kind}.{power}" for power in powers)]}
        chains = [replace(chain, links=(*chain.links[:-1], law), notes=notes) for law in laws]
        fits = [shaped(as_poled(begun(each, found.staged.runs), is_declared=False)) for each in chains]
        number = min(range(len(fits)), key=lambda each: fits[each].total)
        if fits[number].excess <= asked.outdone * found.excess:
            chain, found = chains[number], fits[number]
    return chain, found


def _laws_to_try(chain: Chain, relays: Hypothesis | None) -> list[tuple[tuple[str, ...], list[StrainLaw]]]:
    """Powers that are free, and where they start: at the law of relays, or at some beside the square of the chain."""
    if relays is not None:
        law = next(link for link in relays.staged.chain_at(relays.vector).links if isinstance(link, StrainLaw))
        powers = tuple(power for power in _POWERS[-1] if getattr(law, power) != 0.0)
        return [(powers, [law])]
    square = as_powers(chain.links[-1])
    assert square is not None  # a default chain ends with its law
    laws = [StrainLaw(linear=a * _POLARIZATION * square.quadratic, quadratic=b * square.quadratic) for a, b in _LAWS]
    return [(powers, laws) for powers in _POWERS]


def has_powers(chain: Chain) -> bool:
    """Whether the strain of a default chain goes with other powers of P than its square, free to follow the runs."""
    return f"{StrainLaw.kind}.linear" in chain.notes.get("free", [])


def _falls(runs: Sequence[RunData]) -> bool:
    """Whether the reading falls as the stage extends, to either polarity, as that of a gap does."""
    return sum(float(np.cov(run.record.voltage**2, run.record.displacement)[0, 1]) for run in runs) < 0.0


def _one_domain(polycrystal: Hypothesis, plain: Hypothesis, chain: Chain, asked: Thresholds) -> Hypothesis | None:
    """Fitted in place of a polycrystal; none where no start leaves less, or so little that an effect could be found.

    Args:
        polycrystal: as fitted.
        plain: the same with no drive before but the one before all runs, which a domain has, too; it begins beside.
        chain: that was fitted.
        asked: what counts as less.
    """
    lattice = next(link for link in chain.links if isinstance(link, Lattice))
    runs = polycrystal.staged.runs
    fitted_chain = plain.staged.chain_at(plain.vector)
    field = highest_voltage(runs) / lattice.layer_thickness
    for start in _STARTS:
        domain = _domain(lattice, start, field)
        beside = replace(fitted_chain.with_links(partial(_instead, domain=domain)), notes={})
        free = [each.name for each in free_parameters(beside) if each.name not in _held(runs)]
        found = begun(replace(beside, notes={**_NOTES, "free": free}), runs)
        is_less = found.excess <= asked.instead * polycrystal.excess
        if is_less and found.fit.ratio <= asked.reachable:
            return with_best_amplitude(found)
    return None


def _held(runs: Sequence[RunData]) -> set[str]:
    """Parameters that these runs do not tell: a flat direction would lead every search astray."""
    held = {f"{Parametrized.kind}.saturation_barrier"}
    if not any(run.has_polarization for run in runs):
        held.add(f"{Parametrized.kind}.domain_polarization")
    return held


def _instead(link: Link, domain: Parametrized) -> Link:
    return domain if isinstance(link, Ferroelectric) else link


def _domain(lattice: Lattice, start: _Start, field: float) -> Parametrized:
    return Parametrized(
        barrier_ascending=start.up * field,
        shape_ascending=start.shape_up,
        barrier_descending=start.down * field,
        shape_descending=start.shape_down,
        saturation_barrier=_SATURATION * field,
        relaxation_time=lattice.relaxation_time,
        domain_polarization=lattice.domain_polarization,
        reciprocal_permittivity=lattice.reciprocal_permittivity,
        domain_volume=lattice.domain_volume,
        layer_thickness=lattice.layer_thickness,
    )
