"""Plays the rest of the graph for one node, out of a bag, and holds its answers against the recorded ones."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool

from pzt_config.topics import TOPICS
from pzt_nodes.messages import TYPES, foreign_block
from pzt_ros.bags.recording import PARTS, Recording, Tick, differences
from pzt_ros.blocks import Block
from pzt_ros.errors import BenchError, RunFailedError
from pzt_ros.scenario import Scenario, load_scenario
from pzt_ros.wire import encode

PATIENCE = 60.0
"""A node that does not answer within this time [s] will not any more."""


class ReplayNode(Node):
    """Lock-step by the answers of the node under test: the next tick is played when the last one was answered."""

    def __init__(self, role: str, namespace: str) -> None:
        super().__init__("replay", namespace=namespace)
        self.role = role
        part = PARTS[role]
        qos = QoSProfile(depth=1000)
        self._senders: dict[str, Any] = {
            topic: self.create_publisher(TYPES[TOPICS[topic].type], topic, qos) for topic, _ in part.given
        }
        self.answers: list[Block] = []
        answer = part.answer[0]
        self._listener = self.create_subscription(
            TYPES[TOPICS[answer].type], answer, lambda data: self.answers.append(foreign_block(data)), qos, raw=True
        )
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)

    def wait(self, what: str, happened: Callable[[], Any]) -> None:
        """Handle messages until something has happened.

        Raises:
            RunFailedError: it has not in time.
        """
        deadline = time.monotonic() + PATIENCE
        while not happened():
            if time.monotonic() > deadline:
                raise RunFailedError(f"replay: waited {PATIENCE:.0f} s in vain: {what}")
            self._executor.spin_once(timeout_sec=0.05)

    def call(self, name: str, kind: Any, request: Any) -> Any:
        """Call a service of the axis and wait for its answer."""
        client = self.create_client(kind, name)
        self.wait(f"no service {name}", client.service_is_ready)
        future = client.call_async(request)
        self.wait(f"no answer from {name}", future.done)
        return future.result()

    def play(self, ticks: list[Tick], scenario: Scenario) -> None:
        """Every tick in turn."""
        senders = self._senders.values()
        self.wait(f"the {self.role} does not listen", lambda: all(s.get_subscription_count() for s in senders))
        self.wait(f"nobody says {PARTS[self.role].answer[0]}", lambda: self.count_publishers(self._listener.topic_name))
        prepare = self._conducted(scenario) if self.role == "controller" else lambda _tick: None
        if self.role == "amplifier":
            self._enable()
        for tick in ticks:
            prepare(tick)
            count = len(self.answers)
            for topic, block in tick.given.items():
                self._senders[topic].publish(encode(block.columns, tuple(block[name] for name in block.columns)))
            self.wait(f"no answer to block {tick.number}", lambda count=count: len(self.answers) > count)

    def _enable(self) -> None:
        """The first block is put out by enabling, and not in answer to a command."""
        answer = self.call("enable", SetBool, SetBool.Request(data=True))
        if not answer.success:
            raise RunFailedError(f"replay: the amplifier could not be enabled: {answer.message}")
        self.wait("no first block", lambda: self.answers)
        self.answers.clear()

    def _conducted(self, scenario: Scenario) -> Callable[[Tick], None]:
        """Changes of the controller, where the scenario has them."""
        if not scenario.phases:
            raise BenchError("replay: a run without phases does not tell which controller was in charge when")
        experiment = scenario.experiment()

        def prepare(tick: Tick) -> None:
            measured, voltage = tick.given["measurement"]["displacement_m"], tick.given["applied"]["voltage_V"]
            reference = experiment.step(tick.number + 1, float(measured.mean()), float(voltage[-1]))
            if reference is not None and reference.controller:
                chosen = Parameter("controller", value=reference.controller).to_parameter_msg()
                self.call("controller/set_parameters", SetParameters, SetParameters.Request(parameters=[chosen]))

        return prepare


def replay(run: Path, bag: Path, role: str) -> dict[str, Any]:
    """Replay a node of a run; what it answered against what was recorded.

    Raises:
        BenchError: the bag cannot be replayed, or the node gives no answer.
    """
    namespace = json.loads((run / "run.json").read_text(encoding="utf-8"))["namespace"]
    scenario = load_scenario(run / "scenario.yaml")
    ticks = Recording(bag, namespace, scenario.block_size / scenario.sample_rate).ticks(role)
    rclpy.init()
    node = ReplayNode(role, namespace)
    try:
        node.play(ticks, scenario)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    recorded, now = joined([tick.answer for tick in ticks]), joined(node.answers[: len(ticks)])
    return {"node": role, "ticks": len(ticks), "columns": [asdict(found) for found in differences(recorded, now)]}


def joined(blocks: list[Block]) -> Block:
    """One after the other."""
    return Block(blocks[0].columns, np.concatenate([block.values for block in blocks]))


def main() -> None:
    """Replay, and print what was found as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("bag", type=Path)
    parser.add_argument("role", choices=list(PARTS))
    given = parser.parse_args()
    try:
        print(json.dumps(replay(given.run, given.bag, given.role)))
    except BenchError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
