"""The life cycle of the driver nodes over its standard services: every transition in every state, and what it means."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from foreign_node import ForeignNode
from gcs_server import GcsServer
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from lone_amplifier import Amplifier, own_domain
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from std_srvs.srv import Trigger

from pzt_ros.blocks import Block, fill_message

WAYS = {
    "unconfigured": (),
    "inactive": ("configure",),
    "active": ("configure", "activate"),
    "finalized": ("configure", "activate", "shutdown"),
}
"""How each state is reached."""
LEADS = {
    ("unconfigured", "configure"): "inactive",
    ("inactive", "cleanup"): "unconfigured",
    ("inactive", "activate"): "active",
    ("active", "deactivate"): "inactive",
    **{(state, "shutdown"): "finalized" for state in ("unconfigured", "inactive", "active")},
}
"""Where a transition leads (design.ros2.org, managed nodes); what is not here is refused."""
TRANSITIONS = ("configure", "activate", "deactivate", "cleanup", "shutdown")
NUMBERS = {
    "configure": Transition.TRANSITION_CONFIGURE,
    "activate": Transition.TRANSITION_ACTIVATE,
    "deactivate": Transition.TRANSITION_DEACTIVATE,
    "cleanup": Transition.TRANSITION_CLEANUP,
}


class Managed:
    """A driver node seen by a life cycle manager."""

    def __init__(self, foreign: ForeignNode, name: str) -> None:
        self.foreign = foreign
        self.name = name

    def ask(self, service: str, kind: Any, **request: Any) -> Any:
        client = self.foreign.node.create_client(kind, f"/stage/{self.name}/{service}")
        self.foreign.spin_until(client.service_is_ready)
        future = client.call_async(kind.Request(**request))
        self.foreign.spin_until(future.done)
        self.foreign.node.destroy_client(client)
        return future.result()

    def change(self, label: str) -> bool:
        """By number where it has one, as `ros2 lifecycle` and nav2's manager do; shutdown by its name."""
        wanted = Transition(id=NUMBERS[label]) if label in NUMBERS else Transition(label=label)
        return bool(self.ask("change_state", ChangeState, transition=wanted).success)

    def state(self) -> str:
        return str(self.ask("get_state", GetState).current_state.label)

    def transitions(self) -> set[str]:
        found = self.ask("get_available_transitions", GetAvailableTransitions).available_transitions
        return {description.transition.label for description in found}


@pytest.fixture
def foreign() -> Iterator[ForeignNode]:
    with own_domain() as domain, ForeignNode(domain) as node:
        yield node


@pytest.fixture
def start(foreign: ForeignNode, tmp_path: Path) -> Iterator[Callable[..., Managed]]:
    """Starts a driver node with parameters; ended with Ctrl-C, and its log is free of tracebacks."""
    running: list[tuple[subprocess.Popen[bytes], Path]] = []

    def begin(name: str, *options: str) -> Managed:
        words = [word for option in (f"nodes:={name}", *options) for word in ("-p", option)]
        log = tmp_path / f"{name}-{len(running)}.log"
        with open(log, "wb") as stream:
            process = subprocess.Popen(
                [sys.executable, "-m", f"pzt_nodes.{name}_node", "--ros-args", *words],
                env={**os.environ, "ROS_DOMAIN_ID": str(foreign.node.context.get_domain_id())},
                stderr=stream,
                start_new_session=True,
            )
        running.append((process, log))
        return Managed(foreign, name)

    try:
        yield begin
    finally:
        for process, log in running:
            process.send_signal(signal.SIGINT)
            try:
                assert process.wait(60.0) == 0
            finally:
                process.kill()
                process.wait()
            assert "Traceback" not in log.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["amplifier", "sensor"])
def test_every_transition_in_every_state(start: Callable[..., Managed], name: str) -> None:
    node = start(name, "autostart:=false")
    assert node.state() == "unconfigured"
    for state in ("unconfigured", "inactive", "active"):
        for transition in TRANSITIONS:
            if transition == "shutdown":
                continue  # there is no way back; below
            for step in WAYS[state]:
                assert node.change(step)
            leads = LEADS.get((state, transition))
            assert node.transitions() >= ({transition} if leads else set())
            assert node.change(transition) == (leads is not None), (state, transition)
            assert node.state() == (leads or state), (state, transition)
            for back, step in (("active", "deactivate"), ("inactive", "cleanup")):
                if node.state() == back:
                    assert node.change(step)
    for step in WAYS["finalized"]:
        assert node.change(step)
    for transition in TRANSITIONS:
        assert not node.change(transition)
        assert node.state() == "finalized"


@pytest.mark.parametrize("state", ["unconfigured", "inactive"])
def test_it_can_be_shut_down_early(start: Callable[..., Managed], state: str) -> None:
    node = start("amplifier", "autostart:=false")
    for step in WAYS[state]:
        assert node.change(step)
    assert node.change("shutdown")
    assert node.state() == "finalized"


@pytest.mark.parametrize("name", ["amplifier", "sensor"])
def test_a_node_starts_itself_by_default(start: Callable[..., Managed], name: str) -> None:
    assert start(name).state() == "active"


@pytest.fixture
def amplifier(foreign: ForeignNode, tmp_path: Path) -> Iterator[Amplifier]:
    running = Amplifier(tmp_path, foreign, foreign.node.context.get_domain_id(), "autostart:=false")
    try:
        yield running
    finally:
        running.close()


def test_it_is_enabled_only_while_active_and_is_at_zero_volts_before_it_is_inactive(amplifier: Amplifier) -> None:
    node, spin = Managed(amplifier.foreign, "amplifier"), amplifier.foreign.spin_until
    refused = "cannot enable: the amplifier is {}; activate it first"
    assert amplifier.enable() == (False, refused.format("unconfigured"))
    assert amplifier.call("discharge", Trigger) == (False, "the amplifier is unconfigured; activate it first")
    assert node.change("configure")
    assert amplifier.enable() == (False, refused.format("inactive"))
    begin = 0
    for _ in range(2):  # and once more, with the driver closed and opened in between
        assert node.change("activate")
        assert amplifier.enable() == (True, "amplifier enabled")
        spin(lambda begin=begin: len(amplifier.applied) == begin + 1)
        for block in range(begin + 1, begin + 4):
            amplifier.command(block, 50.0)
            spin(lambda block=block: len(amplifier.applied) == block + 1)
        assert node.change("deactivate")
        assert amplifier.enable() == (False, refused.format("inactive"))
        spin(lambda: amplifier.applied[-1].data[-3] == 0.0)
        spin(lambda: amplifier.state()["state"] == "disabled")
        assert node.change("cleanup")
        spin(lambda: amplifier.state()["stack_voltage_V"] == "nan")  # nobody asks a driver that is closed
        assert node.change("configure")
        begin = len(amplifier.applied)
    times = [time for message in amplifier.applied for time in message.data[0::4]]
    assert all(abs(after - before - 5e-5) < 1e-9 for before, after in itertools.pairwise(times))
    voltage = [value for message in amplifier.applied for value in message.data[1::4]]
    assert max(abs(after - before) for before, after in itertools.pairwise(voltage)) <= 10.0 + 1e-9


def test_a_driver_that_fails_is_not_activated_and_says_why(start: Callable[..., Managed], tmp_path: Path) -> None:
    with GcsServer() as server:
        driver = ("driver:=gcs", "gcs.host:=127.0.0.1", f"gcs.port:={float(server.port)}", "gcs.timeout:=2.0")
        node = start("amplifier", "autostart:=false", *driver)
        node.foreign.listen("/diagnostics", DiagnosticArray)
        assert node.change("configure")
        server.trouble["VOL?"] = b"unknown\n"
        assert not node.change("activate")
        assert node.state() == "inactive"
        assert "transition refused: " in (tmp_path / "amplifier-0.log").read_text(encoding="utf-8")
        assert node.change("cleanup")
        assert not node.change("configure")
        assert node.state() == "unconfigured"
        server.trouble.clear()
        assert node.change("configure")
        assert node.change("activate")
        assert server.history == [0.0], "nothing was put out"


def test_a_sensor_measures_only_while_active(start: Callable[..., Managed], foreign: ForeignNode) -> None:
    node = start("sensor", "autostart:=false")
    foreign.listen("/stage/measurement", Float64MultiArray)
    truth = foreign.node.create_publisher(Float64MultiArray, "/stage/truth", QoSProfile(depth=10))
    heard = foreign.heard["/stage/measurement"]
    columns = ("time_s", "displacement_m", "polarization_C_per_m2", "phase_fraction")

    def say(block: int) -> None:
        values = {column: [1e-6] * 100 for column in columns}
        values["time_s"] = [(100 * block + i) / 20e3 for i in range(100)]
        truth.publish(fill_message(Float64MultiArray(), MultiArrayDimension, Block.of(values)))

    foreign.listen("/diagnostics", DiagnosticArray)

    def counted() -> str:
        said = [{v.key: v.value for v in s.values} for m in foreign.heard["/diagnostics"] for s in m.status]
        return said[-1].get("not measured while inactive", "0") if said else "0"

    foreign.spin_until(lambda: truth.get_subscription_count() == 1)
    for step in (None, "configure"):
        assert step is None or node.change(step)
        say(0)
        foreign.spin_until(lambda step=step: counted() == ("1" if step is None else "2"))
    assert node.change("activate")
    say(1)
    foreign.spin_until(lambda: len(heard) == 1)
    assert node.change("deactivate")
    say(2)
    foreign.spin_until(lambda: counted() == "3")
    assert [message.data[0] for message in heard] == [0.005]
