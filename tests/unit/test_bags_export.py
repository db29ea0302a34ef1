"""What people look at: a bag's contents and its CSV files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from bag_making import (
    BLOCK_TYPE,
    RUN_TOPICS,
    START,
    block_bytes,
    block_values,
    expected,
    run_python,
    serialized,
)

from pzt_ros.bags.export import bag_info, export_csv
from pzt_ros.bags.writer import BagWriter, typestore
from pzt_ros.errors import BenchError
from pzt_ros.records import read_csv


def write_show(folder: Path) -> Path:
    types = typestore().types
    time, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    joint, status = types["sensor_msgs/msg/JointState"], types["diagnostic_msgs/msg/DiagnosticStatus"]
    array = types["diagnostic_msgs/msg/DiagnosticArray"]
    with BagWriter(folder) as writer:
        channels = {
            name: writer.add_topic(name, type_name)
            for name, type_name in (
                ("/stage/measurement", BLOCK_TYPE),
                ("/stage/joint_states", "sensor_msgs/msg/JointState"),
                ("/stage/voltage", "std_msgs/msg/Float64"),
                ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
                ("/stage/label", "std_msgs/msg/String"),
                ("/stage/never", BLOCK_TYPE),
            )
        }
        for number in range(3):
            at = START + number * 500_000_000
            stamp = header(stamp=time(sec=number, nanosec=250_000_000), frame_id="")
            state = joint(
                header=stamp, name=["x"], position=np.array([number * 1e-6]), velocity=np.array([2e-6]),
                effort=np.array([]),
            )  # fmt: skip
            report = array(
                header=stamp,
                status=[status(level=number, name="amplifier", message='slew, "limited"', hardware_id="", values=[])],
            )
            values = block_values("/stage/measurement", number)
            data = {
                "/stage/measurement": block_bytes(RUN_TOPICS["/stage/measurement"], values),
                "/stage/joint_states": serialized(state, "sensor_msgs/msg/JointState"),
                "/stage/voltage": serialized(types["std_msgs/msg/Float64"](data=number * 10.0), "std_msgs/msg/Float64"),
                "/diagnostics": serialized(report, "diagnostic_msgs/msg/DiagnosticArray"),
                "/stage/label": serialized(types["std_msgs/msg/String"](data="hi"), "std_msgs/msg/String"),
            }
            for name, message in data.items():
                writer.write(channels[name], message, at)
    return folder


def test_export_of_every_known_kind(tmp_path: Path) -> None:
    files = export_csv(write_show(tmp_path / "show"), tmp_path / "out")
    assert sorted(file.name for file in files) == [
        "diagnostics.csv", "stage.joint_states.csv", "stage.measurement.csv", "stage.voltage.csv"
    ]  # fmt: skip
    text = {file.name: file.read_text() for file in files}
    assert text["stage.joint_states.csv"] == (
        "log_time_s,stamp_s,x_position_m,x_velocity_m_per_s\n"
        "0.0,0.25,0.0,2e-06\n0.5,1.25,1e-06,2e-06\n1.0,2.25,2e-06,2e-06\n"
    )
    assert text["stage.voltage.csv"] == "log_time_s,voltage\n0.0,0.0\n0.5,10.0\n1.0,20.0\n"
    assert text["diagnostics.csv"].splitlines()[:3] == [
        "log_time_s,name,level,message",
        '0.0,amplifier,OK,"slew, ""limited"""',
        '0.5,amplifier,WARN,"slew, ""limited"""',
    ]
    measured = read_csv(tmp_path / "out" / "stage.measurement.csv", required=("time_s", "displacement_m"))
    np.testing.assert_array_equal(measured.displacement, expected("/stage/measurement", 3)[:, 1])


def test_info_goes_through_json(tmp_path: Path) -> None:
    information = json.loads(json.dumps(bag_info(write_show(tmp_path / "show"))))
    assert information["complete"] is True
    assert information["notes"] == []
    assert information["duration_s"] == pytest.approx(1.0)
    assert information["message_count"] == 15
    topics = {topic["name"]: topic for topic in information["topics"]}
    assert topics["/stage/measurement"]["columns"] == ["time_s", "displacement_m"]
    assert topics["/stage/measurement"]["rate_hz"] == pytest.approx(2.0)
    assert topics["/stage/label"]["exported"] is False
    assert topics["/stage/voltage"]["exported"] is True
    assert topics["/stage/never"]["count"] == 0
    assert topics["/stage/never"]["columns"] == []


def test_nothing_to_export_is_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "empty") as writer:
        writer.add_topic("/stage/applied", BLOCK_TYPE)
    with pytest.raises(BenchError, match=r"nothing to export, found /stage/applied"):
        export_csv(tmp_path / "empty", tmp_path / "out")
    write_show(tmp_path / "show")
    (tmp_path / "out").write_text("a file")
    with pytest.raises(BenchError, match="cannot write"):
        export_csv(tmp_path / "show", tmp_path / "out")


def test_library_needs_no_ros_for_bags() -> None:
    code = """
    import sys
    import pzt_ros.bags, pzt_ros.bags.writer, pzt_ros.bags.reader, pzt_ros.bags.export, pzt_ros.blocks
    assert not [name for name in sys.modules if name.split(".")[0] in ("rclpy", "std_msgs", "rosidl_parser")]
    """
    done = run_python(code)
    assert done.returncode == 0, done.stderr
