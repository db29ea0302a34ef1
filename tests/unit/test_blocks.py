"""The block message: both decoders, views without a copy, and every wrong layout named."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from pzt_ros.bags.writer import typestore
from pzt_ros.blocks import BLOCK_TYPE, Block, BlockError, fill_message, read_block

COLUMNS = ("time_s", "voltage_V", "current_A")


@dataclasses.dataclass
class Dimension:
    label: str
    size: int
    stride: int


@dataclasses.dataclass
class Layout:
    dim: list[Dimension]
    data_offset: int = 0


@dataclasses.dataclass
class Message:
    layout: Layout
    data: Any


def values_of(count: int, seed: int = 1) -> np.ndarray:
    values = np.random.default_rng(seed).normal(size=(count, len(COLUMNS)))
    values[:, 0] = np.arange(count) * 5e-5
    return values


def good_message(count: int = 4) -> Message:
    layout = Layout([Dimension("sample", count, 3 * count), Dimension(",".join(COLUMNS), 3, 3)])
    return Message(layout, values_of(count).ravel())


def test_block_gives_contiguous_columns() -> None:
    block = Block(COLUMNS, values_of(5))
    assert len(block) == 5
    np.testing.assert_array_equal(block["voltage_V"], block.values[:, 1])
    np.testing.assert_array_equal(block.time, block.values[:, 0])
    assert block["current_A"].flags.c_contiguous
    with pytest.raises(BlockError, match="charge_C"):
        block["charge_C"]


def test_block_of_columns_keeps_their_order() -> None:
    block = Block.of({"time_s": [0.0, 1.0], "voltage_V": [3, 4]})
    assert block.columns == ("time_s", "voltage_V")
    np.testing.assert_array_equal(block.values, [[0.0, 3.0], [1.0, 4.0]])


def test_read_block_shares_memory_with_the_message() -> None:
    message = good_message()
    block = read_block(message)
    assert block.columns == COLUMNS
    assert np.shares_memory(block.values, message.data)
    np.testing.assert_array_equal(block.values, values_of(4))


def set_path(message: Message, change: str, value: Any) -> None:
    if change == "data":
        message.data = value
    elif change == "data_offset":
        message.layout.data_offset = value
    elif change == "dim":
        message.layout.dim = value
    else:
        index, name = change.split(".")
        setattr(message.layout.dim[int(index)], name, value)


@pytest.mark.parametrize(
    ("change", "value", "found"),
    [
        ("dim", [], "found 0"),
        ("dim", [Dimension("sample", 12, 12)], "found 1"),
        ("data", np.zeros(11), "11 numbers"),
        ("data", np.zeros(0), "0 numbers"),
        ("1.label", "voltage_V,time_s,current_A", "begin with time_s"),
        ("1.label", "", "begin with time_s"),
        ("1.label", "time_s,voltage_V", "names 2"),
        ("1.label", "time_s,voltage_V,voltage_V", "repeated"),
        ("1.label", "time_s,,voltage_V", "empty"),
        ("0.label", "channel", "'channel'"),
        ("0.stride", 4, "strides 4 and 3"),
        ("1.stride", 1, "strides 12 and 1"),
        ("1.size", 2, "size 2"),
        ("0.size", 5, "strides"),
        ("data_offset", 1, "data_offset is 1"),
    ],
)
def test_wrong_layout_is_named(change: str, value: Any, found: str) -> None:
    message = good_message()
    set_path(message, change, value)
    with pytest.raises(BlockError, match=found) as caught:
        read_block(message)
    assert "\n" not in str(caught.value)


def test_zero_samples_are_no_block() -> None:
    message = good_message()
    message.layout.dim[0] = Dimension("sample", 0, 0)
    message.data = np.zeros(0)
    with pytest.raises(BlockError, match="at least one sample"):
        read_block(message)


def test_other_number_types_are_no_block() -> None:
    with pytest.raises(BlockError, match="float32"):
        Block(COLUMNS, values_of(2).astype(np.float32))


@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")  # lark, which the ROS wheels import
def test_rclpy_message_and_rosbags_decoder_agree() -> None:
    serialization = pytest.importorskip("rclpy.serialization")
    messages = pytest.importorskip("std_msgs.msg")
    block = Block(COLUMNS, values_of(100))
    message = fill_message(messages.Float64MultiArray(), messages.MultiArrayDimension, block)
    back = read_block(message)
    assert back.columns == COLUMNS
    np.testing.assert_array_equal(back.values, block.values)
    assert np.shares_memory(back.values, np.frombuffer(message.data))

    wire = bytes(serialization.serialize_message(message))
    independent = read_block(typestore().deserialize_cdr(wire, BLOCK_TYPE))
    assert independent.columns == COLUMNS
    np.testing.assert_array_equal(independent.values, block.values)
    received = serialization.deserialize_message(wire, messages.Float64MultiArray)
    assert [(d.label, d.size, d.stride) for d in received.layout.dim] == [
        ("sample", 100, 300),
        ("time_s,voltage_V,current_A", 3, 3),
    ]


def test_a_slice_of_a_block_is_sent_row_major() -> None:
    messages = pytest.importorskip("std_msgs.msg")
    block = Block(COLUMNS, np.asfortranarray(values_of(6))[::2])
    message = fill_message(messages.Float64MultiArray(), messages.MultiArrayDimension, block)
    np.testing.assert_array_equal(read_block(message).values, values_of(6)[::2])


def test_blocks_of_different_length_do_not_share_a_layout() -> None:
    messages = pytest.importorskip("std_msgs.msg")
    for count in (1, 2, 1):
        message = fill_message(
            messages.Float64MultiArray(), messages.MultiArrayDimension, Block(COLUMNS, values_of(count))
        )
        assert len(read_block(message)) == count
