"""The amplifier's node without an executor: what it does when nothing but messages reaches it."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from lone_node import lone_node
from std_srvs.srv import SetBool

from pzt_nodes.amplifier_node import AmplifierNode
from pzt_ros.blocks import Block
from pzt_ros.hardware.guard import ENABLED, FAULT, RAMPING
from pzt_ros.reference import block_times

PATIENCE = 0.1
"""Of the watchdog [s]."""


@pytest.fixture
def enabled() -> Iterator[AmplifierNode]:
    options = {"limits.command_timeout": PATIENCE, "limits.late_commands": 0.0, "nodes": "amplifier,controller"}
    with lone_node(AmplifierNode, *(f"{name}:={value}" for name, value in options.items())) as node:
        assert node._on_enable(SetBool.Request(data=True), SetBool.Response()).success
        for tick in range(1, 11):
            command(node, tick, 20.0)
        assert node.amplifier.stack_voltage > 10.0
        yield node


def command(node: AmplifierNode, tick: int, voltage: float) -> None:
    block_time = block_times(tick, node.block_size, node.sample_rate)
    node._on_drive(Block.of({"time_s": block_time, "command_voltage_V": np.full(node.block_size, voltage)}))


def out_of_turn(node: AmplifierNode) -> None:
    """A block that was put out long ago."""
    command(node, 0, 0.0)


def no_block(node: AmplifierNode) -> None:
    """What `listen` does with bytes that are no block."""
    node.refuse("drive", "it is no block")


@pytest.mark.parametrize("flood", [out_of_turn, no_block])
def test_a_flood_does_not_put_the_watchdog_to_sleep(enabled: AmplifierNode, flood) -> None:  # type: ignore[no-untyped-def]
    """No timer runs here, as in an executor that never comes to one; the voltage still has to go to 0 V."""
    deadline = time.monotonic() + 10.0
    states = [enabled.amplifier.state]
    while enabled.amplifier.state != FAULT and time.monotonic() < deadline:
        flood(enabled)
        if enabled.amplifier.state != states[-1]:
            states.append(enabled.amplifier.state)
    assert states == [ENABLED, RAMPING, FAULT]
    assert "no command" in enabled.amplifier.reason
    assert enabled.amplifier.stack_voltage == 0.0
