"""The same scenario and seed give the same numbers, to the bit, however the graph is run."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from graph_process import GraphProcess
from numpy.typing import NDArray
from scenarios import SHORT, write

from pzt_config.topics import TOPICS
from pzt_ros.bags.reader import open_bag
from pzt_ros.loop import Tick, run_in_process
from pzt_ros.scenario import load_scenario

BLOCKS = tuple(topic for topic in TOPICS.values() if topic.is_block)
Streams = dict[str, NDArray[np.float64]]


def run_graph(scenario: Path, folder: Path, *options: str) -> Streams:
    with GraphProcess(scenario, folder, *options) as graph:
        code, said = graph.wait()
        assert code == 0, said
    bag = open_bag(folder / "bag")
    assert bag.complete
    return {topic.name: bag.blocks(f"/stage/{topic.name}").values for topic in BLOCKS}


def run_library(scenario: Path) -> Streams:
    rows: dict[str, list[NDArray[np.float64]]] = defaultdict(list)

    def watch(tick: Tick) -> None:
        time, e = tick.applied.time, tick.estimate
        a, t = tick.applied, tick.truth
        rows["applied"].append(np.column_stack((time, a.voltage, a.current, a.charge)))
        rows["truth"].append(np.column_stack((time, t.displacement, t.polarization, t.phase_fraction)))
        rows["measurement"].append(np.column_stack((time, tick.measurement)))
        found = (e.displacement, e.polarization, e.phase_fraction, e.innovation, e.disturbance)
        bands = (e.displacement_std, e.polarization_std, e.phase_fraction_std) if e.displacement_std.size else ()
        rows["estimate"].append(np.column_stack((time, *found, *bands)))
        if tick.reference is not None and tick.command_voltage is not None:
            name = "reference" if tick.reference.quantity == "displacement" else "voltage_reference"
            rows[name].append(np.column_stack((time, tick.reference.values)))
            rows["drive"].append(np.column_stack((time, tick.command_voltage)))

    run_in_process(load_scenario(scenario), watch)
    return {name: np.concatenate(blocks) for name, blocks in rows.items()}


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("scenario"), SHORT)


@pytest.fixture(scope="module")
def separate(scenario: Path) -> Streams:
    return run_graph(scenario, scenario.parent / "separate")


def assert_equal_to_the_bit(one: Streams, other: Streams) -> None:
    assert one.keys() == other.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_graph_and_in_process_loop_agree(scenario: Path, separate: Streams) -> None:
    assert_equal_to_the_bit(separate, run_library(scenario))


def test_composed_graph_agrees_without_dds_inside(scenario: Path, separate: Streams) -> None:
    folder = scenario.parent / "composed"
    assert_equal_to_the_bit(separate, run_graph(scenario, folder, "--composed"))
    assert list(folder.rglob("fastdds_apart.xml")), "else its nodes would hear everything twice, or by DDS"
    assert not list((scenario.parent / "separate").rglob("fastdds_apart.xml"))


def test_second_run_agrees(scenario: Path, separate: Streams) -> None:
    assert_equal_to_the_bit(separate, run_graph(scenario, scenario.parent / "again"))


def test_another_seed_gives_other_noise(scenario: Path, separate: Streams) -> None:
    other = write(scenario.parent.parent, SHORT.replace("seed: 7", "seed: 8"))
    streams = run_library(other)
    assert not np.array_equal(streams["measurement"], separate["measurement"])


def test_an_observer_with_bands_says_them_and_goes_by_the_charge(tmp_path: Path) -> None:
    observer = "observer: {observer: hysteresis, members: 4, charge_noise_rms: 0.1 uC}\nphases:"
    scenario = write(tmp_path, SHORT.split("  - {phase: scan")[0].replace("phases:", observer))
    library = run_library(scenario)["estimate"]
    said = run_graph(scenario, tmp_path / "graph", "--composed")["estimate"]
    np.testing.assert_array_equal(said[: len(library)], library)  # the ramp to 0 V comes after it
    assert said.shape[1] == 9
    assert np.all(np.isfinite(said))
    without = run_library(write(tmp_path, scenario.read_text(encoding="utf-8").replace("0.1 uC", "0 C")))
    assert np.median(library[:, 7]) < np.median(without["estimate"][:, 7])  # of the polarization
