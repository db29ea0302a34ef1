"""A foreign node beside the graph: every topic is what the table says, on the wire and in time."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from foreign_node import ForeignNode
from graph_process import GraphProcess
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from scenarios import SHORT, write
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray

from pzt_config.qos import QOS
from pzt_config.topics import BLOCK, DIAGNOSTICS, FLOAT, JOINT_STATE, NODES, TOPICS

SAID = {name: topic for name, topic in TOPICS.items() if topic.publisher != "operator"}
"""What the graph says by itself."""
TYPES = {BLOCK: Float64MultiArray, JOINT_STATE: JointState, FLOAT: Float64, DIAGNOSTICS: DiagnosticArray}
SAMPLE_RATE, BLOCK_SIZE, LENGTH = 20e3, 100, 2.5


class Heard:
    """What the foreign node heard of one run."""

    def __init__(self, foreign: ForeignNode, offers: dict[str, list[Any]]) -> None:
        self.messages = dict(foreign.heard)
        self.offers = offers


@pytest.fixture(scope="module")
def heard(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Heard]:
    folder = tmp_path_factory.mktemp("topics")
    scenario = write(folder, SHORT)
    with GraphProcess(scenario, folder / "run", "--real-time") as graph, ForeignNode(graph.domain) as foreign:
        for topic in SAID.values():
            foreign.listen(full_name(topic.name), TYPES[topic.type])
        offers: dict[str, list[Any]] = {}

        def finished() -> bool:
            for name in SAID:
                found = foreign.node.get_publishers_info_by_topic(full_name(name))
                if known(found) > known(offers.get(name, [])):
                    offers[name] = found
            return graph.process.poll() is not None

        foreign.spin_until(finished)
        foreign.hear_out()  # on a busy machine this node is behind the graph
        code, said = graph.wait()
        assert code == 0, said
        yield Heard(foreign, offers)


def known(offers: list[Any]) -> int:
    """How many publishers are known by name; names come later than endpoints, and go before them."""
    return sum("UNKNOWN" not in offer.node_name for offer in offers)


def full_name(name: str) -> str:
    return name if name.startswith("/") else f"/stage/{name}"


@pytest.mark.parametrize("name", SAID)
def test_publisher_type_and_qos_are_those_of_the_table(heard: Heard, name: str) -> None:
    topic = TOPICS[name]
    offers = heard.offers[name]
    assert {offer.node_name for offer in offers} == (set(NODES) if topic.publisher == "*" else {topic.publisher})
    for offer in offers:
        assert offer.topic_type == topic.type
        assert offer.qos_profile.reliability == ReliabilityPolicy[QOS[topic.qos].reliability.upper()]
        assert offer.qos_profile.durability == DurabilityPolicy[QOS[topic.qos].durability.upper()]


@pytest.mark.parametrize("name", [topic.name for topic in TOPICS.values() if topic.is_block])
def test_blocks_have_the_labels_sizes_and_times_of_the_table(heard: Heard, name: str) -> None:
    columns = TOPICS[name].required  # the observer of this run has no standard deviations
    messages = heard.messages[full_name(name)]
    assert messages
    for message in messages:
        sample, column = message.layout.dim
        assert (sample.label, sample.size, sample.stride) == ("sample", BLOCK_SIZE, BLOCK_SIZE * len(columns))
        assert (column.label, column.size, column.stride) == (",".join(columns), len(columns), len(columns))
        assert len(message.data) == BLOCK_SIZE * len(columns)
        assert np.all(np.isfinite(message.data))
    times = np.concatenate([np.array(m.data).reshape(BLOCK_SIZE, -1)[:, 0] for m in messages])
    index = np.round(times * SAMPLE_RATE)
    np.testing.assert_array_equal(times, index / SAMPLE_RATE)
    assert np.all(np.diff(index) > 0)


@pytest.mark.parametrize("name", ["applied", "truth", "measurement", "estimate"])
def test_every_block_of_the_run_is_heard_once(heard: Heard, name: str) -> None:
    firsts = [round(m.data[0] * SAMPLE_RATE / BLOCK_SIZE) for m in heard.messages[full_name(name)]]
    assert firsts == list(range(round(LENGTH * SAMPLE_RATE / BLOCK_SIZE) + 1))


def test_each_tick_has_one_reference_and_one_drive(heard: Heard) -> None:
    def blocks(name: str) -> list[int]:
        return [round(m.data[0] * SAMPLE_RATE / BLOCK_SIZE) for m in heard.messages[full_name(name)]]

    every = list(range(1, round(LENGTH * SAMPLE_RATE / BLOCK_SIZE) + 1))
    assert sorted(blocks("reference") + blocks("voltage_reference")) == every
    assert blocks("drive") == every


@pytest.mark.parametrize("name", ["joint_states", "reference_joint_states"])
def test_joint_states_are_stamped_and_not_faster_than_100_hz(heard: Heard, name: str) -> None:
    messages = heard.messages[full_name(name)]
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages]
    assert len(stamps) > 10
    assert min(b - a for a, b in itertools.pairwise(stamps)) >= 0.01 - 1e-9
    assert all(m.name == ["stage"] and len(m.position) == 1 and len(m.velocity) == 1 for m in messages)
    assert all(-1e-6 < m.position[0] < 20e-6 for m in messages)


def test_plotter_topics_carry_volts_and_metres(heard: Heard) -> None:
    volts = [m.data for m in heard.messages["/stage/voltage"]]
    errors = [m.data for m in heard.messages["/stage/tracking_error"]]
    assert max(volts) == pytest.approx(120.0, abs=1.0)
    assert errors
    assert max(abs(e) for e in errors) < 10e-6


def test_every_node_says_how_it_is(heard: Heard) -> None:
    names = {status.name for message in heard.messages["/diagnostics"] for status in message.status}
    assert names == {f"/stage/{node}" for node in NODES}


def test_run_folder_is_complete(heard: Heard, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = next(tmp_path_factory.getbasetemp().glob("topics*")) / "run"
    assert {p.name for p in folder.iterdir()} >= {"bag", "log", "run.json", "parameters.yaml", "scenario.yaml"}
    assert Path(folder / "bag" / "metadata.yaml").exists()
