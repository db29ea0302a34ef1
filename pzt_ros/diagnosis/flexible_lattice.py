"""The identified lattice as the ceramic among other links, with a tangent that refits go along."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pzt_ros.diagnosis.hysteresis import Hysteresis
from pzt_ros.diagnosis.stiffer import stiffer_of
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.identified import SUSCEPTIBILITY, IdentifiedHysteresis
from pzt_ros.sysid.identified_fit import Choice
from pzt_ros.sysid.remembered import Remembered
from pzt_ros.sysid.run import Start, drive_before
from pzt_ros.sysid.thinning import thinned_for_both

_FEWER = 0.5  # share of a run's samples from which two passes over those take as long as one over all
_REMEMBERED = 24  # polarizations at other voltages and vectors


@dataclass(frozen=True)
class _Tangent:
    """What a fit goes along.

    Attributes:
        vector: where it was taken.
        voltages: of every run there [V, each shape (n,)].
        link: the lattice there.
        polarizations: of every run there [C/m^2, each shape (n,)].
        columns: dP/dvector of every run [each shape (n, p), float32].
    """

    vector: Array
    voltages: list[Array]
    link: IdentifiedLattice
    polarizations: list[Array]
    columns: list[Array]


class FlexibleHysteresis(IdentifiedHysteresis):
    """The identified lattice as a `hysteresis.Hysteresis`.

    Polarization is linear in the weights and the occupancies, and bends little with the logarithms of relaxation time
    and thermal field. So once `exact_at` has taken the tangent somewhere, a copy goes along it: refits with effects
    behind the ceramic then cost no pass over the lattice, those with effects before it short ones for each new
    voltage: what that changes is found where the drive or the change of it turns, and is even between.

    Attributes:
        starts: pasts of the runs whose start is not unknown; they began in the initial state where this is empty.
        gain: of the amplifier, which takes these to the ceramic [-].
        choice: of resolution, prior and law, which served best.
    """

    starts: tuple[Start, ...] = ()
    gain = 1.0
    choice: Choice | None = None
    far = math.inf  # how far the tangent is off depends on how far the search went
    knows_no_rate = False

    _at: _Tangent | None = None

    def for_one_search(self) -> FlexibleHysteresis:
        """Itself: it remembers nothing that another search would not find."""
        return self

    def exact_at(self, vector: Array, voltages: Sequence[Array]) -> FlexibleHysteresis:
        """A copy that goes along the tangent taken here."""
        found = copy.copy(self)
        polarizations, columns = IdentifiedHysteresis.tangent(self, vector, voltages)
        found._at = _Tangent(vector.copy(), list(voltages), self.link(vector), polarizations, columns)
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
        columns = [self._at.columns[number] for number, voltage in enumerate(voltages) if voltage.size]
        return self.polarization(vector, voltages), columns

    def _moved(self, number: int, vector: Array) -> Array:
        """How P of a run changes on the way to a vector; in float32, as the tangent: 1e-7 of a small step."""
        assert self._at is not None
        at, columns = self._at.vector, self._at.columns[number]
        key = b"moved %d " % number + vector.tobytes()
        return self._known.get(key, lambda: (columns @ (vector - at).astype(columns.dtype)).astype(float))

    def _here(self, number: int, voltage: Array) -> Array:
        """P of a run where the tangent was taken, at a voltage that may be another."""
        assert self._at is not None
        at = self._at
        if voltage is at.voltages[number] or np.array_equal(voltage, at.voltages[number]):
            return at.polarizations[number]
        key = b"%d " % number + voltage.tobytes()  # two runs may have one drive and other starts
        return self._known.get(key, lambda: at.polarizations[number] + self._changed(at, number, voltage))

    def _changed(self, at: _Tangent, number: int, voltage: Array) -> Array:
        """How P of a run changes with another voltage, to about 1 % of that."""
        time, here = self.times[number], at.voltages[number]
        kept = thinned_for_both(time, here, voltage)
        if kept.size > _FEWER * time.size:
            return self._on_fewer(at, number, voltage, np.arange(time.size)) - at.polarizations[number]
        there = self._on_fewer(at, number, voltage, kept)
        key = b"before %d " % number + kept.tobytes()
        before = self._known.get(key, lambda: self._on_fewer(at, number, here, kept))
        reversible = at.vector[SUSCEPTIBILITY] / self.layer_thickness * (voltage - here)
        return reversible + np.interp(time, time[kept], there - before - reversible[kept])

    def _on_fewer(self, at: _Tangent, number: int, voltage: Array, kept: NDArray[np.intp]) -> Array:
        """P of a run at the samples that are kept, from the drive at those."""
        return self._run(at.link, at.vector, number, self.times[number][kept], voltage[kept])

    _known: Remembered[Array]

    def start_of(self, vector: Array, number: int) -> Start:
        """The occupancy that was fitted, or the reversals before."""
        if self.unknown_start[number]:
            return Start(occupancy=tuple(float(share) for share in self.occupancy(vector, number)))
        return self._past_of(number)

    def with_starts(self, starts: Sequence[Start]) -> FlexibleHysteresis:
        """The same with other pasts of the runs whose start is not unknown, exact nowhere yet."""
        other = copy.copy(self)
        other.starts, other._at = tuple(starts), None
        return other

    def _past_of(self, number: int) -> Start:
        return self.starts[number] if self.starts else Start()

    def _begun(self, link: IdentifiedLattice, vector: Array, run: int, voltages: Array) -> State:
        """The state that a run starts from, behind its past."""
        past = self._past_of(run)
        if self.unknown_start[run] or not past.prior_voltages:
            return super()._begun(link, vector, run, voltages)
        rest, before = drive_before(float(self.times[run][0]), float(voltages[0]), past, self.gain)
        return link.step(link.init(rest), before)[0]

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
