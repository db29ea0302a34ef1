"""The flexible base: a density of thresholds and a strain law as the runs show them, instead of as declared.

The misfit of a declared density must not be taken for an effect (diagnosis-methods.md 3.3), so where the declared model
does not come down to the noise, effects are looked for on this base.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from pzt_ros.diagnosis.coordinates import coordinate
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.diagnosis.staged import Progress, Staged
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.sysid.identified import IdentifiedHysteresis
from pzt_ros.sysid.run import Start

_STEPS = 15
_REMEMBERED = 6  # polarizations at other voltages
_LEAST_TERM = 0.05  # of the quadratic term at 0.25 C/m^2: where the others start
_TYPICAL_POLARIZATION = 0.25


class FlexibleHysteresis(IdentifiedHysteresis):
    """The identified lattice as a `staged.Hysteresis`.

    Polarization is linear in the weights and the occupancies, and bends little with the logarithms of relaxation time
    and thermal field. So once `exact_at` has taken the tangent somewhere, a copy goes along it: refits with effects
    behind the ceramic then cost no pass over the lattice, those with effects before it one for each new voltage.
    """

    _at: tuple[Array, list[Array], list[Array], list[Array]] | None = None
    """Where the tangent was taken: vector, voltages, polarizations, columns of every run."""

    def exact_at(self, vector: Array, voltages: Sequence[Array]) -> FlexibleHysteresis:
        """A copy that goes along the tangent taken here."""
        found = copy.copy(self)
        polarizations, columns = IdentifiedHysteresis.tangent(self, vector, voltages)
        found._at = (vector.copy(), list(voltages), polarizations, columns)
        found._known = {}
        return found

    def polarization(self, vector: Array, voltages: Sequence[Array]) -> list[Array]:
        """P of each run whose voltage is given [C/m^2]."""
        if self._at is None:
            return super().polarization(vector, voltages)
        asked = [number for number, voltage in enumerate(voltages) if voltage.size]
        step = vector - self._at[0]
        moved = [self._at[3][number] @ step for number in asked]
        return [self._here(number, voltages[number]) + m for number, m in zip(asked, moved, strict=True)]

    def tangent(self, vector: Array, voltages: Sequence[Array]) -> tuple[list[Array], list[Any]]:
        """P of each run whose voltage is given and how it changes with every unknown."""
        if self._at is None:
            return super().tangent(vector, voltages)
        columns = [self._at[3][number] for number, voltage in enumerate(voltages) if voltage.size]
        return self.polarization(vector, voltages), columns

    def _here(self, number: int, voltage: Array) -> Array:
        """P of a run where the tangent was taken, at a voltage that may be another."""
        assert self._at is not None
        vector, voltages, polarizations, _ = self._at
        if voltage is voltages[number] or np.array_equal(voltage, voltages[number]):
            return polarizations[number]
        key = voltage.tobytes()
        if key not in self._known:
            while len(self._known) >= _REMEMBERED:
                self._known.pop(next(iter(self._known)), None)
            alone = [voltage if other == number else np.empty(0) for other in range(len(voltages))]
            self._known[key] = IdentifiedHysteresis.polarization(self, vector, alone)[0]
        return self._known[key]

    _known: dict[bytes, Array]

    def start_of(self, vector: Array, number: int) -> Start:
        """The occupancy that was fitted, or its own initial state."""
        return Start(occupancy=tuple(float(share) for share in self.occupancy(vector, number)))

    def places_of(self, number: int) -> list[int]:
        """The occupancy at the start of a run belongs to it alone."""
        place = self._places(number)
        return list(range(place.start, place.stop))


def fit_flexible(declared: Hypothesis, unknown: Sequence[bool], resolution: int, progress: Progress) -> Hypothesis:
    """Fit the identified lattice and a cubic strain law in place of the declared ceramic and its strain.

    Args:
        declared: the fitted declared model; what else is in its chain stays.
        unknown: of each run, whether what was before it is unknown.
        resolution: coarse cells over the driven range of field.
        progress: is told what is being done.
    """
    progress(f"fitting the density, {resolution} cells a side")
    runs = declared.staged.runs
    chain = declared.staged.chain_at(declared.vector)
    ceramic = next(link for link in chain.links if isinstance(link, Ferroelectric))
    low = min(float(run.record.voltage.min()) for run in runs) / ceramic.layer_thickness
    high = max(float(run.record.voltage.max()) for run in runs) / ceramic.layer_thickness
    times = [run.record.time for run in runs]
    flexible = FlexibleHysteresis(
        times, ceramic.layer_thickness, (low, high), unknown_start=unknown, resolution=resolution
    )
    law = next((_law(link) for link in chain.links if isinstance(link, Electrostriction)), StrainLaw())
    placeholder = flexible.link(flexible.start)
    replaced = chain.with_links(lambda link: _replaced(link, placeholder, law))
    size = _LEAST_TERM * abs(law.quadratic)
    coordinates = (
        coordinate(law, "linear", typical=size * _TYPICAL_POLARIZATION),
        coordinate(law, "quadratic", typical=abs(law.quadratic)),
        coordinate(law, "cubic", typical=size / _TYPICAL_POLARIZATION),
    )
    kept = tuple(each for each in declared.staged.coordinates if each.kind != Electrostriction.kind)
    staged = Staged(replaced, flexible, runs, (*coordinates, *kept))
    start = staged.start
    if kept:
        start[-len(kept) :] = declared.vector[-len(kept) :]
    return exact(fitted(staged, start, most_steps=_STEPS))


def _law(link: Electrostriction) -> StrainLaw:
    return StrainLaw(linear=0.0, quadratic=link.coefficient * link.active_length, cubic=0.0)


def _replaced(link: Link, ceramic: Link, law: StrainLaw) -> Link:
    if isinstance(link, Ferroelectric):
        return ceramic
    return law if isinstance(link, Electrostriction) else link
