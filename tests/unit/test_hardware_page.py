"""docs/safety.md is what the safety machine is; docs/hardware.md names the drivers, and its examples work."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from pzt_bringup.plan import RATES, Plan, node_parameters
from pzt_ros.chains import load_chain
from pzt_ros.errors import BenchError
from pzt_ros.hardware import machine
from pzt_ros.hardware.choose import Drivers, as_parameters, load_drivers
from pzt_ros.hardware.driver import Bench, DriverError
from pzt_ros.hardware.guard import GuardedAmplifier, Limits
from pzt_ros.hardware.replay import ReplaySensorSettings
from pzt_ros.hardware.table import AMPLIFIERS, SENSORS
from pzt_ros.physics.signals import Rest
from pzt_ros.scenario import load_scenario

DOCS = Path(__file__).parents[2] / "docs"


def written() -> str:
    spec = importlib.util.spec_from_file_location("make_safety", DOCS / "make_safety.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return str(module.text())


def test_the_page_is_up_to_date() -> None:
    assert (DOCS / "safety.md").read_text(encoding="utf-8") == written(), "run python docs/make_safety.py"


def test_the_drawing_has_every_arrow_of_the_table_and_no_other() -> None:
    arrows = set(re.findall(r"^    (\w+) --> (\w+):", written(), re.MULTILINE))
    expected = {(a, step.state) for a, row in machine.TABLE.items() for step in row.values() if step.state != a}
    assert arrows == expected


def test_every_driver_has_its_line_in_the_page() -> None:
    page = (DOCS / "hardware.md").read_text(encoding="utf-8")
    for kind, settings in [*AMPLIFIERS.items(), *SENSORS.items()]:
        assert f"`{kind}`" in page
        assert settings.__module__.replace(".", "/") + ".py" in page


def test_the_driver_in_the_page_is_complete(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (DOCS / "hardware.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (tmp_path / "dac_of_the_page.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    settings = importlib.import_module("dac_of_the_page").DacSettings(gain=10.0)
    driver = settings.build(Bench(load_chain("thesis-p2"), Rest(), 1e3, 10))
    with pytest.raises(DriverError, match="open it first"):
        driver.apply(np.arange(10) / 1e3, np.zeros(10))
    driver.open()
    guard = GuardedAmplifier(driver, Limits(), 1e3, 10)
    assert guard.enable() == ""
    applied = guard.apply(0.0, np.full(10, 4.0))
    assert applied is not None
    assert (applied.voltage[-1], driver.voltage, guard.state) == (40.0, 40.0, "enabled")
    driver.close()
    assert driver.voltage == 0.0


def test_the_drivers_file_in_the_page_can_be_read(tmp_path: Path) -> None:
    page = (DOCS / "hardware.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "drivers.yaml").write_text(text, encoding="utf-8")
    chosen = load_drivers(tmp_path / "drivers.yaml")
    assert (chosen.amplifier.kind, chosen.sensor.kind) == ("gcs", "gcs")
    assert not chosen.simulated
    assert not chosen.needs_plant
    assert as_parameters(chosen.sensor)["gcs"]["metres_per_unit"] == 1e-6
    assert as_parameters(chosen.amplifier)["gcs"]["capacitance"] == pytest.approx(1.8e-6)
    assert as_parameters(Drivers().amplifier) == {"driver": "simulated"}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[1, 2]", "expected 'amplifier:' and 'sensor:'"),
        ("motor: {driver: gcs}", "expected 'amplifier:' and 'sensor:'"),
        ("sensor: gcs", "sensor: expected 'driver: name' and its settings, found 'gcs'"),
        ("sensor: {driver: laser}", "sensor: unknown sensor driver 'laser'; known are simulated, replay, gcs"),
        ("amplifier: {driver: gcs, host: a, volts_per_unit: 1}", "1 has no unit"),
        ("amplifier: {driver: gcs, host: a, volts: 1 V}", "unknown parameter 'volts'"),
        ("amplifier: {driver: gcs, timeout: 1 h}", "is outside 0.001 to 10 s"),
        ("amplifier: {driver: gcs, axis: 1}", "1 is not a word (axis that SVA and SVO act on)"),
    ],
)
def test_a_drivers_file_that_is_wrong_is_one_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "drivers.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BenchError) as caught:
        load_drivers(path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "drivers.yaml" in str(caught.value)


def test_a_graph_without_a_plant_says_so_to_its_nodes(tmp_path: Path) -> None:
    drivers = Drivers(sensor=ReplaySensorSettings(record="run.csv"))
    plan = Plan(load_scenario("scan"), tmp_path, False, RATES[0], None, 1, drivers=drivers)
    parameters = node_parameters(plan)
    assert "plant" not in parameters["/stage/observer"]["ros__parameters"]["nodes"]
    assert parameters["/stage/sensor"]["ros__parameters"]["driver"] == "replay"
    assert parameters["/stage/sensor"]["ros__parameters"]["replay"]["record"] == "run.csv"
    assert parameters["/stage/amplifier"]["ros__parameters"]["driver"] == "simulated"
    assert "plant" not in [row.name for row in plan.processes]
    recorder, loop = dataclasses.replace(plan, composed=True).processes
    assert (*recorder.nodes, *loop.nodes) == tuple(process.name for process in plan.processes)
    assert loop.words == loop.nodes


def test_a_drivers_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match="no such file; check the path"):
        load_drivers(tmp_path / "drivers.yaml")
