"""One battery for every driver: whoever stands in the table of amplifiers or sensors is tested here, unasked."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driver_benches import RATE, SIZE, ready

from pzt_ros.chains import load_chain
from pzt_ros.errors import BenchError
from pzt_ros.hardware.amplifier import AmplifierDriver, Applied, Thermometer
from pzt_ros.hardware.driver import Bench
from pzt_ros.hardware.guard import DISABLED, ENABLED, RAMPING, GuardedAmplifier, Limits
from pzt_ros.hardware.stage import SensorDriver
from pzt_ros.hardware.table import AMPLIFIERS, SENSORS, find_amplifier, find_sensor
from pzt_ros.physics.signals import Rest
from pzt_ros.quantities import choices_of, parameters_of, to_si
from pzt_ros.reference import block_times

pytestmark = pytest.mark.timeout(60)

LIMITS = Limits(voltage_min=-20.0, voltage_max=120.0, slew_rate=2e3)
STEP = LIMITS.slew_rate / RATE
SETTINGS = [*((kind, cls) for kind, cls in AMPLIFIERS.items()), *((kind, cls) for kind, cls in SENSORS.items())]


def bench(voltage: float = 0.0) -> Bench:
    return Bench(load_chain("bench-stage"), Rest(voltage=voltage, seed=1), RATE, SIZE)


@pytest.fixture(params=AMPLIFIERS)
def amplifier(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[AmplifierDriver]:
    """One amplifier after the other, opened, 0 V at the stack."""
    with ready(AMPLIFIERS[request.param], tmp_path) as settings:
        driver = settings.build(bench())
        driver.open()
        yield driver
        driver.close()


@pytest.fixture(params=SENSORS)
def sensor(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[SensorDriver]:
    """One sensor after the other, opened."""
    with ready(SENSORS[request.param], tmp_path) as settings:
        driver = settings.build(bench())
        driver.open()
        yield driver
        driver.close()


def assert_block(values: Any) -> None:
    assert isinstance(values, np.ndarray)
    assert values.shape == (SIZE,)
    assert values.dtype == np.float64
    assert np.all(np.isfinite(values))


@pytest.mark.parametrize(("kind", "settings"), SETTINGS)
def test_settings_are_declared(kind: str, settings: Any) -> None:
    assert settings.kind == kind
    assert settings.__doc__
    numbers, words = parameters_of(settings), choices_of(settings)
    assert {*numbers, *words} == {f.name for f in dataclasses.fields(settings)}
    for name, declared in numbers.items():
        assert to_si(1 if declared.unit == "1" else f"1 {declared.unit}", declared.unit, name) == 1.0
        assert len(declared.description) > 5
        assert -math.inf < declared.lower <= getattr(settings(), name) <= declared.upper < math.inf
    for name, word in words.items():
        assert len(word.description) > 5
        assert isinstance(getattr(settings(), name), str)


def test_tables_begin_with_the_simulated_one_and_name_what_they_know() -> None:
    assert next(iter(AMPLIFIERS)) == next(iter(SENSORS)) == "simulated"
    for kind, cls in AMPLIFIERS.items():
        assert find_amplifier(kind) is cls
    for kind, cls in SENSORS.items():
        assert find_sensor(kind) is cls
    with pytest.raises(BenchError, match="unknown amplifier driver 'labjack'; known are simulated, "):
        find_amplifier("labjack")
    with pytest.raises(BenchError, match="unknown sensor driver 'labjack'; known are simulated, "):
        find_sensor("labjack")


# -- amplifiers


def test_applied_is_a_block_of_finite_numbers(amplifier: AmplifierDriver) -> None:
    amplifier.warm_up()
    for block in range(3):
        time, command = block_times(block, SIZE, RATE), np.linspace(block, block + 1.0, SIZE)
        kept = command.copy()
        applied = amplifier.apply(time, command)
        for values in (applied.time, applied.voltage, applied.current, applied.charge):
            assert_block(values)
        np.testing.assert_array_equal(applied.time, time)
        np.testing.assert_array_equal(command, kept, err_msg="it changes nothing it was given")
        assert amplifier.voltage == pytest.approx(applied.voltage[-1], abs=1e-6)


def test_gain_and_remark(amplifier: AmplifierDriver) -> None:
    assert math.isfinite(amplifier.gain)
    assert amplifier.gain > 0.0
    assert isinstance(amplifier.remark, str)
    assert "\n" not in amplifier.remark


def test_opening_and_warming_up_put_nothing_out(amplifier: AmplifierDriver) -> None:
    found = amplifier.voltage
    amplifier.warm_up()
    assert amplifier.voltage == found


@pytest.mark.parametrize("kind", AMPLIFIERS)
def test_close_leaves_zero_volts_and_may_be_called_again(kind: str, tmp_path: Path) -> None:
    with ready(AMPLIFIERS[kind], tmp_path) as settings:
        driver = settings.build(bench())
        driver.open()
        driver.apply(block_times(0, SIZE, RATE), np.linspace(0.0, 10.0, SIZE) / driver.gain)
        driver.close()
        assert driver.voltage == 0.0
        driver.close()


@pytest.mark.parametrize("kind", AMPLIFIERS)
def test_an_amplifier_may_be_opened_again(kind: str, tmp_path: Path) -> None:
    with ready(AMPLIFIERS[kind], tmp_path) as settings:
        driver = settings.build(bench())
        runs = []
        for block in range(2):
            driver.open()
            runs.append(driver.apply(block_times(2 * block, SIZE, RATE), np.linspace(0.0, 5.0, SIZE) / driver.gain))
            driver.apply(block_times(2 * block + 1, SIZE, RATE), np.linspace(5.0, 0.0, SIZE) / driver.gain)
            driver.close()
    for applied in runs:
        for values in (applied.voltage, applied.current, applied.charge):
            assert_block(values)
    if kind != "replay":  # which goes on in its record
        np.testing.assert_allclose(runs[1].voltage, runs[0].voltage, atol=1e-6)


def test_a_temperature_is_a_number(amplifier: AmplifierDriver) -> None:
    if isinstance(amplifier, Thermometer):
        assert 200.0 < amplifier.temperature < 600.0


class Counting:
    """Hands everything on to a driver and counts the blocks."""

    def __init__(self, driver: AmplifierDriver) -> None:
        self._driver = driver
        self.blocks: list[np.ndarray] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._driver, name)

    def apply(self, time: np.ndarray, command_voltage: np.ndarray) -> Applied:
        self.blocks.append(command_voltage)
        return self._driver.apply(time, command_voltage)


@pytest.mark.parametrize(
    "refused",
    [
        np.full(SIZE, math.nan),
        np.full(SIZE, math.inf),
        np.zeros(SIZE - 1),
        np.zeros(SIZE + 1),
        np.zeros((SIZE, 1)),
        np.zeros(0),
    ],
    ids=["nan", "inf", "short", "long", "two-dimensional", "empty"],
)
def test_a_refused_block_does_not_reach_the_driver(amplifier: AmplifierDriver, refused: np.ndarray) -> None:
    counting = Counting(amplifier)
    guard = GuardedAmplifier(counting, LIMITS, RATE, SIZE)
    assert guard.enable() == ""
    before = amplifier.voltage
    assert guard.apply(0.0, refused) is None
    assert guard.apply(0.5, np.zeros(SIZE)) is None, "out of turn"
    assert counting.blocks == []
    assert amplifier.voltage == before


def test_what_reaches_the_driver_is_inside_window_and_slew_rate(amplifier: AmplifierDriver) -> None:
    counting = Counting(amplifier)
    guard = GuardedAmplifier(counting, LIMITS, RATE, SIZE)
    assert guard.enable() == ""
    guard.hold()
    for wanted in (1e6, -1e6, 30.0):
        guard.apply(guard.next_block * SIZE / RATE, np.full(SIZE, wanted))
    sent = np.concatenate(counting.blocks) * amplifier.gain
    assert sent.min() >= LIMITS.voltage_min
    assert sent.max() <= LIMITS.voltage_max
    assert np.max(np.abs(np.diff(sent))) <= STEP * (1 + 1e-9)
    assert guard.state == ENABLED, guard.reason
    guard.disable()
    for _ in range(100):
        if guard.state == RAMPING:
            guard.ramp()
    assert guard.state == DISABLED, guard.reason
    assert guard.command_voltage == 0.0


@pytest.mark.parametrize("kind", AMPLIFIERS)
def test_enabling_at_a_charged_stack_does_not_jump(kind: str, tmp_path: Path) -> None:
    with ready(AMPLIFIERS[kind], tmp_path, voltage=60.0) as settings:
        driver = settings.build(bench(60.0))
        driver.open()
        counting = Counting(driver)
        guard = GuardedAmplifier(counting, LIMITS, RATE, SIZE)
        found = driver.voltage
        assert found == pytest.approx(60.0, abs=1e-6)
        assert guard.enable() == ""
        guard.hold()
        guard.apply(guard.next_block * SIZE / RATE, np.zeros(SIZE))
        sent = np.concatenate(([found], np.concatenate(counting.blocks) * driver.gain))
        assert np.max(np.abs(np.diff(sent))) <= STEP * (1 + 1e-9)
        driver.close()


# -- sensors


def test_a_reading_is_a_block_of_finite_numbers(sensor: SensorDriver) -> None:
    sensor.warm_up()
    for block in range(3):
        time, truth = block_times(block, SIZE, RATE), np.linspace(0.0, 1e-6, SIZE)
        kept = truth.copy()
        assert_block(sensor.read(time, truth))
        np.testing.assert_array_equal(truth, kept, err_msg="it changes nothing it was given")


def test_a_sensor_may_be_opened_again(sensor: SensorDriver) -> None:
    for block in range(2):
        assert_block(sensor.read(block_times(block, SIZE, RATE), np.zeros(SIZE)))
        sensor.close()
        sensor.open()
    assert_block(sensor.read(block_times(2, SIZE, RATE), np.zeros(SIZE)))


def test_a_sensor_may_be_closed_again(sensor: SensorDriver) -> None:
    assert "\n" not in sensor.remark
    sensor.close()
    sensor.close()
