"""The likeliest effects, each on a density of its own, before what else is searched for minutes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from pzt_ros.diagnosis.beside_effects import BesideEffects
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate
from pzt_ros.diagnosis.elements import Elements
from pzt_ros.diagnosis.flexible import fit_rate_independent
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.identified_densities import Densities
from pzt_ros.diagnosis.own_densities import on_own_densities
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds


def beside_likeliest(candidates: Sequence[Candidate], densities: Densities, search: Search) -> Branch | None:
    """The effects that explain most beside a declared density, each on a lattice of its own, where one leaves nothing.

    Two kinds of domains with a bias field of 10 x left Gaussians 8.5 x and with it 4.2 x, which was not enough for a
    name, a lattice 3.9 x, which had bent for it, and a lattice beside it the noise. Where a lattice alone leaves far
    less than such an effect, it is the density that is wrong.

    Args:
        candidates: tried beside the declared density.
        densities: in its place.
        search: beside it.
    """
    asked = search.thresholds
    worth = [c for c in candidates if c.fit_share >= asked.share and c.after.fit.ratio <= asked.reachable]
    if all(densities.lattice.excess <= asked.outdone * each.after.excess for each in worth):
        return None
    if search.limit.is_over(densities.lattice_takes):
        return None
    beside = BesideEffects(dataclasses.replace(search, thresholds=asked.on_lattice()), asked)
    return on_own_densities(beside, sorted(worth, key=lambda candidate: -candidate.fit_share), _as_tried)


def on_lattice_soon(candidates: Sequence[Candidate], densities: Densities, search: Search) -> Branch | None:
    """The likeliest effects on a lattice, or else those beside a declared density, each on one of its own.

    Far from the noise an effect beside a density that is wrong says little: of a fatigue of 10 x beside tilted
    densities Gaussians with a bias field left least, and a lattice with the fatigue the noise, twenty seconds later.

    Args:
        candidates: tried beside the declared density.
        densities: in its place.
        search: beside it.
    """
    asked = search.thresholds
    if densities.on_lattice.at_floor(densities.lattice):
        return None
    here = sorted((c for c in candidates if c.after.fit.ratio <= asked.reachable), key=lambda c: -c.fit_share)
    for some in (densities.at_a_glance, here):
        own = _on_own_lattices(some, densities, asked)
        if own is not None or search.limit.is_over():
            return own
    return None


def _on_own_lattices(some: Sequence[Candidate], densities: Densities, asked: Thresholds) -> Branch | None:
    beside = BesideEffects(densities.on_lattice, asked)
    return on_own_densities(beside, [each for each in some if each.fit_share >= asked.share], _as_tried)


def on_lattice_first(elements: Elements, densities: Densities, search: Search) -> Branch | None:
    """The same before relays are searched, for a minute, where a lattice leaves less than all others do.

    Only effects beside which it comes near the noise are worth a density of their own so soon: of a hum of 10 x beside
    correlated densities it left the noise twenty seconds after it was asked, and nobody had asked it for two minutes.
    """
    asked = search.thresholds
    if search.limit.is_over() or not densities.lattice_leads(elements, asked):
        return None
    near = [each for each in densities.at_a_glance if each.after.fit.ratio <= asked.in_sight]
    return _on_own_lattices(near, densities, asked)


def on_own_relays(elements: Elements, densities: Densities, asked: Thresholds) -> Branch | None:
    """The effects that explain most of what elements leave, each on relays of its own, where one leaves nothing.

    Elements that leave far less than a declared density tell a stage that knows no rate, and its effect, with too few
    numbers for its shape. Relays have enough, but bend: beside plays with a hysteresis of the strain of 10 x the noise
    elements left 2 to 3 x and relays 5 to 8 x, which are searched for two minutes and more; beside it, the noise.
    """
    if elements.base.excess > asked.outdone * densities.declared.excess:
        return None
    worth = [each for each in elements.tried if each.fit_share >= asked.share]
    search, relays = densities.search, densities.relays
    beside = BesideEffects(search, asked)
    return on_own_densities(beside, worth, lambda each: search.with_effects(relays, [each.name]), fit_rate_independent)


def _as_tried(candidate: Candidate) -> Hypothesis:
    return candidate.after
