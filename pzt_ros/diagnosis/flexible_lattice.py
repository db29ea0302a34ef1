"""The identified lattice as the ceramic among other links, with a tangent that refits go along."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pzt_ros.diagnosis.remembered import Remembered
from pzt_ros.diagnosis.staged import Hysteresis
from pzt_ros.diagnosis.stiffer import stiffer_of
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.identified import SUSCEPTIBILITY, IdentifiedHysteresis
from pzt_ros.sysid.run import Start
from pzt_ros.sysid.thinning import thinned_for_both

_FEWER = 0.5  # share of a run's samples from which two passes over those take as long as one over all
_REMEMBERED = 24  # polarizations at other voltages and vectors


class FlexibleHysteresis(IdentifiedHysteresis):
    """The identified lattice as a `staged.Hysteresis`.

    Polarization is linear in the weights and the occupancies, and bends little with the logarithms of relaxation time
    and thermal field. So once `exact_at` has taken the tangent somewhere, a copy goes along it: refits with effects
    behind the ceramic then cost no pass over the lattice, those with effects before it short ones for each new
    voltage: what that changes is found where the drive or the change of it turns, and is even between.
    """

    far = math.inf  # how far the tangent is off depends on how far the search went
    knows_no_rate = False

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
        key = b"%d " % number + voltage.tobytes()  # two runs may have one drive and other starts
        return self._known.get(key, lambda: polarizations[number] + self._changed(number, vector, voltage))

    def _changed(self, number: int, vector: Array, voltage: Array) -> Array:
        """How P of a run changes with another voltage, to about 1 % of that."""
        assert self._at is not None
        time, here = self.times[number], self._at[1][number]
        kept = thinned_for_both(time, here, voltage)
        if kept.size > _FEWER * time.size:
            return self._on_fewer(number, vector, voltage, np.arange(time.size)) - self._at[2][number]
        there = self._on_fewer(number, vector, voltage, kept)
        key = b"before %d " % number + kept.tobytes()
        before = self._known.get(key, lambda: self._on_fewer(number, vector, here, kept))
        reversible = vector[SUSCEPTIBILITY] / self.layer_thickness * (voltage - here)
        return reversible + np.interp(time, time[kept], there - before - reversible[kept])

    def _on_fewer(self, number: int, vector: Array, voltage: Array, kept: NDArray[np.intp]) -> Array:
        """P of a run at the samples that are kept, from the drive at those."""
        fewer = copy.copy(self)
        fewer.times = [each[kept] if other == number else each for other, each in enumerate(self.times)]
        alone = [voltage[kept] if other == number else np.empty(0) for other in range(len(self.times))]
        return IdentifiedHysteresis.polarization(fewer, vector, alone)[0]

    _known: Remembered[Array]

    def start_of(self, vector: Array, number: int) -> Start:
        """The occupancy that was fitted, or its own initial state."""
        return Start(occupancy=tuple(float(share) for share in self.occupancy(vector, number)))

    def way_of(self, vector: Array, number: int) -> Array:
        """Nothing: how a run came to its start is not known."""
        return np.empty(0)

    def places_of(self, number: int) -> list[int]:
        """The occupancy at the start of a run belongs to it alone."""
        place = self._places(number)
        return list(range(place.start, place.stop))

    def stiffer(self) -> list[Hysteresis]:
        """The same with a density that is more even along constant coercive field."""
        return [*stiffer_of(self)]
