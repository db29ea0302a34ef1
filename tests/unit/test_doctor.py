"""The doctor: good health is called so, each illness is found, and comes with what to do."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pzt_ros import doctor
from pzt_ros.cli.app import build
from pzt_ros.doctor import CHECKS, NOTE, OK, PROBLEM, Finding

WHEELS = str(Path(sys.prefix) / "lib" / "rclpy" / "__init__.py")
SOURCED = "/opt/ros/jazzy/lib/python3.12/site-packages/rclpy/__init__.py"

ILL: list[tuple[Finding, str, str]] = [
    (doctor.python((3, 9)), PROBLEM, "3.10 to 3.13"),
    (doctor.python((3, 14)), PROBLEM, "3.10 to 3.13"),
    (doctor.machine("Darwin", "arm64"), PROBLEM, "Linux on x86-64"),
    (doctor.machine("Linux", "x86_64", "2.17"), PROBLEM, "glibc 2.28"),
    (doctor.ros({}, ""), PROBLEM, "pip install pzt_ros"),
    (doctor.ros({"ROS_DISTRO": "jazzy"}, WHEELS), NOTE, "two rclpy"),
    (doctor.ros({"ROS_DISTRO": "humble"}, SOURCED.replace("jazzy", "humble")), PROBLEM, "Jazzy"),
    (doctor.rmw({"RMW_IMPLEMENTATION": "rmw_zenoh_cpp"}), NOTE, "unset RMW_IMPLEMENTATION"),
    (doctor.discovery(dict), PROBLEM, "loopback"),
    (doctor.discovery(lambda: {"found_after_s": 3.0, "round_trip_s": 1e-4}), NOTE, "haunts"),
    (doctor.shared_memory(Path("/nowhere/at/all")), NOTE, "needs none"),
    (doctor.domain({"ROS_DOMAIN_ID": "four"}, {}), PROBLEM, "0 to 101"),
    (doctor.domain({"ROS_DOMAIN_ID": "233"}, {}), PROBLEM, "0 to 101"),
    (doctor.domain({"ROS_DOMAIN_ID": "150"}, {}), NOTE, "0 to 101"),
    (doctor.domain({}, {17: 4711}), NOTE, "ROS_DOMAIN_ID=N"),
    (doctor.cores(1, 0.0), NOTE, "--composed"),
    (doctor.cores(4, 6.0), NOTE, "late"),
    (doctor.clock(5e-3), NOTE, "real-time priority"),
    (doctor.priority(0, False), NOTE, "limits.conf"),
    (doctor.awake(Path("/nowhere/at/all")), NOTE, "udev"),
]

WELL: list[Finding] = [
    doctor.python((3, 12)),
    doctor.machine("Linux", "x86_64", "2.36"),
    doctor.ros({}, WHEELS),
    doctor.ros({"ROS_DISTRO": "jazzy"}, SOURCED),
    doctor.rmw({}),
    doctor.rmw({"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}),
    doctor.discovery(lambda: {"found_after_s": 0.2, "round_trip_s": 1e-4}),
    doctor.domain({"ROS_DOMAIN_ID": "42"}, {}),
    doctor.cores(4, 0.5),
    doctor.clock(1e-4),
    doctor.priority(99, False),
    doctor.priority(0, True),
]


@pytest.mark.parametrize(("finding", "level", "advice"), ILL, ids=lambda value: getattr(value, "check", None))
def test_what_is_wrong_is_found_and_comes_with_advice(finding: Finding, level: str, advice: str) -> None:
    assert finding.level == level
    assert advice in finding.advice
    assert "\n" not in finding.found + finding.advice


@pytest.mark.parametrize("finding", WELL, ids=lambda finding: finding.check)
def test_good_health_needs_no_advice(finding: Finding) -> None:
    assert (finding.level, finding.advice) == (OK, "")


@pytest.mark.parametrize(("allowed", "level"), [("212992", NOTE), ("4194304", OK), ("much", NOTE)])
def test_small_receive_buffers_are_told_of(tmp_path: Path, allowed: str, level: str) -> None:
    file = tmp_path / "rmem_max"
    file.write_text(allowed)
    found = doctor.buffers(file)
    assert found.level == level
    assert ("rmem_max" in found.advice) == (level == NOTE)


def test_shared_memory_counts_what_was_left(tmp_path: Path) -> None:
    assert doctor.shared_memory(tmp_path).level == OK
    for number in range(3):
        with (tmp_path / f"fastrtps_{number:016x}").open("wb") as file:
            file.truncate(50_000_000)
    found = doctor.shared_memory(tmp_path)
    assert found.level == NOTE
    assert "3 files of DDS, 150 MB" in found.found


def test_two_processes_find_one_another() -> None:
    """The real round trip: what `pzt doctor` does."""
    found = doctor.discovery()
    assert found.level in (OK, NOTE), found
    assert "there and back" in found.found


def test_the_command_says_it_for_people_and_for_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    sick = Finding("discovery", PROBLEM, "two nodes do not hear one another [at all]", "pip install 'pzt_ros[panel]'")
    monkeypatch.setattr(doctor, "CHECKS", (doctor.python, lambda: sick))
    for options, code in ((["--json"], 1), ([], 1)):
        result = CliRunner().invoke(build(), ["doctor", *options])
        assert result.exit_code == code
        assert "[at all]" in result.output
        assert "pzt_ros[panel]" in result.output
    result = CliRunner().invoke(build(), ["doctor", "--json"])
    assert [entry["level"] for entry in json.loads(result.output)] == [OK, PROBLEM]
    monkeypatch.setattr(doctor, "CHECKS", (doctor.python,))
    assert CliRunner().invoke(build(), ["doctor"]).exit_code == 0


def test_every_check_of_the_issue_is_there() -> None:
    names = {check.__name__ for check in CHECKS}
    assert {"python", "ros", "rmw", "discovery", "shared_memory", "domain", "cores", "clock", "priority"} <= names
