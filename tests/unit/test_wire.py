"""Blocks on the wire: byte for byte what ROS itself writes, and nothing else is taken for one."""

from __future__ import annotations

import string
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pzt_ros.bags.writer import typestore
from pzt_ros.blocks import BLOCK_TYPE, Block, fill_message, read_block
from pzt_ros.wire import decode, encode, prefix

COLUMNS = ("time_s", "voltage_V", "current_A", "charge_C")
NAME = st.text(string.ascii_letters + string.digits + "_", min_size=1, max_size=12)
SHAPE = st.tuples(st.lists(NAME, unique=True, max_size=7).map(lambda names: ("time_s", *names)), st.integers(1, 300))
CASES = settings(max_examples=60, derandomize=True, deadline=None, database=None)


def arrays_of(columns: tuple[str, ...], count: int) -> tuple[np.ndarray, ...]:
    """Numbers of every size, with those that compare to nothing among them."""
    bits = np.random.default_rng(count).integers(0, 2**64, size=(len(columns), count), dtype=np.uint64)
    return tuple(bits.view(np.float64))


def values_of(arrays: tuple[np.ndarray, ...]) -> np.ndarray:
    return np.column_stack(arrays)


def assert_same_bits(one: np.ndarray, other: np.ndarray) -> None:
    assert one.shape == other.shape
    assert np.ascontiguousarray(one).tobytes() == np.ascontiguousarray(other).tobytes()


@CASES
@given(SHAPE)
def test_what_goes_in_comes_out(shape: tuple[tuple[str, ...], int]) -> None:
    columns, count = shape
    arrays = arrays_of(columns, count)
    block = decode(encode(columns, arrays), columns, count)
    assert block is not None
    assert block.columns == columns
    assert_same_bits(block.values, values_of(arrays))


@CASES
@given(SHAPE)
def test_bytes_are_those_of_rosbags(shape: tuple[tuple[str, ...], int]) -> None:
    columns, count = shape
    arrays = arrays_of(columns, count)
    types = typestore().types
    width = len(columns)
    dimension = types["std_msgs/msg/MultiArrayDimension"]
    layout = types["std_msgs/msg/MultiArrayLayout"](
        dim=[
            dimension(label="sample", size=count, stride=count * width),
            dimension(label=",".join(columns), size=width, stride=width),
        ],
        data_offset=0,
    )
    message = types[BLOCK_TYPE](layout=layout, data=values_of(arrays).ravel())
    assert encode(columns, arrays) == bytes(typestore().serialize_cdr(message, BLOCK_TYPE))
    assert_same_bits(
        read_block(typestore().deserialize_cdr(encode(columns, arrays), BLOCK_TYPE)).values, values_of(arrays)
    )


@pytest.fixture(scope="module")
def ros() -> Any:
    """The serializer of ROS, and the message it is for."""
    serialization = pytest.importorskip("rclpy.serialization")
    messages = pytest.importorskip("std_msgs.msg")
    return SimpleNamespace(
        write=serialization.serialize_message,
        read=serialization.deserialize_message,
        message=messages.Float64MultiArray,
        dimension=messages.MultiArrayDimension,
    )


def without_padding(data: bytes, columns: tuple[str, ...]) -> bytes:
    """The bytes that mean something: the serializer of ROS leaves what was in memory where CDR wants a gap."""
    meaning, at = bytearray(data), 4 + 4  # the CDR header, the number of dimensions
    for label in ("sample", ",".join(columns)):
        at += 4 + len(label) + 1
        gap = -at % 4
        meaning[at : at + gap] = bytes(gap)
        at += gap + 4 + 4
    at += 4 + 4
    gap = -(at - 4) % 8
    meaning[at : at + gap] = bytes(gap)
    return bytes(meaning)


@CASES
@given(shape=SHAPE)
def test_bytes_are_those_of_ros(ros: Any, shape: tuple[tuple[str, ...], int]) -> None:
    columns, count = shape
    arrays = arrays_of(columns, count)
    block = Block(columns, values_of(arrays))
    written = bytes(ros.write(fill_message(ros.message(), ros.dimension, block)))
    assert encode(columns, arrays) == without_padding(written, columns)
    assert len(written) == len(encode(columns, arrays))
    direct = decode(written, columns, count)
    assert direct is None or direct.values.tobytes() == block.values.tobytes(), "None where a gap is not zero"
    back = decode(without_padding(written, columns), columns, count)
    assert back is not None
    assert_same_bits(back.values, block.values)
    assert_same_bits(read_block(ros.read(encode(columns, arrays), ros.message)).values, block.values)


GOOD = encode(COLUMNS, arrays_of(COLUMNS, 5))


@pytest.mark.parametrize(
    ("columns", "count"),
    [
        (("time_s", "voltage_V", "current_A"), 5),
        (("time_s", "voltage_V", "current_A", "charge_K"), 5),
        (("time_s", "current_A", "voltage_V", "charge_C"), 5),
        ((*COLUMNS, "more_m"), 4),
        (COLUMNS, 4),
        (COLUMNS, 6),
        (("time_s", "displacement_m"), 10),
    ],
)
def test_another_block_is_left_to_the_ordinary_decoder(columns: tuple[str, ...], count: int) -> None:
    assert decode(GOOD, COLUMNS, 5) is not None
    assert decode(GOOD, columns, count) is None


def test_a_truncated_or_longer_block_is_none() -> None:
    for length in range(len(GOOD)):
        assert decode(GOOD[:length], COLUMNS, 5) is None, length
    for more in (1, 4, 8):
        assert decode(GOOD + bytes(more), COLUMNS, 5) is None


def test_one_wrong_byte_before_the_numbers_is_none() -> None:
    for position in range(len(prefix(COLUMNS, 5))):
        for flip in (0x01, 0x80, 0xFF):
            broken = bytearray(GOOD)
            broken[position] ^= flip
            assert decode(bytes(broken), COLUMNS, 5) is None, position


def test_numbers_can_be_read_column_by_column() -> None:
    arrays = arrays_of(COLUMNS, 5)
    block = decode(GOOD, COLUMNS, 5)
    assert block is not None
    for name, array in zip(COLUMNS, arrays, strict=True):
        assert_same_bits(block[name], array)
        assert block[name].flags.aligned, "compiled loops want it so"
        assert block[name].flags.c_contiguous


def test_columns_of_other_lengths_are_refused_even_where_their_sum_fits() -> None:
    with pytest.raises(ValueError, match="inhomogeneous"):
        encode(("time_s", "a", "b"), (np.arange(3.0), np.arange(2.0), np.arange(4.0)))
