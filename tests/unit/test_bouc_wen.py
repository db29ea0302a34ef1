"""The Bouc-Wen model: against an ODE solver, its laws, and what it is not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from straight_legs import polarization, walk

from pzt_ros.errors import BenchError
from pzt_ros.physics.bouc_wen import BoucWen
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Array, Rest, Signals

turns = st.lists(st.floats(-150.0, 150.0), min_size=2, max_size=8)
shapes = st.floats(0.5, 5.0)
few = settings(max_examples=25, derandomize=True, deadline=None)


def integrated(link: BoucWen, corners: list[float]) -> float:
    """P at the last corner, by a solver that knows the differential equation only."""
    heights, fields = (link.height_soft, link.height_hard), (link.field_soft, link.field_hard)
    z = np.zeros(2)
    for begin, end in zip([0.0, *corners], corners, strict=False):
        change = (end - begin) / link.layer_thickness
        for i, shape in enumerate((link.shape_soft, link.shape_hard)):

            def slope(_: float, y: Array, b: float = shape, over: float = change / fields[i]) -> Array:
                return over - b * abs(over) * y - (1.0 - b) * over * np.abs(y)

            z[i] = solve_ivp(slope, (0.0, 1.0), z[i : i + 1], rtol=1e-9, atol=1e-11, max_step=0.02).y[0, -1]
    field = corners[-1] / link.layer_thickness
    return link.susceptibility * field - max(1.0 + link.growth * field, 0.0) * float(np.dot(heights, z))


@few
@given(turns, shapes, shapes, st.floats(-1e-6, 1e-6))
def test_it_solves_its_differential_equation(corners: list[float], soft: float, hard: float, growth: float) -> None:
    link = BoucWen(shape_soft=soft, shape_hard=hard, growth=growth)
    found = polarization(link, np.array(corners))[-1]
    assert found == pytest.approx(integrated(link, corners), abs=1e-7)


@few
@given(turns, shapes)
def test_neither_rate_nor_samples_matter(corners: list[float], shape: float) -> None:
    link = BoucWen(shape_soft=shape)
    straight = polarization(link, np.array(corners))
    np.testing.assert_allclose(polarization(link, walk(corners))[39::40], straight, atol=1e-12)
    np.testing.assert_array_equal(polarization(link, np.array(corners), interval=10.0), straight)


@few
@given(turns, shapes)
def test_polarization_never_falls_while_the_field_rises(corners: list[float], shape: float) -> None:
    """Where the susceptibility is what the docstring asks for."""
    link = BoucWen(shape_hard=shape)
    steepest = 2.0 * (link.height_soft / link.field_soft + shape * link.height_hard / link.field_hard)
    voltage = walk(corners)
    p = np.diff(polarization(dataclasses.replace(link, susceptibility=steepest), voltage), prepend=0.0)
    assert np.all(p * np.sign(np.diff(voltage, prepend=0.0)) >= -1e-15)


@pytest.mark.parametrize("shape", [0.5, 1.0, 3.0])
def test_a_steady_cycle_dissipates(shape: float) -> None:
    link = BoucWen(shape_soft=shape, shape_hard=shape)
    voltage = walk([120.0, -60.0] * 40, samples=200)
    cycle = polarization(link, voltage)[-401:], voltage[-401:] / link.layer_thickness
    assert cycle[0][0] == pytest.approx(cycle[0][-1], abs=1e-9)
    assert float(np.trapezoid(cycle[1], cycle[0])) > 1e3  # J/m^3


def test_minor_loops_stay_open_where_a_preisach_model_closes_them() -> None:
    """What puts it outside that family: return-point memory is not among its laws."""
    gaps = []
    for link in (BoucWen(), Preisach()):
        p = polarization(link, walk([120.0, 40.0, 70.0, 40.0]))
        gaps.append(abs(p[159] - p[79]) / np.ptp(p))
    assert gaps[0] > 1e-3
    assert gaps[1] < 1e-12


def test_its_derivative_is_that_of_the_way_it_goes() -> None:
    """`invert` leaves dP/dV in the state; observers and controllers take it from there."""
    link, corners = BoucWen(growth=3e-7), [120.0, 20.0, 60.0]
    state, out = link.step(link.init(Rest()), Signals(np.arange(1.0, 4.0), np.array(corners)))
    step = 1e-4
    further = [link.step(state, Signals(np.array([4.0]), np.array([60.0 + up])))[1].polarization[0] for up in (0, step)]
    asked, _ = link.invert(state, Signals(np.array([4.0]), voltage=np.zeros(0), polarization=out.polarization[-1:]))
    assert asked[2] == pytest.approx((further[1] - further[0]) / step, rel=1e-4)


def test_what_it_refuses_and_what_is_left_without_elements() -> None:
    with pytest.raises(BenchError, match=r"sample 1 .* is not finite"):
        polarization(BoucWen(), np.array([1.0, np.nan]))
    flat = dataclasses.replace(BoucWen(), height_soft=0.0, height_hard=0.0)
    np.testing.assert_allclose(polarization(flat, np.array([10.0, 5.0])), 1.5e-7 * np.array([1e5, 5e4]))
