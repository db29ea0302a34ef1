"""The Preisach model: against relays one by one, its laws, and what a fit of it finds."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from straight_legs import polarization, walk

from pzt_ros.errors import BenchError
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Array, Rest
from pzt_ros.sysid.identified_fit import IdentifiedFit
from pzt_ros.sysid.identified_problem import MeasuredRun
from pzt_ros.sysid.rate_independent import SUSCEPTIBILITY, RateIndependentHysteresis

THICKNESS = 1e-4
turns = st.lists(st.floats(-150.0, 150.0), min_size=2, max_size=8)
few = settings(max_examples=25, derandomize=True, deadline=None)


def relay_by_relay(link: Preisach, voltage: Array, fine: int) -> Array:
    """P of relays on a fine grid of coercive and interaction field, each with its own memory."""
    coercive, interaction = np.asarray(link.coercive), np.asarray(link.interaction)
    step = interaction[1] - interaction[0]
    c = (np.arange(fine) + 0.5) / fine * coercive[-1]
    e = interaction[0] - step + (np.arange(fine) + 0.5) / fine * (interaction[-1] - interaction[0] + 2 * step)
    hats_c = np.array([np.interp(c, coercive, row) for row in np.eye(coercive.size)])
    padded = np.concatenate(([interaction[0] - step], interaction, [interaction[-1] + step]))
    hats_e = np.array([np.interp(e, padded, row) for row in np.eye(padded.size)[1:-1]])
    hats_c, hats_e = hats_c / hats_c.sum(axis=1)[:, None], hats_e / hats_e.sum(axis=1)[:, None]
    weight = hats_c.T @ np.reshape(link.weights, (coercive.size, interaction.size)) @ hats_e
    up = np.broadcast_to(e < 0.0, weight.shape).copy()
    found = []
    for field in voltage / link.layer_thickness:
        up = (up | (field > e + c[:, None])) & ~(field < e - c[:, None])
        found.append(2.0 * float(np.sum(weight[up])) - float(np.sum(weight)) + link.susceptibility * field)
    return np.array(found)


def test_it_is_the_sum_of_its_relays() -> None:
    """The difference is what the relays' grid makes, and halves with its cells."""
    link, voltage = Preisach(plays=400.0), walk([140.0, -60.0, 90.0, 20.0, 120.0, -150.0], samples=30)
    found, scale = polarization(link, voltage), sum(link.weights)
    coarse, fine = (np.max(np.abs(found - relay_by_relay(link, voltage, size))) / scale for size in (100, 400))
    assert fine < 2e-3
    assert fine < 0.4 * coarse


@few
@given(turns)
def test_the_way_back_wipes_out_and_no_rate_counts(corners: list[float]) -> None:
    """Return-point memory: a loop between two fields leaves no trace, however long it takes."""
    link = Preisach()
    low, high = min(*corners, 0.0) - 1.0, max(*corners, 0.0) + 1.0
    plain = polarization(link, walk([high, low, *corners]))
    looped = polarization(link, walk([high, low, 0.4 * high + 0.6 * low, low, *corners]), interval=17.0)
    np.testing.assert_allclose(looped[4 * 40 :], plain[2 * 40 :], atol=1e-13)


@few
@given(turns, st.floats(-100.0, 0.0), st.floats(10.0, 100.0))
def test_loops_between_two_fields_are_congruent(corners: list[float], low: float, high: float) -> None:
    """Mayergoyz' second property: whatever was before the loop, its way up has the same shape."""
    ways = [polarization(Preisach(), walk([*before, high, low, high]))[-41:] for before in (corners, [150.0])]
    np.testing.assert_allclose(ways[0] - ways[0][0], ways[1] - ways[1][0], atol=1e-13)


@few
@given(turns)
def test_loops_dissipate(corners: list[float]) -> None:
    """The integral of E dP round a closed loop is never negative."""
    voltage = walk([150.0, *corners, 150.0])
    start = 39
    p, field = polarization(Preisach(), voltage)[start:], voltage[start:] / THICKNESS
    assert np.sum(0.5 * (field[1:] + field[:-1]) * np.diff(p)) > -1e-6 * np.max(np.abs(field)) * np.ptp(p)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"coercive": (0.0, 2e5, 1e5)}, "coercive of 3 fields that do not all increase"),
        ({"interaction": (0.0, 1e5, 3e5)}, "space them equally"),
        ({"weights": (0.1, 0.2)}, "2 weights for 7 lines of coercive field and 9 of interaction field"),
    ],
)
def test_a_table_that_fits_no_grid_is_refused(change: dict[str, tuple[float, ...]], why: str) -> None:
    with pytest.raises(BenchError, match=why):
        Preisach(**change)  # type: ignore[arg-type]


def test_a_sample_that_cannot_be_used_is_named() -> None:
    link = Preisach()
    with pytest.raises(BenchError, match=r"sample 1 \(0.002 s, nan V\)"):
        link.columns(link.init(Rest()), np.array([1e-3, 2e-3]), np.array([0.0, np.nan]))


def hysteresis(resolution: int = 5, initial: str = "virgin") -> tuple[RateIndependentHysteresis, list[Array]]:
    voltages = [walk([150.0, -50.0, 110.0, 20.0]), walk([90.0, -20.0])]
    times = [np.arange(voltage.size) * 1e-3 for voltage in voltages]
    base = RateIndependentHysteresis(
        times, THICKNESS, (-0.5e6, 1.5e6), unknown_start=[False, False], resolution=resolution, initial=initial
    )
    return base, voltages


@pytest.mark.parametrize("initial", ["virgin", "down", "up"])
def test_columns_are_the_derivatives(initial: str) -> None:
    """P is linear in every coordinate, so the tangent gives every other vector's P."""
    base, voltages = hysteresis(initial=initial)
    other = base.start * np.random.default_rng(1).uniform(0.3, 2.0, base.start.size)
    here, jacobians = base.tangent(base.start, voltages)
    for p, columns, there in zip(here, jacobians, base.polarization(other, voltages), strict=True):
        np.testing.assert_allclose(p + columns @ (other - base.start), there, atol=1e-6)


def test_a_finer_grid_carries_the_density_on() -> None:
    """A density that is linear between the old lines is the same between the new ones, but for hats at the rim."""
    base, voltages = hysteresis(resolution=10)
    finer, _ = hysteresis(resolution=20)
    vector = base.start.copy()
    vector[SUSCEPTIBILITY] *= 2.0
    carried = finer.carried(base, vector)
    for one, other in zip(base.polarization(vector, voltages), finer.polarization(carried, voltages), strict=True):
        assert np.max(np.abs((one - one[0]) - (other - other[0]))) < 0.05 * np.ptp(one)
    assert base.carried(base, vector) is vector


def test_no_range_no_density() -> None:
    with pytest.raises(BenchError, match="preisach: field range 1e\\+06 to 1e\\+06 V/m is empty"):
        RateIndependentHysteresis([np.arange(9.0)], THICKNESS, (1e6, 1e6), unknown_start=[False])


def test_an_unknown_start_is_refused() -> None:
    base, _ = hysteresis()
    with pytest.raises(BenchError, match="a start that is known"):
        base.for_runs(base.times, [True, False])


def test_a_sum_of_plays_is_fitted_to_the_noise_and_predicted() -> None:
    """Made by plays with a formula of their own; the lattice, which has a rate, cannot come so near."""
    dice = np.random.default_rng(3)

    def measured(seed: int) -> MeasuredRun:
        corners = np.random.default_rng(seed).uniform(-40.0, 140.0, 24)
        voltage = walk([150.0, -50.0, *corners], samples=60)
        time = np.cumsum(np.abs(np.diff(voltage, prepend=0.0)) / 10 ** np.repeat(dice.uniform(0.5, 3.0, 26), 60) + 1e-6)
        radii = np.arange(1, 25) * 3.0
        plays = np.zeros(radii.size)
        y = np.empty(voltage.size)
        for k, v in enumerate(voltage):
            plays = np.clip(plays, v - radii, v + radii)
            y[k] = 3e-8 * v + 2e-9 * float(np.exp(-radii / 20.0) @ plays)
        return MeasuredRun(time, voltage, y + dice.normal(0, 12e-9, y.size), 12e-9, np.ones(y.size, bool), False)

    runs, other = [measured(1), measured(2)], measured(3)
    fit = IdentifiedFit(
        THICKNESS, (10, 18), (1.0, 10.0), (2,), voltage_range=(-50.0, 150.0), base=RateIndependentHysteresis
    )
    found = fit.fit(runs, [measured(4)])
    left = (found.predict(other) - other.measured) / 12e-9
    assert np.sqrt(np.mean(np.square(left))) < 1.1
    lattice = dataclasses.replace(fit, resolutions=(10,), rotations=(10.0,), base=IdentifiedFit(THICKNESS).base)
    assert lattice.tried(runs, [measured(4)]) > 1.2 * fit.tried(runs, [measured(4)])
