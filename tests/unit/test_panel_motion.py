"""What the panel may ask of the stage: fuzzed, nothing it sends leaves the window, is too fast, or jumps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pzt_ros.chains import load_model
from pzt_ros.errors import BenchError
from pzt_ros.experiments.trajectory import Path
from pzt_ros.panel.axis import describe, envelope_of
from pzt_ros.panel.motion import MOST_POINTS, SHAPES, Envelope, Point, jog, scan

WINDOW = Envelope(low=2e-6, high=12e-6, speed=400e-6)
PLACES = st.floats(WINDOW.low, WINDOW.high)
ANYTHING = st.one_of(st.floats(), st.floats(-30e-6, 30e-6), st.integers(-5, 5))
RATES = st.one_of(st.floats(), st.floats(0.0, 100.0))
TIMES = st.one_of(st.floats(), st.floats(1e-3, 10.0))
SPEEDS = st.one_of(st.floats(), st.floats(-400e-6, 400e-6))
CASES = settings(max_examples=200, derandomize=True, deadline=None, database=None)
CYCLES = st.one_of(st.floats(), st.integers(-2, 3000).map(float))


def way(points: list[Point], here: float) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and places [m] of what the graph makes of the points: close enough that no corner is missed."""
    table = [(0.0, here, 0.0), *points]
    time, place, velocity = (np.array([math.nan if row[k] is None else row[k] for row in table]) for k in range(3))
    path = Path(time, place, velocity)
    fine = np.unique(np.concatenate([time, np.linspace(0.0, time[-1], 5000)]))
    return fine, path.value(fine)


def check(points: list[Point], here: float) -> None:
    """Inside the window, never too fast, from here, and at rest at the end."""
    time, place = way(points, here)
    assert place.min() >= WINDOW.low - 1e-12
    assert place.max() <= WINDOW.high + 1e-12
    assert place[0] == here
    steps = np.diff(time)
    far = steps > 1e-7  # over less the difference of two places is rounding
    assert np.max(np.abs(np.diff(place))[far] / steps[far]) <= WINDOW.speed * 1.001
    assert points[-1][2] in (None, 0.0)
    assert len(points) <= MOST_POINTS


@given(here=PLACES, step=ANYTHING, speed=ANYTHING)
@CASES
def test_no_jog_leaves_the_window(here: float, step: float, speed: float) -> None:
    try:
        points = jog(WINDOW, here, step, speed)
    except BenchError:
        return
    check(points, here)
    assert points[-1][1] == pytest.approx(here + step, abs=1e-15)


@given(here=PLACES, shape=st.sampled_from([*SHAPES, "square"]), low=ANYTHING, size=ANYTHING, rate=RATES, cycles=CYCLES)
@CASES
def test_no_scan_leaves_the_window(
    here: float, shape: str, low: float, size: float, rate: float, cycles: float
) -> None:
    try:
        points = scan(WINDOW, here, shape=shape, low=low, peak_to_peak=size, rate=rate, cycles=cycles)
    except BenchError:
        return
    check(points, here)
    assert points[-1][1] == pytest.approx(low, abs=1e-12)


@given(here=PLACES, points=st.lists(st.tuples(TIMES, ANYTHING, st.one_of(st.none(), SPEEDS)), max_size=6))
@CASES
def test_the_gate_lets_nothing_bad_through(here: float, points: list[Point]) -> None:
    try:
        passed = WINDOW.check(points, here)
    except BenchError:
        return
    if passed:
        time, place = way(passed, here)
        assert np.all(np.isfinite(place))
        assert place.min() >= WINDOW.low - 1e-9
        assert place.max() <= WINDOW.high + 1e-9
        assert np.all(np.diff([0.0, *(t for t, _, _ in passed)]) > 0.0)
        assert time[-1] == passed[-1][0]


@pytest.mark.parametrize("shape", SHAPES)
def test_a_scan_is_the_shape_it_is_named_after(shape: str) -> None:
    points = scan(WINDOW, 5e-6, shape=shape, low=4e-6, peak_to_peak=6e-6, rate=2.0, cycles=3)
    time, place = way(points, 5e-6)
    begin = points[0][0]
    scanning = time >= begin
    phase = ((time[scanning] - begin) * 2.0) % 1.0
    expected = {
        "triangle": 1.0 - np.abs(1.0 - 2.0 * phase),
        "sine": 0.5 * (1.0 - np.cos(2.0 * np.pi * phase)),
        "raster line": np.where(phase < 0.8, phase / 0.8, (1.0 - phase) / 0.2),
    }[shape]
    assert points[-1][0] - begin == pytest.approx(1.5)
    np.testing.assert_allclose(place[scanning], 4e-6 + 6e-6 * expected, atol=6e-6 * 1e-3)


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        ({"step": 20e-6}, "25 um is outside the window of 2 to 12 um"),
        ({"step": -1e-6 * math.inf}, "step is -inf"),
        ({"step": 0.0}, "goes nowhere"),
        ({"speed": 1.0}, "speed of 1e+06 um/s is outside"),
        ({"speed": math.nan}, "speed is nan"),
    ],
)
def test_a_refused_jog_says_why(asked: dict[str, float], reason: str) -> None:
    with pytest.raises(BenchError) as caught:
        jog(WINDOW, 5e-6, **{"step": 1e-6, "speed": 5e-6, **asked})
    assert reason.replace("2 to 12 um", "2 um to 12 um") in str(caught.value)


def test_a_fast_scan_is_refused_with_both_speeds() -> None:
    with pytest.raises(BenchError, match=r"it takes 1600 um/s, the limit is 400 um/s; slow it down"):
        scan(WINDOW, 5e-6, shape="triangle", low=4e-6, peak_to_peak=8e-6, rate=100.0, cycles=1)


def test_a_stage_left_outside_may_only_come_back() -> None:
    outside = WINDOW.low - 1e-6
    assert jog(WINDOW, outside, 2e-6, 5e-6)[-1][1] == pytest.approx(WINDOW.low + 1e-6)
    with pytest.raises(BenchError, match="outside the window"):
        jog(WINDOW, outside, -0.5e-6, 5e-6)


def test_the_window_is_where_the_model_goes_within_its_voltages() -> None:
    model = load_model("thesis-p2")
    narrow, wide = envelope_of(model, -40.0, 100.0), envelope_of(model, -40.0, 150.0)
    assert 0.0 < narrow.low < narrow.high < wide.high
    about = describe(model, -40.0, 150.0)
    assert about["layer_thickness_m"] == 1e-4
    assert about["active_length_m"] == 8e-3
    assert about["envelope"]["high"] < 8e-3 * 2e-3  # a stack strains by less than 2 per mille
