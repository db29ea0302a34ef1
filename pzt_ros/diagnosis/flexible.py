"""The flexible base: a density of thresholds and a strain law as the runs show them, instead of as declared.

The misfit of a declared density must not be taken for an effect (diagnosis-methods.md 3.3), so where the declared model
does not come down to the noise, effects are looked for on this base.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pzt_ros.diagnosis.data import FIT, SELECTION, RunData
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.diagnosis.remembered import Remembered
from pzt_ros.diagnosis.staged import Progress, Staged
from pzt_ros.diagnosis.strain_laws import coordinates_of
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.sysid.identified import IdentifiedHysteresis
from pzt_ros.sysid.identified_fit import IdentifiedFit, IdentifiedResult
from pzt_ros.sysid.identified_problem import MeasuredRun
from pzt_ros.sysid.run import Start

_STEPS = 4
_AT_REST = 0.02  # of the largest voltage
ROTATIONS, ORDERS = (0.0, 1.0, 10.0, 100.0), (2, 3)
"""Strengths of the rotation prior and orders of the strain law that are compared."""

_REMEMBERED = 12  # polarizations at other voltages and vectors


class FlexibleHysteresis(IdentifiedHysteresis):
    """The identified lattice as a `staged.Hysteresis`.

    Polarization is linear in the weights and the occupancies, and bends little with the logarithms of relaxation time
    and thermal field. So once `exact_at` has taken the tangent somewhere, a copy goes along it: refits with effects
    behind the ceramic then cost no pass over the lattice, those with effects before it one for each new voltage.
    """

    far = math.inf  # how far the tangent is off depends on how far the search went

    _at: tuple[Array, list[Array], list[Array], list[Array]] | None = None
    """Where the tangent was taken: vector, voltages, polarizations, columns of every run."""

    def for_one_search(self) -> FlexibleHysteresis:
        """Itself: it remembers nothing that another search would not find."""
        return self

    def exact_at(self, vector: Array, voltages: Sequence[Array]) -> FlexibleHysteresis:
        """A copy that goes along the tangent taken here."""
        found = copy.copy(self)
        polarizations, columns = IdentifiedHysteresis.tangent(self, vector, voltages)
        found._at = (vector.copy(), list(voltages), polarizations, columns)
        found._known = Remembered(_REMEMBERED)
        return found

    def polarization(self, vector: Array, voltages: Sequence[Array]) -> list[Array]:
        """P of each run whose voltage is given [C/m^2]."""
        if self._at is None:
            return super().polarization(vector, voltages)
        asked = [number for number, voltage in enumerate(voltages) if voltage.size]
        return [self._here(number, voltages[number]) + self._moved(number, vector) for number in asked]

    def tangent(self, vector: Array, voltages: Sequence[Array]) -> tuple[list[Array], list[Any]]:
        """P of each run whose voltage is given and how it changes with every unknown."""
        if self._at is None:
            return super().tangent(vector, voltages)
        columns = [self._at[3][number] for number, voltage in enumerate(voltages) if voltage.size]
        return self.polarization(vector, voltages), columns

    def _moved(self, number: int, vector: Array) -> Array:
        """How P of a run changes on the way to a vector; in float32, as the tangent: 1e-7 of a small step."""
        assert self._at is not None
        at, columns = self._at[0], self._at[3][number]
        key = b"moved %d " % number + vector.tobytes()
        return self._known.get(key, lambda: (columns @ (vector - at).astype(columns.dtype)).astype(float))

    def _here(self, number: int, voltage: Array) -> Array:
        """P of a run where the tangent was taken, at a voltage that may be another."""
        assert self._at is not None
        vector, voltages, polarizations, _ = self._at
        if voltage is voltages[number] or np.array_equal(voltage, voltages[number]):
            return polarizations[number]
        alone = [voltage if other == number else np.empty(0) for other in range(len(voltages))]
        key = b"%d " % number + voltage.tobytes()  # two runs may have one drive and other starts
        return self._known.get(key, lambda: IdentifiedHysteresis.polarization(self, vector, alone)[0])

    _known: Remembered[Array]

    def start_of(self, vector: Array, number: int) -> Start:
        """The occupancy that was fitted, or its own initial state."""
        return Start(occupancy=tuple(float(share) for share in self.occupancy(vector, number)))

    def places_of(self, number: int) -> list[int]:
        """The occupancy at the start of a run belongs to it alone."""
        place = self._places(number)
        return list(range(place.start, place.stop))


def fit_flexible(declared: Hypothesis, unknown: Sequence[bool], progress: Progress) -> Hypothesis:
    """Fit the identified lattice and a strain law in place of the declared ceramic and its strain.

    How fine and smooth the density is, and of which order the law, the parts that choose say: between loops of one
    amplitude any density and law will do.

    Args:
        declared: the fitted declared model; what else is in its chain stays.
        unknown: of each run, whether what was before it is unknown.
        progress: is told what is being done.
    """
    progress("identifying the density")
    runs = declared.staged.runs
    chain = declared.staged.chain_at(declared.vector)
    thickness = next(link.layer_thickness for link in chain.links if isinstance(link, Ferroelectric))
    voltages = declared.staged.voltages(declared.vector)
    unknown = [known_not or _begins_driven(run) for known_not, run in zip(unknown, runs, strict=True)]
    reached = (min(float(v.min()) for v in voltages), max(float(v.max()) for v in voltages))
    fit = IdentifiedFit(thickness, rotations=ROTATIONS, orders=ORDERS, voltage_range=reached)
    found = _identified(fit, runs, voltages, unknown)
    base = found.problem.base
    flexible = FlexibleHysteresis(
        [run.record.time for run in runs],
        thickness,
        (reached[0] / thickness, reached[1] / thickness),
        unknown_start=unknown,
        resolution=found.choices[0].resolution,
        fine_lines=base.fine_lines,
    )
    flexible.rotation_strength, flexible.smoothness_strength = base.rotation_strength, base.smoothness_strength
    known = base.occupancies.stop  # the runs that were fitted come first, so do their occupancies
    flexible.start[:known] = found.vector[:known]
    linear, quadratic, cubic = (float(coefficient) for coefficient in (*found.law, 0.0)[1:4])
    law = StrainLaw(linear=linear, quadratic=quadratic, cubic=cubic)
    placeholder = flexible.link(flexible.start)
    coordinates = coordinates_of(law)[: found.problem.order]
    kept = tuple(each for each in declared.staged.coordinates if each.kind != Electrostriction.kind)
    replaced = chain.with_links(lambda link: _replaced(link, placeholder, law))
    staged = Staged(replaced, flexible, runs, (*coordinates, *kept))
    start = staged.start
    if kept:
        start[-len(kept) :] = declared.vector[-len(kept) :]
    return exact(fitted(staged, start, most_steps=_STEPS))


def _identified(
    fit: IdentifiedFit, runs: Sequence[RunData], voltages: Sequence[Array], unknown: Sequence[bool]
) -> IdentifiedResult:
    """Runs with a part to fit are fitted, those with a part that chooses choose.

    A start is free only where the run has a past. Free starts everywhere describe runs better, whatever is missing, and
    hide it; and the density beside them need not know what switches on the way up from rest.
    """
    numbered = list(enumerate(runs))
    measured = [_measured(run, voltages[n], unknown[n]) for n, run in numbered if FIT in run.picks]
    return fit.fit(measured, [_choosing(run, voltages[n], unknown[n]) for n, run in numbered if SELECTION in run.picks])


def _begins_driven(run: RunData) -> bool:
    """Whether the voltage is up already at the first sample: the record then has a past."""
    voltage = run.record.voltage
    return abs(float(voltage[0])) > _AT_REST * float(np.max(np.abs(voltage)))


def _measured(run: RunData, voltage: Array, unknown: bool) -> MeasuredRun:
    record = run.record
    return MeasuredRun(record.time, voltage, record.displacement, run.noise, run.clear, unknown)


def _choosing(run: RunData, voltage: Array, unknown: bool) -> MeasuredRun:
    """A test run as far as its part that chooses goes."""
    record, picks = run.record, run.picks[SELECTION]
    early = slice(int(picks[-1]) + 1)
    counted = np.zeros(len(record), dtype=bool)
    counted[picks] = True
    return MeasuredRun(
        record.time[early], voltage[early], record.displacement[early], run.noise, counted[early], unknown
    )


def _replaced(link: Link, ceramic: Link, law: StrainLaw) -> Link:
    if isinstance(link, Ferroelectric):
        return ceramic
    return law if isinstance(link, Electrostriction) else link
