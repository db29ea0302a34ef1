"""Laws that the parametrized model has to keep, whatever the load: memory of reversal points, bounds, repeatability."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pzt_ros.errors import BenchError
from pzt_ros.physics import parametrized_branch as branch
from pzt_ros.physics.link import State
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.signals import Array, Rest, Signals

THICKNESS = 1e-4
FULL_LOOP = Parametrized(
    shape_ascending=0.9,
    barrier_ascending=0.5e6,
    shape_descending=0.9,
    barrier_descending=0.5e6,
    relaxation_time=5e-2,
    domain_polarization=0.215,
    reciprocal_permittivity=2.8e7,
)
ACTUATOR_RANGE = dataclasses.replace(
    FULL_LOOP,
    shape_ascending=2.5,
    barrier_ascending=0.25e6,
    shape_descending=1.1,
    barrier_descending=1.0e6,
    relaxation_time=8e-2,
    domain_polarization=0.210,
    reciprocal_permittivity=2.5e7,
)
FAST_STEEP = dataclasses.replace(
    FULL_LOOP, shape_ascending=1.3, shape_descending=1.3, relaxation_time=1e-3, reciprocal_permittivity=6e7
)
LINKS = (FULL_LOOP, ACTUATOR_RANGE, FAST_STEEP)

links = st.sampled_from(LINKS)
few = settings(max_examples=25, derandomize=True, deadline=None)


def ramps(turns: list[float], rate: float, hold: float = 0.0) -> tuple[Array, Array]:
    """Times [s] and fields [V/m] at the corners of straight ramps from 0 through the fields `turns`, each then held."""
    time, field = [0.0], [0.0]
    for turn in turns:
        time.append(time[-1] + max(abs(turn - field[-1]) / rate, 1e-6))
        field.append(turn)
        if hold > 0.0:
            time.append(time[-1] + hold)
            field.append(turn)
    return np.array(time), np.array(field)


def sampled(time: Array, field: Array, interval: float) -> tuple[Array, Array]:
    """The same straight ramps with samples in between, not further apart than `interval` [s]."""
    pieces = [np.linspace(a, b, int(np.ceil((b - a) / interval)), endpoint=False) for a, b in itertools.pairwise(time)]
    fine = np.concatenate([*pieces, time[-1:]])
    return fine, np.interp(fine, time, field)


def drive(link: Parametrized, time: Array, field: Array) -> tuple[State, Signals]:
    return link.step(link.init(Rest()), Signals(time=time, voltage=field * THICKNESS))


def fraction(signals: Signals) -> Array:
    assert signals.phase_fraction is not None
    return signals.phase_fraction


def barrier(state: State) -> float:
    return float(state[branch.CENTRE] + state[branch.SLOPE] * state[branch.W])


def stored(state: State) -> Array:
    """Reversal points on the stack [shape (n, 3): x, 1 - x, barrier]."""
    return state[branch.STACK : branch.STACK + 3 * int(state[branch.COUNT])].reshape(-1, 3)


turning_fields = st.lists(st.integers(-18, 18), min_size=3, max_size=8).map(
    lambda steps: [1e5 * a for a, b in zip(steps, [*steps[1:], 99], strict=True) if a != b]
)


@few
@given(link=links, low=st.integers(-7, 3), width=st.integers(2, 8), up_first=st.booleans())
def test_minor_loop_closes_at_its_reversal_point(link: Parametrized, low: int, width: int, up_first: bool) -> None:
    sign = 1.0 if up_first else -1.0
    reversal, inner, beyond = sign * low * 1e5, sign * (low + width) * 1e5, sign * (low - 4) * 1e5
    poled = [sign * 1.9e6]
    # quasi-static, so that the barrier follows the field without lag
    before, _ = drive(link, *ramps([*poled, reversal], rate=1e4))
    turned, _ = drive(link, *ramps([*poled, reversal, inner], rate=1e4))
    closed, with_loop = drive(link, *ramps([*poled, reversal, inner, beyond], rate=1e4, hold=5.0))
    plain, without_loop = drive(link, *ramps([*poled, beyond], rate=1e4, hold=5.0))

    point = stored(turned)[-1]
    assert point[2] == pytest.approx(barrier(before), abs=200.0)
    assert point[0] == pytest.approx(before[branch.X], abs=1e-3)
    assert closed[branch.COUNT] == plain[branch.COUNT]
    np.testing.assert_allclose(stored(closed), stored(plain), rtol=1e-9, atol=1e-9)
    assert barrier(closed) == pytest.approx(barrier(plain), abs=1.0)
    assert fraction(with_loop)[-1] == pytest.approx(fraction(without_loop)[-1], abs=1e-6)


def test_outer_branch_goes_on_through_the_stored_point() -> None:
    """After the loop, x over B is the curve that the loop interrupted, at any rate."""
    curves = []
    for turns in ([1.5e6, -0.1e6, 0.5e6, -0.8e6], [1.5e6, -0.8e6]):
        time, field = sampled(*ramps(turns, rate=2e6), 1e-3)
        state = ACTUATOR_RANGE.init(Rest())
        curve = []
        for t, e in zip(time, field, strict=True):
            state, _ = ACTUATOR_RANGE.step(state, Signals(time=np.array([t]), voltage=np.array([e * THICKNESS])))
            curve.append((barrier(state), state[branch.X]))
        curves.append(np.array(curve[-250:]))
    with_loop, plain = curves
    common = (with_loop[:, 0] > plain[:, 0].min()) & (with_loop[:, 0] < plain[:, 0].max())
    assert common.sum() > 200
    expected = np.interp(with_loop[common, 0], plain[::-1, 0], plain[::-1, 1])
    np.testing.assert_allclose(with_loop[common, 1], expected, atol=2e-6)


@few
@given(link=links, turns=turning_fields)
def test_a_large_load_wipes_out_what_came_before(link: Parametrized, turns: list[float]) -> None:
    last = [1.95e6, -1.95e6, 0.3e6]
    after_history, found = drive(link, *ramps([*turns, *last], rate=1e6, hold=2.0))
    plain, expected = drive(link, *ramps(last, rate=1e6, hold=2.0))
    assert after_history[branch.COUNT] == plain[branch.COUNT]
    assert fraction(found)[-1] == pytest.approx(fraction(expected)[-1], abs=1e-6)


@few
@given(link=links, turns=turning_fields, rate=st.sampled_from([1e5, 1e6, 1e8]), hold=st.sampled_from([0.0, 1.0]))
def test_fraction_stays_between_0_and_1(link: Parametrized, turns: list[float], rate: float, hold: float) -> None:
    _, found = drive(link, *ramps([*turns, 5e6, -9e6, 0.0], rate, hold))
    assert np.all((fraction(found) >= 0.0) & (fraction(found) <= 1.0))
    assert np.all(np.isfinite(found.polarization))


@few
@given(
    link=links,
    turns=turning_fields,
    rate=st.sampled_from([1e5, 1e6]),
    hold=st.sampled_from([0.0, 0.3]),
    interval=st.sampled_from([1e-3, 10.0]),
)
def test_branches_turn_as_often_as_the_field(
    link: Parametrized, turns: list[float], rate: float, hold: float, interval: float
) -> None:
    time, field = sampled(*ramps([1.9e6, *turns, 2.0e6], rate, hold), interval)
    state, _ = drive(link, time, field)
    slopes = np.sign(np.diff(field))
    slopes = slopes[slopes != 0]
    # the virgin start leaves the material on its descending or ascending branch; the first ramp may turn it once
    first = float(link.init(Rest())[branch.DIRECTION] != slopes[0])
    assert state[branch.REVERSALS] == np.count_nonzero(np.diff(slopes)) + first


def test_a_held_field_with_rounding_noise_does_not_chatter() -> None:
    time, field = sampled(*ramps([1.5e6, -0.2e6], rate=1e6, hold=3.0), 5e-5)
    noisy = field * (1.0 + 2e-16 * np.random.default_rng(0).integers(-2, 3, field.size))
    state, _ = drive(ACTUATOR_RANGE, time, noisy)
    assert state[branch.REVERSALS] == 1


@few
@given(
    link=links, turns=turning_fields, cuts=st.lists(st.integers(1, 400), max_size=12), rate=st.sampled_from([1e6, 3e7])
)
def test_blocks_of_any_size_give_the_same_to_the_bit(
    link: Parametrized, turns: list[float], cuts: list[int], rate: float
) -> None:
    time, field = sampled(*ramps(turns, rate), 1e-3)
    whole_state, whole = drive(link, time, field)
    state, parts = link.init(Rest()), []
    for block in np.split(np.arange(time.size), sorted(c for c in cuts if c < time.size)):
        state, part = link.step(state, Signals(time=time[block], voltage=field[block] * THICKNESS))
        parts.append(fraction(part))
    np.testing.assert_array_equal(np.concatenate(parts), fraction(whole))
    np.testing.assert_array_equal(state, whole_state)


@few
@given(link=links, turns=turning_fields, rate=st.sampled_from([1e5, 1e6, 3e7]), interval=st.sampled_from([5e-4, 5e-2]))
def test_inverse_undoes_the_step(link: Parametrized, turns: list[float], rate: float, interval: float) -> None:
    time, field = sampled(*ramps(turns, rate), interval)
    start = link.init(Rest())
    kept = start.copy()
    _, forward = link.step(start, Signals(time=time, voltage=field * THICKNESS))
    inverse_state, inverse = link.invert(start, Signals(time=time, polarization=forward.polarization))
    step_state, again = link.step(start, inverse)
    assert forward.polarization is not None
    within_accuracy = 2.0 * link.domain_polarization * link.accuracy
    np.testing.assert_allclose(again.polarization, forward.polarization, rtol=0, atol=within_accuracy)
    np.testing.assert_array_equal(inverse_state, step_state)
    np.testing.assert_array_equal(start, kept)


@pytest.mark.parametrize("target", [3.0, -3.0, np.nan])
def test_inverse_of_the_impossible_is_finite_and_bounded(target: float) -> None:
    time = np.arange(1, 20) * 1e-4
    _, found = FULL_LOOP.invert(FULL_LOOP.init(Rest()), Signals(time=time, polarization=np.full(time.size, target)))
    assert found.voltage is not None
    assert np.all(np.abs(found.voltage) <= 1e7 * THICKNESS * (1 + 1e-12))


@few
@given(link=links, seed=st.integers(0, 1000), noise=st.sampled_from([1e-3, 1e2, 1e4, 1e5]))
def test_noise_on_the_field_is_survived(link: Parametrized, seed: int, noise: float) -> None:
    time = np.arange(1, 2001) / 20e3
    scan = 1e6 * np.sin(2 * np.pi * 20 * time)
    state, found = drive(link, time, scan + np.random.default_rng(seed).normal(0.0, noise, time.size))
    assert np.all((fraction(found) >= 0.0) & (fraction(found) <= 1.0))
    assert np.all(np.isfinite(state[: branch.STEP]))
    assert 2 <= state[branch.COUNT] <= branch.DEPTH


@pytest.mark.parametrize(("reversals", "remembered"), [(200, 202), (900, branch.DEPTH)])
def test_many_nested_reversals(reversals: int, remembered: int) -> None:
    shrinking = 1.8e6 * (1 - np.arange(reversals) / reversals) * (-1.0) ** np.arange(reversals)
    nested, found = drive(FULL_LOOP, *ramps(list(shrinking), rate=1e5))
    assert nested[branch.REVERSALS] == reversals - 1
    assert remembered - 3 <= nested[branch.COUNT] <= remembered
    assert np.all(np.isfinite(fraction(found)))
    out, wiped = drive(FULL_LOOP, *ramps([*shrinking, 1.95e6, -1.0e6], rate=1e5, hold=2.0))
    plain, expected = drive(FULL_LOOP, *ramps([1.95e6, -1.0e6], rate=1e5, hold=2.0))
    assert out[branch.COUNT] == plain[branch.COUNT]
    assert fraction(wiped)[-1] == pytest.approx(fraction(expected)[-1], abs=1e-6)


def test_jump_is_the_limit_of_a_fast_ramp() -> None:
    start = FULL_LOOP.init(Rest())
    time = np.array([0.0, 1e-3, 2e-2])
    _, jumped = FULL_LOOP.step(start, Signals(time=time, voltage=np.full(3, 60.0)))
    _, ramped = FULL_LOOP.step(start, Signals(time=np.concatenate(([1e-12], time[1:])), voltage=np.full(3, 60.0)))
    np.testing.assert_allclose(fraction(jumped), fraction(ramped), atol=1e-6)


def test_rest_voltage_is_reached_slowly_and_time_starts_at_rest() -> None:
    state = FULL_LOOP.init(Rest(time=7.0, voltage=80.0))
    again, found = FULL_LOOP.step(state, Signals(time=np.array([7.0, 17.0]), voltage=np.array([80.0, 80.0])))
    assert fraction(found)[1] == pytest.approx(fraction(found)[0], abs=2e-3)
    assert again[branch.TIME] == 17.0


def test_voltage_that_is_no_number_is_refused() -> None:
    with pytest.raises(BenchError, match="voltage is nan V at sample 1"):
        FULL_LOOP.step(FULL_LOOP.init(Rest()), Signals(time=np.array([0.0, 1.0]), voltage=np.array([0.0, np.nan])))


def test_saturation_beyond_all_domains_is_refused() -> None:
    with pytest.raises(BenchError, match=r"saturation_barrier is 50 widths out on the descending branch"):
        dataclasses.replace(FULL_LOOP, shape_descending=0.1).init(Rest())
