"""What is wrong with a run is said in one line, with exit code 2, before anything moves."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pzt_bringup.command import main
from pzt_bringup.domain import take_domain
from pzt_ros.errors import BenchError

GOOD = """
plant: bench-stage
model: thesis-p2
phases:
  - {phase: voltage, to: 10 V, duration: 0.1 s}
"""


def bring_up(scenario: str, *options: str) -> tuple[int, str]:
    command = [sys.executable, "-m", "pzt_bringup", scenario, *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stderr.strip()


def refused(scenario: str, *options: str) -> str:
    """The one line that says why a run was refused."""
    code, said = bring_up(scenario, *options)
    assert code == 2
    assert len(said.splitlines()) == 1
    assert said.startswith("error: ")
    return said


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (("duration: 0.1 s", "duration: 0.1 V"), "duration: '0.1 V' cannot be read as s"),
        (("duration: 0.1 s", "duration: 0.1"), "duration: 0.1 has no unit"),
        (("to: 10 V", "to: 10 furlongs"), "to: '10 furlongs'"),
        (("to: 10 V", "to: 1e6 V"), "outside -1000 to 1000 V"),
        (("to: 10 V,", ""), "parameter 'to' is missing"),
        (("phase: voltage", "phase: jump"), "kind one of voltage, move, scan"),
        (("plant: bench-stage", "plant: no-such-stage"), "chain 'no-such-stage': no such file"),
        (("phases:", "limits: {voltage_max: 900 V}\nphases:"), "voltage_max: 900 V is outside 0 to 200 V"),
        (("phases:", "controllers: {pid: {}}\nphases:"), "unknown controller 'pid'"),
        (("phases:", "sample_rate: 20 kHz\ncolour: red\nphases:"), "unknown key 'colour'"),
        (("phases:", "phases: [}"), "not valid YAML"),
    ],
)
def test_bad_scenario(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    change: tuple[str, str],
    expected: str,
) -> None:
    """In this process: a program of its own takes seconds to start, and the tests below have theirs."""
    path = tmp_path / "bad.yaml"
    path.write_text(GOOD.replace(*change), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["pzt_bringup", str(path), "--out", str(tmp_path / "run")])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err.strip()
    assert ended.value.code == 2
    assert len(said.splitlines()) == 1
    assert said.startswith("error: ")
    assert expected in said
    assert "bad.yaml" in said or "no-such-stage" in said


def test_missing_scenario(tmp_path: Path) -> None:
    assert "scenario 'nowhere.yaml': no such file" in refused("nowhere.yaml", "--out", str(tmp_path / "run"))


def test_run_folder_with_a_run_in_it(tmp_path: Path) -> None:
    (tmp_path / "run" / "bag").mkdir(parents=True)
    assert "holds a run already" in refused("scan", "--out", str(tmp_path / "run"))


def test_domain_out_of_range(tmp_path: Path) -> None:
    assert "ROS domain 233 is outside 0 to 101" in refused("scan", "--domain", "233", "--out", str(tmp_path / "run"))


def test_second_bringup_in_one_domain(tmp_path: Path) -> None:
    lock = take_domain(None)
    try:
        said = refused("scan", "--domain", str(lock.domain), "--out", str(tmp_path / "run"))
        assert f"ROS domain {lock.domain} is in use: another bringup" in said
        with pytest.raises(BenchError):
            take_domain(lock.domain)
    finally:
        lock.release()


def test_duration_must_be_positive(tmp_path: Path) -> None:
    assert "duration -1.0 s is not positive" in refused("scan", "--duration", "-1", "--out", str(tmp_path / "run"))


def test_run_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert "cannot be written" in refused("scan", "--out", str(tmp_path / "file" / "run"))


@pytest.mark.parametrize(
    ("node", "parameter", "expected"),
    [
        ("amplifier", "limits.voltage_max:=900.0", "voltage_max"),
        ("plant", "rate:=sometimes", "rate 'sometimes' is not one of"),
        ("observer", "observer:=oracle", "unknown observer 'oracle'"),
        ("controller", "controller:=pid", "controller 'pid' is unknown"),
        ("sensor", "chain:=nowhere.yaml", "chain 'nowhere.yaml': no such file"),
        ("plant", "sample_rate:=fast", "sample_rate"),
    ],
)
def test_node_refuses_a_bad_parameter(node: str, parameter: str, expected: str) -> None:
    lock = take_domain(None)
    lock.release()
    environment = {**os.environ, "ROS_DOMAIN_ID": str(lock.domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    command = [sys.executable, "-m", f"pzt_nodes.{node}_node", "--ros-args", "-p", parameter]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=environment)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert expected in done.stderr.strip().splitlines()[-1]
