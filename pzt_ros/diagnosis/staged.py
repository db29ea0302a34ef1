"""A chain in three stages, so that what has not changed is not computed again.

Links before the ceramic turn the command into the voltage across it; the ceramic, nearly all of the work, turns that
into polarization; links behind it make the displacement out of it. An unknown of the last stage costs a pass through
links of a few ns a sample. An unknown of the ceramic costs one too: its tangent is taken once and carried through the
last stage.

A link that runs a copy of the ceramic to find the voltage across it would cost a pass for each step of each unknown. So
a search moves its shortcut behind the ceramic, plus what P had beyond that where `exact_at` was last asked for, and how
that changes with the link's own parameters.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress

import numpy as np

from pzt_ros.diagnosis.coordinates import Coordinate, with_coordinates
from pzt_ros.diagnosis.counts import counts_before
from pzt_ros.diagnosis.data import FIT, RunData, seen_through
from pzt_ros.diagnosis.hysteresis import Hysteresis
from pzt_ros.diagnosis.shortcuts import Beyond, shortcuts_of
from pzt_ros.effects.insert import without_effect
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.change import Change, Columns
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import Link, State
from pzt_ros.physics.loaded import shortcut_of
from pzt_ros.physics.signals import ABSENT, Array, Rest, Signals
from pzt_ros.sysid.run import begun, by_way_of, turned

_STEP, _WAY_STEP = 1e-4, 1e-3  # of a coordinate behind the ceramic, and of one of its own


@dataclasses.dataclass(frozen=True)
class Staged:
    """A chain over runs: residuals in units of the noise, and their Jacobian.

    The vector is: the ceramic's unknowns, then those of the other links as `coordinates` lists them.

    Attributes:
        chain: with the values that are not sought; its ceramic only marks the place.
        ceramic: what stands there.
        runs: all of them, those that are fitted first.
        coordinates: of the other links.
        given: what is known of single runs and not sought, at the values where these coordinates start.
        beyond: what P has beyond that of a shortcut, by run; empty where nothing was asked for yet.
    """

    chain: Chain
    ceramic: Hysteresis
    runs: Sequence[RunData]
    coordinates: tuple[Coordinate, ...]
    given: tuple[Coordinate, ...] = ()
    beyond: Mapping[int, Beyond] = dataclasses.field(default_factory=dict)

    @property
    def start(self) -> Array:
        """The vector that stands for the values as given."""
        return np.concatenate((self.ceramic.start, [each.scaled(each.start) for each in self.coordinates]))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest vector."""
        limits = [each.bounds for each in self.coordinates]
        low, high = [a for a, _ in limits], [b for _, b in limits]
        return np.concatenate((self.ceramic.lower, low)), np.concatenate((self.ceramic.upper, high))

    @property
    def prior(self) -> tuple[Array, Array]:
        """The ceramic's regularisation, with columns for all unknowns."""
        rows, targets = self.ceramic.regularisation()
        return np.hstack((rows, np.zeros((len(rows), len(self.coordinates))))), targets

    @property
    def fitted(self) -> list[int]:
        """Indices of the runs with a part to fit."""
        return [number for number, run in enumerate(self.runs) if FIT in run.picks]

    @property
    def far(self) -> float:
        """Rms over noise of a misfit beside which what it is off by does not count."""
        return math.inf if shortcuts_of(self.chain.links) else self.ceramic.far

    @property
    def has_past(self) -> bool:
        """Whether a run begins driven, so that its start is unknown."""
        return any(run.begins_driven for run in self.runs)

    def sparse(self, samples: int) -> Staged:
        """The same with so many samples fitted in all, of every run as large a share; itself where those are all.

        They are drawn by chance, though the same each time: every tenth might see a hum stand still.
        """
        counted = sum(self.runs[number].picks[FIT].size for number in self.fitted)
        if counted <= samples:
            return self
        chance = np.random.default_rng(0)
        runs = list(self.runs)
        for number in self.fitted:
            picks = runs[number].picks[FIT]
            drawn = np.sort(chance.choice(picks, -(-picks.size * samples // counted), replace=False))
            runs[number] = dataclasses.replace(runs[number], picks={**runs[number].picks, FIT: drawn})
        return dataclasses.replace(self, runs=runs)

    def residuals(self, vector: Array) -> list[Array]:
        """Misfit of every fitted run."""
        outputs = self.outputs(vector, self.fitted)
        return [self.runs[r].misfit(FIT, *out) for r, out in zip(self.fitted, outputs, strict=True)]

    def linearise(self, vector: Array) -> tuple[list[Array], list[Array]]:
        """Misfit of every fitted run and its Jacobian."""
        return self.jacobians(vector, self.fitted, FIT)

    def jacobians(self, vector: Array, numbers: Sequence[int], part: str) -> tuple[list[Array], list[Array]]:
        """Misfit of runs on a part and its Jacobian [shapes (m,) and (m, p)], in the precision of the tangent."""
        driven = [self._driven(vector, number) for number in numbers]
        polarized, along = self.ceramic.tangent(vector[: self._own], self._voltages(driven, numbers))
        residuals, jacobians = [], []
        for number, signals, p, columns in zip(numbers, driven, polarized, along, strict=True):
            run, behind = self.runs[number], self._behind(vector, number)
            way = self._way(vector, number)
            turns = self._way_changes(vector, number, way).astype(columns.dtype)
            here = _seen(behind, signals, p, way)
            residual = run.misfit(part, *here)
            jacobian = np.zeros((residual.size, vector.size), dtype=columns.dtype)
            jacobian[:, : self._own] = run.change(part, *_carried(behind, signals, p, columns, (way, turns)))
            for k in range(len(self.coordinates)):
                moved = self._difference(vector, number, k, (signals, p, way), here)
                jacobian[:, self._own + k] = run.change(part, *moved)
            residuals.append(residual)
            jacobians.append(jacobian)
        return residuals, jacobians

    def outputs(self, vector: Array, numbers: Sequence[int]) -> list[tuple[Array, Array]]:
        """Displacement [m] and recorded polarization [C/m^2] of runs, at every sample."""
        driven = [self._driven(vector, number) for number in numbers]
        polarized = self.ceramic.polarization(vector[: self._own], self._voltages(driven, numbers))
        return [
            _seen(self._behind(vector, number), signals, p, self._way(vector, number))
            for number, signals, p in zip(numbers, driven, polarized, strict=True)
        ]

    def exact_at(self, vector: Array) -> Staged:
        """The same, exact at a vector; itself where it is so everywhere."""
        ceramic = self.ceramic.exact_at(vector[: self._own], self.voltages(vector))
        found = self if ceramic is self.ceramic else dataclasses.replace(self, ceramic=ceramic)
        found = found.counted(vector, {each.kind for each in self.given})
        if not shortcuts_of(self.chain.links):
            return found
        return dataclasses.replace(found, beyond=found._beyond_shortcuts(vector))

    def for_one_search(self) -> Staged:
        """The same for one search alone."""
        return dataclasses.replace(self, ceramic=self.ceramic.for_one_search())

    def voltages(self, vector: Array) -> list[Array]:
        """Across the ceramic, of every run [V]."""
        return [self._driven(vector, number).voltage for number in range(len(self.runs))]

    def polarizations(self, vector: Array) -> list[Array]:
        """Of the ceramic, in every run [C/m^2]."""
        return self.ceramic.polarization(vector[: self._own], self.voltages(vector))

    def without(self, kind: str) -> tuple[Staged, list[int]]:
        """The same without an effect, and the places in the vector of the unknowns that are left."""
        kept = [place for place, each in enumerate(self.coordinates) if each.kind != kind]
        chain = without_effect(self.chain, kind)
        plain = dataclasses.replace(
            self,
            chain=chain,
            runs=seen_through(chain, self.runs),
            coordinates=tuple(self.coordinates[place] for place in kept),
            given=tuple(each for each in self.given if each.kind != kind),
            beyond={} if self._has_shortcut(kind) else self.beyond,
        )
        return plain, [*range(self._own), *(self._own + place for place in kept)]

    def without_all(self, kinds: Iterable[str], vector: Array) -> tuple[Staged, Array]:
        """The same without several effects, and what is left of the vector [shape (p,)]."""
        bare = self
        for kind in kinds:
            bare, kept = bare.without(kind)
            vector = vector[kept]
        return bare, vector

    def chain_at(self, vector: Array, number: int | None = None) -> Chain:
        """The chain with the values of the vector, for one run or for the stage."""
        chain = self._valued(vector, number)
        ceramic = self.ceramic.link(vector[: self._own])
        return chain.with_links(lambda link: ceramic if isinstance(link, Ferroelectric) else link)

    def is_before(self, kind: str) -> bool:
        """Whether a link stands before the ceramic, and so does what a search moves in its place."""
        return any(link.kind == kind for link in self.chain.links[: self._place]) and not self._has_shortcut(kind)

    def counted(self, vector: Array, kinds: Collection[str]) -> Staged:
        """With effects of these kinds going on from run to run, by the polarization there; itself where that is so."""
        links = [link for link in self.chain_at(vector).links if link.kind in kinds]
        polarizations = self.polarizations(vector) if links else []
        given = [each for link in links for each in counts_before(EFFECT_OF[link.kind].goes_on, link, polarizations)]
        return self if tuple(given) == self.given else dataclasses.replace(self, given=tuple(given))

    @property
    def _own(self) -> int:
        return self.ceramic.start.size

    @property
    def _place(self) -> int:
        return next(place for place, link in enumerate(self.chain.links) if isinstance(link, Ferroelectric))

    def _links(self, vector: Array, number: int) -> tuple[Link, ...]:
        return self._valued(vector, number).links

    def _valued(self, vector: Array, number: int | None) -> Chain:
        known = [each.scaled(each.start) for each in self.given]
        values = np.concatenate((known, vector[self._own :]))
        return with_coordinates(self.chain, (*self.given, *self.coordinates), values, number)

    def _driven(self, vector: Array, number: int) -> Signals:
        """The signals at the ceramic."""
        run = self.runs[number]
        links = [link for link in self._links(vector, number)[: self._place] if not shortcut_of(link)]
        start = self.ceramic.start_of(vector[: self._own], number)
        return _stepped(links, begun(links, run.record, start), run.signals)

    def _behind(self, vector: Array, number: int) -> tuple[Link, ...]:
        links = self._links(vector, number)
        known = [self.beyond[number].near(self._named(vector))] if number in self.beyond else []
        return (*shortcuts_of(links), *known, *links[self._place + 1 :])

    def _has_shortcut(self, kind: str) -> bool:
        return any(link.kind == kind and shortcut_of(link) for link in self.chain.links)

    def _named(self, vector: Array) -> dict[str, float]:
        """Coordinates of the other links by name."""
        return {each.name: float(value) for each, value in zip(self.coordinates, vector[self._own :], strict=True)}

    def _beyond_shortcuts(self, vector: Array) -> dict[int, Beyond]:
        """What P of each run has beyond that of the shortcuts, and how that changes with their links' parameters."""
        here, at = self._beyond_here(vector), self._named(vector)
        slopes: list[dict[str, Array]] = [{} for _ in self.runs]
        for place, each in enumerate(self.coordinates, start=self._own):
            if self._has_shortcut(each.kind):
                moved = vector.copy()
                moved[place] += _WAY_STEP if vector[place] + _WAY_STEP <= self.bounds[1][place] else -_WAY_STEP
                for number, there in enumerate(self._beyond_here(moved)):
                    slopes[number][each.name] = (there - here[number]) / (moved[place] - vector[place])
        return {number: Beyond(values, at, slopes[number]) for number, values in enumerate(here)}

    def _beyond_here(self, vector: Array) -> list[Array]:
        """The same as it is, of every run [C/m^2, each shape (n,)]."""
        driven = [self._driven(vector, number) for number in range(len(self.runs))]
        polarized = self.ceramic.polarization(vector[: self._own], [signals.voltage for signals in driven])
        pairs = enumerate(zip(driven, polarized, strict=True))
        return [self._beyond_in(vector, number, signals, p) for number, (signals, p) in pairs]

    def _beyond_in(self, vector: Array, number: int, signals: Signals, polarization: Array) -> Array:
        """The same of one run, where a shortcut does anything in it."""
        links, run = self.chain_at(vector, number).links[: self._place + 1], self.runs[number]
        shortcuts, rest = shortcuts_of(links), Rest(float(signals.time[0]), float(signals.voltage[0]))
        near = _stepped(shortcuts, [link.init(rest) for link in shortcuts], signals.replace(polarization=polarization))
        if np.array_equal(near.polarization, polarization):
            return np.zeros_like(polarization)
        states = begun(links, run.record, self.ceramic.start_of(vector[: self._own], number))
        return _stepped(links, states, run.signals).polarization - near.polarization

    def _way(self, vector: Array, number: int) -> Array:
        """Polarization at the reversals before a run [C/m^2, shape (k,)], where a link asks for it."""
        asked = any(link.follows_turns for link in self.chain.links)
        return self.ceramic.way_of(vector[: self._own], number) if asked else np.empty(0)

    def _way_changes(self, vector: Array, number: int, way: Array) -> Array:
        """How that changes with the ceramic's unknowns, by differences [shape (k, p)]."""
        columns = np.zeros((way.size, self._own))
        others = {place for run in range(len(self.runs)) if run != number for place in self.ceramic.places_of(run)}
        for k in (place for place in range(self._own) if way.size and place not in others):
            moved = vector[: self._own].copy()
            moved[k] += _WAY_STEP if vector[k] + _WAY_STEP <= self.ceramic.upper[k] else -_WAY_STEP
            with suppress(BenchError):  # the link refuses this combination of values: taken as one that changes nothing
                columns[:, k] = (self.ceramic.way_of(moved, number) - way) / (moved[k] - vector[k])
        return columns

    def _voltages(self, driven: Sequence[Signals], numbers: Sequence[int]) -> list[Array]:
        """Of every run; empty for those that are not asked for."""
        voltages = [np.empty(0)] * len(self.runs)
        for number, signals in zip(numbers, driven, strict=True):
            voltages[number] = signals.voltage
        return voltages

    def _difference(
        self,
        vector: Array,
        number: int,
        k: int,
        polarized: tuple[Signals, Array, Array],
        here: tuple[Array, Array],
    ) -> tuple[Array, Array]:
        """How the outputs of a run change with coordinate k of the other links."""
        each = self.coordinates[k]
        if each.run not in (None, number):
            return np.zeros_like(here[0]), np.zeros_like(here[1])
        step = _STEP if self.bounds[1][self._own + k] >= vector[self._own + k] + _STEP else -_STEP
        moved = vector.copy()
        moved[self._own + k] += step
        if self.is_before(each.kind):
            there = self.outputs(moved, [number])[0]
        else:
            there = _seen(self._behind(moved, number), *polarized)
        return (there[0] - here[0]) / step, (there[1] - here[1]) / step


def _stepped(links: Sequence[Link], states: Sequence[State], signals: Signals) -> Signals:
    for link, state in zip(links, states, strict=True):
        _, signals = link.step(state, signals)
    return signals


def _seen(behind: Sequence[Link], signals: Signals, polarization: Array, way: Array) -> tuple[Array, Array]:
    """Displacement and polarization as recorded, of a run that began by way of others [C/m^2, shape (k,)]."""
    rest = Rest(time=float(signals.time[0]), voltage=float(signals.voltage[0]))
    out = _stepped(behind, [turned(link, rest, way) for link in behind], signals.replace(polarization=polarization))
    return out.displacement, out.polarization


def _carried(
    behind: Sequence[Link], signals: Signals, polarization: Array, columns: Columns, came: tuple[Array, Columns]
) -> tuple[Columns, Columns]:
    """A tangent of the ceramic and of the way it came, carried to the outputs [each shape (n, p)]."""
    signals, change = signals.replace(polarization=polarization), Change(columns)
    rest = Rest(time=float(signals.time[0]), voltage=float(signals.voltage[0]))
    for link in behind:
        turns = link.follows_turns and came[0].size
        change = _carried_by(link, signals, change, *came) if turns else link.carry(signals, change)
        _, signals = link.step(turned(link, rest, came[0]), signals)
    return change.displacement, change.polarization


def _carried_by(link: Link, signals: Signals, change: Change, way: Array, turns: Columns) -> Change:
    """`Link.carry` by way of other polarizations [C/m^2, shape (k,)], which change as well [shape (k, p)]."""
    before, by_way = vars(by_way_of(way)), {"polarization": turns}
    longer = {name: _after(before[name], values, way.size) for name, values in vars(signals).items()}
    added = {name: _after(by_way.get(name, ABSENT), columns, way.size) for name, columns in vars(change).items()}
    carried = link.carry(Signals(**longer), Change(**added))
    return Change(**{name: columns[way.size :] if columns.size else columns for name, columns in vars(carried).items()})


def _after(first: Columns, values: Columns, rows: int) -> Columns:
    """Values after so many others, or after zeros where there are none; as they are where they are absent."""
    if not values.size:
        return values
    return np.concatenate((first if first.size else np.zeros((rows, *values.shape[1:]), dtype=values.dtype), values))


Progress = Callable[[str], None]
