"""What the amplifier notices of the run: silence, lost and stuck sensors, an observer that disagrees, two senders."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.hardware.amplifier import Applied, SimulatedAmplifier
from pzt_ros.hardware.guard import DISABLED, ENABLED, FAULT, RAMPING, GuardedAmplifier, Limits
from pzt_ros.hardware.watch import Watch
from pzt_ros.physics.signals import Rest

RATE, SIZE = 1000.0, 10
LIMITS = Limits(
    slew_rate=1e4, command_timeout=0.5, sensor_timeout=0.3, stuck_voltage=20.0, discrepancy=1e-6, command_age=0.4
)


class Run:
    """An enabled amplifier that is watched, and a clock that the test turns."""

    def __init__(self) -> None:
        driver = SimulatedAmplifier(load_chain("thesis-p2"), Rest())
        self.guard = GuardedAmplifier(driver, LIMITS, RATE, SIZE)
        self.watch = Watch(self.guard)
        self.now = 100.0
        assert self.guard.enable() == ""
        self.watch.restart(self.now)
        self.put_out(self.guard.hold())

    def put_out(self, applied: Applied | None) -> None:
        assert applied is not None
        self.watch.put_out(applied, self.now)

    def command(self, voltage: float) -> float:
        """One block; returns its first time [s]."""
        first = self.guard.next_block * SIZE / RATE
        self.put_out(self.guard.apply(first, np.full(SIZE, voltage), self.watch.age(self.now)))
        return first

    def measure(self, first: float, reading: float | np.ndarray) -> None:
        self.watch.measured(first, np.broadcast_to(np.asarray(reading, dtype=float), (SIZE,)))

    def later(self, seconds: float) -> str:
        self.now += seconds
        self.watch.look(self.now)
        return self.guard.state


def test_a_run_that_goes_well_is_left_alone() -> None:
    run = Run()
    for block in range(200):
        first = run.command(50.0 * (1.0 - math.cos(0.1 * block)))
        run.measure(first, np.linspace(block, block + 0.9, SIZE) * 1e-8)
        run.watch.estimated(first, np.full(SIZE, 1e-7))
        run.watch.senders(1)
        assert run.later(0.29) == ENABLED


def test_silent_commands() -> None:
    run = Run()
    run.measure(0.0, 0.0)
    assert run.later(0.5) == ENABLED
    assert run.later(0.01) == FAULT
    assert run.guard.reason == "no command for 0.51 s, limit 0.50 s"


def test_a_lost_sensor_is_blamed_and_not_the_commands() -> None:
    run = Run()
    run.measure(0.0, 0.0)
    run.command(20.0)
    assert run.later(0.3) == ENABLED
    assert run.later(0.01) == RAMPING
    assert run.guard.reason == "no measurement for 0.31 s, limit 0.30 s"


def test_an_old_measurement_does_not_pay_for_a_new_block() -> None:
    run = Run()
    run.command(20.0)
    run.measure(0.0, 0.0)
    run.measure(0.0, 0.0)
    assert run.later(0.31) == RAMPING
    assert "no measurement" in run.guard.reason


def test_a_command_that_comes_too_late_is_not_put_out() -> None:
    run = Run()
    first = run.guard.next_block * SIZE / RATE
    assert run.guard.apply(first, np.full(SIZE, 5.0), run.watch.age(run.now + 0.41)) is None
    assert (run.guard.state, run.guard.reason) == (FAULT, "command is 0.41 s old, limit 0.40 s")
    assert run.guard.command_voltage == 0.0


def test_an_age_that_is_no_number_is_too_old() -> None:
    run = Run()
    assert run.guard.apply(SIZE / RATE, np.zeros(SIZE), math.nan) is None
    assert run.guard.state == FAULT


@pytest.mark.parametrize("step", [1.0, 60.0])
def test_a_stuck_sensor(step: float) -> None:
    """Whether the voltage creeps or leaps, and only once it has moved by more than the limit before the reading."""
    run = Run()
    run.measure(0.0, 3e-6)
    voltage = 0.0
    while run.guard.state == ENABLED:
        voltage += step
        assert voltage < 200.0, "never noticed"
        moved = run.guard.driver.voltage  # of the blocks before this one
        first = run.command(voltage)
        run.measure(first, 3e-6)
        assert (run.guard.state == RAMPING) == (moved > 20.0)
    assert "the sensor stays at 3.0000 um while the voltage moved by" in run.guard.reason


def test_one_changed_bit_is_enough_not_to_be_stuck() -> None:
    run = Run()
    for block in range(60):
        first = run.command(float(block))
        reading = np.full(SIZE, 3e-6)
        reading[block % SIZE] = np.nextafter(3e-6, 1.0)
        run.measure(first, reading)
    assert run.guard.state == ENABLED


def test_a_reading_that_waits_for_the_end_of_a_leap_is_not_stuck() -> None:
    """A sensor without noise that lags: the block of the leap still reads as before, the next one does not."""
    run = Run()
    run.measure(0.0, 3e-6)
    run.measure(run.command(90.0), 3e-6)
    run.measure(run.command(90.0), 8e-6)
    assert run.guard.state == ENABLED


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_reading_that_is_no_number(bad: float) -> None:
    run = Run()
    reading = np.zeros(SIZE)
    reading[7] = bad
    run.measure(0.0, reading)
    assert (run.guard.state, run.guard.reason) == (FAULT, "the sensor's reading is not a finite number")


def test_sensor_and_observer_disagree() -> None:
    run = Run()
    run.watch.estimated(0.0, np.full(SIZE, -0.99e-6))
    spike = np.zeros(SIZE)
    spike[3] = 1.0
    run.watch.estimated(0.0, spike)
    assert run.guard.state == ENABLED, "one sample is not the block"
    run.watch.estimated(0.0, np.full(SIZE, -1.5e-6))
    assert (run.guard.state, run.guard.reason) == (FAULT, "sensor and observer differ by 1.500 um, limit 1.000 um")


def test_an_observer_that_has_lost_its_numbers_is_no_disagreement_of_so_many_micrometres() -> None:
    """It may say before the sensor does that a reading is none; "differ by nan um" was told at the bench then."""
    run = Run()
    innovation = np.full(SIZE, 1e-7)
    innovation[3] = math.nan
    run.watch.estimated(0.0, innovation)
    expected = "a reading, or what was expected, is not a finite number"
    assert (run.guard.state, run.guard.reason) == (FAULT, expected)


def test_what_is_said_of_a_run_before_does_not_count() -> None:
    run = Run()
    before = run.command(0.0)
    run.guard.disable()
    assert run.guard.enable() == ""
    run.watch.restart(run.now)
    run.put_out(run.guard.hold())
    run.measure(before, math.nan)
    run.watch.estimated(before, np.full(SIZE, 1.0))
    assert run.guard.state == ENABLED
    run.watch.estimated(before + SIZE / RATE, np.full(SIZE, 1.0))
    assert run.guard.state == FAULT


def test_two_senders_trip_and_nothing_goes_on_until_one_is_gone() -> None:
    run = Run()
    run.watch.senders(2)
    reason = "2 publishers on the topic of the commands, one is allowed"
    assert (run.guard.state, run.guard.reason) == (FAULT, reason)
    assert run.guard.reset() == f"cannot reset: {reason}; see to that first, then reset again"
    run.watch.senders(3)
    assert "3 publishers" in run.guard.reset()
    run.watch.senders(1)
    assert run.guard.state == FAULT, "the reset before the cause was gone does not count"
    assert run.guard.reset() == ""
    run.watch.senders(2)
    assert run.guard.state == DISABLED
    assert run.guard.enable() == f"cannot enable: {reason}"
    run.watch.senders(0)
    assert run.guard.enable() == ""


def test_nobody_is_missed_while_disabled() -> None:
    run = Run()
    run.guard.disable()
    assert run.later(100.0) == DISABLED
    assert run.guard.enable() == ""
    run.watch.restart(run.now)
    assert run.later(0.2) == ENABLED, "what was before does not count"


def test_over_power() -> None:
    run = Run()
    run.guard.limits = Limits(power=1e-6, slew_rate=1e4)
    run.guard.apply(run.guard.next_block * SIZE / RATE, np.full(SIZE, 60.0))
    assert run.guard.state == RAMPING
    assert "exceeds the limit of 1e-06 W" in run.guard.reason


@pytest.mark.parametrize(("capacitance", "state"), [(0.0, ENABLED), (1e-9, ENABLED), (1e-3, RAMPING)])
def test_a_stack_that_takes_no_charge_is_not_connected(capacitance: float, state: str) -> None:
    """Whatever the stack is: 1 nF is less than any, 1 mF more."""
    run = Run()
    run.guard.limits = dataclasses.replace(LIMITS, capacitance_min=capacitance)
    for voltage in (10.0, 15.0, 11.0, 16.0):
        assert run.guard.state == ENABLED, "before it has moved by 20 V"
        run.command(voltage)
    assert run.guard.state == state
    assert ("is it connected?" in run.guard.reason) == (state == RAMPING)


def test_a_graph_without_a_sensor_has_none_to_lose() -> None:
    run = Run()
    run.watch = Watch(run.guard, expects_sensor=False)
    run.watch.restart(run.now)
    run.command(10.0)
    assert run.later(0.49) == ENABLED
    assert run.later(0.02) == RAMPING
    assert "no command" in run.guard.reason


PERIOD = SIZE / RATE


def paced(run: Run, *ages: float) -> str:
    """Commands that come so long after the block before them, in periods; returns the state."""
    for age in ages:
        run.watch.paced(age * PERIOD, PERIOD)
    return run.guard.state


def with_budget(late: float, window: float) -> Run:
    run = Run()
    run.guard.limits = dataclasses.replace(LIMITS, late_after=2.0, late_commands=late, late_window=window)
    return run


def test_late_commands_are_counted_and_a_budget_of_them_is_allowed() -> None:
    run = with_budget(3, 5)
    assert paced(run, 1.0, 2.1, 1.0, 2.0, 50.0, 1.0) == ENABLED
    assert run.guard.counts["late commands"] == 2


def test_a_broken_budget_is_a_fault() -> None:
    run = with_budget(3, 5)
    run.command(20.0)
    assert paced(run, 2.1, 1.0, 2.1, 1.0) == ENABLED
    assert paced(run, 2.1) == RAMPING
    assert run.guard.reason == "3 of the last 5 commands came more than 20 ms after the block before, limit 3 of 5"


def test_late_commands_further_apart_than_the_window_are_no_fault() -> None:
    run = with_budget(2, 5)
    assert paced(run, *([2.1, 1.0, 1.0, 1.0, 1.0] * 20)) == ENABLED
    assert run.guard.counts["late commands"] == 20


def test_without_a_budget_late_commands_are_only_counted() -> None:
    run = with_budget(0, 5)
    assert paced(run, *[9.0] * 100) == ENABLED
    assert run.guard.counts["late commands"] == 100


def test_enabling_anew_begins_a_new_budget() -> None:
    run = with_budget(3, 5)
    assert paced(run, 2.1, 2.1) == ENABLED
    run.watch.restart(run.now)
    assert paced(run, 2.1, 2.1) == ENABLED


class Warm(SimulatedAmplifier):
    """An amplifier with a thermometer."""

    temperature = 300.0


@pytest.mark.parametrize("temperature", [400.0, math.nan])
def test_over_temperature_is_a_fault_that_cannot_be_reset_before_it_is_cool(temperature: float) -> None:
    driver = Warm(load_chain("thesis-p2"), Rest())
    guard = GuardedAmplifier(driver, LIMITS, RATE, SIZE)
    watch = Watch(guard)
    watch.temperature()
    assert guard.enable() == ""
    guard.apply(0.0, np.full(SIZE, 20.0))
    driver.temperature = temperature
    watch.temperature()
    assert guard.state == RAMPING
    assert guard.reason == f"temperature of {temperature:.1f} K, limit 358.1 K"
    while guard.state == RAMPING:
        guard.ramp()
    assert guard.state == FAULT
    assert "see to that first" in guard.reset()
    driver.temperature = 358.0
    watch.temperature()
    assert guard.reset() == ""
    assert guard.enable() == ""


def test_too_hot_while_disabled_is_a_fault_too() -> None:
    driver = Warm(load_chain("thesis-p2"), Rest())
    guard = GuardedAmplifier(driver, LIMITS, RATE, SIZE)
    driver.temperature = 400.0
    Watch(guard).temperature()
    assert guard.state == FAULT


def test_a_thermometer_that_is_there_only_later_is_found() -> None:
    """A driver may know whether its instrument has one only once it is open."""
    run = Run()
    run.watch.temperature()
    assert run.guard.state == ENABLED
    run.guard.driver.temperature = 400.0  # type: ignore[attr-defined]
    run.watch.temperature()
    assert run.guard.state == FAULT  # at 0 V there is nothing to ramp


def test_an_amplifier_without_a_thermometer_is_not_asked() -> None:
    run = Run()
    run.watch.temperature()
    assert run.guard.state == ENABLED
