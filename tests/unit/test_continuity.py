"""Blocks that are missing in a bag are counted and said."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pzt_bringup.supervisor import Supervisor
from pzt_config.topics import TOPICS
from pzt_nodes.recorder_node import WATCHED, RecorderNode
from pzt_ros.bags.continuity import MISSING, Continuity
from pzt_ros.blocks import Block
from pzt_ros.reference import block_times
from pzt_ros.wire import encode

RATE, SIZE = 20e3, 20


def block(number: int, size: int = SIZE) -> Block:
    return Block.of({"time_s": block_times(number, size, RATE)})


@pytest.mark.parametrize(
    ("numbers", "missing"),
    [
        (range(100_000, 100_005), 0),
        ([0], 0),
        ([3, 4, 6, 7, 10], 3),
        ([5, 6, 6, 7], 0),  # said twice
        ([50, 51, 0, 1], 0),  # another run begins
    ],
)
def test_missing_blocks_are_counted(numbers: list[int], missing: int) -> None:
    stream = Continuity()
    assert sum(stream.take(block(number)) for number in numbers) == missing


def test_a_pause_is_no_gap_and_one_sample_tells_no_period() -> None:
    stream = Continuity()
    stream.take(block(1))
    stream.pause()
    assert stream.take(block(9)) == 0
    assert [Continuity().take(block(n, size=1)) for n in (0, 5)] == [0, 0]


def test_the_recorder_says_what_is_missing() -> None:
    columns, said = TOPICS[WATCHED].columns, []
    recorder: Any = SimpleNamespace(
        _watched={7: Continuity()},
        counts=Counter(),
        may_complain=lambda of: True,
        get_logger=lambda: SimpleNamespace(error=said.append),
    )

    def arrived(*numbers: int) -> list[tuple[int, bytes, int, int]]:
        rows = [
            (7, encode(columns, (block_times(n, SIZE, RATE), *[np.zeros(SIZE)] * (len(columns) - 1)))) for n in numbers
        ]
        return [(*row, 0, 0) for row in [*rows, (7, b"no block"), (8, b"another topic")]]

    RecorderNode._count_missing(recorder, arrived(1, 2, 3))
    assert not said
    RecorderNode._count_missing(recorder, arrived(5, 6, 9))
    assert recorder.counts == {MISSING: 3}
    assert [each.split(" came")[0] for each in said] == ["3 blocks"]


def test_the_end_of_a_run_says_it_too() -> None:
    plan: Any = SimpleNamespace(log=lambda name: f"{name}.log")

    def said(count: int) -> str:
        status = {"recorder": {MISSING: count}, "plant": {}}
        supervisor: Any = SimpleNamespace(plan=plan, status=lambda: status)
        return Supervisor._gaps(supervisor)

    assert [said(0), said(4)] == ["", "; 4 blocks missing in the bag, see recorder.log"]
