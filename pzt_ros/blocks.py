"""The one place that knows the fields of the block message (std_msgs/Float64MultiArray); it imports no ROS.

A block is N samples of C columns, row-major, `time_s` first:
`layout.dim = [("sample", N, N*C), ("time_s,voltage_V,...", C, C)]`.
"""

from __future__ import annotations

import array
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

BLOCK_TYPE = "std_msgs/msg/Float64MultiArray"


class BlockError(ValueError):
    """A message that is no block; its text says what is wrong with which number."""


@dataclass(frozen=True, eq=False)
class Block:
    """N samples of C named SI columns.

    Attributes:
        columns: names with units, `time_s` first.
        values: [shape (N, C), float64, row-major].

    Raises:
        BlockError: no samples, time_s not first, or as many names as there are no columns.
    """

    columns: tuple[str, ...]
    values: Array

    def __post_init__(self) -> None:
        if self.columns[:1] != ("time_s",):
            raise BlockError(f"the first column of a block must be time_s, found {','.join(self.columns)!r}")
        if self.values.dtype != np.float64:
            raise BlockError(f"the values of a block are float64, found {self.values.dtype}")
        if self.values.ndim != 2 or self.values.shape[1] != len(self.columns):
            raise BlockError(f"{len(self.columns)} column names for values of shape {self.values.shape}")
        if self.values.shape[0] == 0:
            raise BlockError("a block needs at least one sample, found 0")

    @classmethod
    def of(cls, columns: Mapping[str, ArrayLike]) -> Block:
        """A block from columns [each shape (N,)], in their order."""
        return cls(tuple(columns), np.column_stack([np.asarray(c, dtype=np.float64) for c in columns.values()]))

    @classmethod
    def unchecked(cls, columns: tuple[str, ...], values: Array) -> Block:
        """A block whose shape is known to be right already; three times as fast, for the wire."""
        block = object.__new__(cls)
        block.__dict__.update(columns=columns, values=values)
        return block

    def __len__(self) -> int:
        return int(self.values.shape[0])

    def __getitem__(self, column: str) -> Array:
        """One column [shape (N,)], contiguous, because compiled loops are twice as fast on it."""
        try:
            return np.ascontiguousarray(self.values[:, self.columns.index(column)])
        except ValueError:
            raise BlockError(f"no column {column} in this block; there are {', '.join(self.columns)}") from None

    @property
    def first_time(self) -> float:
        """Time of the first sample [s]."""
        return float(self.values[0, 0])

    @property
    def time(self) -> Array:
        """Sample times [s]."""
        return np.ascontiguousarray(self.values[:, 0])


def read_block(message: Any) -> Block:
    """The block in a Float64MultiArray of rclpy or of rosbags; the values are a view of the message's data.

    Raises:
        BlockError: the layout is not that of a block, or does not fit the data.
    """
    layout = message.layout
    if len(layout.dim) != 2:
        raise BlockError(f"a block has 2 dimensions (sample, columns), found {len(layout.dim)}")
    sample, column = layout.dim
    columns = _columns_of(column.label)
    count, width = sample.size, len(columns)
    if sample.label != "sample":
        raise BlockError(f"the first dimension of a block is 'sample', found {sample.label!r}")
    if column.size != width:
        raise BlockError(f"the second dimension has size {column.size}, but its label names {width}: {column.label!r}")
    if sample.stride != count * width or column.stride != width:
        raise BlockError(
            f"strides {sample.stride} and {column.stride} where {count} samples of {width} columns have "
            f"{count * width} and {width}"
        )
    if layout.data_offset != 0:
        raise BlockError(f"data_offset is {layout.data_offset}, a block has 0")
    data = np.asarray(message.data, dtype=np.float64)
    if data.size != count * width:
        raise BlockError(f"{data.size} numbers where the layout says {count} samples of {width} columns")
    return Block(columns, data.reshape(count, width))


def fill_message(message: Any, dimension_class: Any, block: Block) -> Any:
    """Put a block into an empty Float64MultiArray of rclpy and return it.

    Args:
        message: a new `Float64MultiArray()`; its layout becomes shared with others of the same shape.
        dimension_class: `std_msgs.msg.MultiArrayDimension`.
        block: what to send.
    """
    message.layout = _layout(message.layout.__class__, dimension_class, block.columns, len(block))
    # the message takes an array.array as it is; a NumPy array it would check number by number
    message.data = array.array("d", block.values.tobytes())
    return message


@functools.lru_cache(maxsize=256)
def _columns_of(label: str) -> tuple[str, ...]:
    columns = tuple(label.split(","))
    if columns[0] != "time_s":
        raise BlockError(f"the label of the second dimension must begin with time_s, found {label!r}")
    if len(set(columns)) != len(columns) or "" in columns:
        raise BlockError(f"empty or repeated column name in {label!r}")
    return columns


@functools.lru_cache(maxsize=256)
def _layout(layout_class: Any, dimension_class: Any, columns: tuple[str, ...], count: int) -> Any:
    """The layout message; building one costs more than the rest of a block, so it is built once per shape."""
    width = len(columns)
    sample = dimension_class(label="sample", size=count, stride=count * width)
    column = dimension_class(label=",".join(columns), size=width, stride=width)
    return layout_class(dim=[sample, column], data_offset=0)
