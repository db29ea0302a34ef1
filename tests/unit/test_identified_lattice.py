"""The identified lattice: against the polycrystal's integrator, against the plain lattice, and its own laws."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from pzt_ros.chains import chain_as_data, load_chain, parse_chain, save_chain
from pzt_ros.errors import BenchError
from pzt_ros.physics import polycrystal_kernel
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.identified_hats import (
    accumulate,
    hat_sums,
    hats_of,
    node_count,
    nodes_of,
    relay_thresholds,
    spread_out,
)
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Rest, Signals

GRID = np.linspace(-1.2e6, 1.8e6, 9)


def lattice(**changes: object) -> IdentifiedLattice:
    up, down = np.array(nodes_of(GRID.size)).T
    weights = tuple(0.01 * np.exp(-(((up - down - 2) / 3) ** 2) - ((up + down - 8) / 4) ** 2))
    return IdentifiedLattice(**{"grid": tuple(GRID), "weights": weights, **changes})  # type: ignore[arg-type]


def drive(rate: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Loops, a minor loop, a hold and a jump, sampled unevenly [s, V]."""
    random = np.random.default_rng(8)
    time = np.cumsum(random.uniform(0.2, 1.8, count)) / rate
    phase = np.linspace(0.0, 1.0, count)
    voltage = 150.0 * np.sin(7.0 * np.pi * phase) * (0.3 + 0.7 * np.cos(5.0 * phase) ** 2)
    voltage[count // 2 : count // 2 + 9] = voltage[count // 2]
    return time, voltage * np.minimum(1.0, 20.0 * phase)


def by_collocation(link: IdentifiedLattice, time: np.ndarray, voltage: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """P of the same density on lines of its own, by the polycrystal's order-4 integrator at 1e-8."""
    up, down = relay_thresholds(lines)
    hats, weight = hats_of(lines, np.asarray(link.grid)), np.empty(up.size)
    spread_out(np.asarray(link.weights) / hat_sums(hats), hats, weight)
    elements = polycrystal_kernel.Elements(
        forward=up / link.thermal_field,
        backward=down / link.thermal_field,
        row_weight=np.ones(1),
        column_weight=weight,
        width=link.thermal_field,
        attempt_rate=1.0 / link.relaxation_time,
        susceptibility=link.susceptibility / weight.sum(),
        domain_polarization=1.0,
        bias=0.0,
        layer_thickness=link.layer_thickness,
        method=polycrystal_kernel.COLLOCATION,
        field_step=polycrystal_kernel.field_step(polycrystal_kernel.COLLOCATION, 1e-8),
    )
    state = np.concatenate(([0.0, 0.0, 1.0], np.zeros(up.size)))
    polarization, fraction = np.empty(time.size), np.empty(time.size)
    assert polycrystal_kernel.run(state, elements, time, voltage, polarization, fraction) == -1
    return polarization


@pytest.mark.parametrize("relaxation_time", [1e-5, 1e-3, 0.1])
@pytest.mark.parametrize("rate", [10.0, 200.0, 5000.0])
def test_polarization_is_that_of_the_polycrystal(relaxation_time: float, rate: float) -> None:
    """To 1e-4 of the switching polarization, slow and fast; a finer lattice of the same density agrees."""
    link = lattice(relaxation_time=relaxation_time, initial="down")
    time, voltage = drive(rate, 500)
    _, out = link.step(link.init(Rest()), Signals(time, voltage))
    scale = 2.0 * sum(link.weights)
    same = by_collocation(link, time, voltage, link.lines)
    assert np.std(out.polarization - same) < 5e-5 * scale
    assert np.max(np.abs(out.polarization - same)) < 3e-4 * scale
    fine = GRID[0] + (np.arange(200) + 0.5) / 200 * (GRID[-1] - GRID[0])
    finer = by_collocation(link, time, voltage, fine)
    assert np.std(out.polarization - finer) < 4e-4 * scale


@pytest.mark.parametrize("relaxation_time", [1e-5, 1e-3, 0.1, 1e4])
@pytest.mark.parametrize("rate", [10.0, 5000.0])
def test_relays_that_are_left_alone_have_nothing_to_do(relaxation_time: float, rate: float) -> None:
    """To the bit: a run that moves only what is near the field is that which knows nothing of the sample before."""
    link = lattice(relaxation_time=relaxation_time)
    time, voltage = drive(rate, 500)
    time[100] = time[99]  # a jump in no time
    rest = Rest(float(time[0]), 0.0, occupancy=np.full(node_count(4), 0.3))
    whole, out = link.step(link.init(rest), Signals(time, voltage))
    state, polarization = link.init(rest), []
    for k in range(time.size):
        state, one = link.step(state, Signals(time[k : k + 1], voltage[k : k + 1]))
        polarization.append(one.polarization[0])
    np.testing.assert_array_equal(whole, state)
    np.testing.assert_array_equal(out.polarization, polarization)


def test_approaches_the_plain_lattice_with_its_density() -> None:
    """Gaussian weights on a fine enough grid give what Lattice gives for the Gaussian density."""
    plain = Lattice(coercive_field=0.5e6, coercive_field_spread=1e11, interaction_field_spread=1e11)
    grid = np.linspace(-2.2e6, 2.2e6, 56)
    up, down = np.array(nodes_of(grid.size)).T
    coercive, interaction = (grid[up] - grid[down]) / 2, -(grid[up] + grid[down]) / 2
    density = np.exp(-((coercive - 0.5e6) ** 2) / 1e11 - interaction**2 / 1e11)
    fine = grid[0] + (np.arange(400) + 0.5) / 400 * np.ptp(grid)
    weights = density * hat_sums(hats_of(fine, grid))
    link = IdentifiedLattice(
        relaxation_time=plain.relaxation_time,
        thermal_field=plain.thermal_width,
        susceptibility=1.0 / plain.reciprocal_permittivity,
        grid=tuple(grid),
        weights=tuple(plain.domain_polarization * weights / weights.sum()),
    )
    time, voltage = drive(300.0, 600)
    _, ours = link.step(link.init(Rest()), Signals(time, voltage))
    _, theirs = plain.step(plain.init(Rest()), Signals(time, voltage))
    assert np.std(ours.phase_fraction - theirs.phase_fraction) < 2e-3
    np.testing.assert_allclose(ours.polarization, theirs.polarization, rtol=0, atol=0.01 * np.ptp(theirs.polarization))


def test_hold_ends_in_thermal_equilibrium() -> None:
    """A relay with a low barrier, held for ever, is up in the Boltzmann ratio of its two rates."""
    link = lattice(relaxation_time=1e-4, initial="up")
    _, out = link.step(link.init(Rest()), Signals(np.array([1.0, 1e3, 1e5]), np.zeros(3)))
    state, _ = link.step(link.init(Rest()), Signals(np.array([1e5]), np.zeros(1)))
    up, down = relay_thresholds(link.lines)
    from scipy.special import erfcx

    p, q = 1.0 / erfcx(-up / link.thermal_field), 1.0 / erfcx(down / link.thermal_field)
    flips = (p + q) * 1e5 / 1e-4 > 50.0
    assert np.count_nonzero(flips) > 20
    np.testing.assert_allclose(state[3:][flips], (p / (p + q))[flips], atol=2e-5)
    assert abs(out.polarization[2] - out.polarization[1]) < abs(out.polarization[1] - out.polarization[0])


@pytest.mark.parametrize("count", [3, 17, 18])
def test_hats_sum_to_one_and_transpose(count: int) -> None:
    lines = np.linspace(-0.95, 0.95, count)
    hats = hats_of(lines, np.array([-1.0, -0.4, 0.1, 1.0]))
    relays = count * count // 4
    values = np.empty(relays)
    spread_out(np.ones(10), hats, values)
    np.testing.assert_allclose(values, 1.0, rtol=1e-14)
    random = np.random.default_rng(1)
    one, other, sums = random.normal(size=10), random.normal(size=relays), np.empty(10)
    spread_out(one, hats, values)
    accumulate(other, hats, np.zeros((4, 2, (count + 1) // 2)), sums)
    assert values @ other == pytest.approx(one @ sums, rel=1e-12)


@pytest.mark.parametrize(("first_row", "end_column"), [(0, 18), (5, 11), (18, 0), (17, 1), (3, 3)])
def test_sums_over_hats_may_leave_out_what_is_zero(first_row: int, end_column: int) -> None:
    lines = np.linspace(-0.95, 0.95, 18)
    hats = hats_of(lines, np.array([-1.0, -0.4, 0.1, 1.0]))
    up, down = relay_thresholds(np.arange(18.0))
    values = np.random.default_rng(2).normal(size=up.size)
    work, some, all_of_them = np.zeros((4, 2, 9)), np.empty(10), np.empty(10)
    accumulate(values, hats, work, some, first_row, end_column)
    accumulate(np.where((up >= first_row) & (down < end_column), values, 0.0), hats, work, all_of_them)
    np.testing.assert_allclose(some, all_of_them, rtol=0, atol=1e-13)


def test_relays_are_the_midpoints_of_a_lattice() -> None:
    up, down = relay_thresholds(np.arange(8.0))
    assert up.size == 16
    coercive, interaction = (up - down) / 2, -(up + down) / 2
    assert set(coercive) == {0.5, 1.5, 2.5, 3.5}
    for value in set(coercive):
        np.testing.assert_array_equal(np.diff(np.sort(interaction[coercive == value])), 1.0)


def test_occupancy_is_where_the_run_begins() -> None:
    """All down and all up, but for relays that the first field switches at once; a wrong number of nodes is no grid."""
    link = lattice()
    up, down = relay_thresholds(link.lines)
    stay = (up > 3e5 + 6 * link.thermal_field) & (down < 3e5 - 6 * link.thermal_field)
    nodes = node_count(5)
    for value in (0.0, 1.0):
        state = link.init(Rest(time=2.0, voltage=30.0, occupancy=np.full(nodes, value)))
        assert state[0] == 2.0
        assert state[1] == 30.0
        np.testing.assert_allclose(state[3:][stay], value, atol=1e-12)
        np.testing.assert_allclose(state[3:][up < 3e5 - 6 * link.thermal_field], 1.0, atol=2e-5)
        np.testing.assert_allclose(state[3:][down > 3e5 + 6 * link.thermal_field], 0.0, atol=2e-5)
    with pytest.raises(BenchError, match="fits no grid"):
        link.init(Rest(occupancy=np.zeros(7)))


@pytest.mark.parametrize(("initial", "share"), [("down", 0.0), ("up", 1.0), ("virgin", 0.5)])
def test_initial_state(initial: str, share: float) -> None:
    link = lattice(initial=initial, grid=tuple(np.linspace(-1e6, 1e6, 9)))
    assert link.init(Rest())[3:].mean() == pytest.approx(share, abs=0.01)


def test_round_trip_through_yaml(tmp_path) -> None:  # type: ignore[no-untyped-def]
    link = lattice(thermal_field=5e4, initial="up", polarization_offset=0.01)
    save_chain(Chain("one", (link,)), tmp_path / "one.yaml")
    assert load_chain(tmp_path / "one.yaml").links == (link,)
    assert "unit: C/m^2" in (tmp_path / "one.yaml").read_text()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grid": [1, 2]}, "expected {unit: V/m, values:"),
        ({"grid": {"unit": "V", "values": [1, 2]}}, "grid, value 1: '1.0 V' cannot be read as V/m"),
        ({"grid": {"unit": "V/m", "values": [1, "2"]}}, "value 2: '2' is not a number"),
        ({"grid": {"unit": "V/m", "values": [2, 1]}}, "do not all increase"),
        ({"weights": {"unit": "C/m^2", "values": [0.1]}}, "1 weights for 9 lines"),
        ({"weights": {"unit": "C/m^2", "values": [-0.1] * 45}}, "value 1: -0.1 C/m\\^2 is outside"),
    ],
)
def test_bad_tables_are_refused(change: dict[str, object], message: str) -> None:
    data = chain_as_data(Chain("one", (lattice(),)))
    data["links"][0].update(change)
    with pytest.raises(BenchError, match=message):
        parse_chain(data, "one.yaml")


@pytest.mark.parametrize("width", [1.0, 1e8])
def test_a_grid_in_another_unit_is_refused(width: float) -> None:
    with pytest.raises(BenchError, match="look at the units of grid and thermal_field"):
        lattice(thermal_field=width, grid=tuple(GRID * (1e3 if width == 1.0 else 1e-3)))


def test_table_may_have_another_unit() -> None:
    data = chain_as_data(Chain("one", (lattice(),)))
    data["links"][0]["grid"] = {"unit": "MV/m", "values": [float(field / 1e6) for field in GRID]}
    (link,) = parse_chain(data, "one.yaml").links
    np.testing.assert_allclose(link.grid, GRID, rtol=1e-12)  # type: ignore[attr-defined]


def test_bad_samples_are_refused() -> None:
    link = lattice()
    state = link.init(Rest())
    for time, voltage in (([1.0, 0.5], [0.0, 0.0]), ([0.0, 1.0], [0.0, math.nan]), ([0.0], [1e9])):
        with pytest.raises(BenchError, match="drop or sort"):
            link.step(state, Signals(np.array(time), np.array(voltage)))
    with pytest.raises(BenchError, match="start from init"):
        link.step(state[:-1], Signals(np.zeros(1), np.zeros(1)))


def test_inverse_finds_the_voltage() -> None:
    link = lattice()
    time, voltage = drive(500.0, 120)
    _, out = link.step(link.init(Rest()), Signals(time, voltage))
    _, back = link.invert(link.init(Rest()), Signals(time, polarization=out.polarization))
    np.testing.assert_allclose(back.voltage, voltage, atol=1e-4)
    beyond = dataclasses.replace(out, polarization=out.polarization * np.nan)
    _, kept = link.invert(link.init(Rest()), beyond)
    np.testing.assert_array_equal(kept.voltage, 0.0)
