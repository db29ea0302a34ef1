"""Where an operator's requests arrive: trajectories and poling."""

from __future__ import annotations

from std_srvs.srv import Trigger

from pzt_config.topics import TOPICS
from pzt_nodes.gate import Gate
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.messages import trajectory
from pzt_ros.errors import BenchError
from pzt_ros.experiments.experiment import Experiment
from pzt_ros.manual import ManualConductor

TRAJECTORY = "joint_trajectory"


class OperatorDesk:
    """The topic `joint_trajectory` and the service `pole`; whatever is refused is counted, with its reason in the log.

    A scenario with phases has the stage for itself: then everything is refused.
    """

    def __init__(self, node: GraphNode, conductor: Experiment | ManualConductor, gate: Gate) -> None:
        self._node = node
        self._conductor = conductor
        self._gate = gate
        self._followed = 0
        topic = TOPICS[TRAJECTORY]
        node.hear(topic, self._on_trajectory, raw=True)
        node.create_service(Trigger, "pole", self._on_pole)

    def _enabled(self) -> ManualConductor:
        """The conductor, if it takes requests now."""
        if isinstance(self._conductor, Experiment):
            raise BenchError("a scenario has the stage; requests are for the scenario 'manual'")
        if not self._gate.is_open:
            raise BenchError("the stage is not enabled; enable it first")
        return self._conductor

    def _on_trajectory(self, data: bytes) -> None:
        try:
            self._enabled().follow(trajectory(data))
        except BenchError as error:
            self._node.counts[f"refused on {TRAJECTORY}"] += 1
            self._node.get_logger().warning(f"trajectory refused: {error}")
            return
        self._followed += 1
        self._node.get_logger().info(f"following a trajectory for {self._conductor.left:.3f} s")

    def _on_pole(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            duration = self._enabled().pole()
        except BenchError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, f"poling has begun and takes {duration:.1f} s"
        self._node.get_logger().info(response.message)
        return response

    def values(self) -> dict[str, object]:
        """How it goes, for the diagnostics."""
        doing = self._conductor.doing if self._gate.is_open else "not enabled"
        return {"phase": doing, "left_s": round(self._conductor.left, 3), "trajectories_followed": self._followed}
