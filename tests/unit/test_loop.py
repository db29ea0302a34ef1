"""The closed loop in one process: where the stage is its model, without noise, every error is the loop's."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pzt_ros.chains import load_chain, save_chain
from pzt_ros.errors import RunFailedError
from pzt_ros.loop import InProcessLoop, Tick, run_in_process
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.reference import DISPLACEMENT, block_times
from pzt_ros.scenario import Scenario, load_scenario

TINY = """
plant: thesis-p2
model: thesis-p2
block_size: 100
phases:
  - {phase: voltage, to: 150 V, duration: 0.1 s}
  - {phase: voltage, to: 20 V, duration: 0.1 s}
  - {phase: move, to: 6 um, duration: 0.2 s, controller: inverse}
  - {phase: scan, low: 6 um, peak_to_peak: 5 um, frequency: 10 Hz, cycles: 2}
"""
SCAN = slice(20 + 20 + 40, None)
"""Samples of the scan, in blocks, counted from the first reference."""


def scenario(folder: Path, text: str = TINY) -> Scenario:
    path = folder / "tiny.yaml"
    path.write_text(text, encoding="utf-8")
    return load_scenario(path)


def ticks_of(tiny: Scenario) -> list[Tick]:
    ticks: list[Tick] = []
    run_in_process(tiny, ticks.append)
    return ticks


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    return scenario(tmp_path_factory.mktemp("tiny"))


@pytest.fixture(scope="module")
def ticks(tiny: Scenario) -> list[Tick]:
    return ticks_of(tiny)


def test_watch_sees_every_tick(tiny: Scenario, ticks: list[Tick]) -> None:
    assert len(ticks) == 1 + round(tiny.experiment().length * tiny.sample_rate / tiny.block_size)
    for block, tick in enumerate(ticks):
        for time in (tick.applied.time, tick.truth.time, tick.estimate.time):
            np.testing.assert_array_equal(time, block_times(block, 100, 20e3))
        if tick.reference is not None:
            np.testing.assert_array_equal(tick.reference.time, tick.applied.time)


def test_block_0_is_the_voltage_found_held(ticks: list[Tick]) -> None:
    assert ticks[0].reference is None
    assert ticks[0].command_voltage is None
    np.testing.assert_array_equal(ticks[0].applied.voltage, np.zeros(100))
    assert all(tick.reference is not None and tick.command_voltage is not None for tick in ticks[1:])


def test_inverse_tracks_on_its_own_model(ticks: list[Tick]) -> None:
    scan = ticks[1:][SCAN]
    assert len(scan) == 40
    assert all(tick.reference is not None and tick.reference.quantity == DISPLACEMENT for tick in scan)
    asked = np.concatenate([tick.reference.values for tick in scan if tick.reference is not None])
    true = np.concatenate([tick.truth.displacement for tick in scan])
    assert np.ptp(asked) == pytest.approx(5e-6, rel=1e-3)
    assert np.sqrt(np.mean((true - asked) ** 2)) < 1e-9


def test_without_noise_measurement_and_estimate_are_the_truth(ticks: list[Tick]) -> None:
    for tick in ticks:
        np.testing.assert_array_equal(tick.measurement, tick.truth.displacement)
        np.testing.assert_allclose(tick.estimate.displacement, tick.truth.displacement, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(tick.estimate.polarization, tick.truth.polarization)


def test_the_hysteresis_observer_sees_what_a_run_does(tmp_path: Path, ticks: list[Tick]) -> None:
    """Chosen by name, it takes the place of the other; on the stage's own model it is off by what its noise allows."""
    observed = ticks_of(scenario(tmp_path, TINY + "observer: {observer: hysteresis, members: 4}\n"))
    errors = [np.max(np.abs(tick.estimate.displacement - tick.truth.displacement)) for tick in observed[1:]]
    assert max(errors) < 1e-7
    for tick, other in zip(observed, ticks, strict=True):
        np.testing.assert_array_equal(tick.applied.voltage, other.applied.voltage)


def test_a_good_run_meets_no_limit(tiny: Scenario) -> None:
    loop = InProcessLoop(tiny)
    tick: Tick | None = loop.start()
    while tick is not None:
        tick = loop.step(tick)
    assert not +loop.amplifier.counts
    assert loop.amplifier.state == "enabled"


def test_a_run_repeats_to_the_bit(tiny: Scenario, ticks: list[Tick]) -> None:
    for one, other in zip(ticks_of(tiny), ticks, strict=True):
        np.testing.assert_array_equal(one.applied.voltage, other.applied.voltage)
        np.testing.assert_array_equal(one.applied.current, other.applied.current)
        np.testing.assert_array_equal(one.truth.displacement, other.truth.displacement)


def test_an_amplifier_with_gain_changes_the_command_alone(tmp_path: Path, ticks: list[Tick]) -> None:
    """The same ceramic behind 16 V per volt; 16, so that nothing is rounded."""
    plain = load_chain("thesis-p2")
    save_chain(dataclasses.replace(plain, links=(Amplifier(gain=16.0), *plain.links)), tmp_path / "amplified.yaml")
    amplified = ticks_of(scenario(tmp_path, TINY.replace("thesis-p2", "amplified.yaml")))
    for one, other in zip(amplified, ticks, strict=True):
        np.testing.assert_allclose(one.applied.voltage, other.applied.voltage, rtol=0, atol=1e-9)
        np.testing.assert_allclose(one.truth.displacement, other.truth.displacement, rtol=0, atol=1e-15)
        if one.command_voltage is not None and other.command_voltage is not None:
            np.testing.assert_allclose(16 * one.command_voltage, other.command_voltage, rtol=0, atol=1e-9)


def test_a_fault_ends_the_run_with_its_reason(tmp_path: Path) -> None:
    limited = scenario(tmp_path, TINY + "limits: {current: 1 mA}\n")
    with pytest.raises(RunFailedError, match=r"at 0\.0\d+ s .* ramping: current of .* mA exceeds the limit of 1.0 mA"):
        run_in_process(limited, lambda tick: None)
