"""Bags for the tests, with messages serialized by rosbags, not by us."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from pzt_ros.bags.writer import FILE_BYTES, BagWriter, Qos, typestore
from pzt_ros.blocks import BLOCK_TYPE

START = 1_700_000_000_000_000_000
PERIOD = 5_000_000  # one block of 100 samples at 20 kHz [ns]
RUN_TOPICS = {
    "/stage/reference": ("time_s", "displacement_m"),
    "/stage/drive": ("time_s", "command_voltage_V"),
    "/stage/applied": ("time_s", "voltage_V", "current_A", "charge_C"),
    "/stage/measurement": ("time_s", "displacement_m"),
}


def block_bytes(columns: tuple[str, ...], values: np.ndarray) -> bytes:
    """A block as the independent encoder of rosbags serializes it."""
    types = typestore().types
    count, width = values.shape
    dimension = types["std_msgs/msg/MultiArrayDimension"]
    layout = types["std_msgs/msg/MultiArrayLayout"](
        dim=[dimension("sample", count, count * width), dimension(",".join(columns), width, width)], data_offset=0
    )
    return serialized(types[BLOCK_TYPE](layout=layout, data=values.ravel()), BLOCK_TYPE)


def check_one_line(error: Exception, *parts: str) -> None:
    """An error for people is one line and names what it is about."""
    assert str(error).isprintable(), error
    assert all(part in str(error) for part in parts), error


def serialized(message: Any, type_name: str) -> bytes:
    return bytes(typestore().serialize_cdr(message, type_name))


def block_values(topic: str, number: int, samples: int = 10) -> np.ndarray:
    """Block `number` of a topic: uneven but increasing time, the same on all topics."""
    width = len(RUN_TOPICS[topic])
    values = np.random.default_rng([len(topic), number]).normal(size=(samples, width))
    values[:, 0] = (number * samples + np.arange(samples)) / 3.0
    return values


def write_run(
    folder: Path, blocks: int = 30, flush_every: int = 5, topics: Any = RUN_TOPICS, file_bytes: int = FILE_BYTES
) -> Path:
    with BagWriter(folder, file_bytes) as writer:
        channels = {topic: writer.add_topic(topic, BLOCK_TYPE, Qos(depth=1000)) for topic in topics}
        for number in range(blocks):
            for topic, channel in channels.items():
                data = block_bytes(RUN_TOPICS[topic], block_values(topic, number))
                writer.write(channel, data, START + number * PERIOD)
            if number % flush_every == flush_every - 1:
                writer.flush()
    return folder


def expected(topic: str, blocks: int) -> np.ndarray:
    return np.concatenate([block_values(topic, number) for number in range(blocks)])


def write_foreign(folder: Path, storage: StoragePlugin, blocks: int = 3) -> None:
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection("/stage/applied", BLOCK_TYPE, typestore=typestore())
        for number in range(blocks):
            data = block_bytes(RUN_TOPICS["/stage/applied"], block_values("/stage/applied", number))
            writer.write(connection, START + number, data)


def run_python(code: str, **values: str) -> subprocess.CompletedProcess[str]:
    program = textwrap.dedent(code).format(tests=str(Path(__file__).parent), **values)
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
