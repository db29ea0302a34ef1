"""The declared ceramic in a search: a lattice stays affordable wherever its parameters go, and is right there."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis import bottom, declared
from pzt_ros.diagnosis.base import _within_sight
from pzt_ros.diagnosis.bottom import to_the_bottom
from pzt_ros.diagnosis.coordinates import coordinate
from pzt_ros.diagnosis.data import FIT, RunData
from pzt_ros.diagnosis.declared import DeclaredHysteresis, _Exact
from pzt_ros.diagnosis.hypothesis import fitted
from pzt_ros.diagnosis.staged import Staged
from pzt_ros.errors import BenchError
from pzt_ros.physics.density import Table
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.surrogate import surrogate_of
from pzt_ros.records import Record
from pzt_ros.sysid.parameters import without_noise
from pzt_ros.sysid.run import Start


def lattice() -> Lattice:
    """The shipped P802's, simulated more exactly than it is shipped."""
    shipped = next(link for link in load_chain("p802").links if isinstance(link, Lattice))
    return dataclasses.replace(shipped, spacing=0.5, accuracy=1e-5)


def searched(link: Lattice) -> DeclaredHysteresis:
    """The ceramic with its domain volume free."""
    time = np.arange(0.0, 2.0, 2e-3)
    voltage = 60.0 - 60.0 * np.cos(2.0 * np.pi * time)
    record = Record("loop", {"time_s": time, "voltage_V": voltage, "displacement_m": voltage})
    return DeclaredHysteresis(link, link, [coordinate(link, "domain_volume")], [record], [Start()])


def domains(link: Lattice) -> int:
    """As many as are simulated."""
    coercive, interaction = link.nodes()
    return coercive[0].size * interaction[0].size


def polarization(link: Lattice) -> Array:
    """Over two cycles of a sine to 120 V."""
    time = np.arange(0.0, 2.0, 2e-3)
    voltage = 60.0 - 60.0 * np.cos(2.0 * np.pi * time)
    return link.step(link.init(Rest()), Signals(time=time, voltage=voltage))[1].polarization


def test_a_lattice_as_declared_is_left_alone() -> None:
    link = lattice()
    ceramic = searched(link)
    assert ceramic.link(ceramic.start) == link


def test_a_narrow_spread_beside_a_wide_one_does_not_take_millions_of_domains() -> None:
    """A measured run, PICMA as it was recorded, ended in an error of the lattice.

    Far below the thermal width d all spreads are alike: a twentieth of d is resolved as it is.
    """
    wide = dataclasses.replace(lattice(), coercive_field_spread=2e12, interaction_field_spread=200.0)
    with pytest.raises(BenchError, match="domains"):
        wide.nodes()
    ceramic = searched(wide)
    link = ceramic.link(ceramic.start)
    assert isinstance(link, Lattice)
    assert link.coercive_field_spread == wide.coercive_field_spread
    assert link.interaction_field_spread < (0.2 * link.thermal_width) ** 2
    assert domains(link) <= 1.1 * declared._FEW_MORE * declared._MOST_DOMAINS
    resolved = dataclasses.replace(wide, interaction_field_spread=2.0 * (0.05 * wide.thermal_width) ** 2)
    expected = polarization(resolved)
    assert np.max(np.abs(polarization(link) - expected)) < 2e-3 * np.ptp(expected)


def test_a_table_beside_a_narrow_spread_stays_a_table() -> None:
    """It has no spread that could be widened: that of the Gaussian in its place says nothing."""
    fields = np.linspace(0.0, 2e6, 41)
    table = Table(tuple(fields), tuple(np.exp(-(((fields - 6e5) / 4e5) ** 2))))
    wide = dataclasses.replace(lattice(), coercive_density=table, interaction_field_spread=200.0)
    link = declared._affordable(wide, declared._MOST_DOMAINS)
    assert isinstance(link, Lattice)
    assert (link.coercive_density, link.coercive_field_spread) == (table, wide.coercive_field_spread)
    assert link.interaction_field_spread > wide.interaction_field_spread


def test_domains_are_no_more_than_can_be_waited_for() -> None:
    ceramic = searched(lattice())
    for larger in (10.0, 1e3):  # the thermal width falls with the root of the domain volume
        found = ceramic.link(ceramic.start + np.log(larger))
        assert isinstance(found, Lattice)
        assert found.domain_volume == pytest.approx(larger * lattice().domain_volume)
        assert domains(found) <= 1.05 * declared._MOST_DOMAINS


def test_fewer_domains_say_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    link = dataclasses.replace(lattice(), domain_volume=2.0 * lattice().domain_volume)
    exact = polarization(link)
    monkeypatch.setattr(declared, "_MOST_DOMAINS", domains(link) // 3)
    ceramic = searched(link)
    fewer = ceramic.link(ceramic.start)
    assert domains(fewer) < 0.4 * domains(link)
    assert np.std(polarization(fewer) - exact) < 1.5e-3 * np.ptp(exact)


def test_what_takes_the_front_models_place_has_fewer_domains_still() -> None:
    ceramic = searched(dataclasses.replace(lattice(), interaction_field_spread=1e14))
    ceramic._rough = [True]
    near = ceramic._near(ceramic.start, 0)
    assert isinstance(near, Lattice)
    assert domains(near) <= 1.1 * declared._MOST_WIDE_DOMAINS < domains(ceramic.model)


@pytest.mark.parametrize(("wider", "taken"), [(1.0, True), (400.0, False)])
def test_spreads_that_ran_away_leave_the_front_model_in_its_place(
    monkeypatch: pytest.MonkeyPatch, wider: float, taken: bool
) -> None:
    """A court case of one hold: each step of a search took seconds, a run 2,000 times what the front model takes."""
    monkeypatch.setattr(declared, "_ROUGH", 0.0)  # so that it is always too far off
    link = dataclasses.replace(lattice(), interaction_field_spread=wider * lattice().interaction_field_spread)
    ceramic = searched(link)
    found = DeclaredHysteresis(link, surrogate_of(link), ceramic.coordinates, ceramic.records, ceramic.starts)
    exact = found.exact_at(found.start, [found.records[0].voltage])
    assert exact._rough == [taken]


def test_what_takes_the_front_models_place_has_its_slopes() -> None:
    """Domains a thermal width apart gave P well, but slopes that were half off: refits crept and came to no end."""
    link = lattice()
    names = ["coercive_field", "relaxation_time", "reciprocal_permittivity", "domain_volume"]
    time = np.arange(0.0, 1.0, 1e-3)
    voltage = 60.0 - 50.0 * np.cos(2.0 * np.pi * time) + 8.0 * np.sin(2.0 * np.pi * 60.0 * time)  # turns and turns
    record = Record("busy", {"time_s": time, "voltage_V": voltage, "displacement_m": voltage})
    ceramic = DeclaredHysteresis(link, link, [coordinate(link, name) for name in names], [record], [Start()])
    ceramic._rough = [True]
    slopes = ceramic._differentiated(ceramic.start, 0, voltage)
    for column, name in enumerate(names):
        higher, lower = ceramic.start.copy(), ceramic.start.copy()
        higher[column], lower[column] = 3e-3, -3e-3
        there, back = (ceramic._run(ceramic.link(v), v, 0, voltage) for v in (higher, lower))
        true = (there - back) / 6e-3
        assert np.linalg.norm(slopes[:, column] - true) < 0.2 * np.linalg.norm(true), name


def test_slopes_of_slow_runs_are_found_at_few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    link = lattice()
    time = np.arange(0.0, 20.0, 1e-3)
    voltage = 60.0 - 60.0 * np.cos(0.5 * time) + 20.0 * np.sin(3.0 * time)
    record = Record("slow", {"time_s": time, "voltage_V": voltage, "displacement_m": voltage})
    free = [coordinate(link, name) for name in ("coercive_field", "relaxation_time", "interaction_field_spread")]
    ceramic = DeclaredHysteresis(link, surrogate_of(link), free, [record], [Start()])
    fewer = ceramic._differentiated(ceramic.start, 0, voltage)
    monkeypatch.setattr(declared, "thinned", lambda time, voltage: np.arange(time.size))
    of_all = ceramic._differentiated(ceramic.start, 0, voltage)
    assert np.all(np.std(fewer - of_all, axis=0) < 0.01 * np.std(of_all, axis=0))
    assert not np.array_equal(fewer, of_all)


def test_a_search_knows_how_the_difference_changed_on_its_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exact where it was last, and at the place before, too: between them the model is met to second order."""
    monkeypatch.setattr(declared, "_WIDE", 1.0)  # so that there is a difference to learn
    link = lattice()
    coarse = dataclasses.replace(link, spacing=1.0, accuracy=1e-3)
    free = [coordinate(link, "relaxation_time"), coordinate(link, "coercive_field")]
    record, voltages = searched(link).records[0], [searched(link).records[0].voltage]
    ceramic = DeclaredHysteresis(link, coarse, free, [record], [Start()])
    ceramic._rough = [True]
    before, after = np.zeros(2), np.array([0.4, -0.1])
    way = ceramic.exact_at(before, voltages).exact_at(after, voltages)

    def missed(searching: DeclaredHysteresis, vector: Array) -> float:
        exact = searching._run(searching.link(vector), vector, 0, voltages[0])
        return float(np.std(searching.polarization(vector, voltages)[0] - exact))

    assert missed(way, after) < 1e-12
    assert missed(way, before) < 1e-12
    between = 0.5 * (before + after)
    assert missed(way, between) < 0.5 * missed(ceramic.exact_at(after, voltages), between)
    _, (columns,) = way.tangent(after, voltages)
    moved = after + np.array([1e-3, 0.0])
    slope = (way.polarization(moved, voltages)[0] - way.polarization(after, voltages)[0]) / 1e-3
    np.testing.assert_allclose(columns[:, 0], slope, atol=1e-9)


def test_a_short_way_or_another_drive_tells_nothing() -> None:
    """Over so short a way the difference changes by noise; over another drive it is another one."""
    nothing = np.zeros((3, 1))
    known = _Exact(np.zeros(1), np.arange(3.0), np.zeros(3), nothing)
    learned = known.moved_to(np.array([0.5]), np.arange(3.0), np.ones(3))
    np.testing.assert_allclose(learned.bend, 2.0)
    np.testing.assert_array_equal(learned.moved_to(np.array([0.501]), np.arange(3.0), np.zeros(3)).bend, learned.bend)
    np.testing.assert_array_equal(learned.moved_to(np.array([1.0]), 2.0 * np.arange(3.0), np.zeros(3)).bend, nothing)


def test_thermal_width_stays_within_what_the_runs_can_tell() -> None:
    """One sine once led it to 0.05 V/m, where a lattice of it takes for ever."""
    link = lattice()
    time = np.arange(0.0, 2.0, 2e-3)
    voltage = 60.0 - 60.0 * np.cos(2.0 * np.pi * time)
    record = Record("loop", {"time_s": time, "voltage_V": voltage, "displacement_m": voltage})
    each = _within_sight(link, coordinate(link, "domain_volume"), [RunData(record, {}, 1e-9)])
    narrowest = dataclasses.replace(link, domain_volume=each.upper)
    assert narrowest.thermal_width == pytest.approx(0.01 * 120.0 / link.layer_thickness)
    assert each.upper < coordinate(link, "domain_volume").upper
    kept = coordinate(link, "coercive_field")
    assert _within_sight(link, kept, [RunData(record, {}, 1e-9)]) == kept


class Astray(DeclaredHysteresis):
    """Moved in place of the model is one whose slopes with the coercive field are none, as at a cliff."""

    def _differentiated(self, vector: Array, number: int, voltage: Array, here: Array) -> Array:
        columns = super()._differentiated(vector, number, voltage, here)
        columns[:, 0] *= -3.0
        return columns


@pytest.mark.parametrize(("off", "comes_down"), [(0.0006, True), (0.002, False)])
def test_a_base_near_the_noise_is_taken_on_with_slopes_of_the_model_itself(off: float, comes_down: bool) -> None:
    """A court case: a null stayed 1 % above the noise, and a strain hysteresis that left that base was named.

    A base that is farther off is left to the search.
    """
    chain = load_chain("p802").with_links(lambda link: lattice() if isinstance(link, Lattice) else link)
    link = next(link for link in chain.links if isinstance(link, Lattice))
    time = np.arange(0.0, 2.0, 2e-3)
    voltage = 60.0 - 60.0 * np.cos(2.0 * np.pi * time)
    record = Record("loop", {"time_s": time, "voltage_V": voltage, "displacement_m": voltage})
    free = [coordinate(link, "coercive_field"), coordinate(link, "relaxation_time")]
    ceramic = Astray(link, surrogate_of(link), free, [record], [Start()])
    runs = [RunData(record, {FIT: np.arange(time.size)}, 1e-9)]
    (told, _), *_ = Staged(without_noise(chain), ceramic, runs, ()).outputs(ceramic.start, [0])
    noise = 1e-3 * float(np.ptp(told))
    measured = told + noise * np.random.default_rng(1).standard_normal(time.size)
    runs = [RunData(Record("loop", {**record.columns, "displacement_m": measured}), {FIT: np.arange(time.size)}, noise)]
    staged = Staged(without_noise(chain), ceramic, runs, ())
    stuck = np.array([off, 2.0 * off])
    found = fitted(staged.exact_at(stuck), stuck, most_steps=0)
    there = to_the_bottom(found)
    assert (there is not found) is comes_down
    if comes_down:
        assert there.fit.ratio < 1.001 * fitted(staged.exact_at(ceramic.start), ceramic.start, most_steps=0).fit.ratio
        assert there.fit.ratio < 0.995 * found.fit.ratio


def test_a_fit_that_only_the_front_model_can_follow_stays_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spreads that ran away ask for more domains than are wise; a diagnosis ended with that."""
    link = lattice()
    time = np.arange(0.0, 1.0, 2e-3)
    record = Record("rise", {"time_s": time, "voltage_V": 90.0 * time, "displacement_m": 1e-6 * time})
    free = [coordinate(link, "coercive_field")]
    ceramic = DeclaredHysteresis(link, surrogate_of(link), free, [record], [Start()])
    chain = without_noise(load_chain("p802")).with_links(lambda each: link if isinstance(each, Lattice) else each)
    staged = Staged(chain, ceramic, [RunData(record, {FIT: np.arange(time.size)}, 1.0)], ())
    found = fitted(staged, staged.start, most_steps=0)

    def refuse(*_: object) -> None:
        raise BenchError("lattice: 4.72e+06 domains 132 V/m apart")

    monkeypatch.setattr(bottom, "fitted", refuse)
    assert to_the_bottom(found) is found
