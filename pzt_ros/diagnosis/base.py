"""The declared model, fitted: where every diagnosis starts."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from pzt_ros.diagnosis.coordinates import Coordinate, coordinate
from pzt_ros.diagnosis.data import RunData, seen_through
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.from_rest import as_poled
from pzt_ros.diagnosis.grain import without_grain
from pzt_ros.diagnosis.histories import with_histories
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.diagnosis.reach_of_pasts import where_no_past_reaches
from pzt_ros.diagnosis.shaped import far_better_shaped
from pzt_ros.diagnosis.staged import Progress, Staged
from pzt_ros.diagnosis.strain_laws import coordinates_of
from pzt_ros.errors import BenchError
from pzt_ros.parallel import IN_THIS_PROCESS, Workers
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.domains import Domains
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import Link
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.physics.surrogate import ACCURACY, surrogate_of
from pzt_ros.sysid.parameters import free_parameters, without_noise
from pzt_ros.sysid.run import Start, amplifier_gain

_SCALE = "domain_polarization"
"""Strain goes with its square, so displacement alone cannot tell it from the strain's coefficient."""

_NARROWING = "domain_volume"
"""The thermal width goes with the root of its inverse."""

_NARROWEST = 1e-2  # thermal width over the swing of the field
_STEPS = 40
_SPACING = 0.35  # of the thermal width


def fit_declared(
    chain: Chain, runs: Sequence[RunData], progress: Progress, workers: Workers = IN_THIS_PROCESS
) -> Hypothesis:
    """Fit the free parameters of a chain to the runs, with as short a history before each as the data ask for.

    Args:
        chain: with the values to start from.
        runs: split into parts.
        progress: is told what is being done.
        workers: look for the histories side by side.

    Raises:
        BenchError: the chain has no ceramic, or an unknown parameter in `free:`.
    """
    progress(f"fitting {chain.name}")
    virgin = begun(chain, runs)
    found = where_no_past_reaches(virgin, as_poled(virgin), workers)
    return with_pasts(far_better_shaped(without_grain(found, _SPACING)), progress, workers)


def begun(chain: Chain, runs: Sequence[RunData]) -> Hypothesis:
    """Fitted with every run starting where it begins."""
    quiet = without_noise(chain)
    model = _as_exact_as_seen(_ceramic_of(quiet))
    coordinates = [(link, _within_sight(link, each, runs)) for link, each in _coordinates(chain, runs)]
    return _solved(quiet, model, coordinates, runs)


def with_pasts(found: Hypothesis, progress: Progress, workers: Workers) -> Hypothesis:
    """With as short a history before each run as the data ask for, and exact."""
    name = found.staged.chain.name
    found = with_histories(found, progress, workers)
    progress(f"fitting {name}, exact kinetics")
    return exact(found)


def _ceramic_of(chain: Chain) -> Ferroelectric:
    for link in chain.links:
        if isinstance(link, Ferroelectric):
            return link
    raise BenchError(f"{chain.name}: no link for the ceramic; add one such as 'link: lattice'")


def _as_exact_as_seen(model: Ferroelectric) -> Ferroelectric:
    """The same with kinetics and a lattice as exact as a measurement can tell: 2e-6 and 5e-5 of x+.

    At half the thermal width, its default, a lattice is 2 to 3 nm of 12 um away from the density that it stands for.
    """
    if not isinstance(model, Polycrystal):
        return model
    if isinstance(model, Lattice):
        model = dataclasses.replace(model, spacing=min(model.spacing, _SPACING))
    return dataclasses.replace(model, accuracy=max(model.accuracy, ACCURACY), method="midpoint")


def _coordinates(chain: Chain, runs: Sequence[RunData]) -> list[tuple[Link, Coordinate]]:
    """What may move: as `free:` says, or all that can be told apart."""
    with_polarization = any(run.has_polarization for run in runs)
    declared = free_parameters(chain)
    named = "free" in chain.notes
    found = []
    for parameter in declared:
        link = chain.links[parameter.place]
        if parameter.field == _SCALE and not named and not with_polarization:
            continue
        if float(getattr(link, parameter.field)) != 0.0 or named:
            found.append((link, _coordinate(link, parameter.field)))
    return found


def _coordinate(link: Link, field: str) -> Coordinate:
    """Of a parameter; those of a strain law move in proportion to what it does."""
    powers = {each.field: each for each in coordinates_of(link)} if isinstance(link, StrainLaw) else {}
    return powers[field] if field in powers else coordinate(link, field)


def _within_sight(link: Link, each: Coordinate, runs: Sequence[RunData]) -> Coordinate:
    """A thermal width within what the runs can tell: far below their swing all are alike, and take for ever."""
    if not isinstance(link, Domains) or each.field != _NARROWING:
        return each
    swing = max(float(np.ptp(run.record.voltage)) for run in runs) / link.layer_thickness
    most = each.start * (link.thermal_width / (_NARROWEST * swing)) ** 2
    return dataclasses.replace(each, upper=min(each.upper, max(most, each.start)))


def _solved(
    chain: Chain,
    model: Ferroelectric,
    coordinates: Sequence[tuple[Link, Coordinate]],
    runs: Sequence[RunData],
) -> Hypothesis:
    """Fitted with every run starting where it begins."""
    own = [each for link, each in coordinates if isinstance(link, Ferroelectric)]
    others = tuple(each for link, each in coordinates if not isinstance(link, Ferroelectric))
    records = [run.record for run in runs]
    starts = [Start() for _ in runs]
    ceramic = DeclaredHysteresis(model, surrogate_of(model), own, records, starts, amplifier_gain(chain))
    replaced = chain.with_links(lambda link: model if isinstance(link, Ferroelectric) else link)
    staged = Staged(replaced, ceramic, seen_through(chain, runs), others)
    return fitted(staged, staged.start, most_steps=_STEPS)
