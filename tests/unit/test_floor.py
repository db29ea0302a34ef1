"""The noise floor where noise is coloured, where the mains hums, and samples that no model can know."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import signal

from pzt_ros.diagnosis.data import FIT, SCORE, SELECTION, RunData, split
from pzt_ros.diagnosis.floor import displacement_floors
from pzt_ros.diagnosis.gaps import lost_turns
from pzt_ros.diagnosis.lines import without_lines
from pzt_ros.diagnosis.refinement import rivals_of
from pzt_ros.diagnosis.remains import remains_of
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record

NOISE = 10e-9
STEP = 1e-3


def white(seed: int, count: int) -> Array:
    return NOISE * np.random.default_rng(seed).standard_normal(count)


def coloured(seed: int, count: int) -> Array:
    """Of the same rms: a third of its power remembers itself for 20 samples."""
    memory = 0.95
    slow = signal.lfilter([math.sqrt(1.0 - memory**2)], [1.0, -memory], white(seed + 100, count))
    return math.sqrt(2.0 / 3.0) * white(seed, count) + math.sqrt(1.0 / 3.0) * np.asarray(slow)


def steps(noise: Array, hum: float = 0.0, length: float = 1.0) -> Record:
    """A staircase of holds with creep."""
    time = STEP * np.arange(noise.size)
    voltage = 20.0 * ((time // length) % 5)
    creep = 1e-8 * np.log10(1.0 + (time % length) / 0.01)
    tone = hum * (np.sin(2 * math.pi * 50.03 * time + 1.0) + 0.3 * np.sin(2 * math.pi * 150.09 * time))
    return Record(
        "steps", {"time_s": time, "voltage_V": voltage, "displacement_m": 1e-7 * voltage + creep + tone + noise}
    )


@pytest.mark.parametrize("make", [white, coloured])
@pytest.mark.parametrize("hum", [0.0, 1.0 * NOISE, 10.0 * NOISE])
def test_floor_is_the_noise_whatever_its_colour_and_the_mains(make: Any, hum: float) -> None:
    runs = [steps(make(seed, 20_000), hum) for seed in (1, 2)]
    assert displacement_floors(runs) == pytest.approx([NOISE, NOISE], rel=0.12)


def test_short_holds_learn_the_colour_from_long_ones() -> None:
    runs = [steps(coloured(1, 20_000)), steps(coloured(2, 4_000), length=0.2)]
    assert displacement_floors(runs) == pytest.approx([NOISE, NOISE], rel=0.1)


@pytest.mark.parametrize("make", [white, coloured])
def test_a_mode_that_rings_into_a_hold_is_no_noise(make: Any) -> None:
    """A court case: a mode of 191 Hz, damped by 3 %, was taken for noise of 1.6 times the true one."""
    made = steps(make(1, 20_000), length=0.4)
    since = made.time % 0.4
    ringing = 2e-6 * np.exp(-since / 0.05) * np.sin(2 * math.pi * 31.0 * since)
    record = Record("rings", {**made.columns, "displacement_m": made.displacement + ringing})
    assert displacement_floors([record]) == pytest.approx([NOISE], rel=0.1)


def test_lines_are_taken_out_and_nothing_else() -> None:
    time, noise = STEP * np.arange(3000), white(3, 3000)
    left, found = without_lines(time, noise + 5e-8 * np.sin(2 * math.pi * 37.2 * time) + 1e-6 * time**2)
    assert found == pytest.approx([37.2], abs=0.01)
    assert np.std(left) == pytest.approx(NOISE, rel=0.03)
    np.testing.assert_allclose(left, noise, rtol=0, atol=2e-9)
    assert without_lines(time, noise)[1] == []


def triangle(turn: float, missing: slice) -> Record:
    time = np.delete(STEP * np.arange(2000), np.arange(2000)[missing])
    voltage = 100.0 * (1.0 - np.abs(time - turn))
    return Record("triangle", {"time_s": time, "voltage_V": voltage, "displacement_m": 1e-7 * voltage})


def test_what_follows_a_lost_turn_does_not_count() -> None:
    run = triangle(1.0, slice(980, 1020))
    lost = run.time[lost_turns(run)]
    assert lost[0] == pytest.approx(1.020)
    assert lost[-1] == pytest.approx(1.020 + 3 * 0.041, abs=2e-3)
    data = split([RunData(run, {}, NOISE)], [RunData(run, {}, NOISE)])
    counted = np.concatenate([data[0].picks[FIT]]), np.concatenate([data[1].picks[SELECTION], data[1].picks[SCORE]])
    for picks in counted:
        assert not np.any(lost_turns(run)[picks])
        assert picks.size == len(run) - lost.size


@pytest.mark.parametrize(("missing", "remain"), [(slice(980, 1020), False), (slice(300, 340), True)])
def test_a_lost_turn_is_no_slow_remain(missing: slice, remain: bool) -> None:
    """A null of the court: a chirp lost some turns, was 5 nm off for half a second, and "something is missing"."""
    run = triangle(1.0, missing)
    noise = NOISE * np.random.default_rng(3).standard_normal(len(run))
    left = noise + 0.8 * NOISE * (run.time > 1.2)
    found = remains_of([RunData(run, {}, NOISE)], [left], 1.1, 2.0)
    assert found.present is remain
    assert not remains_of([RunData(run, {}, NOISE)], [noise], 1.1, 2.0).present


@pytest.mark.parametrize("missing", [slice(300, 340), slice(0, 0), slice(1000, 1001)])
def test_gaps_elsewhere_lose_nothing(missing: slice) -> None:
    assert not np.any(lost_turns(triangle(1.0, missing)))


def test_a_logger_that_stores_changes_only_has_no_gaps() -> None:
    time = np.cumsum(np.tile([0.01, 0.01, 3.0], 40))
    run = Record("sparse", {"time_s": time, "voltage_V": 10.0 * (np.arange(120) // 3 % 2), "displacement_m": time})
    assert not np.any(lost_turns(run))


def test_slow_noise_is_nothing_unexplained() -> None:
    noise = coloured(5, 20_000)
    data = RunData(steps(noise), {FIT: np.arange(noise.size)}, NOISE)
    assert not remains_of([data], [noise], 1.05, 2.0).present
    wave = 0.4 * NOISE * np.sin(2 * math.pi * data.record.time / 7.0)  # slower than any hold
    quiet = RunData(steps(white(6, 20_000)), {FIT: np.arange(noise.size)}, NOISE)
    assert remains_of([quiet], [white(6, 20_000) + wave], 1.2, 2.0).present


def test_one_that_fails_where_nothing_was_fitted_is_still_made_exact() -> None:
    """Else an approximation that fails on one run hides the right effect."""

    def candidate(fit: float, selection: float) -> Any:
        before = SimpleNamespace(fit=SimpleNamespace(total=1000.0), total=2.0)
        return SimpleNamespace(before=before, after=SimpleNamespace(fit=SimpleNamespace(total=fit), total=selection))

    right, weaker, hopeless = candidate(200.0, 8.0), candidate(400.0, 9.0), candidate(990.0, 2.5)
    assert rivals_of([right, weaker, hopeless]) == [right, weaker]
    ahead = candidate(900.0, 1.2)
    assert rivals_of([right, ahead, hopeless]) == [right, ahead]


@pytest.mark.parametrize("seed", range(5))
def test_slow_noise_of_a_run_without_holds_is_known_from_the_other_runs(seed: int) -> None:
    """At another rate, too: bursts at five times the rate have no holds that would tell."""
    time = np.arange(20_000) / 5e3
    burst = Record("burst", {"time_s": time, "voltage_V": 50 * np.sin(300 * time), "displacement_m": time})
    for make, present in ((coloured, False), (white, True)):
        known, own = make(seed, 20_000), coloured(seed + 100, time.size)
        data = [
            RunData(steps(known), {FIT: np.arange(known.size)}, NOISE),
            RunData(burst, {FIT: np.arange(own.size)}, NOISE),
        ]
        assert remains_of(data, [known, own], 1.2, 2.0).present is present
