"""Manual operation without ROS: holding, trajectories through the whole loop, what is refused, and poling."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pzt_ros.errors import BenchError
from pzt_ros.experiments.trajectory import Trajectory
from pzt_ros.hardware.limits import Limits
from pzt_ros.loop import InProcessLoop, Tick, foresee
from pzt_ros.manual import ManualConductor, conductor
from pzt_ros.reference import VOLTAGE
from pzt_ros.scenario import REAL_TIME, Scenario, load_scenario

QUICK = """
plant: bench-stage
model: thesis-p2
block_size: 100
rate: real time
controllers: {inverse_pi: {integral_gain: 100 1/s}}
manual: {poling_voltage: 140 V, poling_ramp: 0.2 s, poling_hold: 0.1 s}
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Scenario:
    path = tmp_path / "manual.yaml"
    path.write_text(QUICK, encoding="utf-8")
    return load_scenario(path)


def line(*points: tuple[float, float]) -> Trajectory:
    rows = np.array(points).reshape(-1, 2)
    return Trajectory(("stage",), 0.0, rows[:, 0], rows[:, 1], np.full(len(rows), np.nan))


def operator(loop: InProcessLoop) -> ManualConductor:
    assert isinstance(loop.experiment, ManualConductor)
    return loop.experiment


def run(loop: InProcessLoop, tick: Tick, seconds: float) -> list[Tick]:
    ticks = [tick]
    for _ in range(round(seconds * 200)):
        following = loop.step(ticks[-1])
        assert following is not None
        ticks.append(following)
    return ticks[1:]


def together(ticks: list[Tick], of: Callable[[Tick], np.ndarray]) -> np.ndarray:
    return np.concatenate([of(tick) for tick in ticks])


def asked(tick: Tick) -> np.ndarray:
    assert tick.reference is not None
    return tick.reference.values


def test_it_holds_where_the_stage_was_found_without_a_jump(scenario: Scenario) -> None:
    loop = InProcessLoop(scenario)
    first = loop.start()
    ticks = run(loop, first, 0.5)
    np.testing.assert_array_equal(together(ticks, asked), first.measurement.mean())
    voltage = together([first, *ticks], lambda tick: tick.applied.voltage)
    assert np.max(np.abs(np.diff(voltage))) < 0.1
    assert np.ptp(together(ticks, lambda tick: tick.truth.displacement)) < 0.2e-6


def test_it_follows_a_trajectory_and_holds_its_last_position(scenario: Scenario) -> None:
    loop = InProcessLoop(scenario)
    before = run(loop, loop.start(), 0.1)
    here = before[-1].reference
    assert here is not None
    operator(loop).follow(line((0.2, 4e-6), (0.5, 3e-6)))
    assert operator(loop).doing == "trajectory"
    ticks = run(loop, before[-1], 1.0)
    assert operator(loop).doing == "hold"
    time = together(ticks, lambda tick: tick.applied.time)
    begin = here.time[-1]
    knots, places = begin + np.array([0.0, 0.2, 0.5]), [here.values[-1], 4e-6, 3e-6]
    np.testing.assert_allclose(together(ticks, asked), np.interp(time, knots, places), rtol=0, atol=1e-15)
    late = together(ticks[-40:], lambda tick: tick.truth.displacement)
    assert np.max(np.abs(late - 3e-6)) < 0.1e-6


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([(0.5, 40e-6)], "beyond the stroke"),
        ([(1e-5, 5e-6)], "slew rate"),
        ([(0.0, 5e-6), (1.0, 4e-6)], "slew rate"),
        ([(0.5, -5e-6)], "it cannot be followed"),
        ([(0.5, 2e-6), (0.5001, 6e-6), (1.0, 2e-6)], "slew rate"),
    ],
)
def test_what_cannot_be_followed_is_refused_and_the_present_one_stays(
    scenario: Scenario, points: list[tuple[float, float]], expected: str
) -> None:
    loop = InProcessLoop(scenario)
    ticks = run(loop, loop.start(), 0.05)
    operator(loop).follow(line((0.2, 4e-6)))
    with pytest.raises(BenchError, match=expected):
        operator(loop).follow(line(*points))
    assert asked(run(loop, ticks[-1], 0.25)[-1])[-1] == 4e-6


def test_the_limits_of_the_scenario_count(scenario: Scenario) -> None:
    weak = dataclasses.replace(scenario, limits=dataclasses.replace(scenario.limits, current=1e-6))
    manual = conductor(weak)
    assert isinstance(manual, ManualConductor)
    manual.observe(np.arange(100) / 20e3, np.zeros(100))
    manual.step(1, 1e-6, 0.0)
    with pytest.raises(BenchError, match=r"current of .* the limit is 1e-06 A"):
        manual.follow(line((0.2, 4e-6)))


def test_it_poles_as_the_thesis_does_and_holds_where_it_ends(scenario: Scenario) -> None:
    loop = InProcessLoop(scenario)
    before = run(loop, loop.start(), 0.05)
    length = operator(loop).pole()
    assert length == pytest.approx(0.5)
    with pytest.raises(BenchError, match=r"being poled for another 0\.5 s"):
        operator(loop).follow(line((0.2, 5e-6)))
    with pytest.raises(BenchError, match="cannot pole: the stage is being poled for another"):
        operator(loop).pole()
    ticks = run(loop, before[-1], length)
    assert all(tick.reference is not None and tick.reference.quantity == VOLTAGE for tick in ticks)
    voltage = together(ticks, lambda tick: tick.applied.voltage)
    assert voltage.max() == pytest.approx(140.0)
    assert voltage[-1] == pytest.approx(0.0, abs=1e-9)
    after = run(loop, ticks[-1], 0.2)
    assert operator(loop).doing == "hold"
    np.testing.assert_array_equal(together(after, asked), ticks[-1].measurement.mean())
    whole = together([ticks[-1], *after], lambda tick: tick.applied.voltage)
    assert np.max(np.abs(np.diff(whole))) < 0.1, "no jump from poling to holding"
    assert np.mean(ticks[-1].truth.displacement) > np.mean(before[-1].truth.displacement) + 0.1e-6, "it is poled"


def test_poling_beyond_the_limits_is_refused(scenario: Scenario) -> None:
    narrow = dataclasses.replace(scenario, limits=Limits(voltage_max=120.0))
    loop = InProcessLoop(narrow)
    loop.step(loop.start())
    with pytest.raises(BenchError, match=r"takes 140 V, and limits\.voltage_max is 120 V"):
        operator(loop).pole()


def test_after_a_gap_it_begins_anew_where_the_stage_is(scenario: Scenario) -> None:
    manual = conductor(scenario)
    assert isinstance(manual, ManualConductor)
    first = manual.step(1, 5e-6, 0.0)
    assert first.controller == "inverse_pi"
    manual.observe(np.arange(100) / 20e3, np.zeros(100))
    manual.follow(line((1.0, 5.5e-6)))
    assert manual.step(2, 5e-6, 0.0).values[-1] > 5e-6
    again = manual.step(70, 2e-6, 0.0)
    np.testing.assert_array_equal(again.values, 2e-6)
    assert again.controller == "", "whoever chose another controller meanwhile keeps it"
    assert manual.doing == "hold"


def test_the_shipped_scenario_is_for_an_operator_and_in_real_time() -> None:
    scenario = load_scenario("manual")
    assert scenario.manual is not None
    assert scenario.phases == ()
    assert scenario.rate == REAL_TIME
    assert foresee(scenario) == []


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (("manual: {", "phases: []\nmanual: {"), "say either 'phases:', a list of them, or 'manual:'"),
        (("manual: {", "manually: {"), "unknown key 'manually'"),
        (("manual: {", "manual: {controller: pid, "), "unknown controller 'pid'"),
        (("manual: {", "manual: {speed: 1, "), "unknown parameter 'speed'"),
        (("140 V", "300 V"), "poling_voltage: 300 V is outside 0 to 200 V"),
        (("real time", "quickly"), "rate 'quickly' is not one of"),
    ],
)
def test_mistakes_in_the_scenario(tmp_path: Path, change: tuple[str, str], expected: str) -> None:
    path = tmp_path / "manual.yaml"
    path.write_text(QUICK.replace(*change), encoding="utf-8")
    with pytest.raises(BenchError) as caught:
        load_scenario(path)
    assert expected in str(caught.value)
