"""Instruments that are a recorded run, and such as cannot be opened: nothing here keeps time."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from driver_graph import DriverGraph, recorded
from graph_process import free_domain
from scenarios import SHORT, write

from pzt_ros.bags.reader import open_bag
from pzt_ros.records import Record, write_csv


def test_a_recorded_run_is_played_as_if_it_were_the_instrument(tmp_path: Path) -> None:
    scenario = write(tmp_path, SHORT)
    record = recorded(scenario)
    write_csv(record.between(0.0, 1.0), tmp_path / "run.csv")
    driver = f"{{driver: replay, record: {tmp_path / 'run.csv'}}}"
    with DriverGraph(scenario, f"amplifier: {driver}\nsensor: {driver}\n", tmp_path / "run") as graph:
        code, said = graph.wait()
        assert code == 0, said
    status = graph.run_json()
    assert status["simulated"] is False
    assert status["drivers"] == {"amplifier": "replay", "sensor": "replay"}
    assert not (tmp_path / "run" / "log" / "plant.log").exists()
    assert "is over after 1 s: holding its last sample" in graph.log("amplifier")
    assert "is over after 1 s: holding its last sample" in graph.log("sensor")
    bag = open_bag(tmp_path / "run" / "bag")
    applied, measured = bag.blocks("/stage/applied"), bag.blocks("/stage/measurement")
    count = 20_001  # samples of the record; then it holds
    np.testing.assert_array_equal(applied["voltage_V"][:count], record.voltage[:count])
    np.testing.assert_array_equal(applied["current_A"][:count], record["current_A"][:count])
    np.testing.assert_array_equal(measured["displacement_m"][:count], record.displacement[:count])
    assert set(measured["displacement_m"][count:]) == {record.displacement[count - 1]}
    assert len(bag.blocks("/stage/estimate")) == len(applied)


def test_a_record_of_another_rate_is_refused_in_one_line(tmp_path: Path) -> None:
    time = np.arange(100) / 1e3
    write_csv(Record("run", dict.fromkeys(("time_s", "voltage_V", "displacement_m"), time)), tmp_path / "run.csv")
    driver = f"{{driver: replay, record: {tmp_path / 'run.csv'}}}"
    with DriverGraph(write(tmp_path, SHORT), f"amplifier: {driver}\nsensor: {driver}\n", tmp_path / "run") as graph:
        code, said = graph.wait()
    assert code == 2, said
    assert "sampled at 1000 Hz" in said
    assert "Traceback" not in said


def test_replay_in_one_process_says_the_same_as_in_several(tmp_path: Path) -> None:
    scenario = write(tmp_path, SHORT)
    record = recorded(scenario)
    write_csv(record, tmp_path / "run.csv")
    driver = f"{{driver: replay, record: {tmp_path / 'run.csv'}}}"
    found = []
    for name, options in (("separate", ()), ("composed", ("--composed",))):
        with DriverGraph(scenario, f"amplifier: {driver}\nsensor: {driver}\n", tmp_path / name, *options) as graph:
            code, said = graph.wait()
            assert code == 0, said
        assert "plant" not in graph.run_json()["outcome"]["status"]
        bag = open_bag(tmp_path / name / "bag")
        found.append(
            [bag.blocks(f"/stage/{topic}").values for topic in ("drive", "applied", "measurement", "estimate")]
        )
    for separate, composed in zip(*found, strict=True):
        np.testing.assert_array_equal(separate, composed)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("driver:=labjack",), "unknown amplifier driver 'labjack'; known are simulated, "),
        (("driver:=gcs",), "set the parameter gcs.host"),
        (("driver:=gcs", "gcs.host:=127.0.0.1", "gcs.port:=1.0"), "controller 127.0.0.1:1 cannot be reached"),
        (("driver:=replay", "replay.record:=/none.csv"), "/none.csv: no such file"),
        (("driver:=gcs", "gcs.host:=127.0.0.1", "gcs.timeout:=-1.0"), "gcs.timeout"),
    ],
)
def test_a_driver_that_cannot_be_opened_is_one_line(tmp_path: Path, options: tuple[str, ...], says: str) -> None:
    words = [word for option in options for word in ("-p", option)]
    for node in ("amplifier", "sensor"):
        done = subprocess.run(
            [sys.executable, "-m", f"pzt_nodes.{node}_node", "--ros-args", *words],
            env={**os.environ, "ROS_DOMAIN_ID": str(free_domain())},
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )
        errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
        assert len(errors) == 1, done.stderr
        assert says.replace("amplifier", node) in errors[0]
        assert "Traceback" not in done.stderr
        assert done.returncode == 2
