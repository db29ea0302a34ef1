"""A recorded run tick by tick: what each node was given, and what it answered."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pzt_ros.bags.reader import open_bag
from pzt_ros.blocks import Array, Block
from pzt_ros.errors import BenchError, named

REFERENCES = ("reference", "voltage_reference")
"""A tick has one of them."""


@dataclass(frozen=True)
class Part:
    """What a node takes part in: the blocks it is given in a tick, in this order, and its answer.

    Each is a topic and by how many blocks it is ahead of the block just measured.
    """

    given: tuple[tuple[str, int], ...]
    answer: tuple[str, int]


PARTS: dict[str, Part] = {
    "observer": Part((("applied", 0), ("measurement", 0)), ("estimate", 0)),
    "controller": Part(
        (("applied", 0), ("measurement", 0), ("estimate", 0), *((name, 1) for name in REFERENCES)), ("drive", 1)
    ),
    "amplifier": Part((("measurement", 0), ("estimate", 0), ("drive", 1)), ("applied", 1)),
    "sensor": Part((("truth", 0),), ("measurement", 0)),
}
"""The nodes that can be replayed."""


@dataclass(frozen=True)
class Tick:
    """The blocks a node is given in a tick, by topic, and its answer."""

    number: int
    given: dict[str, Block]
    answer: Block


class Recording:
    """The blocks of a bag, by topic and number.

    Args:
        path: of the bag.
        namespace: of the axis.
        period: of a block [s].
    """

    def __init__(self, path: Path, namespace: str, period: float) -> None:
        self._bag = open_bag(path)
        self._namespace = namespace.rstrip("/")
        self._period = period
        self._blocks: dict[str, dict[int, Block]] = {}

    def ticks(self, node: str) -> list[Tick]:
        """What a node was given and answered, from its first tick on, as far as nothing is missing.

        Raises:
            BenchError: no such node, the bag lacks one of its topics, or has no complete tick of it.
        """
        part = named(PARTS, node, "node to replay")
        answer, ahead = part.answer
        found: list[Tick] = []
        for number in sorted(n - ahead for n in self.blocks(answer)):
            given = {topic: block for topic, offset in part.given if (block := self.blocks(topic).get(number + offset))}
            missing = [t for t, _ in part.given if t not in given and t not in REFERENCES]
            has_reference = any(topic in given for topic in REFERENCES) or node != "controller"
            complete = not missing and has_reference and (not found or number == found[-1].number + 1)
            if complete:
                found.append(Tick(number, given, self.blocks(answer)[number + ahead]))
            elif found:
                break
        if not found:
            raise BenchError(
                f"{self._bag.path}: no tick in which the {node} was given all and answered; nothing to replay"
            )
        return found

    def blocks(self, topic: str) -> dict[int, Block]:
        """The blocks of a topic by number; empty for a kind of reference that was never said.

        Raises:
            BenchError: the bag has no such topic.
        """
        if topic not in self._blocks:
            name = f"{self._namespace}/{topic}"
            if topic in REFERENCES and self._bag.topic(name).count == 0:
                self._blocks[topic] = {}
            else:
                self._blocks[topic] = self._cut(name)
        return self._blocks[topic]

    def _cut(self, name: str) -> dict[int, Block]:
        whole = self._bag.blocks(name)
        numbers = np.floor(whole.time / self._period + 1e-6).astype(int)
        begins = np.flatnonzero(np.diff(numbers, prepend=-1))
        ends = [*begins[1:], len(whole)]
        return {
            int(numbers[begin]): Block(whole.columns, whole.values[begin:end])
            for begin, end in zip(begins, ends, strict=True)
        }


@dataclass(frozen=True)
class Difference:
    """The largest difference in one column, where it is [s], and the column's largest absolute value."""

    column: str
    largest: float
    at: float
    scale: float

    def beyond(self, tolerance: float) -> bool:
        """Whether it is more than that share of the column's largest value."""
        return not self.largest <= tolerance * self.scale


def differences(recorded: Block, now: Block) -> list[Difference]:
    """Column by column; a NaN equals a NaN and nothing else."""
    found = []
    for column in recorded.columns:
        before, after = recorded[column], now[column]
        apart: Array = np.where(np.isnan(before) & np.isnan(after), 0.0, np.abs(after - before))
        apart = np.where(np.isnan(apart), np.inf, apart)
        place = int(np.argmax(apart))
        scale = float(np.nanmax(np.abs(before), initial=0.0))
        found.append(Difference(column, float(apart[place]), float(recorded.time[place]), scale))
    return found
