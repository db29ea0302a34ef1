"""A JointTrajectory in bytes: what is read from it, and what of it is refused."""

from __future__ import annotations

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pzt_nodes.messages import LONGEST_TRAJECTORY, trajectory
from pzt_ros.errors import BenchError
from pzt_ros.experiments.trajectory import Trajectory


def message(count: int = 3, velocities: bool = True) -> JointTrajectory:
    found = JointTrajectory(joint_names=["stage"])
    found.header.stamp.sec, found.header.stamp.nanosec = 7, 250_000_000
    for number in range(1, count + 1):
        point = JointTrajectoryPoint(positions=[1e-6 * number], velocities=[0.0] if velocities else [])
        point.accelerations = [9.0]
        point.time_from_start.sec, point.time_from_start.nanosec = number, 300_000_000
        found.points.append(point)
    return found


def test_positions_times_velocities_and_start_are_read() -> None:
    found = trajectory(serialize_message(message()))
    assert found.joints == ("stage",)
    assert found.start == 7.25
    np.testing.assert_array_equal(found.time, [1.3, 2.3, 3.3])
    np.testing.assert_array_equal(found.position, [1e-6, 2e-6, 3e-6])
    np.testing.assert_array_equal(found.velocity, 0.0)
    assert np.all(np.isnan(trajectory(serialize_message(message(velocities=False))).velocity))


def test_no_points_are_a_trajectory_too() -> None:
    assert trajectory(serialize_message(JointTrajectory(joint_names=["stage"]))).time.shape == (0,)


@pytest.mark.parametrize(
    ("positions", "velocities", "expected"),
    [
        ([], [], "point 2 has 0 positions and 0 velocities"),
        ([1e-6, 2e-6], [], "point 2 has 2 positions and 0 velocities"),
        ([1e-6], [0.0, 0.0], "point 2 has 1 positions and 2 velocities"),
    ],
)
def test_each_point_has_one_position(positions: list[float], velocities: list[float], expected: str) -> None:
    wrong = message()
    wrong.points[1] = JointTrajectoryPoint(positions=positions, velocities=velocities)
    with pytest.raises(BenchError, match=expected):
        trajectory(serialize_message(wrong))


def test_too_many_points_are_refused_unread() -> None:
    with pytest.raises(BenchError, match=f"{LONGEST_TRAJECTORY} are allowed; send it in parts"):
        trajectory(bytes(LONGEST_TRAJECTORY + 1))


def read_or_refused(data: bytes) -> Trajectory | str:
    try:
        return trajectory(data)
    except BenchError as error:
        return str(error)


def test_bytes_that_end_early_are_refused_in_one_line() -> None:
    data = bytes(serialize_message(message()))
    found = [read_or_refused(data[:length]) for length in range(len(data))]
    assert all(isinstance(what, Trajectory) or (what and "\n" not in what) for what in found)
    assert all(isinstance(what, str) for what in found[: len(data) // 2])
