"""Bags (rosbag2, MCAP storage) and CSV runs, written and read without ROS."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pzt_ros.records import RUN_COLUMNS, Record, read_csv


def load_run(path: str | Path, required: Sequence[str] = RUN_COLUMNS, namespace: str | None = None) -> Record:
    """A measured run out of a CSV file, a bag folder or an .mcap file, chosen by what is there.

    Of a bag of several axes it is that of `namespace`, or that in whose run folder the bag is named (`run/x/bag`), with
    the reading of the other one, where there is one other, beside it.

    Raises:
        BenchError: as `read_csv`, `axis_of` and `record_from_bag`.
    """
    if _is_bag(Path(path)):
        from pzt_ros.bags.axes import axis_of, with_neighbour  # a CSV file must not pay for the bag libraries
        from pzt_ros.bags.reader import open_bag, record_from_bag

        bag = open_bag(path)
        axis = namespace or axis_of(bag, path)
        record = record_from_bag(path, axis, [name for name in required if name != "time_s"])
        return with_neighbour(record, bag, axis)
    return read_csv(path, required)


def _is_bag(path: Path) -> bool:
    from pzt_ros.bags.scan import MAGIC

    if path.is_dir() or path.suffix in (".mcap", ".db3"):
        return True
    try:
        with path.open("rb") as stream:
            return stream.read(len(MAGIC)) == MAGIC
    except OSError:
        return False  # read_csv names what is wrong with the file
