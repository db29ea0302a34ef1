"""The ceramic as the chain declares it: any of the models, its parameters and the histories of the runs free."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pzt_ros.diagnosis.coordinates import Coordinate, coordinate
from pzt_ros.diagnosis.hysteresis import Hysteresis
from pzt_ros.errors import BenchError
from pzt_ros.parallel import side_by_side
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.front import Front
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.signals import Array, Signals
from pzt_ros.physics.surrogate import in_few_steps, surrogate_of
from pzt_ros.records import Record
from pzt_ros.sysid.history_shares import share_bounds, shares_of, with_shares
from pzt_ros.sysid.remembered import Remembered
from pzt_ros.sysid.run import Start, begun_ceramic
from pzt_ros.sysid.thinning import thinned

_STEP = 1e-3
_AT_ONCE = 2  # runs, or columns of a tangent
_FEWER = 0.25  # share of a run's samples that say the same of its drive, beyond which it turns at every few of them
_HALF = 0.5  # the same for columns of the front model, which tells them as well at fewer
_REMEMBERED = 3  # evaluations
_NEAR = 0.01  # so far off, in coordinates and of the drive's span, a tangent still serves to search along
_FAR = 0.01  # so far apart, in coordinates, two places have to be for their differences to tell a slope
_FAR_OFF = 5.0  # rms over noise: the front model is off by a fraction of the noise of a good sensor
_FAR_BESIDE_PASTS = 1.6  # while more than this is missing, pasts are sought that make up for it, exact or not
_ROUGH = 6e-4  # rms of the difference over the span of P from which the front model is too far off for a run
_WIDE, _LOOSE = 0.5, 1e-3  # thermal widths between domains, error of x+: of what takes its place
_WIDEST = 10.0  # thermal widths between domains
_COARSEST = 1e-2  # error of x+ on slow ramps
_MOST_DOMAINS = 40_000  # of a lattice; 20,000 samples that all move then take 2 s
_FEW_MORE = 4.0  # times that: what a narrow spread may ask for
_MOST_WIDE_DOMAINS = 8_000  # of one that takes the front model's place: spreads that ran away would make it far slower
_SPREADS = (
    "coercive_field_spread",
    "interaction_field_spread",
    "second_coercive_field_spread",
    "second_interaction_field_spread",
)

_Kept = slice | NDArray[np.intp]


class _Slope(NamedTuple):
    """How P of a run changes with each parameter, and where that was found.

    Attributes:
        vector: of what P of the run depends on [shape (p,)].
        voltage: across the ceramic [V, shape (n,)].
        columns: dP/dvector [C/m^2, shape (n, p)].
    """

    vector: Array
    voltage: Array
    columns: Array

    def serves(self, vector: Array, voltage: Array) -> bool:
        """Whether it is near enough there."""
        driven_alike = np.max(np.abs(self.voltage - voltage)) <= _NEAR * np.ptp(voltage)
        return bool(driven_alike and np.max(np.abs(self.vector - vector), initial=0.0) <= _NEAR)


class _Exact(NamedTuple):
    """Where a run's polarization was last exact, and what has to be added there and nearby.

    Attributes:
        vector: of what P of the run depends on [shape (p,)].
        voltage: across the ceramic [V, shape (n,)].
        difference: of the model and what is moved in its place [C/m^2, shape (n,)].
        bend: how that changes along the vector, as far as is known [C/m^2, shape (n, p)].
    """

    vector: Array
    voltage: Array
    difference: Array
    bend: Array

    def moved_to(self, vector: Array, voltage: Array, difference: Array) -> _Exact:
        """The same elsewhere; what the difference did on the way there is learned (Broyden's rank-one update)."""
        way = vector - self.vector
        length = float(way @ way)
        alike = np.max(np.abs(self.voltage - voltage)) <= _NEAR * np.ptp(voltage)
        if not alike or length < _FAR**2:
            return _Exact(vector, voltage, difference, self.bend if alike else np.zeros_like(self.bend))
        surprise = difference - self.difference - self.bend @ way
        return _Exact(vector, voltage, difference, self.bend + np.outer(surprise, way / length))


class DeclaredHysteresis:
    """A ceramic's link with some of its parameters free; a `hysteresis.Hysteresis`.

    A model of many domains takes ten to twenty times as long as the front model of the same ceramic, and the two differ
    by little that changes slowly with the parameters. So the search moves the front model, plus the difference of the
    two where `exact_at` was last asked for, and how that changed on the way there: without it a search creeps in a
    valley, such as where a lag and a relaxation time make up for one another. On drives that turn at every few samples
    the front model is worst, and its decisions on what is a reversal are cliffs in the cost; there a lattice of wide
    spacing takes its place, which on such drives takes no longer.

    The vector is: the parameters, then run by run its history as shares of what is allowed.

    Args:
        model: the link, with the values to start from.
        quick: a fast model with the same parameters; the model itself where there is none.
        coordinates: its free parameters.
        records: the runs.
        starts: their histories; how many unknowns each has is fixed here.
        gain: of the amplifier, which takes these histories to the ceramic [-].
    """

    def __init__(
        self,
        model: Ferroelectric,
        quick: Ferroelectric,
        coordinates: Sequence[Coordinate],
        records: Sequence[Record],
        starts: Sequence[Start],
        gain: float = 1.0,
    ) -> None:
        self.model, self.quick, self.gain = model, quick, gain
        self.knows_no_rate = model.knows_no_rate
        self.coordinates = tuple(coordinates)
        self.records, self.starts = tuple(records), tuple(starts)
        self.far = _FAR_BESIDE_PASTS if any(start.prior_voltages for start in starts) else _FAR_OFF
        shares = [share for r, s in zip(records, starts, strict=True) for share in shares_of(r, s)]
        self.names = [each.name for each in coordinates]
        for run, start in enumerate(starts, start=1):
            self.names += [f"run {run} reversal {k + 1}" for k in range(len(start.prior_voltages))]
            self.names += [f"run {run} approach"] if start.approach is not None else []
        self.start = np.array([each.scaled(each.start) for each in coordinates] + shares)
        limits = [each.bounds for each in coordinates]
        for record, start in zip(records, starts, strict=True):
            limits += share_bounds(record, start)
        self.lower, self.upper = (np.array([limit[k] for limit in limits]) for k in (0, 1))
        self._exact: dict[int, _Exact] = {}  # by run
        self._rough = [False] * len(records)
        self._known: Remembered[list[Array]] = Remembered(_REMEMBERED)
        self._slopes: dict[int, _Slope] | None = None  # by run; only where no other search looks

    def with_starts(self, starts: Sequence[Start]) -> DeclaredHysteresis:
        """The same ceramic with other histories."""
        return DeclaredHysteresis(self.model, self.quick, self.coordinates, self.records, starts, self.gain)

    def with_model(self, model: Ferroelectric) -> DeclaredHysteresis:
        """The same with another link, which is moved itself, without a fast model in its place."""
        return DeclaredHysteresis(model, model, self.coordinates, self.records, self.starts, self.gain)

    def with_polycrystal(self, model: Polycrystal) -> DeclaredHysteresis:
        """The same with another model of the same domains."""
        free = [dataclasses.replace(each, kind=model.kind) for each in self.coordinates]
        return DeclaredHysteresis(model, surrogate_of(model), free, self.records, self.starts, self.gain)

    def with_free(self, fields: Sequence[str]) -> DeclaredHysteresis:
        """The same with more parameters of the model free, behind those that are."""
        free = (*self.coordinates, *(coordinate(self.model, field) for field in fields))
        return DeclaredHysteresis(self.model, self.quick, free, self.records, self.starts, self.gain)

    def begun_at(self, values: Mapping[str, float]) -> DeclaredHysteresis:
        """The same with other values to start from [SI]."""
        model, quick = (dataclasses.replace(link, **values) for link in (self.model, self.quick))
        free = [dataclasses.replace(each, start=values.get(each.field, each.start)) for each in self.coordinates]
        return DeclaredHysteresis(model, quick, free, self.records, self.starts, self.gain)

    def for_one_search(self) -> DeclaredHysteresis:
        """A copy that keeps tangents for as long as they serve; what it gives depends on what it was asked before."""
        found = copy.copy(self)
        found._slopes = {}
        return found

    def exact_at(self, vector: Array, voltages: Sequence[Array]) -> DeclaredHysteresis:
        """A copy that agrees with the model at a vector, for the runs whose voltage is given."""
        if self.quick is self.model:
            return self
        found = self.with_starts(self.starts)
        exact = self.link(vector)
        for number, voltage in enumerate(voltages):
            if voltage.size:
                here = self._run(exact, vector, number, voltage)
                found._rough[number] = self._rough[number]
                difference = here - self._run(found._near(vector, number), vector, number, voltage)
                far_off = np.std(difference) > _ROUGH * np.ptp(here) and _turns_often(self.records[number], voltage)
                if far_off and not found._rough[number] and self._may_be_rough(vector):
                    found._rough[number] = True
                    difference = here - self._run(found._near(vector, number), vector, number, voltage)
                known, of_run = self._exact.get(number), vector[self._all_of(number)]
                if known is None or found._rough[number] != self._rough[number]:
                    nothing = np.zeros((voltage.size, of_run.size))
                    found._exact[number] = _Exact(of_run, voltage, difference, nothing)
                else:
                    found._exact[number] = known.moved_to(of_run, voltage, difference)
        return found

    def _near(self, vector: Array, number: int) -> Ferroelectric:
        """What is moved in place of the model for a run."""
        if not self._rough[number]:
            return in_few_steps(self._valued(self.quick, vector), self.records[number].voltage)
        link = self.link(vector)
        assert isinstance(link, Lattice)
        wide = dataclasses.replace(link, spacing=max(link.spacing, _WIDE), accuracy=max(link.accuracy, _LOOSE))
        return _affordable(wide, _MOST_WIDE_DOMAINS)

    def _may_be_rough(self, vector: Array) -> bool:
        """Whether the model is a lattice whose spreads did not run away: with those each step takes minutes."""
        exact = self._valued(self.model, vector)
        return isinstance(exact, Lattice) and _affordable(exact, _MOST_DOMAINS) is exact

    def link(self, vector: Array) -> Ferroelectric:
        """The ceramic with the values of the vector, its domains no more than can be waited for."""
        return _affordable(self._valued(self.model, vector), _MOST_DOMAINS)

    def polarization(self, vector: Array, voltages: Sequence[Array]) -> list[Array]:
        """P of each run whose voltage is given [C/m^2]; what was computed lately is not computed again."""
        key = vector.tobytes() + b"".join(voltage.tobytes() for voltage in voltages)
        return self._known.get(key, lambda: self._all(vector, voltages))

    def tangent(self, vector: Array, voltages: Sequence[Array]) -> tuple[list[Array], list[Array]]:
        """P of each run and how it changes with each parameter, by differences."""
        asked = [number for number, voltage in enumerate(voltages) if voltage.size]
        return self.polarization(vector, voltages), [self._slope(vector, n, voltages[n]) for n in asked]

    def _slope(self, vector: Array, number: int, voltage: Array) -> Array:
        """dP/dvector of a run [shape (n, p)]; a search does as well with one from nearby, which costs nothing."""
        of_run = self._all_of(number)
        known = self._slopes.get(number) if self._slopes is not None else None
        if known is None or not known.serves(vector[of_run], voltage):
            known = _Slope(vector[of_run], voltage, self._differentiated(vector, number, voltage))
        if self._slopes is not None:
            self._slopes[number] = known
        columns = np.zeros((voltage.size, vector.size))
        columns[:, of_run] = known.columns
        return columns

    def _differentiated(self, vector: Array, number: int, voltage: Array) -> Array:
        """The same by differences, at fewer samples where those are few: between them it is even, to some 0.2 %."""
        of_run, known = self._all_of(number), self._exact.get(number)
        columns = np.zeros((voltage.size, len(of_run)))
        near = self._near(vector, number)  # with its substeps and spacing: a difference may not see them change
        time = self.records[number].time
        few, most = thinned(time, voltage), _HALF if isinstance(near, Front) else _FEWER
        kept = few if few.size <= most * time.size else np.arange(time.size)
        here = self._run(near, vector, number, voltage, kept)

        def differentiate(column: int) -> None:
            k, moved = of_run[column], vector.copy()
            moved[k] += _STEP if vector[k] + _STEP <= self.upper[k] else -_STEP
            with suppress(BenchError):  # the link refuses this combination of values: taken as one that changes nothing
                there = self._run(self._valued(near, moved), moved, number, voltage, kept)
                columns[:, column] = np.interp(time, time[kept], (there - here) / (moved[k] - vector[k]))
                if known is not None:
                    columns[:, column] += known.bend[:, column]

        side_by_side(differentiate, range(len(of_run)), _AT_ONCE)
        return columns

    def regularisation(self) -> tuple[Array, Array]:
        """Nothing: every parameter is told by the data, or held."""
        return np.zeros((0, self.start.size)), np.zeros(0)

    def start_of(self, vector: Array, number: int) -> Start:
        """The history of a run, with the reversals of the vector."""
        return with_shares(self.starts[number], self.records[number], vector[self.places_of(number)])

    def way_of(self, vector: Array, number: int) -> Array:
        """P at the reversals before a run [C/m^2, shape (k,)], by what is moved in place of the model."""
        start = self.start_of(vector, number)
        return begun_ceramic(self._near(vector, number), self.records[number], start, self.gain)[1]

    def places_of(self, number: int) -> list[int]:
        """The history of a run belongs to it alone."""
        first = len(self.coordinates) + sum(start.unknowns for start in self.starts[:number])
        return list(range(first, first + self.starts[number].unknowns))

    def stiffer(self) -> list[Hysteresis]:
        """Nothing: it has no prior."""
        return []

    def _all(self, vector: Array, voltages: Sequence[Array]) -> list[Array]:
        def of_run(number: int) -> Array:
            near = self._near(vector, number)
            return self._run(near, vector, number, voltages[number]) + self._added(vector, number)

        return side_by_side(of_run, [number for number, voltage in enumerate(voltages) if voltage.size], _AT_ONCE)

    def _added(self, vector: Array, number: int) -> Array | float:
        """What the model has beyond what is moved in its place [C/m^2]."""
        known = self._exact.get(number)
        return 0.0 if known is None else known.difference + known.bend @ (vector[self._all_of(number)] - known.vector)

    def _all_of(self, number: int) -> list[int]:
        """Where in the vector stands what P of a run depends on."""
        return [*range(len(self.coordinates)), *self.places_of(number)]

    def _valued(self, model: Ferroelectric, vector: Array) -> Ferroelectric:
        own = vector[: len(self.coordinates)]
        values = {each.field: each.si(float(v)) for each, v in zip(self.coordinates, own, strict=True)}
        return dataclasses.replace(model, **values)

    def _run(self, link: Ferroelectric, vector: Array, number: int, voltage: Array, kept: _Kept = slice(None)) -> Array:
        """P of a run at the samples that are kept, from the drive at those [C/m^2]."""
        record = self.records[number]
        state, _ = begun_ceramic(link, record, self.start_of(vector, number), self.gain)
        _, out = link.step(state, Signals(time=record.time[kept], voltage=voltage[kept]))
        return out.polarization


def _turns_often(record: Record, voltage: Array) -> bool:
    """Whether a drive turns at every few samples, where the front model's steps and decisions are cliffs."""
    return thinned(record.time, voltage).size > _FEWER * record.time.size


def _affordable(link: Ferroelectric, most: int) -> Ferroelectric:
    """A lattice with fewer domains and longer substeps where there would be too many to wait for.

    Records that do not tell the thermal width, one hold or one sine, let it shrink. The domains grow with its inverse
    square, the substeps with its inverse: each sample then takes many. Nor do they tell a spread far below the other,
    which no spacing may pass over: where that alone asks for too many, it is made wider.
    """
    if not isinstance(link, Lattice) or link.threshold_density is not None:
        return link
    link = _not_too_narrow(link, _FEW_MORE * most)
    excess = link.domains / most
    if excess <= 1.0:
        return link
    wide = sum(density.spread > 0 for density in (link.coercive, link.interaction)) if link.is_product else 2
    spacing = link.field_spacing / link.thermal_width * excess ** (1.0 / max(wide, 1))
    accuracy = max(link.accuracy, min(excess * link.accuracy, _COARSEST))  # a substep goes with the root of it
    return dataclasses.replace(link, spacing=max(link.spacing, min(spacing, _WIDEST)), accuracy=accuracy)


def _not_too_narrow(link: Lattice, most: float) -> Lattice:
    """With a spread that is far below thermal activation no narrower than so many domains can follow."""
    densities = [density for kind in link.kinds for density in (kind.coercive, kind.interaction)]
    spread = {field: density.spread for field, density in zip(_SPREADS, densities, strict=False)}
    narrowest = min(spread, key=lambda field: spread[field])
    needless = link.spacing * link.thermal_width / link.field_spacing  # times closer than thermal activation asks
    widening = min(link.domains / most, needless)
    if widening <= 1.0 or spread[narrowest] == 0.0:
        return link
    least = spread[narrowest] * widening**2
    widened: dict[str, Any] = {field: least for field, known in spread.items() if known < least}
    return dataclasses.replace(link, **widened)
