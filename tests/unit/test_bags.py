"""Bags: what we write other readers read, and what others write we read."""

from __future__ import annotations

import json
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bag_making import (
    BLOCK_TYPE,
    PERIOD,
    RUN_TOPICS,
    START,
    block_bytes,
    block_values,
    check_one_line,
    expected,
    serialized,
    write_foreign,
    write_run,
)
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

from pzt_ros.bags import load_run
from pzt_ros.bags.reader import open_bag, record_from_bag
from pzt_ros.bags.writer import BagWriter, typestore
from pzt_ros.errors import BenchError
from pzt_ros.records import write_csv


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
        assert summary is not None
        assert summary.statistics is not None
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
    assert information["version"] == 9
    assert information["message_count"] == 120


def test_stream_reader_of_mcap_confirms_the_checksum_of_the_data(run_file: Path) -> None:
    records = list(StreamReader(BytesIO(run_file.read_bytes()), validate_crcs=True).records)
    ends = [record for record in records if type(record).__name__ == "DataEnd"]
    assert len(ends) == 1
    assert ends[0].data_section_crc != 0
    chunks = StreamReader(BytesIO(run_file.read_bytes()), emit_chunks=True).records
    assert all(chunk.uncompressed_crc for chunk in chunks if type(chunk).__name__ == "Chunk")


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
    assert set(topic) == set(other)
    assert topic["type_description_hash"] == other["type_description_hash"]


# --- we read what we and others write


def test_blocks_come_back_whole(run_bag: Path) -> None:
    bag = open_bag(run_bag)
    assert bag.complete
    assert bag.notes == []
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

    with (tmp_path / "x.mcap").open("wb") as stream:
        writer = McapWriter(stream, compression=CompressionType[compression], use_chunking=chunked, chunk_size=3000)
        writer.start()
        schema = writer.register_schema(BLOCK_TYPE, "ros2msg", b"")
        channel = writer.register_channel("/stage/applied", "cdr", schema)
        for number in range(20):
            data = block_bytes(RUN_TOPICS["/stage/applied"], block_values("/stage/applied", number))
            writer.add_message(channel, START + number, data, START + number)
        writer.finish()
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
    assert not bag.complete
    assert "split_11.mcap" in bag.notes[0]


def test_a_long_bag_is_split_into_files_that_are_whole_by_themselves(tmp_path: Path) -> None:
    """A flush after 3 kB begins the next file; MCAP then forgets the index of the one before."""
    folder = write_run(tmp_path / "long", flush_every=5, file_bytes=3000)
    names = [f"long_{number}.mcap" for number in range(6)]
    information = yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["relative_file_paths"] == names
    assert [file["path"] for file in information["files"]] == names
    assert [file["message_count"] for file in information["files"]] == [20] * 6
    assert information["files"][1]["starting_time"] == {"nanoseconds_since_epoch": START + 5 * PERIOD}
    assert information["files"][1]["duration"] == {"nanoseconds": 4 * PERIOD}
    assert information["message_count"] == 120
    for name in names:
        summary = make_reader(BytesIO((folder / name).read_bytes()), validate_crcs=True).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 20
        assert {channel.topic for channel in summary.channels.values()} == set(RUN_TOPICS)
    with AnyReader([folder]) as reader:
        assert reader.message_count == 120
        assert [when for _, when, _ in reader.messages()] == [START + n * PERIOD for n in range(30) for _ in RUN_TOPICS]
    bag = open_bag(folder)
    assert bag.complete, bag.notes
    for topic in RUN_TOPICS:
        np.testing.assert_array_equal(bag.blocks(topic).values, expected(topic, 30))


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
    assert found in str(caught.value)
    assert "no_run" in str(caught.value)
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
            check_one_line(caught.value, found, str(path))
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
        assert found in str(caught.value)
        assert topic in str(caught.value)
        assert str(caught.value).isprintable()


def test_unknown_type_of_another_recorder(tmp_path: Path) -> None:
    with Writer(tmp_path / "thing", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/thing", "acme_msgs/msg/Thing", msgdef="float64 x\n", rihs01="RIHS01_0")
        writer.write(connection, START, b"\0\1\0\0" + bytes(8))
    bag = open_bag(tmp_path / "thing")
    assert bag.topic("/thing").type_name == "acme_msgs/msg/Thing"
    with pytest.raises(BenchError, match=r"/thing: messages of type acme_msgs/msg/Thing cannot be read"):
        next(bag.messages("/thing"))
