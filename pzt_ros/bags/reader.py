"""Reading a bag without ROS: complete, cut off by a kill, or damaged; says what could be read and guesses nothing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pzt_ros.bags.scan import McapFile, Tally, Topic
from pzt_ros.bags.writer import typestore
from pzt_ros.blocks import BLOCK_TYPE, Array, Block, BlockError, read_block
from pzt_ros.errors import BenchError
from pzt_ros.records import Record

RUN_SOURCES = (
    ("voltage_V", "applied", "voltage_V"),
    ("displacement_m", "measurement", "displacement_m"),
    ("current_A", "applied", "current_A"),
    ("reference_m", "reference", "displacement_m"),
    ("command_voltage_V", "drive", "command_voltage_V"),
)
"""Columns of a run out of a bag: the record's name, the topic below the namespace, the block's name."""


@dataclass(frozen=True)
class TopicSummary:
    """What a bag holds of one topic [log times in ns since 1970; rate in 1/s, 0 for fewer than two messages]."""

    name: str
    type_name: str
    count: int
    first_ns: int
    last_ns: int

    @property
    def rate_hz(self) -> float:
        span = self.last_ns - self.first_ns
        return (self.count - 1) / span * 1e9 if span > 0 else 0.0


class Bag:
    """A bag looked through once.

    Attributes:
        path: what was opened.
        notes: one line for each thing that is missing or damaged; empty for a complete bag.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        names, self.notes = _storage_files(path)
        self._files = [McapFile(name) for name in names]
        for file in self._files:
            if file.damage is not None:
                count = sum(tally.count for tally in file.tallies.values())
                self.notes.append(
                    f"{file.path}: cut off or damaged at byte {file.damage.offset} of {file.size} "
                    f"({file.damage.what}); the {count} messages before it were read"
                )
        self._topics = _summaries(file.tallies for file in self._files)

    @property
    def complete(self) -> bool:
        """Whether the recording ended cleanly and every checksum holds."""
        return not self.notes

    @property
    def files(self) -> list[Path]:
        """The MCAP files in the order of recording."""
        return [file.path for file in self._files]

    @property
    def size_bytes(self) -> int:
        """Of all MCAP files."""
        return sum(file.size for file in self._files)

    def topics(self) -> list[TopicSummary]:
        """What there is, by name."""
        return list(self._topics.values())

    def topic(self, name: str) -> TopicSummary:
        """One topic; BenchError where the bag has none of that name."""
        if name not in self._topics:
            there = ", ".join(self._topics) or "none"
            raise BenchError(f"{self.path}: no topic {name}; there are {there}")
        return self._topics[name]

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Log time [ns] and decoded message, in the order of recording.

        Raises:
            BenchError: no such topic, a type outside the common interfaces, or a message that is none of its type.
        """
        type_name = self.topic(topic).type_name
        if type_name not in typestore().fielddefs:
            raise BenchError(
                f"{self.path} topic {topic}: messages of type {type_name or '(none)'} cannot be read; "
                "only those of the common interfaces are"
            )
        for number, (log_time, encoding, data) in enumerate(self._stored(topic), start=1):
            try:
                if encoding != "cdr":
                    raise ValueError(f"encoding {encoding!r}, expected cdr")
                message = typestore().deserialize_cdr(data, type_name)
            except Exception as error:  # the decoder raises whatever the bytes lead it to
                what = " ".join(str(error).split()) or type(error).__name__
                raise BenchError(f"{self.path} topic {topic}, message {number}: is no {type_name} ({what})") from None
            yield log_time, message

    def blocks(self, topic: str) -> Block:
        """All blocks of a topic as one [values: shape (N_total, C)].

        Raises:
            BenchError: no such topic, no blocks in it, or blocks whose columns change.
        """
        summary = self.topic(topic)
        where = f"{self.path} topic {topic}"
        if summary.type_name != BLOCK_TYPE:
            raise BenchError(f"{where}: holds {summary.type_name}, expected blocks ({BLOCK_TYPE})")
        columns: tuple[str, ...] = ()
        parts: list[Array] = []
        for number, (_, message) in enumerate(self.messages(topic), start=1):
            try:
                block = read_block(message)
            except BlockError as error:
                raise BenchError(f"{where}, message {number}: no block: {error}") from None
            columns = columns or block.columns
            if block.columns != columns:
                raise BenchError(
                    f"{where}, message {number}: columns {','.join(block.columns)} where those before have "
                    f"{','.join(columns)}; export the parts apart"
                )
            parts.append(block.values)
        if not parts:
            raise BenchError(f"{where}: no message was recorded; was its node running?")
        return Block(columns, np.concatenate(parts))

    def _stored(self, topic: str) -> Iterator[tuple[int, str, memoryview]]:
        for file in self._files:
            for declared, log_time, data in file.messages():
                if declared.name == topic:
                    yield log_time, declared.encoding, data


def open_bag(path: str | Path) -> Bag:
    """Open a rosbag2 folder (MCAP storage, with or without metadata.yaml) or a bare .mcap file.

    Raises:
        BenchError: nothing there, another storage than MCAP, or a file that is no MCAP file.
    """
    return Bag(Path(path))


def record_from_bag(
    path: str | Path, namespace: str = "/stage", required: Sequence[str] = ("voltage_V", "displacement_m")
) -> Record:
    """The measured run in a bag: the samples whose time_s stands in every topic that is needed for `required`.

    Of the other `RUN_SOURCES` a column comes along where it covers all those samples; otherwise it is left out with a
    warning, so that nothing is filled in.

    Args:
        path: as for `open_bag`.
        namespace: of the axis.
        required: columns of `RUN_SOURCES` that the record must have.

    Raises:
        BenchError: a topic or column is missing, a value is not finite, time does not increase, no two samples match.
    """
    bag = open_bag(path)
    warnings = list(bag.notes)
    present = {summary.name for summary in bag.topics() if summary.count}
    blocks: dict[str, Block] = {}
    for column, leaf, source in RUN_SOURCES:
        topic = f"{namespace.rstrip('/')}/{leaf}"
        if leaf not in blocks and (column in required or topic in present):
            blocks[leaf] = _checked(bag, topic)
        if column in required and source not in blocks[leaf].columns:
            raise BenchError(f"{path} topic {topic}: no column {source}; there are {', '.join(blocks[leaf].columns)}")
    time = _common_time(
        str(path), {leaf: blocks[leaf] for column, leaf, _ in RUN_SOURCES if column in required}, warnings
    )
    columns = {"time_s": time}
    for column, leaf, source in RUN_SOURCES:
        if leaf not in blocks or source not in blocks[leaf].columns:
            continue
        rows = np.searchsorted(blocks[leaf].time, time)
        rows[rows == len(blocks[leaf])] = 0  # later than the last sample: cannot match
        missing = int(np.count_nonzero(blocks[leaf].time[rows] != time))
        if missing:
            warnings.append(f"{path}: {column} left out, {leaf} lacks {missing} of the {len(time)} samples")
        else:
            columns[column] = blocks[leaf][source][rows]
    return Record(str(path), columns, tuple(warnings))


def _common_time(path: str, blocks: dict[str, Block], warnings: list[str]) -> Array:
    """The time stamps that all blocks have [s]; a warning for each topic that has more."""
    time: Array | None = None
    for block in blocks.values():
        time = block.time if time is None else np.intersect1d(time, block.time, assume_unique=True)
    if time is None or len(time) < 2:
        raise BenchError(
            f"{path}: {' and '.join(blocks)} have {0 if time is None else len(time)} time stamps in common, "
            "a run needs at least 2; were they recorded together?"
        )
    for leaf, block in blocks.items():
        within = int(np.count_nonzero((block.time >= time[0]) & (block.time <= time[-1]))) - len(time)
        outside = len(block) - len(time) - within
        if within or outside:
            warnings.append(
                f"{path}: {within} samples of {leaf} within the run and {outside} before or after it have no partner "
                f"in {' and '.join(other for other in blocks if other != leaf)} and are left out"
            )
    return time


def _checked(bag: Bag, topic: str) -> Block:
    block = bag.blocks(topic)
    bad = np.argwhere(~np.isfinite(block.values))
    if bad.size:
        row, column = bad[0]
        raise BenchError(
            f"{bag.path} topic {topic}: sample {row + 1} of {block.columns[column]} is {block.values[row, column]}; "
            "only finite numbers make a run"
        )
    steps = np.flatnonzero(np.diff(block.time) <= 0.0)
    if steps.size:
        row = steps[0]
        raise BenchError(
            f"{bag.path} topic {topic}: sample {row + 2} has time_s {float(block.time[row + 1])!r}, not after "
            f"{float(block.time[row])!r} before it; a node was restarted or the topic has two senders, record anew"
        )
    return block


def _summaries(tallies: Any) -> dict[str, TopicSummary]:
    merged: dict[str, tuple[Topic, Tally]] = {}
    for file_tallies in tallies:
        for topic, tally in file_tallies.items():
            known, total = merged.setdefault(topic.name, (topic, Tally()))
            if known != topic:
                raise BenchError(
                    f"topic {topic.name}: recorded as {known.type_name} and as {topic.type_name}; "
                    "record anew with one sender"
                )
            total.merge(tally)
    return {
        name: TopicSummary(name, topic.type_name, tally.count, tally.first_ns, tally.last_ns)
        for name, (topic, tally) in sorted(merged.items())
    }


def _storage_files(path: Path) -> tuple[list[Path], list[str]]:
    """The MCAP files of a bag and notes about what is missing."""
    if not path.exists():
        raise BenchError(f"{path}: no such bag; check the path")
    if not path.is_dir():
        if path.suffix == ".db3":
            raise BenchError(_convert(path, path.parent))
        return [path], []
    names = sorted(path.glob("*.mcap"), key=_natural)
    if not names:
        if list(path.glob("*.db3")):
            raise BenchError(_convert(path, path))
        if list(path.glob("*.mcap.zstd")):
            raise BenchError(f"{path}: compressed as whole files; unpack them first with: unzstd {path}/*.mcap.zstd")
        raise BenchError(f"{path}: no .mcap file in this folder, so it is no bag; give the folder that was recorded")
    return names, _metadata_notes(path, names)


def _convert(path: Path, folder: Path) -> str:
    new = folder.resolve().name + "_mcap"
    command = f"rosbags-convert --src {folder} --dst {new} --dst-storage mcap"
    return f"{path}: a bag with sqlite3 storage, expected MCAP; convert it with: {command}"


def _natural(path: Path) -> list[tuple[int, str]]:
    """bag_2 before bag_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def _metadata_notes(folder: Path, names: Sequence[Path]) -> list[str]:
    metadata = folder / "metadata.yaml"
    if not metadata.exists():
        return []  # the recorder was killed, or the file was moved; whether the data are whole the file itself says
    try:
        listed = yaml.safe_load(metadata.read_text(encoding="utf-8"))["rosbag2_bagfile_information"][
            "relative_file_paths"
        ]
        there = {name.name for name in names}
        missing = [str(name) for name in listed if Path(str(name)).name not in there]
    except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError):
        return [f"{metadata}: damaged; the messages themselves do not depend on it"]
    return [f"{folder}: {name}, which metadata.yaml lists, is missing" for name in missing]
