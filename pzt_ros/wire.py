"""Blocks as the bytes that go over the wire (CDR), without a message object in between.

Building and taking apart a Float64MultiArray costs ten times what its numbers cost. All blocks of a topic begin with
the same bytes, up to the first number: what begins so is read directly, and whatever else a foreign node may send is
left to the ordinary decoder. A test holds the two together.
"""

from __future__ import annotations

import functools
import struct

import numpy as np

from pzt_ros.blocks import Block
from pzt_ros.physics.signals import Array

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_DOUBLE = np.dtype("<f8")


@functools.lru_cache(maxsize=256)
def prefix(columns: tuple[str, ...], count: int) -> bytes:
    """All that stands before the numbers of a block of `count` samples, in little-endian CDR."""
    width = len(columns)
    body = struct.pack("<I", 2)
    for label, size, stride in (("sample", count, count * width), (",".join(columns), width, width)):
        text = label.encode() + b"\0"
        body += struct.pack("<I", len(text)) + text
        body += b"\0" * (-len(body) % 4) + struct.pack("<II", size, stride)
    body += struct.pack("<II", 0, count * width)
    return _LITTLE_ENDIAN + body + b"\0" * (-len(body) % 8)


def encode(columns: tuple[str, ...], arrays: tuple[Array, ...]) -> bytes:
    """A block of one array per column [each of shape (n,)] as bytes for the wire.

    Raises:
        ValueError: the columns are not all as long as the first.
    """
    values = np.array(arrays, dtype=_DOUBLE)
    return prefix(columns, len(arrays[0])) + values.T.tobytes()


def decode(data: bytes, columns: tuple[str, ...], count: int) -> Block | None:
    """The block in `data`, or None if it does not begin as a block of these columns and `count` samples does."""
    head, width = prefix(columns, count), len(columns)
    if len(data) != len(head) + 8 * count * width or not data.startswith(head):
        return None
    return Block.unchecked(columns, np.ndarray((count, width), _DOUBLE, data, len(head)))


def decode_any(data: bytes, columns: tuple[str, ...]) -> Block | None:
    """The block of these columns in `data`, however many samples it has; or None, as `decode` has it."""
    count, rest = divmod(len(data) - len(prefix(columns, 1)), 8 * len(columns))
    return decode(data, columns, count) if count > 0 and not rest else None
