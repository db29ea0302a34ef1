"""The panel's node at a running graph: whatever it is asked, the stage stays in its window and never jumps."""

from __future__ import annotations

import asyncio
import json
import random
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph_process import GraphProcess, wait_until
from scenarios import POLED_QUICKLY

from pzt_ros.bags.reader import open_bag
from pzt_ros.hardware.limits import Limits
from pzt_ros.panel.board import Board
from pzt_ros.panel.feed import NodeFeed
from pzt_ros.panel.motion import Envelope, jog
from pzt_ros.ros_environment import ros_environment

ROUNDS = 120
WILD = (0.0, 1.0, -1.0, 5e-6, 9e-6, 50e-6, -3e-6, 1e9, 1e-12, float("nan"), float("inf"), None, True, "far", [], {})
NAMES = ("enable", "reset", "controller", "trajectory", "pole", "jump", "", None, 7)
"""Without `record`: the bag is what is judged by."""


def panel_node(domain: int, folder: Path, *, read_only: bool = False) -> NodeFeed:
    command = [sys.executable, "-m", "pzt_nodes.panel_node", "--ros-args", "-r", "__ns:=/stage"]
    command += ["-p", f"read_only:='{str(read_only).lower()}'"]
    return NodeFeed(command, ros_environment(folder / "log", domain), read_only=False)  # the node refuses, not the feed


async def until(happened: Any, what: str) -> None:
    for _ in range(1200):
        if happened():
            return
        await asyncio.sleep(0.05)
    pytest.fail(f"waited 60 s in vain: {what}")


def wild_request(dice: random.Random) -> dict[str, Any]:
    """Something a broken page might send; enabling comes often, so that the stage is worth attacking."""
    if dice.random() < 0.2:
        return {"do": "enable", "value": True}
    name = dice.choice(NAMES)
    points = [[dice.choice(WILD) for _ in range(dice.choice((1, 3, 3, 3, 4)))] for _ in range(dice.randrange(4))]
    return {
        "do": name,
        "value": dice.choice(WILD),
        "name": dice.choice(WILD),
        "points": dice.choice((points, "x", None)),
    }


async def attack(domain: int, folder: Path) -> list[Any]:
    """Garbage and wild requests; afterwards a proper jog still works. Returns the answers."""
    dice, board, feed = random.Random(7), Board(), panel_node(domain, folder)
    running = asyncio.create_task(feed.run(board))
    await until(lambda: board.safety.headline == "DISABLED", "the graph")
    answers = []
    for _ in range(ROUNDS):
        answers.append(await feed.ask(wild_request(dice)))
        assert feed._process is not None
        assert feed._process.stdin is not None
        feed._process.stdin.write(dice.choice((b"{}\n", b"[1]\n", b"\xff\xfe\n", b'{"id": "x"}\n', b"\n")))
    await feed.ask({"do": "enable", "value": True})
    await until(lambda: board.safety.headline == "ENABLED", "enabled after all")
    await until(lambda: board.here is not None and board.envelope is not None, "blocks and the window")
    await until(lambda: board.health["experiment"]["values"].get("phase") == "hold", "the end of a poling")
    assert isinstance(board.envelope, Envelope)
    answers.append(await feed.ask({"do": "trajectory", "points": jog(board.envelope, board.here or 0.0, 0.5e-6, 5e-6)}))
    await feed.close()
    await running
    return answers


async def look(domain: int, folder: Path) -> tuple[str, Any]:
    """What a read-only panel sees, and what it is told when it asks all the same."""
    board, feed = Board(), panel_node(domain, folder, read_only=True)
    running = asyncio.create_task(feed.run(board))
    await until(lambda: "amplifier" in board.health, "the amplifier")
    answer = await feed.ask({"do": "enable", "value": False})
    headline = board.safety.headline
    await feed.close()
    await running
    return headline, answer


def test_no_request_makes_the_stage_jump_or_leave_its_window(tmp_path: Path) -> None:
    scenario = tmp_path / "manual.yaml"
    scenario.write_text(POLED_QUICKLY, encoding="utf-8")
    with GraphProcess(scenario, tmp_path / "run") as graph:
        wait_until(lambda: (tmp_path / "run" / "run.json").exists(), "the run folder")
        answers = asyncio.run(attack(graph.domain, tmp_path))
        headline, refused = asyncio.run(look(graph.domain, tmp_path))
        graph.interrupt()
        code, said = graph.wait()
    assert code == 0, said
    assert answers[-1].granted, answers[-1]
    assert sum(answer.granted for answer in answers) < len(answers)
    assert all("\n" not in answer.message for answer in answers)
    assert headline == "ENABLED"  # the panel that attacked is gone, and the stage is as it was left
    assert not refused.granted
    assert "read-only" in refused.message
    bag = open_bag(tmp_path / "run" / "bag")
    voltage, limits = bag.blocks("/stage/applied")["voltage_V"], Limits()
    assert voltage.min() >= limits.voltage_min
    assert voltage.max() <= limits.voltage_max
    assert np.abs(np.diff(voltage)).max() <= limits.slew_rate / 20e3 * (1 + 1e-9)
    health = json.loads((tmp_path / "run" / "run.json").read_text(encoding="utf-8"))["outcome"]["status"]["amplifier"]
    assert "limited: voltage window" not in health  # nothing even reached the guard that it had to hold back
    assert "limited: slew rate" not in health
    reference = bag.blocks("/stage/reference")
    without_a_gap = np.diff(reference.time) < 1.5 / 20e3  # poling and enabling anew begin where the stage is then
    assert np.abs(np.diff(reference["displacement_m"]))[without_a_gap].max() < 0.1e-6
