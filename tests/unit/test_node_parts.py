"""Parts of nodes that need no ROS: the gate before the conductor, the pace, and the histogram of latencies."""

from __future__ import annotations

import time

import numpy as np
import pytest

from pzt_nodes.gate import Gate
from pzt_nodes.latency import LatencyLog
from pzt_nodes.pace import Pace


def enabled(block: int) -> dict[str, str]:
    return {"state": "enabled", "enabled_at_block": str(block)}


def gate() -> tuple[Gate, list[int]]:
    passed: list[int] = []
    return Gate(lambda tick, _: passed.append(tick)), passed


def test_a_gate_lets_the_ticks_of_a_beat_through_whichever_is_heard_first() -> None:
    for early in (True, False):
        door, passed = gate()
        if early:
            door.hear(enabled(5))
        door.add(5, None)
        if not early:
            assert passed == []
            door.hear(enabled(5))
        assert passed == [5]
        assert door.is_open
        for tick in (6, 7):
            door.hear(enabled(5))
            door.add(tick, None)
        assert passed == [5, 6, 7], "each once"


def test_a_gate_keeps_ticks_of_a_ramp_and_of_an_earlier_beat_back() -> None:
    door, passed = gate()
    door.hear(enabled(0))
    door.add(0, None)
    door.hear({"state": "ramping", "enabled_at_block": "0"})
    assert not door.is_open
    for tick in (1, 2, 3):
        door.add(tick, None)
    door.hear(enabled(4))
    assert passed == [0], "tick 3 was of the ramp"
    assert not door.is_open, "the first tick of the new beat has still to come"
    door.add(4, None)
    assert passed == [0, 4]


@pytest.mark.parametrize("said", [{}, {"state": "enabled"}, {"state": "enabled", "enabled_at_block": "soon"}])
def test_a_gate_stays_shut_for_an_amplifier_that_does_not_say_where_it_began(said: dict[str, str]) -> None:
    door, passed = gate()
    door.hear(said)
    door.add(1, None)
    assert passed == []


def test_a_pace_holds_blocks_back_until_their_time() -> None:
    pace = Pace()
    began = time.monotonic()
    for block in range(1, 6):
        pace.wait_for(0.01 * block)
    assert time.monotonic() - began >= 0.04
    assert pace.summary()["paced_ticks"] == 5


def test_a_pace_counts_what_comes_late_and_a_pause_is_not_late() -> None:
    pace = Pace()
    pace.wait_for(0.0)
    time.sleep(0.03)
    pace.wait_for(0.01)
    found = pace.summary()
    assert found["missed_ticks"] == 1
    assert float(str(found["lateness_max_us"])) >= 19e3
    pace.pause()
    time.sleep(0.03)
    pace.wait_for(0.011)
    pace.wait_for(0.2)
    assert pace.missed == 1


def test_percentiles_are_those_of_numpy() -> None:
    durations = np.random.default_rng(1).lognormal(np.log(2e-4), 1.0, 20_000)
    log = LatencyLog()
    for duration in durations:
        log.add(float(duration))
    for percent in (1.0, 50.0, 99.0, 99.9):
        assert log.percentile(percent) == pytest.approx(np.percentile(durations, percent), rel=0.03)
    said = log.summary("took")
    assert set(said) == {"took_p50_us", "took_p99_us", "took_p999_us", "took_max_us"}
    assert said["took_max_us"] == pytest.approx(1e6 * durations.max(), abs=0.1)


def test_durations_beyond_every_bin_are_counted() -> None:
    log = LatencyLog()
    assert log.summary("took") == {}
    for duration in (0.0, -1.0, 1e9):
        log.add(duration)
    assert log.percentile(50.0) == 0.0
    assert log.summary("took")["took_max_us"] == 1e15
