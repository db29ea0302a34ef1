"""An operator beside the graph: plain rclpy calls of services, trajectories, and what the nodes say of themselves."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from foreign_node import ForeignNode
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

AXIS = "stage"


def trajectory(*points: tuple[float, ...], names: tuple[str, ...] = (AXIS,)) -> JointTrajectory:
    """A message of points (time, position) or (time, position, velocity), for now."""
    message = JointTrajectory(joint_names=list(names))
    for time, position, *velocity in points:
        point = JointTrajectoryPoint(positions=[position], velocities=list(velocity))
        point.time_from_start.sec = int(time)
        point.time_from_start.nanosec = round(1e9 * (time - int(time)))
        message.points.append(point)
    return message


class Operator:
    """Somebody at the stage `/stage`."""

    def __init__(self, foreign: ForeignNode) -> None:
        self.foreign = foreign
        foreign.listen("/diagnostics", DiagnosticArray)
        for name in ("applied", "measurement"):
            foreign.listen(f"/{AXIS}/{name}", Float64MultiArray)
        self._trajectories = foreign.node.create_publisher(
            JointTrajectory, f"/{AXIS}/joint_trajectory", QoSProfile(depth=10)
        )

    def call(self, name: str, kind: Any = Trigger, **request: Any) -> tuple[bool, str]:
        """Call a service of the axis; success and message."""
        client = self.foreign.node.create_client(kind, f"/{AXIS}/{name}")
        self.foreign.spin_until(client.service_is_ready)
        future = client.call_async(kind.Request(**request))
        self.foreign.spin_until(future.done)
        self.foreign.node.destroy_client(client)
        return future.result().success, future.result().message

    def enable(self, wanted: bool = True) -> tuple[bool, str]:
        """Call `enable`."""
        return self.call("enable", SetBool, data=wanted)

    def say(self, message: JointTrajectory) -> None:
        """Publish a trajectory."""
        self._trajectories.publish(message)

    def values(self, node: str) -> dict[str, str]:
        """What a node said last of itself; nothing before it has."""
        found = [s for m in self.foreign.heard["/diagnostics"] for s in m.status if s.name == f"/{AXIS}/{node}"]
        return {pair.key: pair.value for pair in found[-1].values} if found else {}

    def heard(self, node: str, key: str) -> str:
        """What a node says of that, once it has said anything of it: nodes speak of themselves one after another."""
        self.foreign.spin_until(lambda: key in self.values(node))
        return self.values(node)[key]

    def wait_for(self, node: str, key: str, value: str) -> None:
        """Until a node says that."""
        self.foreign.spin_until(lambda: self.values(node).get(key) == value)

    def wait_until_ready(self) -> None:
        """Until the graph is there, and hears an operator."""
        self.foreign.spin_until(lambda: self.values("experiment").get("phase", "starting") != "starting")
        self.foreign.spin_until(lambda: self._trajectories.get_subscription_count() >= 2)  # experiment and recorder

    def run_for(self, seconds: float) -> None:
        """Until the run's own time has gone on by so much; nothing is awaited for if it stands still."""
        begin = self.run_time()
        self.foreign.spin_until(lambda: self.run_time() >= begin + seconds)

    def run_time(self) -> float:
        """Of the last block applied [s]; 0 before the first."""
        heard = self.foreign.heard[f"/{AXIS}/applied"]
        return float(heard[-1].data[-4]) if heard else 0.0

    def displacement(self) -> float:
        """Last reading [m]."""
        return float(self.foreign.heard[f"/{AXIS}/measurement"][-1].data[-1])
