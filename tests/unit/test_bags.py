"""Bags: what we write other readers read; what others cut off or damaged we read up to the damage, and say so."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

from pzt_ros.bags import load_run
from pzt_ros.bags.export import bag_info, export_csv
from pzt_ros.bags.reader import open_bag, record_from_bag
from pzt_ros.bags.writer import BagWriter, Qos, typestore
from pzt_ros.blocks import BLOCK_TYPE
from pzt_ros.errors import BenchError, RunFailedError
from pzt_ros.records import read_csv, write_csv

START = 1_700_000_000_000_000_000
PERIOD = 5_000_000  # one block of 100 samples at 20 kHz [ns]
RUN_TOPICS = {
    "/stage/reference": ("time_s", "displacement_m"),
    "/stage/drive": ("time_s", "command_voltage_V"),
    "/stage/applied": ("time_s", "voltage_V", "current_A", "charge_C"),
    "/stage/measurement": ("time_s", "displacement_m"),
}


def block_bytes(columns: tuple[str, ...], values: np.ndarray) -> bytes:
    """A block as the independent encoder of rosbags serializes it."""
    types = typestore().types
    count, width = values.shape
    dimension = types["std_msgs/msg/MultiArrayDimension"]
    layout = types["std_msgs/msg/MultiArrayLayout"](
        dim=[dimension("sample", count, count * width), dimension(",".join(columns), width, width)], data_offset=0
    )
    return serialized(types[BLOCK_TYPE](layout=layout, data=values.ravel()), BLOCK_TYPE)


def serialized(message: Any, type_name: str) -> bytes:
    return bytes(typestore().serialize_cdr(message, type_name))


def block_values(topic: str, number: int, samples: int = 10) -> np.ndarray:
    """Block `number` of a topic: uneven but increasing time, the same on all topics."""
    width = len(RUN_TOPICS[topic])
    values = np.random.default_rng([len(topic), number]).normal(size=(samples, width))
    values[:, 0] = (number * samples + np.arange(samples)) / 3.0
    return values


def write_run(folder: Path, blocks: int = 30, flush_every: int = 5, topics: Any = RUN_TOPICS) -> Path:
    with BagWriter(folder) as writer:
        channels = {topic: writer.add_topic(topic, BLOCK_TYPE, Qos(depth=1000)) for topic in topics}
        for number in range(blocks):
            for topic, channel in channels.items():
                data = block_bytes(RUN_TOPICS[topic], block_values(topic, number))
                writer.write(channel, data, START + number * PERIOD)
            if number % flush_every == flush_every - 1:
                writer.flush()
    return folder


def expected(topic: str, blocks: int) -> np.ndarray:
    return np.concatenate([block_values(topic, number) for number in range(blocks)])


@pytest.fixture(scope="module")
def run_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("bags") / "run")


@pytest.fixture(scope="module")
def run_file(run_bag: Path) -> Path:
    return run_bag / "run_0.mcap"


# --- others read what we write


def test_rosbags_reads_equal_values(run_bag: Path) -> None:
    with AnyReader([run_bag]) as reader:
        assert reader.message_count == 120
        assert reader.start_time == START
        seen: dict[str, list[Any]] = {topic: [] for topic in RUN_TOPICS}
        for connection, log_time, data in reader.messages():
            number = len(seen[connection.topic])
            assert log_time == START + number * PERIOD
            seen[connection.topic].append(reader.deserialize(data, connection.msgtype).data)
    for topic, parts in seen.items():
        np.testing.assert_array_equal(np.concatenate(parts), expected(topic, 30).ravel())


def test_indexed_reader_of_mcap_sees_every_message_and_the_ros_fields(run_file: Path) -> None:
    with run_file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == 120
        assert reader.get_header().profile == "ros2"
        assert all(index.compression == "" for index in summary.chunk_indexes)
        first = next(iter(reader.iter_messages(topics=["/stage/applied"])))
        metadata = [record for record in reader.iter_metadata() if record.name == "rosbag2"]
    schema, channel, message = first
    assert (schema.name, schema.encoding, channel.message_encoding) == (BLOCK_TYPE, "ros2msg", "cdr")
    assert "MSG: std_msgs/MultiArrayDimension" in schema.data.decode()
    assert message.publish_time == message.log_time == START
    assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
    assert yaml.safe_load(channel.metadata["offered_qos_profiles"])[0]["reliability"] == "reliable"
    information = yaml.safe_load(metadata[-1].metadata["serialized_metadata"])
    assert information["version"] == 9 and information["message_count"] == 120


def test_stream_reader_of_mcap_confirms_the_checksum_of_the_data(run_file: Path) -> None:
    records = list(StreamReader(str(run_file), validate_crcs=True).records)
    ends = [record for record in records if type(record).__name__ == "DataEnd"]
    assert len(ends) == 1 and ends[0].data_section_crc != 0
    assert all(chunk.uncompressed_crc for chunk in StreamReader(str(run_file), emit_chunks=True).records
               if type(chunk).__name__ == "Chunk")  # fmt: skip


def test_type_hash_is_that_of_the_live_graph(run_file: Path) -> None:
    """The hash that ros2/common_interfaces 5.3 (Jazzy) publishes for this type."""
    interfaces = pytest.importorskip("ament_index_python")
    assert interfaces
    path = Path(sys.prefix) / "share/std_msgs/msg/Float64MultiArray.json"
    if not path.exists():
        pytest.skip("the wheel has no type descriptions")
    hashes = {entry["type_name"]: entry["hash_string"] for entry in json.loads(path.read_text())["type_hashes"]}
    assert typestore().hash_rihs01(BLOCK_TYPE) == hashes[BLOCK_TYPE]


def test_metadata_is_that_of_jazzy(run_bag: Path) -> None:
    text = (run_bag / "metadata.yaml").read_text()
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert "&" not in text  # no YAML references
    assert information["version"] == 9
    assert information["storage_identifier"] == "mcap"
    assert information["relative_file_paths"] == ["run_0.mcap"]
    assert information["message_count"] == 120
    assert information["starting_time"] == {"nanoseconds_since_epoch": START}
    assert information["duration"] == {"nanoseconds": 29 * PERIOD}
    topics = {entry["topic_metadata"]["name"]: entry for entry in information["topics_with_message_count"]}
    assert set(topics) == set(RUN_TOPICS)
    assert topics["/stage/drive"]["message_count"] == 30
    qos = topics["/stage/drive"]["topic_metadata"]["offered_qos_profiles"]
    infinite = {"sec": 9223372036, "nsec": 854775807}
    assert qos == [
        {
            "history": "keep_last",
            "depth": 1000,
            "reliability": "reliable",
            "durability": "volatile",
            "deadline": infinite,
            "lifespan": infinite,
            "liveliness": "automatic",
            "liveliness_lease_duration": infinite,
            "avoid_ros_namespace_conventions": False,
        }
    ]


def test_same_fields_as_the_writer_of_rosbags(run_bag: Path, tmp_path: Path) -> None:
    write_foreign(tmp_path / "other", StoragePlugin.MCAP)
    ours, theirs = (
        yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        for folder in (run_bag, tmp_path / "other")
    )
    assert set(ours) == set(theirs)
    for part in ("topics_with_message_count", "files"):
        assert set(ours[part][0]) == set(theirs[part][0])
    topic, other = (entry["topics_with_message_count"][0]["topic_metadata"] for entry in (ours, theirs))
    assert set(topic) == set(other) and topic["type_description_hash"] == other["type_description_hash"]


# --- we read what we and others write


def write_foreign(folder: Path, storage: StoragePlugin, blocks: int = 3) -> None:
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection("/stage/applied", BLOCK_TYPE, typestore=typestore())
        for number in range(blocks):
            data = block_bytes(RUN_TOPICS["/stage/applied"], block_values("/stage/applied", number))
            writer.write(connection, START + number, data)


def test_blocks_come_back_whole(run_bag: Path) -> None:
    bag = open_bag(run_bag)
    assert bag.complete and bag.notes == []
    for topic, columns in RUN_TOPICS.items():
        block = bag.blocks(topic)
        assert block.columns == columns
        np.testing.assert_array_equal(block.values, expected(topic, 30))
    summary = bag.topic("/stage/drive")
    assert (summary.count, summary.first_ns, summary.last_ns) == (30, START, START + 29 * PERIOD)
    assert summary.rate_hz == pytest.approx(200.0)


def test_folder_without_metadata_and_bare_file(run_bag: Path, run_file: Path, tmp_path: Path) -> None:
    (tmp_path / "bare").mkdir()
    for place in (tmp_path / "bare" / "run_0.mcap", tmp_path / "other name"):
        place.write_bytes(run_file.read_bytes())
    for path in (tmp_path / "bare", tmp_path / "bare" / "run_0.mcap", tmp_path / "other name"):
        assert open_bag(path).complete
        assert load_run(path).sha256 == load_run(run_bag).sha256


def test_foreign_mcap_bag_is_read(tmp_path: Path) -> None:
    write_foreign(tmp_path / "foreign", StoragePlugin.MCAP)
    bag = open_bag(tmp_path / "foreign")
    assert bag.complete
    np.testing.assert_array_equal(bag.blocks("/stage/applied").values, expected("/stage/applied", 3))


@pytest.mark.parametrize("compression", ["ZSTD", "LZ4", "NONE"])
@pytest.mark.parametrize("chunked", [True, False])
def test_other_layouts_of_mcap_are_read(tmp_path: Path, compression: str, chunked: bool) -> None:
    from mcap.writer import CompressionType
    from mcap.writer import Writer as McapWriter

    writer = McapWriter(
        str(tmp_path / "x.mcap"), compression=CompressionType[compression], use_chunking=chunked, chunk_size=3000
    )
    writer.start()
    schema = writer.register_schema(BLOCK_TYPE, "ros2msg", b"")
    channel = writer.register_channel("/stage/applied", "cdr", schema)
    for number in range(20):
        data = block_bytes(RUN_TOPICS["/stage/applied"], block_values("/stage/applied", number))
        writer.add_message(channel, START + number, data, START + number)
    writer.finish()
    writer._Writer__stream.close()  # finish() leaves a file it was given by name open in some versions
    bag = open_bag(tmp_path / "x.mcap")
    assert bag.complete, bag.notes
    np.testing.assert_array_equal(bag.blocks("/stage/applied").values, expected("/stage/applied", 20))


def test_split_bag_is_read_in_order_and_a_missing_part_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    values = [block_values("/stage/applied", number) for number in range(12)]
    for number, part in enumerate(values):
        with BagWriter(tmp_path / "one" / f"{number}") as writer:
            channel = writer.add_topic("/stage/applied", BLOCK_TYPE)
            writer.write(channel, block_bytes(RUN_TOPICS["/stage/applied"], part), START + number)
        writer.file.rename(folder / f"split_{number}.mcap")
    np.testing.assert_array_equal(open_bag(folder).blocks("/stage/applied").values, np.concatenate(values))
    listed = {"rosbag2_bagfile_information": {"relative_file_paths": [f"split_{n}.mcap" for n in range(12)]}}
    (folder / "metadata.yaml").write_text(yaml.safe_dump(listed))
    assert open_bag(folder).complete
    (folder / "split_11.mcap").unlink()
    bag = open_bag(folder)
    assert not bag.complete and "split_11.mcap" in bag.notes[0]


def test_empty_bag_is_complete_and_has_its_topics(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "empty") as writer:
        writer.add_topic("/stage/applied", BLOCK_TYPE)
    bag = open_bag(tmp_path / "empty")
    assert bag.complete
    assert [(topic.name, topic.count, topic.rate_hz) for topic in bag.topics()] == [("/stage/applied", 0, 0.0)]
    with pytest.raises(BenchError, match="/stage/applied: no message"):
        bag.blocks("/stage/applied")
    with AnyReader([tmp_path / "empty"]) as reader:
        assert reader.message_count == 0


# --- the run in a bag


def test_run_out_of_a_bag(run_bag: Path) -> None:
    record = record_from_bag(run_bag)
    assert set(record.columns) == {
        "time_s", "voltage_V", "displacement_m", "current_A", "reference_m", "command_voltage_V"
    }  # fmt: skip
    applied, reference = expected("/stage/applied", 30), expected("/stage/reference", 30)
    np.testing.assert_array_equal(record.time, applied[:, 0])
    np.testing.assert_array_equal(record.voltage, applied[:, 1])
    np.testing.assert_array_equal(record.current, applied[:, 2])
    np.testing.assert_array_equal(record.reference, reference[:, 1])
    np.testing.assert_array_equal(record.displacement, expected("/stage/measurement", 30)[:, 1])
    assert record.warnings == ()


def test_run_is_the_same_out_of_bag_and_csv(run_bag: Path, tmp_path: Path) -> None:
    record = load_run(run_bag)
    write_csv(record, tmp_path / "run.csv")
    assert load_run(tmp_path / "run.csv").sha256 == record.sha256


def write_parts(folder: Path, parts: dict[str, list[int]]) -> Path:
    with BagWriter(folder) as writer:
        for topic, numbers in parts.items():
            channel = writer.add_topic(topic, BLOCK_TYPE)
            for number in numbers:
                data = block_bytes(RUN_TOPICS[topic], block_values(topic, number))
                writer.write(channel, data, START + number * PERIOD)
    return folder


def test_only_samples_of_both_topics_make_the_run(tmp_path: Path) -> None:
    parts = {
        "/stage/applied": [0, 1, 2, 3, 5],
        "/stage/measurement": [1, 2, 4, 5],
        "/stage/reference": [1, 2],
        "/stage/drive": [1, 2, 3, 4, 5, 6],
    }
    folder = write_parts(tmp_path / "gaps", parts)
    record = record_from_bag(folder)
    rows = np.concatenate([block_values("/stage/applied", number) for number in (1, 2, 5)])
    np.testing.assert_array_equal(record.time, rows[:, 0])
    np.testing.assert_array_equal(record.voltage, rows[:, 1])
    drive = np.concatenate([block_values("/stage/drive", number) for number in (1, 2, 5)])
    np.testing.assert_array_equal(record.command_voltage, drive[:, 1])
    assert record.reference is None
    text = "\n".join(record.warnings)
    assert "reference_m left out, reference lacks 10 of the 30 samples" in text
    assert "10 samples of applied within the run and 10 before or after" in text
    assert "10 samples of measurement within the run and 0 before or after" in text
    with_reference = record_from_bag(folder, required=("voltage_V", "displacement_m", "reference_m"))
    np.testing.assert_array_equal(with_reference.time, rows[:20, 0])


@pytest.mark.parametrize(
    ("parts", "found"),
    [
        ({"/stage/applied": [0, 1]}, "no topic /stage/measurement; there are /stage/applied"),
        ({"/stage/applied": [0, 1], "/stage/measurement": []}, "/stage/measurement: no message"),
        ({"/stage/applied": [0, 1], "/stage/measurement": [2, 3]}, "0 time stamps in common"),
        ({"/stage/applied": [0, 1], "/stage/measurement": [1, 0]}, "sample 11 has time_s 0.0, not after"),
        ({"/stage/applied": [0, 0], "/stage/measurement": [0]}, "not after 3.0"),
    ],
)
def test_bag_that_holds_no_run_is_named(tmp_path: Path, parts: dict[str, list[int]], found: str) -> None:
    folder = write_parts(tmp_path / "no_run", parts)
    with pytest.raises(BenchError) as caught:
        load_run(folder)
    assert found in str(caught.value) and "no_run" in str(caught.value)
    assert str(caught.value).isprintable()


def test_other_namespace(run_bag: Path) -> None:
    with pytest.raises(BenchError, match="no topic /axis_2/applied"):
        record_from_bag(run_bag, namespace="/axis_2")
    assert len(record_from_bag(run_bag, namespace="/stage/")) == 300


def test_value_that_is_not_finite_is_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "nan") as writer:
        for topic in ("/stage/applied", "/stage/measurement"):
            values = block_values(topic, 0)
            values[4, 1] = np.nan
            writer.write(writer.add_topic(topic, BLOCK_TYPE), block_bytes(RUN_TOPICS[topic], values), START)
    with pytest.raises(BenchError, match="/stage/applied: sample 5 of voltage_V is nan"):
        load_run(tmp_path / "nan")


# --- bags that are none


def test_foreign_things_are_named(tmp_path: Path, run_bag: Path) -> None:
    write_foreign(tmp_path / "lite", StoragePlugin.SQLITE3)
    (tmp_path / "void").mkdir()
    (tmp_path / "zero.mcap").write_bytes(b"")
    (tmp_path / "text.mcap").write_text("time_s,voltage_V\n")
    cases = {
        tmp_path / "lite": "rosbags-convert",
        tmp_path / "lite" / "lite.db3": "rosbags-convert",
        tmp_path / "void": "no .mcap file",
        tmp_path / "zero.mcap": "empty",
        tmp_path / "text.mcap": "no MCAP file",
        tmp_path / "nowhere": "no such",
        tmp_path / "nowhere.mcap": "no such",
    }
    for path, found in cases.items():
        for read in (open_bag, load_run) if path.name != "nowhere" else (load_run,):
            with pytest.raises(BenchError) as caught:
                read(path)
            text = str(caught.value)
            assert found in text and str(path) in text and text.isprintable(), text
    with pytest.raises(BenchError, match="no topic /other"):
        open_bag(run_bag).blocks("/other")


def test_messages_of_other_kinds_are_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "mixed") as writer:
        number = writer.add_topic("/voltage", "std_msgs/msg/Float64")
        broken = writer.add_topic("/broken", BLOCK_TYPE)
        plain = writer.add_topic("/plain", BLOCK_TYPE)
        writer.write(number, b"\0\1\0\0" + bytes(8), START)
        writer.write(broken, b"\0\1\0\0\xff\xff", START)
        types = typestore().types
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        writer.write(plain, serialized(types[BLOCK_TYPE](layout=layout, data=np.zeros(3)), BLOCK_TYPE), START)
        with pytest.raises(BenchError, match="acme_msgs/msg/Thing"):
            writer.add_topic("/thing", "acme_msgs/msg/Thing")
    bag = open_bag(tmp_path / "mixed")
    for topic, found in (("/voltage", "expected blocks"), ("/broken", "message 1: is no"), ("/plain", "found 0")):
        with pytest.raises(BenchError) as caught:
            bag.blocks(topic)
        assert found in str(caught.value) and topic in str(caught.value) and str(caught.value).isprintable()


def test_unknown_type_of_another_recorder(tmp_path: Path) -> None:
    with Writer(tmp_path / "thing", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/thing", "acme_msgs/msg/Thing", msgdef="float64 x\n", rihs01="RIHS01_0")
        writer.write(connection, START, b"\0\1\0\0" + bytes(8))
    bag = open_bag(tmp_path / "thing")
    assert bag.topic("/thing").type_name == "acme_msgs/msg/Thing"
    with pytest.raises(BenchError, match=r"/thing: messages of type acme_msgs/msg/Thing cannot be read"):
        next(bag.messages("/thing"))


# --- damage


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
        assert not bag.complete and "cut.mcap" in bag.notes[0] and bag.notes[0].isprintable()
        part = read_all(path)
        assert sum(map(len, part.values())) == sum(topic.count for topic in bag.topics()) == safe
        assert is_beginning(part, whole)
        if safe:
            record = load_run(path)
            assert len(record) == safe // 4 * 10
            assert any("cut.mcap" in warning for warning in record.warnings)


def test_every_flipped_bit_is_named(run_file: Path, tmp_path: Path) -> None:
    data, whole = run_file.read_bytes(), read_all(run_file)
    path = tmp_path / "flip.mcap"
    rng = random.Random(2)
    # half of the flips where they hurt most: outside the chunks (heads, index, summary, footer)
    outside = [*range(0, 200), *range(flushed_counts(data)[-1][0], len(data))]
    positions = [rng.randrange(len(data)) for _ in range(100)] + rng.sample(outside, 100)
    for position in positions:
        damaged = bytearray(data)
        damaged[position] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            bag = open_bag(path)
        except BenchError as error:
            assert position < 8 and "flip.mcap" in str(error) and str(error).isprintable()
            continue
        assert not bag.complete, f"a flip at byte {position} was not noticed"
        assert "flip.mcap" in bag.notes[0] and bag.notes[0].isprintable(), bag.notes
        part = read_all(path)
        for topic, messages in part.items():
            assert set(messages) <= set(whole[topic])
        try:
            load_run(path)
        except BenchError as error:
            assert "flip.mcap" in str(error) and str(error).isprintable()


def test_random_bytes_behind_the_magic_are_named(tmp_path: Path) -> None:
    rng = random.Random(3)
    path = tmp_path / "noise.mcap"
    for length in (1, 9, 50, 5000):
        path.write_bytes(b"\x89MCAP0\r\n" + rng.randbytes(length))
        bag = open_bag(path)
        assert not bag.complete and bag.topics() == []
        with pytest.raises(BenchError, match="no topic"):
            load_run(path)


WRITE_AND_DIE = """
    import os, signal, sys
    sys.path.insert(0, {tests!r})
    from test_bags import BLOCK_TYPE, PERIOD, RUN_TOPICS, START, block_bytes, block_values
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


def run_python(code: str, **values: str) -> subprocess.CompletedProcess[str]:
    program = textwrap.dedent(code).format(tests=str(Path(__file__).parent), **values)
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)


def test_kill_after_flush_loses_nothing_before_it(tmp_path: Path) -> None:
    done = run_python(WRITE_AND_DIE, folder=str(tmp_path / "killed"))
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert os.listdir(tmp_path / "killed") == ["killed_0.mcap"]
    bag = open_bag(tmp_path / "killed")
    assert not bag.complete and "148 messages" in bag.notes[0]
    for topic in RUN_TOPICS:
        np.testing.assert_array_equal(bag.blocks(topic).values, expected(topic, 37))
    records = StreamReader(str(tmp_path / "killed" / "killed_0.mcap")).records
    first_metadata = next(record for record in records if type(record).__name__ == "Metadata")
    assert yaml.safe_load(first_metadata.metadata["serialized_metadata"])["version"] == 9


FILL_THE_DISK = """
    import resource, signal, sys
    sys.path.insert(0, {tests!r})
    from test_bags import BLOCK_TYPE, RUN_TOPICS, START, block_bytes, block_values
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
    assert done.returncode == 0 and done.stderr == "", done.stderr
    first, again = done.stdout.splitlines()
    assert "full_0.mcap: cannot write the bag: File too large" in first and again.startswith("again ")
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


# --- what people look at


def write_show(folder: Path) -> Path:
    types = typestore().types
    time, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    joint, status = types["sensor_msgs/msg/JointState"], types["diagnostic_msgs/msg/DiagnosticStatus"]
    array = types["diagnostic_msgs/msg/DiagnosticArray"]
    with BagWriter(folder) as writer:
        channels = {
            name: writer.add_topic(name, type_name)
            for name, type_name in (
                ("/stage/measurement", BLOCK_TYPE),
                ("/stage/joint_states", "sensor_msgs/msg/JointState"),
                ("/stage/voltage", "std_msgs/msg/Float64"),
                ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
                ("/stage/label", "std_msgs/msg/String"),
                ("/stage/never", BLOCK_TYPE),
            )
        }
        for number in range(3):
            at = START + number * 500_000_000
            stamp = header(stamp=time(sec=number, nanosec=250_000_000), frame_id="")
            state = joint(
                header=stamp, name=["x"], position=np.array([number * 1e-6]), velocity=np.array([2e-6]),
                effort=np.array([]),
            )  # fmt: skip
            report = array(
                header=stamp,
                status=[status(level=number, name="amplifier", message='slew, "limited"', hardware_id="", values=[])],
            )
            values = block_values("/stage/measurement", number)
            data = {
                "/stage/measurement": block_bytes(RUN_TOPICS["/stage/measurement"], values),
                "/stage/joint_states": serialized(state, "sensor_msgs/msg/JointState"),
                "/stage/voltage": serialized(types["std_msgs/msg/Float64"](data=number * 10.0), "std_msgs/msg/Float64"),
                "/diagnostics": serialized(report, "diagnostic_msgs/msg/DiagnosticArray"),
                "/stage/label": serialized(types["std_msgs/msg/String"](data="hi"), "std_msgs/msg/String"),
            }
            for name, message in data.items():
                writer.write(channels[name], message, at)
    return folder


def test_export_of_every_known_kind(tmp_path: Path) -> None:
    files = export_csv(write_show(tmp_path / "show"), tmp_path / "out")
    assert sorted(file.name for file in files) == [
        "diagnostics.csv", "stage.joint_states.csv", "stage.measurement.csv", "stage.voltage.csv"
    ]  # fmt: skip
    text = {file.name: file.read_text() for file in files}
    assert text["stage.joint_states.csv"] == (
        "log_time_s,stamp_s,x_position_m,x_velocity_m_per_s\n"
        "0.0,0.25,0.0,2e-06\n0.5,1.25,1e-06,2e-06\n1.0,2.25,2e-06,2e-06\n"
    )
    assert text["stage.voltage.csv"] == "log_time_s,voltage\n0.0,0.0\n0.5,10.0\n1.0,20.0\n"
    assert text["diagnostics.csv"].splitlines()[:3] == [
        "log_time_s,name,level,message",
        '0.0,amplifier,OK,"slew, ""limited"""',
        '0.5,amplifier,WARN,"slew, ""limited"""',
    ]
    measured = read_csv(tmp_path / "out" / "stage.measurement.csv", required=("time_s", "displacement_m"))
    np.testing.assert_array_equal(measured.displacement, expected("/stage/measurement", 3)[:, 1])


def test_info_goes_through_json(tmp_path: Path) -> None:
    information = json.loads(json.dumps(bag_info(write_show(tmp_path / "show"))))
    assert information["complete"] is True and information["notes"] == []
    assert information["duration_s"] == pytest.approx(1.0) and information["message_count"] == 15
    topics = {topic["name"]: topic for topic in information["topics"]}
    assert topics["/stage/measurement"]["columns"] == ["time_s", "displacement_m"]
    assert topics["/stage/measurement"]["rate_hz"] == pytest.approx(2.0)
    assert topics["/stage/label"]["exported"] is False and topics["/stage/voltage"]["exported"] is True
    assert topics["/stage/never"]["count"] == 0 and topics["/stage/never"]["columns"] == []


def test_nothing_to_export_is_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "empty") as writer:
        writer.add_topic("/stage/applied", BLOCK_TYPE)
    with pytest.raises(BenchError, match=r"nothing to export, found /stage/applied"):
        export_csv(tmp_path / "empty", tmp_path / "out")
    with pytest.raises(BenchError, match="cannot write"):
        (tmp_path / "out").write_text("a file")
        export_csv(write_show(tmp_path / "show"), tmp_path / "out")


def test_library_needs_no_ros_for_bags() -> None:
    code = """
    import sys
    import pzt_ros.bags, pzt_ros.bags.writer, pzt_ros.bags.reader, pzt_ros.bags.export, pzt_ros.blocks
    assert not [name for name in sys.modules if name.split(".")[0] in ("rclpy", "std_msgs", "rosidl_parser")]
    """
    done = run_python(code)
    assert done.returncode == 0, done.stderr
