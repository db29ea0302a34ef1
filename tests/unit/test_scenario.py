"""Scenario files: what is read from them, where chains are looked for, and what is said of a mistake."""

from __future__ import annotations

from pathlib import Path

import pytest

from pzt_ros.chains import load_chain, save_chain, shipped
from pzt_ros.controllers.pi import PI
from pzt_ros.controllers.table import CONTROLLERS
from pzt_ros.errors import BenchError
from pzt_ros.experiments.phases import Move, VoltageRamp
from pzt_ros.hardware.guard import Limits
from pzt_ros.observers.disturbance import DisturbanceObserver
from pzt_ros.scenario import Scenario, Timing, load_scenario

GOOD = """
plant: thesis-p1
model: thesis-p2
phases:
  - {phase: voltage, to: 10 V, duration: 0.1 s}
  - {phase: move, to: 2 um, duration: 50 ms, controller: inverse}
"""


def load(folder: Path, text: str) -> Scenario:
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_scenario(path)


def refusal(folder: Path, text: str) -> str:
    """The one line with which a scenario is refused."""
    with pytest.raises(BenchError) as caught:
        load(folder, text)
    said = str(caught.value)
    assert "\n" not in said
    assert caught.value.exit_code == 2
    return said


@pytest.mark.parametrize("name", shipped("scenarios"))
def test_shipped_scenario_loads(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description
    assert scenario.source == shipped("scenarios")[name].resolve()
    assert set(scenario.controllers) == set(CONTROLLERS)
    spans = scenario.experiment().spans()
    assert len(spans) == len(scenario.phases)
    if scenario.manual is not None:
        assert not spans
        return
    last = [phase for phase in scenario.phases if isinstance(phase, VoltageRamp)][-1]
    assert last is scenario.phases[-1], "a shipped scenario ends with a ramp"
    assert last.to == 0.0


def test_defaults(tmp_path: Path) -> None:
    scenario = load(tmp_path, GOOD)
    assert (scenario.name, scenario.description) == ("mine", "")
    assert (scenario.plant, scenario.model) == ("thesis-p1", "thesis-p2")
    assert scenario.timing == Timing()
    assert scenario.limits == Limits()
    assert scenario.observer == DisturbanceObserver()
    assert scenario.controllers == {name: cls() for name, cls in CONTROLLERS.items()}
    assert scenario.phases == (
        VoltageRamp(to=10.0, duration=0.1),
        Move(to=2 * 1e-6, duration=0.05, controller="inverse"),
    )
    assert (scenario.sample_rate, scenario.block_size, scenario.seed) == (20e3, 100, 1)


def test_everything_can_be_said(tmp_path: Path) -> None:
    scenario = load(
        tmp_path,
        GOOD
        + """
scenario: all of it
description: "  with a description "
sample_rate: 10 kHz
block_size: 50
seed: 9
handover_time: 20 ms
limits: {voltage_max: 120 V, current: 100 mA}
observer: {observer: disturbance, gain: 50 1/s}
controllers:
  pi: {integral_gain: 1e8 V/m/s, integral_limit: 50 V}
  inverse:
""",
    )
    assert (scenario.name, scenario.description) == ("all of it", "with a description")
    assert scenario.timing == Timing(sample_rate=10e3, block_size=50.0, seed=9.0, handover_time=0.02)
    assert scenario.limits == Limits(voltage_max=120.0, current=0.1)
    assert scenario.observer == DisturbanceObserver(gain=50.0)
    assert scenario.controllers["pi"] == PI(integral_gain=1e8, integral_limit=50.0)
    assert scenario.controllers["inverse"] == CONTROLLERS["inverse"]()


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (("plant: thesis-p1\n", ""), "mine.yaml: key 'plant' is missing"),
        (("model: thesis-p2\n", ""), "mine.yaml: key 'model' is missing"),
        (("phases:", "phrases:"), "mine.yaml: unknown key 'phrases'; known are scenario, description, plant"),
        (("thesis-p1", "thesis-p9"), "chain 'thesis-p9': no such file; shipped are"),
        (("thesis-p1", "[thesis-p1]"), "no such file"),
        (("plant: thesis-p1", "plant:"), "chain 'None': no such file"),
        (("phases:", "sample_rate: 20\nphases:"), "mine.yaml.sample_rate: 20 has no unit; write '20 Hz'"),
        (("phases:", "block_size: 1\nphases:"), "mine.yaml.block_size: 1 is outside 2 to 100000"),
        (("phases:", "block_size: 2.5\nphases:"), "mine.yaml.block_size: 2.5 is not a whole number"),
        (("phases:", "seed: 1.5\nphases:"), "mine.yaml.seed: 1.5 is not a whole number"),
        (("phases:", "seed: -1\nphases:"), "mine.yaml.seed: -1 is outside 0 to"),
        (("phases:", "observer: disturbance\nphases:"), "mine.yaml: observer: expected 'observer: kind' and its gains"),
        (("phases:", "observer: [1]\nphases:"), "mine.yaml: observer: expected 'observer: kind' and its gains"),
        (("phases:", "observer: {observer: kalman}\nphases:"), "mine.yaml: unknown observer 'kalman'; known are"),
        (("phases:", "observer: {observer: [1]}\nphases:"), "mine.yaml: unknown observer [1]; known are disturbance"),
        (("phases:", "observer: {gain: 5}\nphases:"), "mine.yaml: observer.gain: 5 has no unit"),
        (("phases:", "controllers: pi\nphases:"), "mine.yaml: controllers: expected a controller's name and its gains"),
        (
            ("phases:", "controllers: {pid: {}}\nphases:"),
            "mine.yaml: unknown controller 'pid'; known are open_loop, pi",
        ),
        (("phases:", "controllers: {pi: 5}\nphases:"), "mine.yaml: controllers.pi: expected 'name: value' lines"),
        (("phases:", "controllers: {pi: {Ki: 5}}\nphases:"), "mine.yaml: controllers.pi: unknown parameter 'Ki'"),
        (("phases:", "limits: 5\nphases:"), "mine.yaml: limits: expected 'name: value' lines, found 5"),
        (("phases:", "limits: {voltage_max: 900 V}\nphases:"), "limits.voltage_max: 900 V is outside 0 to 200 V"),
        (
            ("phase: voltage", "phase: jump"),
            "mine.yaml: phase 1: expected 'phase: kind', kind one of voltage, move, scan",
        ),
        (("phase: voltage", "phase: [voltage]"), "mine.yaml: phase 1: expected 'phase: kind'"),
        (("phase: voltage, ", ""), "mine.yaml: phase 1: expected 'phase: kind'"),
        (("{phase: voltage, to: 10 V, duration: 0.1 s}", "wait"), "mine.yaml: phase 1: expected 'phase: kind'"),
        (("to: 10 V, ", ""), "mine.yaml: phase 1 (voltage): parameter 'to' is missing (voltage at the end)"),
        (("2 um", "2 V"), "mine.yaml: phase 2 (move).to: '2 V' cannot be read as m"),
        (("50 ms", "0 s"), "mine.yaml: phase 2 (move).duration: 0 s is outside 1e-06 to 100000 s"),
        (("inverse}", "pid}"), "mine.yaml: phase 2: unknown controller 'pid'; known are open_loop, pi"),
        (("inverse}", "5}"), "mine.yaml: phase 2 (move).controller: 5 is not a word"),
        (("2 um", "2,5 um"), "mine.yaml: phase 2"),
        ((GOOD, "plant: thesis-p1\nmodel: thesis-p1\nphases: []"), "mine.yaml: phases: expected a list of phases"),
        ((GOOD, "plant: thesis-p1\nmodel: thesis-p1\nphases:"), "phases: expected a list of phases, found None"),
        ((GOOD, "- 1"), "mine.yaml: not a scenario"),
        ((GOOD, ""), "mine.yaml: not a scenario"),
        ((GOOD, "a: [}"), "mine.yaml: line 1: not valid YAML"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, change: tuple[str, str], found: str) -> None:
    assert change[0] in GOOD
    assert found in refusal(tmp_path, GOOD.replace(*change))


def test_no_such_scenario_names_the_shipped_ones() -> None:
    with pytest.raises(BenchError, match=r"scenario 'nothing': no such file; shipped are demo, full-loop"):
        load_scenario("nothing")


@pytest.mark.parametrize("name", ["my-stage.yaml", "chains/my-stage.yaml", "my-stage.yml"])
def test_a_relative_chain_stands_beside_the_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    chain = load_chain("thesis-p3")
    save_chain(chain, tmp_path / "bench" / name)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    scenario = load(tmp_path / "bench", GOOD.replace("thesis-p1", name))
    assert Path(scenario.plant) == tmp_path / "bench" / name
    assert load_chain(scenario.plant) == chain
    assert scenario.model == "thesis-p2"


def test_a_broken_chain_is_found_when_the_scenario_is_read(tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("links: [{link: piezo}]", encoding="utf-8")
    assert "bad.yaml: link 1: unknown link 'piezo'" in refusal(tmp_path, GOOD.replace("thesis-p2", "bad.yaml"))
