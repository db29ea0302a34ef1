"""A node of your own beside the graph: plain rclpy and the messages of ROS, nothing of this project.

    pzt run manual --out runs/mine        # in one terminal; it says its ROS domain
    ROS_DOMAIN_ID=... python docs/foreign_node.py --position 3e-6

It waits until the stage is ready, enables it, has the recorder record, moves to a position and back, reads the
observer's estimate on the way, and disables the stage. docs/foreign-node.md explains it line by line.
"""

from __future__ import annotations

import argparse
import json
import os
import time

# The graph keeps to this machine, and so must whoever wants to see it; both before rclpy is imported.
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import rclpy
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

PATIENCE = 60.0  # s


def columns_of(block: Float64MultiArray) -> dict[str, list[float]]:
    """A block as columns: the layout says how many samples there are, and the name of each number in a sample."""
    names = block.layout.dim[1].label.split(",")
    return {name: list(block.data[place :: len(names)]) for place, name in enumerate(names)}


class ForeignNode(Node):
    """Drives one axis and keeps what it hears of it."""

    def __init__(self, axis: str) -> None:
        super().__init__("foreign")
        self.axis = axis
        self.health: dict[str, dict[str, str]] = {}
        self.estimates: list[dict[str, list[float]]] = []
        self.time, self.position = -1.0, float("nan")
        self.trajectory = self.create_publisher(JointTrajectory, f"{axis}/joint_trajectory", QoSProfile(depth=10))
        self.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, QoSProfile(depth=20))
        self.create_subscription(Float64MultiArray, f"{axis}/estimate", self.on_estimate, QoSProfile(depth=1000))
        self.create_subscription(JointState, f"{axis}/joint_states", self.on_joint_state, QoSProfile(depth=10))

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.health[status.name] = {pair.key: pair.value for pair in status.values}

    def on_estimate(self, message: Float64MultiArray) -> None:
        self.estimates.append(columns_of(message))

    def on_joint_state(self, message: JointState) -> None:
        self.time = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.position = message.position[0]

    def wait(self, what: str, happened) -> None:
        deadline = time.monotonic() + PATIENCE
        while not happened():
            if time.monotonic() > deadline:
                raise SystemExit(f"waited {PATIENCE:.0f} s in vain: {what}")
            rclpy.spin_once(self, timeout_sec=0.1)

    def call(self, service: str, kind, **request) -> None:
        """Call a service of the axis; what it refuses is said with its reason."""
        client = self.create_client(kind, f"{self.axis}/{service}")
        self.wait(f"no service {service}", client.service_is_ready)
        future = client.call_async(kind.Request(**request))
        self.wait(f"no answer from {service}", future.done)
        if not future.result().success:
            raise SystemExit(f"{service}: {future.result().message}")

    def wait_until_ready(self) -> None:
        """Until the graph waits for an operator, as /diagnostics says, and the experiment node hears this one."""
        self.wait("nobody waits for an operator", lambda: self.says("experiment", "phase") == "not enabled")
        self.wait("the amplifier says nothing", lambda: self.says("amplifier", "state"))
        self.wait("the experiment does not listen", self.experiment_listens)

    def experiment_listens(self) -> bool:
        """DDS finds one reader after the other, and the recorder has one of the same topic: the first is not enough."""
        readers = self.get_subscriptions_info_by_topic(self.trajectory.topic_name)
        there = any(reader.node_name == "experiment" for reader in readers)
        return there and self.trajectory.get_subscription_count() >= len(readers)

    def says(self, node: str, what: str) -> str | None:
        """What a node of the axis last said of itself."""
        return self.health.get(f"{self.axis}/{node}", {}).get(what)

    def move(self, position: float, seconds: int) -> None:
        """A straight way from where the reference is now; wait until the stage is there, and its estimate heard."""
        point = JointTrajectoryPoint(positions=[position], time_from_start=Duration(sec=seconds))
        joint = self.axis.strip("/").replace("/", "_")
        self.trajectory.publish(JointTrajectory(joint_names=[joint], points=[point]))
        self.wait(f"not at {position} m", lambda: abs(self.position - position) < 0.1e-6)
        measured = self.time
        self.wait("no estimate of that time", lambda: self.estimates[-1]["time_s"][-1] > measured - 1e-6)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--axis", default="/stage")
    parser.add_argument("--position", type=float, default=3e-6, help="where to go [m]")
    given = parser.parse_args()
    rclpy.init()
    node = ForeignNode(given.axis)
    try:
        node.wait_until_ready()
        if node.says("amplifier", "state") == "fault":
            node.call("reset", Trigger)
        node.call("record", SetBool, data=True)
        node.call("enable", SetBool, data=True)
        node.wait("no estimate", lambda: node.estimates)
        begin = node.estimates[0]["displacement_m"][-1]
        node.move(given.position, seconds=1)
        there = node.estimates[-1]["displacement_m"][-1]
        node.move(begin, seconds=1)
        node.call("enable", SetBool, data=False)
        print(json.dumps({"blocks": len(node.estimates), "begin_m": begin, "there_m": there}))
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
