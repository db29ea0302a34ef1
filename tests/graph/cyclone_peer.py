"""A process that knows nothing of ROS: Eclipse Cyclone DDS enables the stage, moves it, and says what it has read.

    python cyclone_peer.py DOMAIN POSITION_M

The types are written down here as anybody would from the ROS message definitions; their names and those of the topics
follow the rules by which ROS 2 maps to DDS (https://design.ros2.org/articles/topic_and_service_names.html).
(No `from __future__ import annotations` here: the library reads the annotations of the types.)
"""

import json
import os
import sys
import time
from dataclasses import dataclass

# Loopback without multicast is where ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST has its participants.
os.environ["CYCLONEDDS_URI"] = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>99</MaxAutoParticipantIndex><Peers><Peer Address='localhost'/></Peers></Discovery>"
    "</Domain></CycloneDDS>"
)

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

PATIENCE = 60.0
NEAR = 0.1e-6
"""The stage is there when ten readings in a row are this near [m]."""


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces::msg::dds_::Duration_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class JointTrajectoryPoint(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectoryPoint_"):
    positions: sequence[float64]
    velocities: sequence[float64]
    accelerations: sequence[float64]
    effort: sequence[float64]
    time_from_start: Duration


@dataclass
class JointTrajectory(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectory_"):
    header: Header
    joint_names: sequence[str]
    points: sequence[JointTrajectoryPoint]


@dataclass
class SetBoolRequest(IdlStruct, typename="std_srvs::srv::dds_::SetBool_Request_"):
    data: bool


RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))


class Peer:
    """Reads the joint states of the axis, and writes what moves it."""

    def __init__(self, domain: int) -> None:
        here = DomainParticipant(domain)
        self.states = DataReader(here, Topic(here, "rt/stage/joint_states", JointState), RELIABLE)
        self.enable = DataWriter(here, Topic(here, "rq/stage/enableRequest", SetBoolRequest), RELIABLE)
        self.trajectory = DataWriter(here, Topic(here, "rt/stage/joint_trajectory", JointTrajectory), RELIABLE)
        self.heard: list[JointState] = []

    def matched(self) -> bool:
        """Whether all have found each other; a trajectory has two readers, the experiment and the recorder."""
        heard_by = {self.enable: 1, self.trajectory: 2}
        return all(len(w.get_matched_subscriptions()) >= n for w, n in heard_by.items()) and bool(
            self.states.get_matched_publications()
        )

    def listen(self) -> None:
        """Take in what has come."""
        self.heard += [state for state in self.states.take(100) if isinstance(state, JointState)]
        time.sleep(0.01)

    def go_to(self, position: float, seconds: int) -> None:
        """Ask for a position [m], to be reached in so many seconds."""
        point = JointTrajectoryPoint([position], [], [], [], Duration(seconds, 0))
        self.trajectory.write(JointTrajectory(Header(Time(0, 0), ""), ["stage"], [point]))


def wait(peer: Peer, what: str, happened: object) -> None:
    """Listen until something has happened."""
    deadline = time.monotonic() + PATIENCE
    while not happened():  # type: ignore[operator]
        if time.monotonic() > deadline:
            sys.exit(f"waited {PATIENCE:.0f} s in vain: {what}")
        peer.listen()


def main() -> None:
    """Enable, move, read, and disable; prints what was read as JSON."""
    peer, position = Peer(int(sys.argv[1])), float(sys.argv[2])
    wait(peer, "not matched", peer.matched)
    peer.enable.write(SetBoolRequest(True))
    wait(peer, "no joint state", lambda: len(peer.heard) > 5)
    peer.go_to(position, 1)
    wait(peer, "not there", lambda: all(abs(state.position[0] - position) < NEAR for state in peer.heard[-10:]))
    peer.enable.write(SetBoolRequest(False))
    count = len(peer.heard)
    stamps = [state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec for state in peer.heard]
    last = peer.heard[-1]
    print(json.dumps({"count": count, "stamps": stamps, "name": list(last.name), "position": last.position[0]}))


if __name__ == "__main__":
    main()
