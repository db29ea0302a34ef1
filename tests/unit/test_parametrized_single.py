"""The parametrized model with one distribution: against SciPy's Radau on the thesis' equations, and its laws."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, special

from pzt_ros.errors import BenchError
from pzt_ros.figures.optimal_control import MODEL as CHAPTER_4
from pzt_ros.physics import parametrized_single_branch as branch
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.link import State
from pzt_ros.physics.parametrized_single import ParametrizedSingle
from pzt_ros.physics.signals import Array, Rest, Signals

GOLDEN = Path(__file__).parents[1] / "golden" / "data"

COERCIVE = ParametrizedSingle(distribution="coercive", start="positive")
FORGETFUL = ParametrizedSingle(distribution="coercive_without_history")
INTERACTION = ParametrizedSingle(distribution="interaction")
MODELS = (COERCIVE, FORGETFUL, INTERACTION)
NAMES = [model.distribution for model in MODELS]
each = pytest.mark.parametrize("model", MODELS, ids=NAMES)

few = settings(max_examples=15, derandomize=True, deadline=None)
turning_fields = st.lists(st.integers(-18, 18), min_size=2, max_size=6).map(
    lambda steps: [1e5 * a for a, b in zip(steps, [*steps[1:], 99], strict=True) if a != b]
)


def ramps(turns: list[float], rate: float, samples: int = 200) -> tuple[Array, Array]:
    """Times [s] and fields [V/m] of straight ramps from 0 through the fields `turns`, `samples` each."""
    time, field = [0.0], [0.0]
    for turn in turns:
        duration = max(abs(turn - field[-1]) / rate, 1e-6)
        steps = np.arange(1, samples + 1) / samples
        time.extend(time[-1] + duration * steps)
        field.extend(field[-1] + (turn - field[-1]) * steps)
    return np.array(time), np.array(field)


def drive(model: ParametrizedSingle, time: Array, field: Array) -> tuple[State, Signals]:
    return model.step(model.init(Rest()), Signals(time=time, voltage=field * model.layer_thickness))


# The second method: the equations in x+ as the thesis prints them


def rate(model: ParametrizedSingle, beyond: float) -> float:
    """How often a domain switches in a field that much beyond its barrier [1/s] (3.9, 3.10)."""
    z = beyond / model.material.thermal_width
    return 0.0 if z < -26.0 else 1.0 / (model.relaxation_time * float(special.erfcx(z)))


def coercive_field(model: ParametrizedSingle, share: float) -> float:
    """(3.24) with the increment of x+ from barrier 0 (3.23)."""
    root = np.sqrt(model.spread)
    ratio = model.coercive_field / root
    rest = (1 - min(max(share, 0.0), 1 - 1e-15)) * special.erfc(-ratio)
    return float(model.coercive_field + root * special.erfcinv(rest))


def smooth(model: ParametrizedSingle) -> Callable[[float, float], float]:
    def slope(field: float, x: float) -> float:
        x = min(max(x, 1e-15), 1 - 1e-15)
        if model.distribution == "interaction":  # (3.31)
            local = field + float(np.sqrt(model.spread) * special.erfcinv(2 * x))
            up, down = local - model.coercive_field, -local - model.coercive_field
        else:
            up, down = field - coercive_field(model, x), -field - coercive_field(model, 1 - x)
        return rate(model, up) * (1 - x) - rate(model, down) * x

    return slope


def followed(slope: Callable[[float, float], float], time: Array, field: Array, x: float) -> Array:
    """x+ at the samples of one straight ramp, by SciPy's Radau."""

    def derivative(t: float, y: Array) -> list[float]:
        return [slope(float(np.interp(t, [time[0], time[-1]], [field[0], field[-1]])), float(y[0]))]

    longest = (time[-1] - time[0]) * 2e4 / max(abs(field[-1] - field[0]), 2e4)
    found: Any = integrate.solve_ivp(
        derivative, (time[0], time[-1]), [x], "Radau", time, rtol=1e-8, atol=1e-9, max_step=longest
    )
    return np.asarray(found.y[0])


def remembered(model: ParametrizedSingle, pieces: list[tuple[Array, Array]], x: float) -> list[Array]:
    """x+ on pieces of field of one sign each; loops are looked up, nothing is popped on the way (3.23)."""
    lower, upper, curves, went_up = [0.0], [1.0], [], None
    for time, field in pieces:
        up = bool(field[-1] + field[0] > 0)
        while len(lower) > 1 and len(upper) > 1 and not lower[-1] < x < upper[-1]:
            lower.pop()
            upper.pop()
        if up is not went_up:
            (lower if up else upper).append(x)
        went_up = up
        sign = 1.0 if up else -1.0
        loops = list(zip(reversed(lower), reversed(upper), strict=False))
        if not up:
            loops = [(high, low) for low, high in loops]

        def slope(e: float, y: float, loops: Any = tuple(loops), sign: float = sign) -> float:
            base = next((begin for begin, end in loops if sign * y < sign * end), loops[-1][0])
            ahead = 1 - y if sign > 0 else y
            return sign * rate(model, sign * e - coercive_field(model, sign * (y - base))) * ahead

        curves.append(followed(slope, time, field, x))
        x = float(curves[-1][-1])
    return curves


@pytest.mark.parametrize("model", [FORGETFUL, INTERACTION, CHAPTER_4], ids=["forgetful", "interaction", "chapter 4"])
@pytest.mark.parametrize("speed", [1e5, 1e7])
def test_smooth_models_against_radau(model: ParametrizedSingle, speed: float) -> None:
    time, field = ramps([1.4e6, -1.1e6, 0.3e6, -0.4e6, 2e6], speed, samples=50)
    _, found = drive(model, time, field)
    x, expected = 0.5, np.empty_like(time)
    for begin in range(0, time.size - 1, 50):
        leg = slice(begin, begin + 51)
        expected[leg] = followed(smooth(model), time[leg], field[leg], x)
        x = float(expected[leg][-1])
    np.testing.assert_allclose(found.phase_fraction, expected, rtol=0, atol=5e-6)
    p = field / model.reciprocal_permittivity + (2 * expected - 1) * model.domain_polarization  # (3.20)
    np.testing.assert_allclose(found.polarization, p, rtol=0, atol=5e-6)


@pytest.mark.parametrize("speed", [1e6, 1e7])
def test_coercive_fields_with_history_against_radau(speed: float) -> None:
    """Major loop, a minor loop inside it and one in that, and out through both."""
    turns = [-2e6, 0.6e6, -0.5e6, 0.4e6, -0.3e6, 1.2e6, -0.7e6, 2e6]
    time, field = ramps(turns, speed, samples=64)
    _, found = drive(COERCIVE, time, field)
    zeros = [
        t + (t2 - t) * e / (e - e2)
        for (t, e), (t2, e2) in itertools.pairwise(zip(time, field, strict=True))
        if e * e2 < 0
    ]
    pieces = []
    for begin, end in itertools.pairwise(sorted({0.0, *zeros, *time[field == 0], *time[64::64]})):
        inside = np.unique([begin, *time[(time > begin) & (time < end)], end])
        pieces.append((inside, np.interp(inside, time, field)))
    expected = np.interp(
        time, np.concatenate([t for t, _ in pieces]), np.concatenate(remembered(COERCIVE, pieces, 1.0))
    )
    np.testing.assert_allclose(found.phase_fraction, expected, rtol=0, atol=2e-5)


@pytest.mark.parametrize(
    ("name", "model"), [("Q4_Ec_only_32", COERCIVE), ("Q4_Ee_only_32", INTERACTION)], ids=["coercive", "interaction"]
)
def test_almost_the_quadrature(name: str, model: ParametrizedSingle) -> None:
    """The thesis finds its two versions almost the same (3.3.1, 3.3.2); the reference solves the quadrature."""
    time, field, x = np.loadtxt(GOLDEN / f"{name}.csv", delimiter=",", skiprows=1, usecols=(0, 1, 2)).T.copy()
    _, found = drive(model, time, field)
    after = slice(int(np.argmax(field)), None)
    assert np.sqrt(np.mean((found.phase_fraction[after] - x[after]) ** 2)) < 0.05


def test_interaction_fields_alone_give_the_gaussian_when_slow() -> None:
    """Quasi-static major loop: x+ is the share of the domains with E + E_e above E_c, a shifted error function."""
    cold = dataclasses.replace(INTERACTION, temperature=1.0)
    time, field = ramps([-2e6, 2e6], rate=1e4)
    _, found = drive(cold, time, field)
    up = slice(200, None)
    expected = 0.5 * special.erfc(-(field[up] - cold.coercive_field) / np.sqrt(cold.spread))
    assert np.max(np.abs(found.phase_fraction[up] - expected)) < 0.04


def test_coercive_fields_alone_give_their_distribution_when_slow() -> None:
    """(3.22) from barrier 0 on; and the field that chapter 4 ends at, 1.9 MV/m, holds x+ = 0.83 (b_1 = 2.0e12)."""
    cold = dataclasses.replace(COERCIVE, temperature=1.0, start="negative")
    time, field = ramps([2e6], rate=1e4)
    _, found = drive(cold, time, field)
    root, whole = np.sqrt(cold.spread), special.erfc(-cold.coercive_field / np.sqrt(cold.spread))
    expected = (special.erfc((cold.coercive_field - field) / root) - special.erfc(cold.coercive_field / root)) / whole
    assert np.max(np.abs(found.phase_fraction - expected)) < 0.04
    _, held = drive(CHAPTER_4, *ramps([1.9e6], rate=1e5))
    assert held.phase_fraction[-1] == pytest.approx(0.83, abs=0.02)


# Laws


def test_history_is_what_coercive_fields_need_and_interaction_fields_do_not() -> None:
    """With interaction fields a leg keeps its x+ up to the major branch and goes on along it; 3.3.2."""
    strays = {}
    for model in (COERCIVE, INTERACTION):
        cold = dataclasses.replace(model, temperature=20.0)
        time, field = ramps([2e6, -2e6, 2e6, -0.6e6, 2e6], rate=1e5)
        _, found = drive(cold, time, field)
        major, minor = slice(400, 601), slice(800, 1001)
        on_major = np.interp(field[minor], field[major], found.phase_fraction[major])
        expected = np.maximum(on_major, found.phase_fraction[800])
        strays[model.distribution] = float(np.max(np.abs(found.phase_fraction[minor] - expected)))
    assert strays["interaction"] < 0.02
    assert strays["coercive"] > 0.2


@few
@given(turns=turning_fields)
def test_smooth_models_know_x_alone(turns: list[float]) -> None:
    """Whatever the history, the same field and x+ go on alike."""
    for model in (FORGETFUL, INTERACTION):
        time, field = ramps([*turns, 0.0], 1e7, samples=20)
        state, _ = drive(model, time, field)
        other = branch.fresh_state(model.material, float(state[branch.X]))
        after, onward = np.arange(1, 101) * 1e-3, np.linspace(0.0, 9e1, 100)
        _, one = model.step(state, Signals(time=time[-1] + after, voltage=onward))
        _, two = model.step(other, Signals(time=after, voltage=onward))
        np.testing.assert_allclose(one.phase_fraction, two.phase_fraction, rtol=0, atol=1e-6)


@few
@given(low=st.integers(2, 9), inner=st.integers(1, 8), up=st.booleans())
def test_minor_loop_closes_and_is_forgotten(low: int, inner: int, up: bool) -> None:
    """Return-point memory and wiping-out, quasi-static; the loop goes back at most as far as it came."""
    sign = 1.0 if up else -1.0
    outer = [-2e6 * sign, 1e5 * low * sign]
    beyond = 1e5 * (low + 4) * sign
    loop = [-1e5 * min(inner, low - 1) * sign, beyond]
    with_loop, one = drive(COERCIVE, *ramps([*outer, *loop], rate=2e4))
    plain, two = drive(COERCIVE, *ramps([*outer, beyond], rate=2e4))
    assert with_loop[branch.COUNT] == plain[branch.COUNT]
    points = slice(branch.STACK, branch.STACK + int(plain[branch.COUNT]))
    np.testing.assert_allclose(with_loop[points], plain[points], atol=1e-9)
    assert one.phase_fraction[-1] == pytest.approx(two.phase_fraction[-1], abs=2e-3)


@few
@given(turns=turning_fields, speed=st.sampled_from([1e5, 1e7, 1e9]))
def test_bounds_and_direction(turns: list[float], speed: float) -> None:
    """x+ stays between 0 and 1; with coercive fields and history every bit of switching dissipates: E dx >= 0."""
    time, field = ramps([*turns, 9e6, -9e6], speed)
    for model in MODELS:
        _, found = drive(model, time, field)
        assert np.all((found.phase_fraction >= 0.0) & (found.phase_fraction <= 1.0))
    _, found = drive(COERCIVE, time, field)
    one_sign = field[1:] * field[:-1] >= 0
    assert np.all((np.diff(found.phase_fraction) * (field[1:] + field[:-1]))[one_sign] >= -1e-9)


@each
@pytest.mark.parametrize("amplitude", [0.2e6, 0.6e6, 1.5e6])
@pytest.mark.parametrize("offset", [-0.3e6, 0.0, 0.3e6])
def test_closed_loops_dissipate(model: ParametrizedSingle, amplitude: float, offset: float) -> None:
    turns = [offset + sign * amplitude for sign in (1, -1) * 12]
    time, field = ramps(turns, rate=1e7, samples=400)
    _, found = drive(model, time, field)
    e, p = field[-801:], found.polarization[-801:]
    drift = p[-1] - p[0]  # of creep: what is left of it leaves the loop's energy open by the fields passed
    assert abs(drift) < 5e-3
    assert np.sum(0.5 * (e[1:] + e[:-1]) * np.diff(p)) - e[0] * drift >= -2 * amplitude * abs(drift) - 1e-6


def test_noise_about_zero_does_not_fill_the_memory() -> None:
    field = 1e3 * np.random.default_rng(1).standard_normal(20_000)
    state, found = drive(COERCIVE, np.arange(1, 20_001) * 5e-5, field)
    assert state[branch.COUNT] < 100
    assert np.ptp(found.phase_fraction) < 0.1


def test_virgin_is_half_up() -> None:
    """As many up as down, and what comes up next does not depend on the sign (to the last turn of the drive)."""
    virgin = dataclasses.replace(COERCIVE, start="virgin")
    state = virgin.init(Rest())
    assert state[branch.X] == pytest.approx(0.5, abs=0.05)
    assert state[branch.COUNT] > 10
    (_, up), (_, down) = (drive(virgin, *ramps([sign * 1e6], 1e6)) for sign in (1, -1))
    np.testing.assert_allclose(up.phase_fraction + down.phase_fraction, 1.0, atol=0.08)
    for model in (FORGETFUL, INTERACTION):
        assert model.init(Rest())[branch.X] == 0.5


# What every link promises, for the distributions that are not the default one


@each
def test_blocks_and_rows(model: ParametrizedSingle) -> None:
    """Blocks may be cut anywhere, to the bit; rows may be far apart, to the accuracy."""
    time, field = ramps([1.4e6, -1.1e6, 0.3e6, -0.4e6, 2e6], 1e7, samples=100)
    end, whole = drive(model, time, field)
    state, parts = model.init(Rest()), []
    for begin, stop in itertools.pairwise([0, 1, 2, 130, 377, time.size]):
        state, out = model.step(state, Signals(time=time[begin:stop], voltage=field[begin:stop] * 1e-4))
        parts.append(out.phase_fraction)
    np.testing.assert_array_equal(np.concatenate(parts), whole.phase_fraction)
    np.testing.assert_array_equal(state, end)
    _, sparse = drive(model, time[::100], field[::100])
    np.testing.assert_allclose(sparse.phase_fraction, whole.phase_fraction[::100], rtol=0, atol=1e-5)


@each
def test_inverse_undoes_step(model: ParametrizedSingle) -> None:
    """Through fronts, turns and closures; step on the voltage found gives the same state to the bit."""
    time, field = ramps([1.4e6, -1.1e6, 0.3e6, -0.4e6, 2e6], 1e7, samples=100)
    _, wanted = drive(model, time, field)
    start = model.init(Rest())
    moved, needed = model.invert(start, wanted)
    after, got = model.step(start, needed)
    np.testing.assert_allclose(got.polarization, wanted.polarization, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(got.phase_fraction, needed.phase_fraction)
    kept = [n for n in range(branch.SIZE) if n != branch.STEEPNESS]
    np.testing.assert_array_equal(after[kept], moved[kept])


def test_inverse_out_of_reach_and_without_target() -> None:
    time = np.arange(1, 4) * 1e-3
    target = np.array([9.0, np.nan, 0.0])
    _, found = COERCIVE.invert(COERCIVE.init(Rest()), Signals(time=time, polarization=target))
    assert found.voltage[0] == pytest.approx(1e7 * COERCIVE.layer_thickness)
    assert found.voltage[1] == found.voltage[0]
    assert abs(found.voltage[2]) < found.voltage[0]


def test_bad_blocks_are_refused() -> None:
    state, time = COERCIVE.init(Rest()), np.array([0.1, 0.2])
    with pytest.raises(BenchError, match="2 samples, but 0 of voltage"):
        COERCIVE.step(state, Signals(time=time))
    with pytest.raises(BenchError, match="voltage is nan V at sample 1"):
        COERCIVE.step(state, Signals(time=time, voltage=np.array([0.0, np.nan])))
    with pytest.raises(BenchError, match="2 samples, but 0 of polarization"):
        COERCIVE.invert(state, Signals(time=time))


@each
def test_amplifier_drives_it(model: ParametrizedSingle) -> None:
    """As a load with a reference capacitor: the ceramic gets what the capacitor, in series, leaves it."""
    amplifier = Amplifier(reference_capacitance=1e-4).driving(model)
    time, field = ramps([1.4e6, -1.1e6, 0.3e6], 1e7, samples=100)
    command = Signals(time=time, voltage=field * model.layer_thickness)
    _, driven = amplifier.step(amplifier.init(Rest()), command)
    _, out = model.step(model.init(Rest()), driven)
    charge = model.electrode_area * (out.polarization - out.polarization[0])
    np.testing.assert_allclose(driven.voltage + charge / 1e-4, command.voltage, rtol=0, atol=1e-6)
