"""The processor is kept awake where that is allowed, and the graph runs where it is not."""

from __future__ import annotations

import struct
from pathlib import Path

from pzt_bringup.cpu_latency import awake_processor


def test_asks_for_zero_latency_while_open(tmp_path: Path) -> None:
    device = tmp_path / "cpu_dma_latency"
    device.write_bytes(b"")
    with awake_processor(device) as granted:
        assert granted
        assert struct.unpack("i", device.read_bytes()) == (0,)


def test_goes_on_without_the_right(tmp_path: Path) -> None:
    with awake_processor(tmp_path / "not" / "there") as granted:
        assert not granted
