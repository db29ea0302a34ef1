"""Commands that come late: the last voltage is held, they are counted, and too many of them are a fault."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from foreign_node import ForeignNode
from lone_amplifier import Amplifier, own_domain

REAL_TIME, BUDGET = "rate:=real time", ("limits.late_commands:=4.0", "limits.late_window:=20.0")


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Amplifier]]:
    running: list[Amplifier] = []
    with own_domain() as domain, ForeignNode(domain) as foreign:

        def begin(*options: str) -> Amplifier:
            running.append(Amplifier(tmp_path, foreign, domain, *options))
            assert running[0].enable() == (True, "amplifier enabled")
            foreign.spin_until(lambda: len(running[0].applied) == 1)
            foreign.spin_until(lambda: running[0].state().get("state") == "enabled")  # said on another topic
            return running[0]

        try:
            yield begin
        finally:
            for amplifier in running:
                amplifier.close()


def command_late(amplifier: Amplifier, block: int) -> None:
    """A command 30 ms after the block before, where one is due every 5 ms."""
    heard = len(amplifier.applied)
    time.sleep(0.03)
    amplifier.command(block, 20.0)
    amplifier.foreign.spin_until(lambda: len(amplifier.applied) > heard or amplifier.state().get("state") != "enabled")


def test_late_commands_are_waited_for_and_counted_until_they_are_too_many(start: Callable[..., Amplifier]) -> None:
    amplifier = start(REAL_TIME, *BUDGET)
    for block in range(1, 4):
        command_late(amplifier, block)
    assert len(amplifier.applied) == 4, "nothing is put out while a command is waited for"
    command_late(amplifier, 4)
    amplifier.foreign.spin_until(lambda: amplifier.state().get("state") == "fault")
    assert amplifier.state()["reason"] == (
        "4 of the last 4 commands came more than 20 ms after the block before, limit 4 of 20"
    )
    amplifier.foreign.spin_until(lambda: amplifier.applied[-1].data[-3] == 0.0)  # said on another topic
    assert amplifier.state()["late commands"] == "4"
    assert float(amplifier.state()["command_age_p50_us"]) >= 30e3
    voltage = [value for message in amplifier.applied[4:] for value in message.data[1::4]]
    assert all(after <= before for before, after in itertools.pairwise(voltage))


def test_without_a_pace_no_command_is_late(start: Callable[..., Amplifier]) -> None:
    amplifier = start(*BUDGET)
    for block in range(1, 8):
        command_late(amplifier, block)
    amplifier.foreign.spin_until(lambda: "command_age_max_us" in amplifier.state())
    assert amplifier.state()["state"] == "enabled"
    assert "late commands" not in amplifier.state()
