"""Bags cut off, damaged, on a full disk: read up to the damage, and it is said so."""

from __future__ import annotations

import os
import random
import signal
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import yaml
from bag_making import (
    BLOCK_TYPE,
    RUN_TOPICS,
    START,
    expected,
    run_python,
    write_run,
)
from mcap.stream_reader import StreamReader

from pzt_benchmarks.soak.bag_faults import Damage
from pzt_benchmarks.soak.fault import NAMED
from pzt_ros.bags import load_run
from pzt_ros.bags.reader import open_bag
from pzt_ros.bags.writer import BagWriter
from pzt_ros.errors import BenchError, RunFailedError


@pytest.fixture(scope="module")
def run_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("bags") / "run")


@pytest.fixture(scope="module")
def run_file(run_bag: Path) -> Path:
    return run_bag / "run_0.mcap"


def flushed_counts(data: bytes) -> list[tuple[int, int]]:
    """(end of chunk, messages up to there), from the lengths that the format puts before each record."""
    offset, total, ends = 8, 0, []
    while offset < len(data) - 8:
        opcode, length = data[offset], int.from_bytes(data[offset + 1 : offset + 9], "little")
        offset += 9 + length
        if opcode == 0x06:
            total += 20  # 4 topics, 5 blocks between flushes
            ends.append((offset, total))
    return ends


def read_all(path: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Every message of a file as bytes, by topic, through the pass that readers use."""
    from pzt_ros.bags.scan import McapFile

    found: dict[str, list[tuple[int, bytes]]] = {}
    for topic, log_time, data in McapFile(path).messages():
        found.setdefault(topic.name, []).append((log_time, bytes(data)))
    return found


def is_beginning(part: dict[str, list[tuple[int, bytes]]], whole: dict[str, list[tuple[int, bytes]]]) -> bool:
    return all(messages == whole[topic][: len(messages)] for topic, messages in part.items())


def test_cut_anywhere_keeps_every_flushed_message(run_file: Path, tmp_path: Path) -> None:
    data, whole = run_file.read_bytes(), read_all(run_file)
    ends = flushed_counts(data)
    assert ends[-1][1] == 120
    offsets = random.Random(1).sample(range(len(data)), 50)
    edges = [1, 7, 8, 9, len(data) - 1, ends[0][0] - 1, ends[0][0], ends[0][0] + 1, ends[-1][0]]
    path = tmp_path / "cut.mcap"
    for offset in offsets + edges:
        path.write_bytes(data[:offset])
        safe = max((total for end, total in ends if end <= offset), default=0)
        if offset < 8:
            with pytest.raises(BenchError, match=r"cut\.mcap"):
                open_bag(path)
            continue
        bag = open_bag(path)
        assert not bag.complete
        assert "cut.mcap" in bag.notes[0]
        assert bag.notes[0].isprintable()
        part = read_all(path)
        assert sum(map(len, part.values())) == sum(topic.count for topic in bag.topics()) == safe
        assert is_beginning(part, whole)
        if safe:
            record = load_run(path)
            assert len(record) == safe // 4 * 10
            assert any("cut.mcap" in warning for warning in record.warnings)


def test_a_record_of_another_kind_is_noticed(tmp_path: Path) -> None:
    """A chunk that claims to be something else must not vanish, nor anything else become a message."""
    bag = Damage(tmp_path)
    offset, tried = 8, 0
    while offset < len(bag.good) - 8:
        for bit in range(8):
            damaged = bytearray(bag.good)
            damaged[offset] ^= 1 << bit
            assert bag.read(bytes(damaged)).reaction == NAMED, f"record at byte {offset}, bit {bit}"
            tried += 1
        offset += 9 + int.from_bytes(bag.good[offset + 1 : offset + 9], "little")
    assert tried > 400


def test_every_bit_of_the_end_of_the_data_counts(run_file: Path, tmp_path: Path) -> None:
    """The record that carries the checksum must not vanish or change unnoticed itself."""
    data = run_file.read_bytes()
    summary_start = int.from_bytes(data[-28:-20], "little")  # in the footer: 8 + 8 + 4 bytes, then 8 of magic
    path = tmp_path / "end.mcap"
    for bit in range(13 * 8):
        damaged = bytearray(data)
        damaged[summary_start - 13 + bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        bag = open_bag(path)
        assert not bag.complete, f"bit {bit}"
        assert sum(topic.count for topic in bag.topics()) == 120


def test_random_bytes_behind_the_magic_are_named(tmp_path: Path) -> None:
    rng = random.Random(3)
    path = tmp_path / "noise.mcap"
    for length in (1, 9, 50, 5000):
        path.write_bytes(b"\x89MCAP0\r\n" + rng.randbytes(length))
        bag = open_bag(path)
        assert not bag.complete
        assert bag.topics() == []
        with pytest.raises(BenchError, match="no topic"):
            load_run(path)


WRITE_AND_DIE = """
    import os, signal, sys
    sys.path.insert(0, {tests!r})
    from bag_making import BLOCK_TYPE, PERIOD, RUN_TOPICS, START, block_bytes, block_values
    from pzt_ros.bags.writer import BagWriter
    writer = BagWriter({folder!r})
    channels = {{topic: writer.add_topic(topic, BLOCK_TYPE) for topic in RUN_TOPICS}}
    for number in range(40):
        for topic, channel in channels.items():
            writer.write(channel, block_bytes(RUN_TOPICS[topic], block_values(topic, number)), START + number * PERIOD)
        if number == 36:
            writer.flush()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_kill_after_flush_loses_nothing_before_it(tmp_path: Path) -> None:
    done = run_python(WRITE_AND_DIE, folder=str(tmp_path / "killed"))
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert os.listdir(tmp_path / "killed") == ["killed_0.mcap"]
    bag = open_bag(tmp_path / "killed")
    assert not bag.complete
    assert "148 messages" in bag.notes[0]
    for topic in RUN_TOPICS:
        np.testing.assert_array_equal(bag.blocks(topic).values, expected(topic, 37))
    records = StreamReader(BytesIO((tmp_path / "killed" / "killed_0.mcap").read_bytes())).records
    first_metadata = next(record for record in records if type(record).__name__ == "Metadata")
    assert yaml.safe_load(first_metadata.metadata["serialized_metadata"])["version"] == 9


FILL_THE_DISK = """
    import resource, signal, sys
    sys.path.insert(0, {tests!r})
    from bag_making import BLOCK_TYPE, RUN_TOPICS, START, block_bytes, block_values
    from pzt_ros.bags.writer import BagWriter
    from pzt_ros.errors import RunFailedError
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
    writer = BagWriter({folder!r})
    channel = writer.add_topic("/stage/applied", BLOCK_TYPE)
    try:
        for number in range(10_000):
            data = block_bytes(RUN_TOPICS["/stage/applied"], block_values("/stage/applied", number))
            writer.write(channel, data, START)
            if number % 10 == 9:
                writer.flush()
                flushed = number + 1
    except RunFailedError as error:
        print(flushed, error)
    try:
        writer.write(channel, b"", START)
    except RunFailedError as error:
        print("again", error)
    writer.close()
"""


def test_full_disk_is_an_error_and_what_was_written_stays_readable(tmp_path: Path) -> None:
    done = run_python(FILL_THE_DISK, folder=str(tmp_path / "full"))
    assert (done.returncode, done.stderr) == (0, "")
    first, again = done.stdout.splitlines()
    assert "full_0.mcap: cannot write the bag: File too large" in first
    assert again.startswith("again ")
    flushed = int(first.split()[0])
    assert flushed >= 50
    assert os.listdir(tmp_path / "full") == ["full_0.mcap"]
    bag = open_bag(tmp_path / "full")
    assert not bag.complete
    np.testing.assert_array_equal(bag.blocks("/stage/applied").values, expected("/stage/applied", flushed))


def test_writer_refuses_what_is_there(tmp_path: Path, run_bag: Path) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / "empty").mkdir()
    for folder, found in (
        (run_bag, "not empty"),
        (tmp_path / "file", "is a file"),
        (tmp_path / "file" / "bag", "cannot make"),
    ):
        with pytest.raises(BenchError, match=found) as caught:
            BagWriter(folder)
        assert str(folder) in str(caught.value)
    BagWriter(tmp_path / "empty").close()


def test_closed_writer_takes_nothing_more(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag")
    channel = writer.add_topic("/stage/applied", BLOCK_TYPE)
    writer.close()
    writer.close()
    with pytest.raises(RunFailedError, match="closed"):
        writer.write(channel, b"", START)
    assert open_bag(tmp_path / "bag").complete
