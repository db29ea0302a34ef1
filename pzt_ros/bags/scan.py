"""Every message of one MCAP file, complete or not: reads forward, checks every checksum, stops at the first damage.

The official readers need an intact summary, or stop with whatever exception the damaged bytes happen to cause. Here
each record is framed by its own length before the official parser sees it, so that damage has a place and nothing is
read across it.
Format: https://mcap.dev/spec
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, Schema
from mcap.stream_reader import get_chunk_data_stream

from pzt_ros.errors import BenchError

MAGIC = b"\x89MCAP0\r\n"
_RECORD_HEAD = struct.Struct("<BQ")  # opcode, length of the content
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_INDEX_HEAD = struct.Struct("<HI")  # channel, length of the entries
_FIRST_PRIVATE_OPCODE = 0x80
_OF_THE_SUMMARY = (
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.STATISTICS,
    Opcode.METADATA_INDEX,
    Opcode.SUMMARY_OFFSET,
)
"""Kinds of records that have no place among the data; a chunk whose kind was altered may look like one of them."""


@dataclass(frozen=True)
class Topic:
    """A topic as the file declares it."""

    name: str
    type_name: str
    encoding: str


@dataclass
class Tally:
    """What there is of one topic [log times in ns]."""

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def add(self, log_time_ns: int) -> None:
        self.first_ns = log_time_ns if self.count == 0 else min(self.first_ns, log_time_ns)
        self.last_ns = max(self.last_ns, log_time_ns)
        self.count += 1

    def merge(self, other: Tally) -> None:
        """Take in the tally of the same topic in the next file."""
        if other.count:
            self.first_ns = min(self.first_ns, other.first_ns) if self.count else other.first_ns
            self.last_ns = max(self.last_ns, other.last_ns)
            self.count += other.count


StoredMessage = tuple[Topic, int, memoryview]
"""Topic, log time [ns], serialized message."""


class DamageError(Exception):
    """From here on the file cannot be read."""

    def __init__(self, offset: int, what: str) -> None:
        super().__init__(what)
        self.offset = offset
        self.what = what


@dataclass
class _Declared:
    schemas: dict[int, str] = field(default_factory=dict)
    topics: dict[int, Topic] = field(default_factory=dict)


class McapFile:
    """One MCAP file, looked through once when opened.

    Attributes:
        path: of the file.
        damage: None where the file is whole.
        tallies: what was found of each topic, up to the damage.

    Raises:
        BenchError: no such file, or no MCAP file at all.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._bytes = _mapped(path)
        self.size = len(self._bytes)
        self.tallies: dict[Topic, Tally] = {}
        self.damage: DamageError | None = None
        self._end = self.size
        declared = _Declared()
        try:
            for topic, log_time, _ in _walk(self._bytes, self.size, declared, verify=True):
                self.tallies.setdefault(topic, Tally()).add(log_time)
        except DamageError as damage:
            self.damage = damage
            self._end = damage.offset
            self.tallies = {}  # the damage may lie before what was counted already
            for topic, log_time, _ in self.messages():
                self.tallies.setdefault(topic, Tally()).add(log_time)
        for topic in declared.topics.values():
            self.tallies.setdefault(topic, Tally())

    def messages(self) -> Iterator[StoredMessage]:
        """Every message up to the damage, in the order of the file; the bytes are a view of the file."""
        return _walk(self._bytes, self._end, _Declared(), verify=False)


def _mapped(path: Path) -> memoryview:
    try:
        with path.open("rb") as stream:
            head = stream.read(len(MAGIC))
            if not head:
                raise BenchError(f"{path}: the file is empty; nothing was recorded, or the copy failed")
            if head != MAGIC:
                raise BenchError(
                    f"{path}: no MCAP file, it begins with {head!r}; give a bag recorded with MCAP storage"
                )
            return memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
    except OSError as error:
        raise BenchError(f"{path}: cannot read: {error.strerror}; check the path and its permissions") from None


def _walk(data: memoryview, end: int, declared: _Declared, verify: bool) -> Iterator[StoredMessage]:
    """The messages of the records before `end`; with `verify` also every checksum and the end of the file.

    Raises:
        DamageError: with `verify` only, because without it `end` lies before the damage.
    """
    offset = len(MAGIC)
    checksum = zlib.crc32(data[:offset])
    data_end_seen = False
    chunks_seen = False
    unsure: int | None = None  # the first record that is not what a file with chunks is made of
    summary_start = offset
    summary = _Declared()  # repeats what the data section declares, and adds the topics that never had a message
    while offset < end:
        opcode, start, stop = _frame(data, offset, end)
        content = data[start:stop]
        damaged = offset
        try:
            if chunks_seen and (opcode == Opcode.MESSAGE or opcode >= _FIRST_PRIVATE_OPCODE):
                unsure = offset if unsure is None else unsure
            if opcode == Opcode.CHUNK:
                chunks_seen = True
                yield from _chunk_messages(content, declared, verify)
            elif opcode == Opcode.FOOTER:
                if verify:
                    _check_footer(data, content, offset, summary_start, data_end_seen)
                declared.topics.update({**summary.topics, **declared.topics})
                return
            elif opcode == Opcode.DATA_END:
                expected = DataEnd.read(_stream(content)).data_section_crc
                if verify and expected not in (0, checksum):
                    damaged = offset if unsure is None else unsure
                    raise ValueError("checksum of the data section is wrong, some record before it was altered")
                data_end_seen, summary_start = True, stop
            elif opcode in _OF_THE_SUMMARY and not data_end_seen:
                raise ValueError(f"a record of the summary (0x{opcode:02x}) among the data")
            else:
                message = _other_record(opcode, content, summary if data_end_seen else declared)
                if message is not None:
                    yield message
        except Exception as error:  # parser and decompressors raise a dozen kinds; to the reader they are one
            raise DamageError(damaged, str(error) or type(error).__name__) from None
        if verify and not data_end_seen:
            checksum = zlib.crc32(data[offset:stop], checksum)
        offset = stop
    if verify:
        raise DamageError(end, "the end of the file is missing")


def _frame(data: memoryview, offset: int, end: int) -> tuple[int, int, int]:
    """Opcode, start and stop of the content of the record at `offset`."""
    start = offset + _RECORD_HEAD.size
    if start > end:
        raise DamageError(offset, "the file ends within a record")
    opcode, length = _RECORD_HEAD.unpack_from(data, offset)
    if opcode == 0 or Opcode.DATA_END < opcode < _FIRST_PRIVATE_OPCODE:
        raise DamageError(offset, f"0x{opcode:02x} is no kind of record")
    if start + length > end:
        raise DamageError(offset, f"a record of {length} bytes reaches past the end of the file")
    return opcode, start, start + length


def _stream(content: memoryview) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


def _other_record(opcode: int, content: memoryview, declared: _Declared) -> StoredMessage | None:
    if opcode == Opcode.MESSAGE:
        channel, _, log_time, _ = _MESSAGE_HEAD.unpack_from(content)
        if channel not in declared.topics:
            raise ValueError(f"a message of channel {channel}, which was never declared")
        return declared.topics[channel], log_time, content[_MESSAGE_HEAD.size :]
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(_stream(content))
        declared.schemas[schema.id] = schema.name
    elif opcode == Opcode.MESSAGE_INDEX:
        _, length = _INDEX_HEAD.unpack_from(content)
        if length != len(content) - _INDEX_HEAD.size:
            raise ValueError("a record that is no index of messages, though it says so")
    elif opcode == Opcode.CHANNEL:
        channel_record = Channel.read(_stream(content))
        type_name = declared.schemas.get(channel_record.schema_id, "")
        declared.topics[channel_record.id] = Topic(channel_record.topic, type_name, channel_record.message_encoding)
    return None


def _chunk_messages(content: memoryview, declared: _Declared, verify: bool) -> list[StoredMessage]:
    """All messages of a chunk or none: a list, so that damage within the chunk shows before the first is handed out."""
    chunk = Chunk.read(_stream(content))
    stream, length = get_chunk_data_stream(chunk, validate_crc=verify)
    if length != chunk.uncompressed_size:
        raise ValueError(f"chunk of {length} bytes where its head says {chunk.uncompressed_size}")
    data = memoryview(stream.read(length))
    messages = []
    offset = 0
    while offset < length:
        opcode, start, stop = _frame(data, offset, length)
        message = _other_record(opcode, data[start:stop], declared)
        if message is not None:
            messages.append(message)
        offset = stop
    return messages


def _check_footer(data: memoryview, content: memoryview, offset: int, summary_start: int, data_end_seen: bool) -> None:
    footer = Footer.read(_stream(content))
    if not data_end_seen:
        raise ValueError("the record that ends the data section is missing")
    checked = data[summary_start : offset + _RECORD_HEAD.size + 16]  # up to the checksum itself
    if footer.summary_crc not in (0, zlib.crc32(checked)):
        raise ValueError("checksum of the summary is wrong")
    if bytes(data[offset + _RECORD_HEAD.size + len(content) :]) != MAGIC:
        raise ValueError("the file does not end as an MCAP file")
