"""What is asked beyond stroke, slew or current is refused or planned anew, with the error that then comes true."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.controllers.bounds import Bounds
from pzt_ros.controllers.controller import Feedback
from pzt_ros.controllers.feasible import Forecast, forecast, replanned, require
from pzt_ros.controllers.inverse import Inverse
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.errors import BenchError
from pzt_ros.loop import foresee, refuse_what_cannot_be, run_in_process
from pzt_ros.physics.chain import ChainState
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference
from pzt_ros.scenario import load_scenario

RATE = 20e3
MODEL = load_chain("thesis-p2").behind_amplifier
POLING = np.concatenate((np.linspace(0.0, 150.0, 2000), np.linspace(150.0, 60.0, 2000)))
TIME = np.arange(1, POLING.size + 1) / RATE
LAST = (float(TIME[-1]), 60.0)


@pytest.fixture(scope="module")
def poled() -> tuple[ChainState, float]:
    """State and displacement [m] after poling, at 60 V."""
    state, out = MODEL.step(MODEL.init(Rest()), Signals(TIME, POLING))
    return state, float(out.displacement[-1])


def sine(here: float, amplitude: float, frequency: float, samples: int = 4000) -> Signals:
    since = np.arange(1, samples + 1) / RATE
    return Signals(LAST[0] + since, displacement=here + amplitude / 2 * (1.0 - np.cos(2 * np.pi * frequency * since)))


def ask(
    poled: tuple[ChainState, float], signals: Signals, bounds: Bounds | None = None, current: float = 0.2
) -> Forecast:
    return forecast(MODEL, poled[0], signals, bounds or Bounds(), last=LAST, current=current)


def test_what_can_be_followed_is(poled: tuple[ChainState, float]) -> None:
    found = ask(poled, sine(poled[1], 2e-6, 10.0))
    assert found.feasible
    require(found)
    assert np.max(np.abs(found.error)) < 1e-10
    again, slower = replanned(MODEL, poled[0], sine(poled[1], 2e-6, 10.0), Bounds(), last=LAST, current=0.2)
    assert slower == 1.0
    np.testing.assert_array_equal(again.voltage, found.voltage)


def test_beyond_the_stroke_is_refused_with_the_error(poled: tuple[ChainState, float]) -> None:
    found = ask(poled, sine(poled[1], 8e-6, 10.0))
    with pytest.raises(BenchError, match=r"is beyond the stroke: it takes \d+\.?\d* V of -40 to 150 V; expected error"):
        require(found)
    assert found.voltage.max() == 150.0


def test_the_error_that_was_said_comes_true(poled: tuple[ChainState, float]) -> None:
    """The same reference through the control loop, on the stage itself."""
    signals = sine(poled[1], 8e-6, 10.0)
    said = ask(poled, signals)
    loop = ControlLoop(MODEL, {"inverse": Inverse(handover_time=1e-3)}, Rest(), active="inverse")
    loop.follow(TIME, POLING)
    state, errors, voltage, time = poled[0], [], POLING[-40:], TIME[-40:]
    reading = MODEL.step(MODEL.init(Rest()), Signals(TIME, POLING))[1].displacement[-40:]
    for begin in range(0, signals.time.size, 40):
        part = slice(begin, begin + 40)
        reference = Reference(DISPLACEMENT, signals.time[part], signals.displacement[part])
        voltage = loop.step(reference, Feedback(time, voltage, reading, reading))
        time = signals.time[part]
        state, out = MODEL.step(state, Signals(time, voltage))
        reading = out.displacement
        errors.append(reference.values - reading)
    came = np.sqrt(np.mean(np.concatenate(errors) ** 2))
    assert loop.limited > 0
    assert came == pytest.approx(np.sqrt(np.mean(said.error**2)), rel=0.05)


def test_below_the_stack_is_out_of_reach(poled: tuple[ChainState, float]) -> None:
    found = ask(poled, sine(poled[1], -2e-5, 10.0), Bounds(voltage_min=-1000.0))
    assert not found.feasible


@pytest.mark.parametrize(
    ("bounds", "current", "reason"),
    [
        (Bounds(slew_rate=1e3), 0.2, r"takes a slew rate of .* V/s, the limit is 1e\+03 V/s"),
        (Bounds(), 1e-3, r"takes a current of .* A, the limit is 0.001 A"),
    ],
)
def test_too_fast_is_refused_or_slowed_down(
    poled: tuple[ChainState, float], bounds: Bounds, current: float, reason: str
) -> None:
    signals = sine(poled[1], 2e-6, 50.0)
    with pytest.raises(BenchError, match=reason):
        require(ask(poled, signals, bounds, current))
    found, slower = replanned(MODEL, poled[0], signals, bounds, last=LAST, current=current)
    assert 1.0 < slower < 20.0
    assert found.feasible
    assert found.reference.max() == pytest.approx(signals.displacement.max(), abs=1e-9)
    assert np.max(np.abs(np.diff(found.voltage))) * RATE <= bounds.slew_rate * (1.0 + 1e-6)
    assert np.max(np.abs(found.current)) <= current
    assert np.max(np.abs(found.error)) < 1e-10


def test_a_reference_that_is_no_number_is_refused(poled: tuple[ChainState, float]) -> None:
    signals = sine(poled[1], 2e-6, 50.0)
    signals.displacement[7] = np.nan
    with pytest.raises(BenchError, match=r"reference of nan m at .* s; give finite numbers"):
        ask(poled, signals)


SCENARIO = """
plant: thesis-p2
model: thesis-p2
phases:
  - {phase: voltage, to: 150 V, duration: 0.1 s}
  - {phase: voltage, to: 20 V, duration: 0.1 s}
  - {phase: move, to: 6 um, duration: 0.2 s, controller: inverse}
  - {phase: scan, low: 6 um, peak_to_peak: STROKE, frequency: 10 Hz, cycles: 2}
"""


def scenario_of(folder: Path, stroke: str) -> Path:
    path = folder / "asked.yaml"
    path.write_text(SCENARIO.replace("STROKE", stroke), encoding="utf-8")
    return path


def test_a_scenario_is_foreseen_as_it_then_runs(tmp_path: Path) -> None:
    scenario = load_scenario(scenario_of(tmp_path, "5 um"))
    move, scan = foresee(scenario)
    assert move.feasible
    assert scan.feasible
    refuse_what_cannot_be(scenario)
    ticks = []
    run_in_process(scenario, ticks.append)
    ran = np.concatenate(
        [tick.applied.voltage for tick in ticks if tick.reference and tick.reference.quantity != VOLTAGE]
    )
    np.testing.assert_allclose(np.concatenate((move.voltage, scan.voltage))[-2000:], ran[-2000:], atol=1e-3)


def test_a_scenario_beyond_the_stroke_is_refused(tmp_path: Path) -> None:
    scenario = load_scenario(scenario_of(tmp_path, "15 um"))
    with pytest.raises(BenchError, match=r"reference refused: 21 um at .* is beyond the stroke"):
        refuse_what_cannot_be(scenario)
    slow = dataclasses.replace(scenario, limits=dataclasses.replace(scenario.limits, current=1e-5))
    with pytest.raises(BenchError, match="current of"):
        refuse_what_cannot_be(slow)
