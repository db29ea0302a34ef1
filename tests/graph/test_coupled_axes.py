"""Two axes of which one moves the other: what the bag holds, and what a diagnosis gets to see of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from graph_process import GraphProcess
from scenarios import write

from pzt_bringup.command import run_graph
from pzt_ros.bags import load_run
from pzt_ros.bags.reader import open_bag
from pzt_ros.chains import load_chain, save_chain
from pzt_ros.effects.cross_coupling import CrossCoupling
from pzt_ros.effects.insert import with_effect
from pzt_ros.errors import BenchError

COUPLING = 0.05
RESTING = """
scenario: at rest
plant: {plant}
model: thesis-p2
phases:
  - {{phase: voltage, to: 60 V, duration: 0.2 s}}
  - {{phase: voltage, to: 60 V, duration: 4.4 s}}
"""
# The axes have no time in common: y rests before and after for longer than a busy machine sets their clocks apart.
MOVING = """
scenario: up and down
plant: bench-stage
model: thesis-p2
phases:
  - {phase: voltage, to: 20 V, duration: 0.2 s}
  - {phase: voltage, to: 20 V, duration: 1.6 s}
  - {phase: voltage, to: 110 V, duration: 0.6 s}
  - {phase: voltage, to: 110 V, duration: 0.3 s}
  - {phase: voltage, to: 20 V, duration: 0.6 s}
  - {phase: voltage, to: 20 V, duration: 1.2 s}
"""


def coupled(folder: Path, neighbour: str = "y") -> Path:
    """A scenario in which x stands still and feels y."""
    plant = folder / "coupled.yaml"
    save_chain(with_effect(load_chain("bench-stage"), CrossCoupling(coupling=COUPLING)), plant)
    for name, text in (("x", RESTING.format(plant=plant)), ("y", MOVING)):
        (folder / name).mkdir()
        write(folder / name, text)
    path = folder / "two.yaml"
    axes = f"axes:\n  x: {{scenario: x/scenario.yaml, neighbour: {neighbour}}}\n  y: y/scenario.yaml\n"
    path.write_text(axes, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("coupled")
    with GraphProcess(coupled(folder), folder / "run", "--composed", "--real-time") as graph:
        code, said = graph.wait()
    assert code == 0, said
    return folder / "run"


def test_an_axis_at_rest_moves_with_the_one_that_scans(run: Path) -> None:
    x, y = (open_bag(run / "bag").blocks(f"/{axis}/truth") for axis in "xy")
    late = (x.time > 0.8) & (x.time < 4.6)  # its own voltage has been still for long, and is not yet taken away
    moved_x, moved_y = np.ptp(x["displacement_m"][late]), np.ptp(y["displacement_m"][y.time > 1.0])
    assert moved_y > 3e-6
    assert moved_x == pytest.approx(COUPLING * moved_y, rel=0.05)


def test_a_run_of_one_axis_has_the_other_beside_it(run: Path) -> None:
    record = load_run(run / "x" / "bag").between(0.8, 4.5)
    assert record.neighbour is not None
    slope = np.polyfit(record.neighbour, record.displacement, 1)[0]
    assert slope == pytest.approx(COUPLING, rel=0.1)


def test_a_bag_of_several_axes_is_not_guessed_at(run: Path) -> None:
    with pytest.raises(BenchError, match=r"a bag of the axes /x, /y; name one, as .*/x/bag or .*/y/bag"):
        load_run(run / "bag")


def test_coupled_axes_need_the_wall_clock(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match="add --real-time"):
        run_graph(str(coupled(tmp_path)), tmp_path / "run", None, True, False, None, "/stage", None, True)


@pytest.mark.parametrize("neighbour", ["x", "z"])
def test_a_neighbour_has_to_be_another_axis(tmp_path: Path, neighbour: str) -> None:
    with pytest.raises(BenchError, match=f"neighbour '{neighbour}' is none of y"):
        run_graph(str(coupled(tmp_path, neighbour)), tmp_path / "run", None, True, True, None, "/stage", None, True)
