"""The plant's node without an executor: the truth is said in the order in which it happened."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from lone_node import lone_node
from rclpy.experimental import EventsExecutor

from pzt_nodes.plant_node import PlantNode
from pzt_ros.blocks import Block
from pzt_ros.reference import block_times


@pytest.fixture
def plant(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[PlantNode, list[float]]]:
    """The node in real time, and the first times [s] of the blocks of truth that it says."""
    said: list[float] = []
    with lone_node(PlantNode, "rate:=real time", "nodes:=plant,amplifier") as node:
        publish = node.publish

        def listen(name: str, *arrays: np.ndarray) -> None:
            said.append(float(arrays[0][0]))
            publish(name, *arrays)

        monkeypatch.setattr(node, "publish", listen)
        yield node, said


def apply(node: PlantNode, tick: int, voltage: float) -> None:
    time = block_times(tick, node.block_size, node.sample_rate)
    idle = np.zeros(node.block_size)
    applied = {"time_s": time, "voltage_V": np.full(node.block_size, voltage), "current_A": idle, "charge_C": idle}
    node._on_applied(Block.of(applied))


def take_turns(node: PlantNode) -> None:
    executor = EventsExecutor()
    executor.add_node(node)
    with node.turns.of(executor):
        executor.spin_once(timeout_sec=0.1)
        executor.spin_once(timeout_sec=0.1)


def test_a_ramp_does_not_overtake_what_was_commanded_before(plant: tuple[PlantNode, list[float]]) -> None:
    """That waits for its time when a fault is said and the ramp begins, if the plant had no processor for a moment."""
    node, said = plant
    for tick in range(2):
        apply(node, tick, 10.0)
    node._on_health("amplifier", "error", "fault", {"state": "ramping"})
    apply(node, 2, 9.0)
    take_turns(node)
    period = node.block_size / node.sample_rate
    assert said == pytest.approx([0.0, period, 2.0 * period])


def test_what_waits_for_its_time_is_said_before_the_node_stops(plant: tuple[PlantNode, list[float]]) -> None:
    node, said = plant
    apply(node, 0, 10.0)
    assert said == []
    node.stop()
    assert said == [0.0]
    take_turns(node)
    assert said == [0.0], "it is not said twice"
