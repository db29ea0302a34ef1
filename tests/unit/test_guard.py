"""The guard before the amplifier: what it refuses, what it limits, and how it makes the stage safe."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pzt_ros.hardware.amplifier import Applied
from pzt_ros.hardware.block_figures import largest
from pzt_ros.hardware.guard import DISABLED, ENABLED, FAULT, RAMPING, GuardedAmplifier, Limits
from pzt_ros.reference import block_times

RATE, SIZE = 1000.0, 10
LIMITS = Limits(voltage_min=-40.0, voltage_max=150.0, slew_rate=5e3, current=0.2, safe_rate=500.0)
SLEW_STEP, SAFE_STEP = LIMITS.slew_rate / RATE, LIMITS.safe_rate / RATE
ROUNDING = 1e-9


class Recorder:
    """A driver that writes down what it is given; its current is whatever the test says."""

    def __init__(self, gain: float = 1.0, found: float = 0.0) -> None:
        self.gain = gain
        self.voltage = found
        self.current = 0.0
        self.blocks: list[np.ndarray] = []
        self.times: list[np.ndarray] = []

    def apply(self, time: np.ndarray, command_voltage: np.ndarray) -> Applied:
        self.blocks.append(self.gain * command_voltage)
        self.times.append(time)
        self.voltage = float(self.blocks[-1][-1])
        return Applied(time, self.blocks[-1], np.full_like(time, self.current), np.zeros_like(time))

    def warm_up(self) -> None:
        pass

    @property
    def stack(self) -> np.ndarray:
        """All voltage that was ever across the stack [V]."""
        return np.concatenate(self.blocks) if self.blocks else np.empty(0)


class Bench:
    """A guarded recorder that is commanded in turn."""

    def __init__(self, limits: Limits = LIMITS, gain: float = 1.0, found: float = 0.0, enabled: bool = True) -> None:
        self.driver = Recorder(gain, found)
        self.guard = GuardedAmplifier(self.driver, limits, RATE, SIZE)
        if enabled:
            assert self.guard.enable() == ""

    def command(self, values: float | np.ndarray) -> Applied | None:
        block = np.broadcast_to(np.asarray(values, dtype=float), (SIZE,)).copy()
        return self.guard.apply(self.guard.next_block * SIZE / RATE, block)

    def go_to(self, voltage: float) -> None:
        """Command `voltage` until it is there."""
        while self.guard.command_voltage != voltage:
            before = self.guard.command_voltage
            assert self.command(voltage) is not None
            assert self.guard.command_voltage != before

    def ramp_down(self) -> np.ndarray:
        """Ramp until nothing moves any more; the voltage on the way [V]."""
        self.driver.blocks.clear()
        while self.guard.state == RAMPING:
            self.guard.ramp()
        return self.driver.stack


def count(bench: Bench, what: str) -> int:
    return bench.guard.counts[what]


def test_a_good_block_passes_unchanged() -> None:
    bench = Bench()
    wanted = np.linspace(0.0, 9.0, SIZE)
    applied = bench.command(wanted)
    assert applied is not None
    np.testing.assert_array_equal(applied.voltage, wanted)
    np.testing.assert_array_equal(bench.driver.times[0], block_times(0, SIZE, RATE))
    assert bench.guard.next_block == 1
    assert bench.guard.command_voltage == 9.0
    assert not +bench.guard.counts  # nothing above zero


@pytest.mark.parametrize("shape", [(SIZE - 1,), (SIZE + 1,), (0,), (), (SIZE, 1), (1, SIZE)])
def test_wrong_block_size_is_refused(shape: tuple[int, ...]) -> None:
    bench = Bench()
    assert bench.guard.apply(0.0, np.zeros(shape)) is None
    assert count(bench, "refused: wrong block size") == 1
    assert (bench.guard.state, bench.guard.next_block, bench.driver.blocks) == (ENABLED, 0, [])


@pytest.mark.parametrize("late", [-1.0, -0.02, -0.01, 0.01, 0.02, 0.0006, -0.0006, 1e308, -1e308, math.nan, math.inf])
def test_wrong_time_is_refused(late: float) -> None:
    """Late, early, repeated, no number, and too large to be counted in samples."""
    bench = Bench()
    bench.command(1.0)
    bench.command(2.0)
    assert bench.guard.apply(0.02 + late, np.full(SIZE, 3.0)) is None
    assert count(bench, "refused: out of turn") == 1
    assert (bench.guard.state, bench.guard.next_block, bench.guard.command_voltage) == (ENABLED, 2, 2.0)
    assert bench.command(3.0) is not None


def test_rounding_of_the_time_is_no_reason_to_refuse() -> None:
    bench = Bench()
    for block in range(1000):
        assert bench.guard.apply(float(np.float32(block * SIZE / RATE)), np.zeros(SIZE)) is not None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("where", [0, 4, SIZE - 1])
@pytest.mark.parametrize("start", [150.0, -40.0, 3.3])
def test_a_command_that_is_no_number_is_a_fault(bad: float, where: int, start: float) -> None:
    bench = Bench()
    bench.go_to(start)
    block = np.full(SIZE, start)
    block[where] = bad
    blocks = len(bench.driver.blocks)
    assert bench.command(block) is None
    assert len(bench.driver.blocks) == blocks, "nothing of that block was put out"
    assert count(bench, "refused: not finite") == 1
    assert bench.guard.state == RAMPING
    way = np.abs(np.concatenate(([start], bench.ramp_down())))
    steps = -np.diff(way)
    moving = way[1:] > 0.0
    np.testing.assert_allclose(steps[moving], SAFE_STEP, rtol=1e-9)
    assert np.all(steps[~moving] <= SAFE_STEP * (1 + ROUNDING))
    assert np.all(steps >= 0.0)
    assert way[-1] == 0.0
    assert len(way) - 1 <= math.ceil(abs(start) / SAFE_STEP / SIZE) * SIZE, "no longer than it needs"
    assert (bench.guard.state, bench.guard.reason) == (FAULT, "command voltage is not a finite number")
    assert np.all(bench.guard.ramp().voltage == 0.0)


def test_no_number_at_zero_volts_is_a_fault_at_once() -> None:
    bench = Bench()
    assert bench.command(math.nan) is None
    assert bench.guard.state == FAULT


@pytest.mark.parametrize(("asked", "edge"), [(151.0, 150.0), (1e308, 150.0), (-41.0, -40.0), (-1e308, -40.0)])
def test_window(asked: float, edge: float) -> None:
    bench = Bench()
    bench.go_to(edge)
    assert count(bench, "limited: voltage window") == 0
    applied = bench.command(asked)
    assert applied is not None
    np.testing.assert_array_equal(applied.voltage, np.full(SIZE, edge))
    assert count(bench, "limited: voltage window") == SIZE
    assert bench.guard.state == ENABLED


@pytest.mark.parametrize("start", [-40.0, 0.0, 77.7, 150.0])
@pytest.mark.parametrize("asked", [-40.0, 0.0, 50.0, 150.0])
def test_slew_rate_from_anywhere(start: float, asked: float) -> None:
    bench = Bench()
    bench.go_to(start)
    before = count(bench, "limited: slew rate")
    applied = bench.command(asked)
    assert applied is not None
    steps = np.arange(1, SIZE + 1) * SLEW_STEP
    expected = start + np.sign(asked - start) * np.minimum(steps, abs(asked - start))
    np.testing.assert_allclose(applied.voltage, expected, rtol=1e-12, atol=1e-12)
    assert count(bench, "limited: slew rate") - before == np.count_nonzero(steps < abs(asked - start))


def test_slew_rate_counts_from_the_last_block() -> None:
    bench = Bench()
    bench.command(np.full(SIZE, SLEW_STEP))
    applied = bench.command(np.full(SIZE, 3 * SLEW_STEP))
    assert applied is not None
    np.testing.assert_allclose(applied.voltage[:3], [2 * SLEW_STEP, 3 * SLEW_STEP, 3 * SLEW_STEP])


@pytest.mark.parametrize("current", [0.21, -0.21, math.nan, math.inf, -math.inf])
def test_over_current_is_a_fault(current: float) -> None:
    bench = Bench()
    bench.go_to(20.0)
    bench.driver.current = current
    assert bench.command(20.0) is not None, "that block is out already"
    assert bench.guard.state == RAMPING
    assert "mA exceeds the limit of 200.0 mA" in bench.guard.reason
    assert bench.command(20.0) is None
    assert bench.ramp_down()[-1] == 0.0
    assert bench.guard.state == FAULT


@pytest.mark.parametrize(
    ("voltage", "current"),
    [([1.0, 2.0], [0.1]), ([1.0], [0.1, 0.1]), ([0.0, 1.0], [math.inf, 0.1]), ([math.nan], [0.1])],
)
def test_what_is_no_figure_is_within_no_limit(voltage: list[float], current: list[float]) -> None:
    found = largest(np.array(voltage), np.array(current))
    assert not (found[0] <= 1e9 and found[1] <= 1e9)


def test_current_at_the_limit_is_allowed() -> None:
    bench = Bench()
    bench.driver.current = -0.2
    bench.command(1.0)
    assert bench.guard.state == ENABLED


def test_disabled_takes_no_command() -> None:
    bench = Bench(enabled=False)
    assert bench.guard.state == DISABLED
    assert bench.command(10.0) is None
    assert count(bench, "refused: amplifier is disabled") == 1
    assert bench.driver.blocks == []
    assert bench.guard.enable() == ""
    assert bench.guard.enable() == "", "twice is no harm"
    assert bench.command(10.0) is not None


def test_disable_ramps_down() -> None:
    bench = Bench()
    bench.go_to(60.0)
    bench.guard.disable()
    assert bench.guard.state == RAMPING
    assert bench.command(60.0) is None
    assert count(bench, "refused: amplifier is ramping") == 1
    assert bench.guard.enable() == "cannot enable: ramping to 0 V; wait until it is there"
    assert bench.guard.reset() == "nothing to reset: the amplifier is ramping"
    bench.guard.disable()
    way = bench.ramp_down()
    np.testing.assert_allclose(way[0], 60.0 - SAFE_STEP)
    assert way[-1] == 0.0
    assert (bench.guard.state, bench.guard.reason) == (DISABLED, "")
    assert bench.guard.enable() == ""


def test_disable_at_zero_volts_is_immediate() -> None:
    bench = Bench()
    bench.guard.disable()
    assert bench.guard.state == DISABLED


def test_fault_has_to_be_reset() -> None:
    bench = Bench()
    bench.go_to(5.0)
    bench.guard.fault("hot")
    assert bench.guard.enable() == "cannot enable: ramping to 0 V (hot); wait until it is there"
    assert bench.guard.reset() == "nothing to reset: the amplifier is ramping"
    bench.ramp_down()
    assert bench.guard.state == FAULT
    assert bench.guard.enable() == "cannot enable: fault (hot); reset first"
    bench.guard.disable()
    assert bench.guard.state == FAULT
    assert bench.guard.reset() == ""
    assert (bench.guard.state, bench.guard.reason) == (DISABLED, "")
    assert bench.guard.reset() == "nothing to reset: the amplifier is disabled"
    assert bench.guard.enable() == ""
    assert bench.guard.reset() == "nothing to reset: the amplifier is enabled"


def test_first_reason_is_kept() -> None:
    bench = Bench()
    bench.go_to(20.0)
    bench.guard.fault("first")
    bench.guard.fault("second")
    bench.ramp_down()
    bench.guard.fault("third")
    assert bench.guard.reason == "first"


def test_a_fault_while_ramping_down_is_not_lost() -> None:
    bench = Bench()
    bench.go_to(20.0)
    bench.guard.disable()
    bench.guard.fault("silence")
    bench.ramp_down()
    assert (bench.guard.state, bench.guard.reason) == (FAULT, "silence")


def test_hold_goes_on_with_the_last_command() -> None:
    bench = Bench()
    bench.go_to(12.5)
    np.testing.assert_array_equal(bench.guard.hold().voltage, np.full(SIZE, 12.5))
    np.testing.assert_array_equal(np.concatenate(bench.driver.times), np.arange(SIZE * len(bench.driver.times)) / RATE)


def test_begins_at_the_voltage_found() -> None:
    """A stack that is charged when the program starts must not be jerked to 0 V."""
    bench = Bench(found=80.0)
    np.testing.assert_array_equal(bench.guard.hold().voltage, np.full(SIZE, 80.0))
    bench.guard.disable()
    assert bench.guard.state == RAMPING
    assert bench.ramp_down()[0] == pytest.approx(80.0 - SAFE_STEP)


def test_limits_are_of_the_stack_not_of_the_command() -> None:
    """With 27.8 V per volt, 5.4 V of command are 150 V at the stack."""
    bench = Bench(gain=27.8)
    for _ in range(10):
        bench.command(1e3)
    assert bench.guard.command_voltage == pytest.approx(150.0 / 27.8)
    assert np.max(bench.driver.stack) <= 150.0 * (1 + 1e-12)
    assert np.max(np.abs(np.diff(bench.driver.stack, prepend=0.0))) == pytest.approx(SLEW_STEP)
    bench.guard.disable()
    np.testing.assert_allclose(-np.diff(bench.ramp_down())[:200], SAFE_STEP, rtol=1e-9)


def test_ramp_is_no_faster_than_the_slew_rate() -> None:
    slow = dataclasses.replace(LIMITS, slew_rate=100.0, safe_rate=500.0)
    bench = Bench(slow)
    bench.go_to(5.0)
    bench.guard.disable()
    assert np.max(np.abs(np.diff(bench.ramp_down(), prepend=5.0))) <= 0.1 * (1 + ROUNDING)
    assert slow.declared_safe_time == pytest.approx(0.5 + 150.0 / 100.0 + 0.2)
    assert LIMITS.declared_safe_time == pytest.approx(0.5 + 150.0 / 500.0 + 0.2)


FINITE = st.one_of(st.floats(-60.0, 200.0), st.floats(allow_nan=False, allow_infinity=False))
ANYTHING = st.one_of(FINITE, st.sampled_from([math.nan, math.inf, -math.inf]))
COMMAND = st.one_of(
    st.lists(FINITE, min_size=SIZE, max_size=SIZE),
    st.lists(ANYTHING, min_size=SIZE, max_size=SIZE),
    st.lists(ANYTHING, max_size=SIZE + 2),
    FINITE.map(lambda v: [v] * SIZE),
)
EVENT = st.one_of(
    st.tuples(st.just("command"), COMMAND),
    st.tuples(st.just("command at"), st.one_of(st.floats(), st.sampled_from([0.0, 0.01, -0.01]))),
    st.tuples(st.just("current"), st.sampled_from([0.0, 0.0, 0.0, 0.3, math.nan])),
    st.tuples(st.sampled_from(["enable", "enable", "disable", "reset", "fault", "ramp", "ramp"]), st.none()),
)


def happen(bench: Bench, what: str, value: object) -> None:
    """One event; enabling puts out a block, as the amplifier node does."""
    guard = bench.guard
    if what == "command":
        guard.apply(guard.next_block * SIZE / RATE, np.array(value, dtype=float))
    elif what == "command at":
        assert isinstance(value, float)
        guard.apply(value, np.full(SIZE, 100.0))
    elif what == "current":
        assert isinstance(value, float)
        bench.driver.current = value
    elif what == "enable":
        if guard.enable() == "":
            guard.hold()
    elif what == "fault":
        guard.fault("the test says so")
    else:
        getattr(guard, what)()


@settings(max_examples=200, derandomize=True, deadline=None, database=None)
@given(st.sampled_from([1.0, 27.8]), st.sampled_from([0.0, 90.0]), st.lists(EVENT, max_size=40))
def test_nothing_dangerous_ever_comes_out(gain: float, found: float, events: list[tuple[str, object]]) -> None:
    bench = Bench(gain=gain, found=found, enabled=False)
    for what, value in events:
        state, before, blocks = bench.guard.state, bench.driver.voltage, len(bench.driver.blocks)
        happen(bench, what, value)
        for block in bench.driver.blocks[blocks:]:
            voltage = np.concatenate(([before], block))
            assert np.all(np.isfinite(voltage))
            assert np.all(voltage >= LIMITS.voltage_min * (1 + 1e-12))
            assert np.all(voltage <= LIMITS.voltage_max * (1 + 1e-12))
            assert np.all(np.abs(np.diff(voltage)) <= SLEW_STEP * (1 + ROUNDING))
            if state in (RAMPING, FAULT):
                assert np.all(np.diff(np.abs(voltage)) <= 0.0)
                assert np.all(np.abs(np.diff(voltage)) <= SAFE_STEP * (1 + ROUNDING))
                assert np.all(voltage * before >= 0.0), "no swing through 0 V"
            before = block[-1]
        if bench.guard.state == FAULT:
            assert bench.driver.voltage == 0.0
            assert bench.guard.reason
    while bench.guard.state == RAMPING:
        bench.guard.ramp()
    np.testing.assert_array_equal(
        np.concatenate([*bench.driver.times, []]), np.arange(SIZE * len(bench.driver.blocks)) / RATE
    )


def test_the_voltage_found_is_that_of_the_moment_of_enabling() -> None:
    """Somebody charged the stack after the program had started."""
    bench = Bench(enabled=False)
    bench.driver.voltage = 64.0
    assert bench.guard.enable() == ""
    assert bench.command(0.0) is not None
    assert bench.driver.stack[0] == 64.0 - SLEW_STEP


def test_a_stack_outside_the_window_is_not_enabled_but_discharged() -> None:
    bench = Bench(found=160.0, enabled=False)
    assert bench.guard.enable() == ("cannot enable: the stack is at 160.00 V, outside -40 to 150 V; discharge it first")
    bench.guard.disable()
    assert (bench.guard.state, bench.driver.blocks) == (DISABLED, []), "disabled already: nothing is put out"
    bench.guard.discharge()
    way = bench.ramp_down()
    assert way[0] == pytest.approx(160.0 - SAFE_STEP)
    assert way[-1] == 0.0
    assert bench.guard.state == DISABLED
    assert bench.guard.enable() == ""


def test_discharging_at_zero_volts_is_immediate() -> None:
    bench = Bench(enabled=False)
    bench.guard.discharge()
    assert (bench.guard.state, bench.driver.blocks) == (DISABLED, [])


@pytest.mark.parametrize("current", [0.1, -0.1])
def test_over_power_is_a_fault(current: float) -> None:
    bench = Bench(dataclasses.replace(LIMITS, power=4.0))
    bench.driver.current = current
    bench.go_to(40.0)
    assert bench.guard.state == ENABLED, "4 W are the limit"
    bench.command(41.0)
    assert (bench.guard.state, bench.guard.reason) == (RAMPING, "power of 4.1 W exceeds the limit of 4 W")
