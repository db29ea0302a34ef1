"""Between library objects and messages: with `pzt_ros.blocks`, the only place that knows message fields."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from pzt_config.topics import BLOCK, DIAGNOSTICS, FLOAT, JOINT_STATE, JOINT_TRAJECTORY, Topic
from pzt_ros.blocks import Block, BlockError, read_block
from pzt_ros.errors import BenchError
from pzt_ros.experiments.trajectory import Trajectory
from pzt_ros.wire import decode, decode_any

TYPES = {
    BLOCK: Float64MultiArray,
    JOINT_STATE: JointState,
    JOINT_TRAJECTORY: JointTrajectory,
    FLOAT: Float64,
    DIAGNOSTICS: DiagnosticArray,
}
"""Message classes by their ROS name."""

LONGEST_TRAJECTORY = 400_000
"""A trajectory of more bytes, some thousand points, would take longer to read than commands may be silent."""

LEVELS = {"ok": DiagnosticStatus.OK, "warn": DiagnosticStatus.WARN, "error": DiagnosticStatus.ERROR}


def foreign_block(data: bytes) -> Block:
    """The block in bytes that our own nodes did not write.

    Raises:
        BlockError: it is no block.
    """
    try:
        message = deserialize_message(data, Float64MultiArray)
    except Exception as error:  # rclpy raises RuntimeError and others; all mean that it is no message
        raise BlockError(f"not a Float64MultiArray: {error}") from error
    return read_block(message)


def block_of(topic: Topic, data: bytes, count: int = 0) -> Block:
    """The block of a topic in bytes, of `count` samples where that is known; quick where one of our nodes wrote it.

    Raises:
        BlockError: it is no block, or one of other columns.
    """
    for columns in topic.layouts:
        block = decode(data, columns, count) if count else decode_any(data, columns)
        if block is not None:
            return block
    block = foreign_block(data)
    if block.columns not in topic.layouts:
        raise BlockError(f"columns are {','.join(block.columns)}, expected {','.join(topic.columns)}")
    return block


def trajectory(data: bytes) -> Trajectory:
    """The trajectory in the bytes of a JointTrajectory; its accelerations and efforts are not used.

    Raises:
        BenchError: it is no such message, too long, or a point has not one position, or more than one velocity.
    """
    if len(data) > LONGEST_TRAJECTORY:
        raise BenchError(f"it has {len(data)} bytes, {LONGEST_TRAJECTORY} are allowed; send it in parts")
    try:
        message = deserialize_message(data, JointTrajectory)
    except Exception as error:  # as above
        raise BenchError(f"not a JointTrajectory: {error}") from error
    for number, point in enumerate(message.points, start=1):
        if len(point.positions) != 1 or len(point.velocities) > 1:
            found = f"{len(point.positions)} positions and {len(point.velocities)} velocities"
            raise BenchError(f"point {number} has {found}, expected one position and at most one velocity")
    return Trajectory(
        joints=tuple(message.joint_names),
        start=_seconds(message.header.stamp),
        time=np.array([_seconds(point.time_from_start) for point in message.points]),
        position=np.array([point.positions[0] for point in message.points]),
        velocity=np.array([point.velocities[0] if point.velocities else math.nan for point in message.points]),
    )


def _seconds(time: Time | Duration) -> float:
    return float(time.sec + time.nanosec / 1e9)  # not times 1e-9: 0.3 s is to be 0.3 s


def stamp(time: float) -> Time:
    """Seconds since the start of the run as a ROS time."""
    nanoseconds = round(time * 1e9)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def joint_state(axis: str, time: NDArray[np.float64], position: NDArray[np.float64]) -> JointState:
    """The end of a block as a joint state: position [m] and mean velocity over the block [m/s]."""
    message = JointState()
    message.header.stamp = stamp(float(time[-1]))
    message.header.frame_id = axis
    message.name = [axis]
    message.position = [float(position[-1])]
    elapsed = float(time[-1] - time[0])
    message.velocity = [float(position[-1] - position[0]) / elapsed if elapsed > 0 else math.nan]
    message.effort = [0.0]
    return message


def float_message(value: float) -> Float64:
    """One number."""
    return Float64(data=float(value))


def diagnostics(now: Time, node: str, level: str, text: str, values: Mapping[str, object]) -> DiagnosticArray:
    """The health of one node; `level` is ok, warn or error."""
    status = DiagnosticStatus(level=LEVELS[level], name=node, message=text, hardware_id="pzt_ros")
    status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    message = DiagnosticArray()
    message.header.stamp = now
    message.status = [status]
    return message


def status_of(message: DiagnosticArray) -> Iterator[tuple[str, str, str, dict[str, str]]]:
    """Node, level, text and values of each status in a diagnostics message."""
    names = {level: name for name, level in LEVELS.items()}
    for status in message.status:
        yield status.name, names.get(status.level, "error"), status.message, {v.key: v.value for v in status.values}
