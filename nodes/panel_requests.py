"""What the page may ask for, handed on to the services, the parameter and the topic of the graph."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from builtin_interfaces.msg import Duration
from rcl_interfaces.msg import Log, ParameterType
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pzt_config.topics import TOPICS
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.messages import TYPES
from pzt_ros.chains import load_model
from pzt_ros.controllers.table import CONTROLLERS
from pzt_ros.errors import BenchError
from pzt_ros.panel.axis import describe
from pzt_ros.panel.frames import Row, as_record
from pzt_ros.panel.motion import Envelope, Point
from pzt_ros.panel.safety import in_the_way

SERVICES: dict[str, type] = {
    "enable": SetBool,
    "record": SetBool,
    "reset": Trigger,
    "pole": Trigger,
    "discharge": Trigger,
}
"""Requests that are a service of the same name."""

FOLLOWED, REFUSED = "following a trajectory", "trajectory refused: "
"""How the experiment node's log begins when it has taken, or not taken, a trajectory."""

WORD_WITHIN = 4.0
"""The experiment node says within this time [s] what became of a trajectory."""

ASKING_PERIOD = 0.5
"""The axis is asked for its model and limits so often [s]: an answer can be lost while who was asked does not know yet
where it should go.
"""

FOUND_WITHIN = 3.0
"""A service or a reader that discovery has not brought after this time [s] is not there."""

Say = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Pending:
    """A request that waits for whoever it is for to be found, until a deadline [s, monotonic]."""

    deadline: float
    ready: Callable[[], bool]
    act: Callable[[], None]
    number: int
    otherwise: str


class Requests:
    """Checks requests, hands them on, and says what came of each: {"answer": id, "granted": bool, "message": text}."""

    def __init__(self, node: GraphNode, say: Say, *, read_only: bool) -> None:
        self._node = node
        self._say = say
        self._read_only = read_only
        self._health: dict[str, dict[str, Any]] = {}
        self._heard: dict[str, float] = {}
        self._enabled = False
        self._here: float | None = None
        self._now = 0.0
        self._busy_until = 0.0
        self._envelope: Envelope | None = None
        self._sent: tuple[int, float] | None = None  # the trajectory that no word has come of: its id, when it was sent
        self._pending: list[Pending] = []
        name = node.get_namespace().strip("/")
        self.axis = name.replace("/", "_") or "stage"
        self._conductor = f"{name.replace('/', '.')}.experiment"  # as the log names it
        say({"about": {"namespace": node.get_namespace(), "controllers": list(CONTROLLERS)}})
        self._ask_model = node.create_client(GetParameters, "controller/get_parameters")
        self._ask_limits = node.create_client(GetParameters, "amplifier/get_parameters")
        self._asking = node.create_timer(ASKING_PERIOD, self._ask_about)
        if read_only:
            return
        self._services = {name: node.create_client(kind, name) for name, kind in SERVICES.items()}
        self._controller = node.create_client(SetParameters, "controller/set_parameters")
        topic = TOPICS["joint_trajectory"]
        self._trajectory = node.create_publisher(TYPES[topic.type], topic.name, node.qos(topic))

    # -- what is known of the stage

    def saw(self, row: Row) -> None:
        """The newest row."""
        last = as_record(row)
        before, self._now = self._now, float(last["time_s"] or 0.0)
        if self._now < before:  # another run, perhaps of another stage
            self._asking.reset()
        self._here = last["displacement_m"] if last["reference_m"] is None else last["reference_m"]

    def hear_health(self, health: list[dict[str, Any]]) -> None:
        """What the nodes say of themselves: whatever is not enabled moves nowhere."""
        for said in health:
            self._health[said["node"]], self._heard[said["node"]] = said, time.monotonic()
            if said["node"] == "amplifier":
                self._enabled = said["values"].get("state") == "enabled"
                self._busy_until = self._busy_until if self._enabled else 0.0

    def hear_log(self, line: Log) -> None:
        """What the experiment node logs about trajectories."""
        if self._sent is None or line.name != self._conductor:
            return
        if line.msg.startswith(FOLLOWED):
            self._answer(self._sent[0], True, line.msg)
        elif line.msg.startswith(REFUSED):
            self._busy_until = 0.0
            self._answer(self._sent[0], False, line.msg.removeprefix(REFUSED))
        else:
            return
        self._sent = None

    def look_after(self) -> None:
        """Every frame: do what waited for somebody to be found, and give up what has waited for too long."""
        now, waiting, self._pending = time.monotonic(), self._pending, []
        for one in waiting:
            if one.ready():
                one.act()
            elif now > one.deadline:
                self._answer(one.number, False, one.otherwise)
            else:
                self._pending.append(one)
        if self._sent is not None and time.monotonic() - self._sent[1] > WORD_WITHIN:
            self._answer(self._sent[0], False, "no word of the trajectory; is the scenario 'manual'?")
            self._sent, self._busy_until = None, 0.0

    # -- about the axis

    def _ask_about(self) -> None:
        """Ask the graph for its model and limits until it has said both."""
        if not (self._ask_model.service_is_ready() and self._ask_limits.service_is_ready()):
            return
        answers: dict[str, Any] = {}

        def collect(name: str, future: Any) -> None:
            answers[name] = future.result().values
            if len(answers) == 2:
                self._asking.cancel()
                # the model may have to be compiled first: that must not hold up the frames
                threading.Thread(target=self._describe, args=(answers,), name="describe", daemon=True).start()

        model = self._ask_model.call_async(GetParameters.Request(names=["model"]))
        model.add_done_callback(lambda future: collect("model", future))
        limits = self._ask_limits.call_async(GetParameters.Request(names=["limits.voltage_min", "limits.voltage_max"]))
        limits.add_done_callback(lambda future: collect("limits", future))

    def _describe(self, answers: dict[str, Any]) -> None:
        about: dict[str, Any] = {}
        try:
            found = describe(load_model(answers["model"][0].string_value), *(v.double_value for v in answers["limits"]))
            self._envelope = Envelope(**found["envelope"])
            about.update(found)
        except (BenchError, IndexError) as error:
            about["problem"] = f"the stage's model is not known here ({error}): no jog and no scan from this panel"
        self._say({"about": about})

    # -- requests

    def take(self, line: str) -> None:
        """A request as a line of JSON: {"id": n, "do": name, ...}."""
        number = -1
        try:
            request = json.loads(line)
            number = int(request["id"])
            self._do(number, request)
        except BenchError as error:
            self._answer(number, False, str(error))
        except (ValueError, KeyError, TypeError) as error:
            self._answer(number, False, f"not a request: {error!r}")

    def _do(self, number: int, request: dict[str, Any]) -> None:
        if self._read_only:
            raise BenchError("this panel is read-only; start one without --read-only to command the stage")
        do = request["do"]
        if do in SERVICES:
            self._call(number, do, request)
        elif do == "controller":
            self._select(number, str(request["name"]))
        elif do == "trajectory":
            self._follow(number, request["points"])
        else:
            raise BenchError(f"unknown request '{do}'")

    def _call(self, number: int, name: str, request: dict[str, Any]) -> None:
        kind, client = SERVICES[name], self._services[name]
        if name == "enable" and request["value"]:
            now = time.monotonic()
            ages = {node: now - heard for node, heard in self._heard.items()}
            if problem := in_the_way(self._health, ages):
                raise BenchError(problem)
        message = SetBool.Request(data=bool(request["value"])) if kind is SetBool else Trigger.Request()

        def call() -> None:
            client.call_async(message).add_done_callback(
                lambda future: self._answer(number, future.result().success, future.result().message)
            )

        why = f"nobody offers the service '{name}'; is the graph running, and its node alive?"
        self._when(client.service_is_ready, call, number, why)

    def _select(self, number: int, name: str) -> None:
        chosen = Parameter("controller", value=name).to_parameter_msg()
        assert chosen.value.type == ParameterType.PARAMETER_STRING

        def answered(future: Any) -> None:
            result = future.result().results[0]
            self._answer(number, result.successful, result.reason or f"controller {name} is in charge")

        def call() -> None:
            self._controller.call_async(SetParameters.Request(parameters=[chosen])).add_done_callback(answered)

        self._when(self._controller.service_is_ready, call, number, "the controller node does not answer; is it alive?")

    def _follow(self, number: int, points: list[Point]) -> None:
        """Publish a trajectory that stays in the envelope from where the stage is now; no points are a stop."""
        if not self._enabled or self._here is None:
            raise BenchError("the stage is not enabled; enable it first")
        checked: list[Point] = [(float(t), float(x), None if v is None else float(v)) for t, x, v in points]
        if checked:
            if self._envelope is None:
                raise BenchError("the window of the stage is not known yet; wait for the controller node")
            if self._now < self._busy_until:
                raise BenchError(f"still moving for {self._busy_until - self._now:.1f} s; Hold stops it")
            self._envelope.check(checked, self._here)
        if self._trajectory.get_subscription_count() == 0:  # not waited for: the stage may be elsewhere by then
            raise BenchError("nobody follows trajectories; is the experiment node alive?")
        self._trajectory.publish(_message(self.axis, checked))
        self._busy_until = self._now + checked[-1][0] if checked else 0.0
        self._sent = number, time.monotonic()

    def _when(self, ready: Callable[[], bool], act: Callable[[], None], number: int, otherwise: str) -> None:
        """Act now, or as soon as it can be; say `otherwise` if that takes too long."""
        self._pending.append(Pending(time.monotonic() + FOUND_WITHIN, ready, act, number, otherwise))

    def _answer(self, number: int, granted: bool, message: str) -> None:
        self._say({"answer": number, "granted": bool(granted), "message": message})

    def close(self) -> None:
        """Nothing is asked any more; the stage stays as it is."""
        self._sent = None


def _message(axis: str, points: list[Point]) -> JointTrajectory:
    message = JointTrajectory(joint_names=[axis])
    for time_from_start, place, velocity in points:
        seconds, nanoseconds = divmod(round(time_from_start * 1e9), 1_000_000_000)
        message.points.append(
            JointTrajectoryPoint(
                positions=[place],
                velocities=[] if velocity is None else [velocity],
                time_from_start=Duration(sec=seconds, nanosec=nanoseconds),
            )
        )
    return message
