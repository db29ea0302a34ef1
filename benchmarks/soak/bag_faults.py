"""Bags that are cut, altered or overwritten: named, or read up to the damage, and never altered silently."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Any

import numpy as np

from pzt_benchmarks.soak.fault import NAMED, Fault, Seen
from pzt_config.topics import TOPICS
from pzt_ros.bags import load_run
from pzt_ros.bags.reader import open_bag
from pzt_ros.bags.scan import McapFile
from pzt_ros.bags.writer import BagWriter
from pzt_ros.errors import BenchError
from pzt_ros.wire import encode

BLOCKS, SIZE, RATE = 60, 20, 20e3
COLUMNS = {f"/stage/{name}": TOPICS[name].columns for name in ("drive", "applied", "measurement")}
Content = dict[str, list[tuple[int, bytes]]]


class Damage:
    """A good bag, and what is in it."""

    def __init__(self, folder: Path) -> None:
        rng = np.random.default_rng(1)
        with BagWriter(folder / "good") as writer:
            channels = {name: writer.add_topic(name, TOPICS["drive"].type) for name in COLUMNS}
            for block in range(BLOCKS):
                time_s = (block * SIZE + np.arange(SIZE)) / RATE
                for name, channel in channels.items():
                    arrays = (time_s, *(rng.normal(size=SIZE) for _ in COLUMNS[name][1:]))
                    writer.write(channel, encode(COLUMNS[name], arrays), 10**18 + round(1e9 * time_s[0]))
                if block % 7 == 6:
                    writer.flush()
        self.good = (folder / "good" / "good_0.mcap").read_bytes()
        self.content = content_of(folder / "good" / "good_0.mcap")
        self.path = folder / "damaged.mcap"

    def read(self, data: bytes) -> Seen:
        """Write a damaged file and read it as a user would; whatever is not the original has to be said."""
        self.path.write_bytes(data)
        began = time.monotonic()
        try:
            bag = open_bag(self.path)
            notes, read = bag.notes, content_of(self.path)
            with contextlib.suppress(BenchError):
                record = load_run(self.path)
                notes += record.warnings
        except BenchError as error:
            notes, read = [str(error)], {}
        seconds = time.monotonic() - began
        if any(messages != self.content.get(topic, [])[: len(messages)] for topic, messages in read.items()):
            return Seen("a message was read that is not as it was recorded", seconds)
        if data != self.good and not notes:
            return Seen("nothing was said of the damage", seconds)
        if not all(note.isprintable() and "damaged.mcap" in note for note in notes):
            return Seen(f"not one line that names the file: {notes}", seconds)
        return Seen(NAMED, seconds)


def content_of(path: Path) -> Content:
    """Every message of a file as bytes, by topic."""
    found: Content = {}
    for topic, log_time, data in McapFile(path).messages():
        found.setdefault(topic.name, []).append((log_time, bytes(data)))
    return found


def damage(folder: Path) -> Any:
    """A good bag in the folder."""
    return contextlib.nullcontext(Damage(folder))


def cut(bag: Damage, rng: np.random.Generator) -> Seen:
    """The end is missing."""
    return bag.read(bag.good[: int(rng.integers(0, len(bag.good)))])


def flipped(bag: Damage, rng: np.random.Generator) -> Seen:
    """One bit is another; half of the time outside the messages, where a reader trusts most."""
    end = len(bag.good) - int.from_bytes(bag.good[-28:-20], "little")
    outside = (int(rng.integers(0, 300)), len(bag.good) - 1 - int(rng.integers(0, end)))
    place = int(rng.choice(outside)) if rng.random() < 0.5 else int(rng.integers(len(bag.good)))
    data = bytearray(bag.good)
    data[place] ^= 1 << int(rng.integers(8))
    return bag.read(bytes(data))


def overwritten(bag: Damage, rng: np.random.Generator) -> Seen:
    """A stretch of the file is noise, as after a lost sector."""
    data, length = bytearray(bag.good), int(rng.choice([16, 512, 4096]))
    place = int(rng.integers(8, len(data) - length))
    data[place : place + length] = rng.bytes(length)
    return bag.read(bytes(data))


BAG_FAULTS = (
    Fault("bag truncated", "at a random byte", NAMED, 1.0, "to read it", damage, cut, long=500),
    Fault("bag with a flipped bit", "at a random byte, half of them in head, index and foot", NAMED, 1.0, "to read it",
          damage, flipped, long=1000),
    Fault("bag overwritten", "16, 512 or 4096 bytes of noise", NAMED, 1.0, "to read it", damage, overwritten, long=500),
)  # fmt: skip
