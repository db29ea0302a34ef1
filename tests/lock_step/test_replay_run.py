"""Regression by replay: a node that is given what it was given in a run answers as it did, a changed one does not."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from graph_process import GraphProcess
from scenarios import SHORT, write

from pzt_ros.bags.recording import PARTS, differences
from pzt_ros.blocks import Block

TICKS = 500  # of the 2.5 s of the scenario, at 20 kHz in blocks of 100


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replay")
    with GraphProcess(write(folder, SHORT), folder / "run", "--composed") as graph:
        code, said = graph.wait()
        assert code == 0, said
    return folder / "run"


def replayed(bag: Path, *options: str) -> tuple[int, dict[str, Any], str]:
    program = "from pzt_ros.cli import main; main()"
    command = [sys.executable, "-c", program, "run", "--replay", str(bag), "--json", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    return done.returncode, json.loads(done.stdout) if done.stdout else {}, done.stderr


@pytest.mark.parametrize("node", PARTS)
def test_a_node_answers_as_it_did(run: Path, node: str) -> None:
    code, found, said = replayed(run / "bag", "--node", node, "--tolerance", "0")
    assert code == 0, (said, found)
    assert found["ticks"] in (TICKS, TICKS + 1)  # the first block is no answer to a command
    assert [column["largest"] for column in found["columns"]] == [0.0] * len(found["columns"]), "to the bit"
    assert all(column["scale"] > 0.0 for column in found["columns"]), "of something that moves"


@pytest.mark.long
def test_another_gain_is_found_out(run: Path, tmp_path: Path) -> None:
    changed = tmp_path / "run"
    shutil.copytree(run, changed)
    sections = yaml.safe_load((changed / "parameters.yaml").read_text(encoding="utf-8"))
    sections["/stage/controller"]["ros__parameters"]["pi"]["integral_gain"] *= 1.01
    (changed / "parameters.yaml").write_text(yaml.safe_dump(sections), encoding="utf-8")
    code, found, said = replayed(changed / "bag", "--node", "controller")
    assert code == 1, said
    by_name = {column["column"]: column for column in found["columns"]}
    assert not found["same"]
    assert by_name["time_s"]["largest"] == 0.0
    assert by_name["command_voltage_V"]["largest"] > 1e-3
    assert by_name["command_voltage_V"]["at"] >= 0.6, "the controller is in charge from then on"
    assert replayed(changed / "bag", "--node", "controller", "--tolerance", "1")[0] == 0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--node", "oracle"), "unknown node to replay 'oracle'; known are observer, "),
        (("--node", "sensor"), "no parameters.yaml beside it"),
    ],
)
def test_what_cannot_be_replayed_is_one_line(run: Path, tmp_path: Path, options: tuple[str, ...], says: str) -> None:
    shutil.copytree(run / "bag", tmp_path / "bag")
    code, _, said = replayed(tmp_path / "bag", *options)
    assert code == 2, said
    assert says in said
    assert len(said.strip().splitlines()) == 1


def test_no_number_is_equal_to_no_number_alone() -> None:
    def block(*values: float) -> Block:
        return Block.of({"time_s": np.arange(3.0), "x_m": values})

    one = block(np.nan, 2.0, -4.0)
    same, gone = differences(one, one)[1], differences(one, block(np.nan, np.nan, -4.0))[1]
    moved = differences(one, block(np.nan, 2.0, -4.1))[1]
    assert (same.largest, same.beyond(0.0)) == (0.0, False)
    assert (gone.largest, gone.at, gone.beyond(1e9)) == (np.inf, 1.0, True)
    assert (moved.at, moved.scale) == (2.0, 4.0)
    assert moved.beyond(0.02)
    assert not moved.beyond(0.03)
