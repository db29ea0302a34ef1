"""Writing a rosbag2 folder (MCAP storage) as `ros2 bag record` of Jazzy does, without ROS.

A file is readable up to the last `flush()` whatever happens afterwards. `metadata.yaml` is written at the end only:
a folder without it is how rosbag2 itself marks an unfinished recording, and one with a count of 0 would be believed.
A bag is split into files of 1 GB (as by `ros2 bag record --max-bag-size`): MCAP keeps an index of every chunk in memory
until its file ends, 1.4 kB for each, which was 50 MB an hour in one file. Chunks are as large as rosbag2's; with 4 MB
the buffers of two of them came and went, and memory that came back to the system in one hour did not in another.
Fields follow rosbag2 (branch jazzy): rosbag2_storage/yaml.hpp, qos.cpp, rosbag2_storage_mcap/mcap_storage.cpp.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

from pzt_ros.errors import BenchError, RunFailedError
from pzt_ros.records import write_text

METADATA_VERSION = 9
_NO_TIME = 2**63 - 1  # what rosbag2 writes as the starting time of an empty bag
_CHUNK_BYTES = 768 * 1024
FILE_BYTES = 1_000_000_000
"""A file of a bag is this long."""
_MOST_TIME = {"sec": 9223372036, "nsec": 854775807}  # RMW_DURATION_INFINITE


@dataclass(frozen=True)
class Qos:
    """Quality of service a topic was offered with, in rosbag2's words; any object with these fields will do."""

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "keep_last"
    depth: int = 10


@functools.cache
def typestore() -> Any:
    """The message types of Jazzy as rosbags knows them."""
    from rosbags.typesys import Stores, get_typestore  # 0.1 s: only those who touch a bag pay for it

    return get_typestore(Stores.ROS2_JAZZY)


@dataclass
class _Span:
    """How many messages there were, and from when to when [ns since 1970]."""

    first: int = _NO_TIME
    last: int = 0
    count: int = 0

    def take(self, times: Sequence[int]) -> None:
        """Count messages logged at these times."""
        if times:
            self.first, self.last = min(self.first, *times), max(self.last, *times)
            self.count += len(times)

    def mapping(self) -> dict[str, Any]:
        """As metadata.yaml has it."""
        return {
            "starting_time": {"nanoseconds_since_epoch": self.first},
            "duration": {"nanoseconds": self.last - self.first if self.count else 0},
            "message_count": self.count,
        }


class BagWriter:
    """A rosbag2 folder being written; messages are stored as the bytes they arrive in.

    Args:
        folder: is made, parents included; must not exist or be empty.
        file_bytes: the first flush after so many bytes begins the next file.

    Attributes:
        file: that is being written.

    Raises:
        BenchError: the folder holds something already, or cannot be made.
    """

    def __init__(self, folder: str | Path, file_bytes: int = FILE_BYTES) -> None:
        self.folder = Path(folder)
        self._file_bytes = file_bytes
        self._topics: dict[int, dict[str, Any]] = {}
        self._counts: dict[int, int] = {}
        self._files: list[tuple[str, _Span]] = []
        self._failure: str | None = None
        self._closed = False
        _make_empty(self.folder)
        self._name_file()
        try:
            self._stream = self.file.open("xb")
        except OSError as error:
            raise BenchError(f"{self.file}: cannot write: {error.strerror}; choose another folder") from None
        self._guarded(self._begin_file)

    def _name_file(self) -> None:
        self.file = self.folder / f"{self.folder.resolve().name}_{len(self._files)}.mcap"
        self._files.append((self.file.name, _Span()))

    def _begin_file(self) -> None:
        self._full = False
        self._schemas: dict[str, int] = {}
        self._mcap: Any = Writer(
            self._stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.NONE, enable_data_crcs=True
        )
        self._mcap.start(profile="ros2", library="pzt_ros")
        # rosbag2 too writes this record twice; after a kill the first one still tells the version of the QoS text
        self._add_metadata_record()
        for channel, topic in self._topics.items():
            again = self._register(topic)
            assert again == channel  # MCAP counts them

    def _end_file(self) -> None:
        self._mcap.flush()  # the metadata record belongs behind the last chunk
        self._add_metadata_record()
        self._mcap.finish()
        self._stream.close()

    def add_topic(self, name: str, type_name: str, qos: Any = None) -> int:
        """Announce a topic; returns the channel to write to.

        Args:
            name: absolute, such as /stage/measurement.
            type_name: such as std_msgs/msg/Float64MultiArray.
            qos: fields of `Qos`.

        Raises:
            BenchError: a type that Jazzy's common interfaces do not have.
        """
        qos = qos or Qos()
        if type_name not in typestore().fielddefs:
            raise BenchError(f"topic {name}: unknown message type {type_name}; only the common interfaces are recorded")
        topic = {"name": name, "type": type_name, "qos": qos, "hash": typestore().hash_rihs01(type_name)}
        channel: int = self._guarded(self._register, topic)
        self._topics[channel], self._counts[channel] = topic, 0
        return channel

    def _register(self, topic: dict[str, Any]) -> int:
        """Announce a topic in the file that is being written."""
        kind = topic["type"]
        if kind not in self._schemas:
            definition, _ = typestore().generate_msgdef(kind, ros_version=2)
            self._schemas[kind] = self._mcap.register_schema(name=kind, encoding="ros2msg", data=definition.encode())
        channel: int = self._mcap.register_channel(
            topic=topic["name"],
            message_encoding="cdr",
            schema_id=self._schemas[kind],
            metadata={
                "offered_qos_profiles": yaml.safe_dump([_qos_mapping(topic["qos"])], sort_keys=False).strip(),
                "topic_type_hash": topic["hash"],
            },
        )
        return channel

    def write(self, channel: int, data: bytes, log_time_ns: int, publish_time_ns: int | None = None) -> None:
        """Append one serialized message (CDR with its 4 bytes of encapsulation, as a raw subscription hands it over).

        Raises:
            RunFailedError: the disk is full or gone; what was flushed before stays readable, nothing more is written.
        """
        published = log_time_ns if publish_time_ns is None else publish_time_ns
        self.write_all([(channel, data, log_time_ns, published)])

    def write_all(self, messages: Iterable[tuple[int, bytes, int, int]]) -> None:
        """Append many messages, each (channel, serialized, log time [ns], publish time [ns]). Raises as `write`."""
        self._guarded(self._write_all, messages)

    def _write_all(self, messages: Iterable[tuple[int, bytes, int, int]]) -> None:
        if self._full:
            self._next_file()
        add, counts, times = self._mcap.add_message, self._counts, []
        for channel, data, logged, published in messages:
            add(channel, logged, data, published)
            counts[channel] += 1
            times.append(logged)
        self._files[-1][1].take(times)

    def flush(self) -> None:
        """Close the chunk and hand it to the system: a kill -9 right after loses nothing, a power cut may.

        What is written next goes to the next file if this one is long enough. Raises as `write`.
        """
        self._guarded(self._flush)

    def _flush(self) -> None:
        self._mcap.flush()
        self._full = self._stream.tell() >= self._file_bytes

    def _next_file(self) -> None:
        self._end_file()
        self._name_file()
        self._stream = self.file.open("xb")
        self._begin_file()

    def close(self) -> None:
        """Write the summary and metadata.yaml; nothing after a failed write or twice. Raises as `write`."""
        if self._closed:
            return
        self._closed = True
        if self._failure is not None:
            return
        self._guarded(self._end_file)
        self._failure = f"{self.file}: the bag is closed; open a new one"
        content = {"rosbag2_bagfile_information": self._information()}
        write_text(self.folder / "metadata.yaml", [yaml.safe_dump(content, sort_keys=False)])

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _guarded(self, call: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        """Call; after the first failure never again, because bytes behind a torn record could not be read."""
        if self._failure is None:
            try:
                return call(*args, **kwargs)
            except OSError as error:
                self._failure = f"{self.file}: cannot write the bag: {error.strerror}; make room and record anew"
                self._abandon()
        raise RunFailedError(self._failure)

    def _abandon(self) -> None:
        with contextlib.suppress(OSError):  # the same failure again, for the bytes still in the buffer
            self._stream.close()

    def _add_metadata_record(self) -> None:
        text = yaml.safe_dump(self._information(), sort_keys=False)
        self._mcap.add_metadata("rosbag2", {"serialized_metadata": text})
        self._stream.flush()

    def _information(self) -> dict[str, Any]:
        spans = [span for _, span in self._files]
        first, last = min(span.first for span in spans), max(span.last for span in spans)
        whole = _Span(first, last, sum(span.count for span in spans))
        return {
            "version": METADATA_VERSION,
            "storage_identifier": "mcap",
            **whole.mapping(),
            "topics_with_message_count": [
                {"topic_metadata": _topic_mapping(topic), "message_count": self._counts[channel]}
                for channel, topic in self._topics.items()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [name for name, _ in self._files],
            "files": [{"path": name, **span.mapping()} for name, span in self._files],
            "custom_data": {},
            "ros_distro": "jazzy",
        }


def _topic_mapping(topic: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": topic["name"],
        "type": topic["type"],
        "serialization_format": "cdr",
        "offered_qos_profiles": [_qos_mapping(topic["qos"])],
        "type_description_hash": topic["hash"],
    }


def _qos_mapping(qos: Any) -> dict[str, Any]:
    # the copies keep YAML from writing references, which not every reader resolves
    return {
        "history": qos.history,
        "depth": qos.depth,
        "reliability": qos.reliability,
        "durability": qos.durability,
        "deadline": dict(_MOST_TIME),
        "lifespan": dict(_MOST_TIME),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(_MOST_TIME),
        "avoid_ros_namespace_conventions": False,
    }


def _make_empty(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise BenchError(f"{folder}: the folder is not empty; choose a new one for the bag")
    except FileExistsError:
        raise BenchError(f"{folder}: is a file, expected a new folder for the bag; choose another name") from None
    except OSError as error:
        raise BenchError(f"{folder}: cannot make the folder: {error.strerror}; choose another place") from None
