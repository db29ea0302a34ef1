"""What is in a bag, and its records as CSV files, for people and for other programs."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pzt_ros.bags.reader import Bag, TopicSummary, open_bag
from pzt_ros.blocks import BLOCK_TYPE, BlockError, read_block
from pzt_ros.errors import BenchError
from pzt_ros.records import write_table, write_text

_LEVELS = ("OK", "WARN", "ERROR", "STALE")  # diagnostic_msgs/DiagnosticStatus


def bag_info(path: str | Path) -> dict[str, Any]:
    """What a bag holds, ready for JSON; BenchError as `open_bag`."""
    bag = open_bag(path)
    start = _start_ns(bag)
    end = max((topic.last_ns for topic in bag.topics() if topic.count), default=start)
    return {
        "path": str(path),
        "complete": bag.complete,
        "notes": bag.notes,
        "files": [str(file) for file in bag.files],
        "size_bytes": bag.size_bytes,
        "start_ns": start,
        "duration_s": (end - start) * 1e-9,
        "message_count": sum(topic.count for topic in bag.topics()),
        "topics": [
            {
                "name": topic.name,
                "type": topic.type_name,
                "count": topic.count,
                "first_ns": topic.first_ns,
                "last_ns": topic.last_ns,
                "rate_hz": topic.rate_hz,
                "columns": _block_columns(bag, topic),
                "exported": topic.type_name in _EXPORTERS and topic.count > 0,
            }
            for topic in bag.topics()
        ],
    }


def export_csv(path: str | Path, out_dir: str | Path) -> list[Path]:
    """Write one CSV file per topic of a kind we know; returns the files.

    `/stage/measurement` becomes `stage.measurement.csv` (no topic name has a dot, so no two can meet in one file).
    Blocks keep their columns. `log_time_s` counts from the first message of the bag [s].

    Raises:
        BenchError: as `open_bag`; nothing in the bag to export; a file cannot be written.
    """
    bag = open_bag(path)
    files = []
    for topic in bag.topics():
        if topic.type_name in _EXPORTERS and topic.count > 0:
            file = Path(out_dir) / (topic.name.strip("/").replace("/", ".") + ".csv")
            _EXPORTERS[topic.type_name](bag, topic.name, file)
            files.append(file)
    if not files:
        found = ", ".join(f"{topic.name} ({topic.type_name}, {topic.count})" for topic in bag.topics()) or "no topic"
        raise BenchError(f"{path}: nothing to export, found {found}; known are {', '.join(_EXPORTERS)}")
    return files


def _export_blocks(bag: Bag, topic: str, file: Path) -> None:
    block = bag.blocks(topic)
    write_table(file, block.columns, [block[column] for column in block.columns])


def _export_joint_states(bag: Bag, topic: str, file: Path) -> None:
    start = _start_ns(bag)
    header: list[str] = []
    rows = []
    for number, (log_time, message) in enumerate(bag.messages(topic), start=1):
        names = list(message.name)
        header = header or _joint_header(message)
        if header != _joint_header(message):
            raise BenchError(f"{bag.path} topic {topic}, message {number}: joints {names} differ from those before")
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        rows.append([(log_time - start) * 1e-9, stamp, *message.position, *message.velocity])
    write_table(file, header, list(np.array(rows, dtype=np.float64).T))


def _joint_header(message: Any) -> list[str]:
    names = list(message.name)
    positions = [f"{name}_position_m" for name in names[: len(message.position)]]
    velocities = [f"{name}_velocity_m_per_s" for name in names[: len(message.velocity)]]
    return ["log_time_s", "stamp_s", *positions, *velocities]


def _export_numbers(bag: Bag, topic: str, file: Path) -> None:
    start = _start_ns(bag)
    rows = [((log_time - start) * 1e-9, message.data) for log_time, message in bag.messages(topic)]
    write_table(file, ["log_time_s", topic.rsplit("/", 1)[-1]], list(np.array(rows, dtype=np.float64).T))


def _export_diagnostics(bag: Bag, topic: str, file: Path) -> None:
    start = _start_ns(bag)

    def lines() -> Iterator[str]:
        yield _csv_line(["log_time_s", "name", "level", "message"])
        for log_time, message in bag.messages(topic):
            for status in message.status:
                level = _LEVELS[status.level] if status.level < len(_LEVELS) else str(status.level)
                yield _csv_line([repr((log_time - start) * 1e-9), status.name, level, status.message])

    write_text(file, lines())


_EXPORTERS: dict[str, Callable[[Bag, str, Path], None]] = {
    BLOCK_TYPE: _export_blocks,
    "sensor_msgs/msg/JointState": _export_joint_states,
    "std_msgs/msg/Float64": _export_numbers,
    "diagnostic_msgs/msg/DiagnosticArray": _export_diagnostics,
}


def _csv_line(cells: list[str]) -> str:
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue()


def _start_ns(bag: Bag) -> int:
    return min((topic.first_ns for topic in bag.topics() if topic.count), default=0)


def _block_columns(bag: Bag, topic: TopicSummary) -> list[str]:
    """The columns of the first block; empty for other topics and for messages that are no blocks."""
    if topic.type_name != BLOCK_TYPE or topic.count == 0:
        return []
    try:
        _, message = next(bag.messages(topic.name))
        return list(read_block(message).columns)
    except (BlockError, BenchError):
        return []
