"""Which axis of a bag is meant, and where the other one was meanwhile."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from pzt_ros.bags.reader import Bag
from pzt_ros.blocks import read_block
from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record

_MEASUREMENT = "/measurement"


def axis_of(bag: Bag, path: str | Path) -> str:
    """The namespace of the axis that was recorded; of several, that in whose run folder the bag was named.

    Raises:
        BenchError: several axes, and the path says none of them.
    """
    axes = _axes(bag)
    if len(axes) < 2:
        return axes[0] if axes else "/stage"  # whose topics are then said to be missing
    named = f"/{Path(path).absolute().parent.name}"
    if named in axes:
        return named
    folders = " or ".join(str(Path(path).parent / axis.strip("/") / Path(path).name) for axis in axes)
    raise BenchError(f"{path}: a bag of the axes {', '.join(axes)}; name one, as {folders}")


def with_neighbour(record: Record, bag: Bag, namespace: str) -> Record:
    """The record with the reading of the other axis as `neighbour_displacement_m`, where there is one other axis.

    Axes have no time in common but that of the recorder, so it is right to within a block.
    """
    others = [axis for axis in _axes(bag) if axis != namespace]
    if len(others) != 1:
        return record
    own_time, own_clock, _ = _course(bag, namespace)
    _, clock, displacement = _course(bag, others[0])
    when = np.interp(record.time, own_time, own_clock)
    columns = {**record.columns, "neighbour_displacement_m": np.interp(when, clock, displacement)}
    return dataclasses.replace(record, columns=columns)


def _axes(bag: Bag) -> list[str]:
    said = (topic.name for topic in bag.topics() if topic.count and topic.name.endswith(_MEASUREMENT))
    return [name.removesuffix(_MEASUREMENT) for name in said]


def _course(bag: Bag, namespace: str) -> tuple[Array, Array, Array]:
    """Mean run time of each block [s], when it was recorded [s], and its mean reading [m]; [each of shape (n,)]."""
    time, clock, displacement = [], [], []
    for when, message in bag.messages(namespace + _MEASUREMENT):
        block = read_block(message)
        time.append(block.time.mean())
        clock.append(when * 1e-9)
        displacement.append(block["displacement_m"].mean())
    return np.array(time), np.array(clock), np.array(displacement)
