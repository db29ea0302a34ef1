"""A reference out of a CSV file as a phase: what is read, how it is followed, and what is wrong with a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pzt_bringup.plan import Plan, prepare
from pzt_ros.errors import BenchError
from pzt_ros.loop import Tick, refuse_what_cannot_be, run_in_process
from pzt_ros.scenario import Scenario, load_scenario

SCENARIO = """
plant: thesis-p2
model: thesis-p2
block_size: 100
phases:
  - {phase: voltage, to: 60 V, duration: 0.1 s}
  - {phase: move, to: 5 um, duration: 0.1 s, controller: inverse}
  - {phase: file, path: way/reference.csv}
"""
ROWS = "time_s,reference_m\n7.0,5e-6\n7.05,6e-6\n7.2,4.5e-6\n"
"""The file's own clock begins at 7 s."""


def scenario(folder: Path, rows: str = ROWS, text: str = SCENARIO) -> Scenario:
    (folder / "way").mkdir(parents=True)
    (folder / "way" / "reference.csv").write_text(rows, encoding="utf-8")
    (folder / "scenario.yaml").write_text(text, encoding="utf-8")
    return load_scenario(folder / "scenario.yaml")


def asked(loaded: Scenario) -> np.ndarray:
    """The reference of the phase, sample by sample, through the whole loop."""
    ticks: list[Tick] = []
    run_in_process(loaded, ticks.append)
    return np.concatenate([tick.reference.values for tick in ticks[41:] if tick.reference is not None])


@pytest.mark.parametrize("column", ["reference_m", "displacement_m"])
def test_it_is_linear_between_the_rows(tmp_path: Path, column: str) -> None:
    found = asked(scenario(tmp_path, ROWS.replace("reference_m", column)))
    time = np.arange(1, len(found) + 1) / 20e3
    np.testing.assert_allclose(found, np.interp(time, [0.0, 0.05, 0.2], [5e-6, 6e-6, 4.5e-6]), rtol=0, atol=1e-17)
    assert len(found) == 4000


def test_of_both_columns_the_reference_counts(tmp_path: Path) -> None:
    rows = "time_s,displacement_m,reference_m\n0,9,5e-6\n0.1,9,5.5e-6\n"
    assert asked(scenario(tmp_path, rows))[-1] == 5.5e-6


def test_what_the_stage_cannot_follow_is_refused(tmp_path: Path) -> None:
    refuse_what_cannot_be(scenario(tmp_path / "good"))
    with pytest.raises(BenchError, match="beyond the stroke"):
        refuse_what_cannot_be(scenario(tmp_path / "far", ROWS.replace("6e-6", "60e-6")))


def test_the_run_folder_has_a_copy_and_reads_it(tmp_path: Path) -> None:
    loaded = scenario(tmp_path)
    prepare(Plan(loaded, tmp_path / "run", False, loaded.rate, None, 1))
    copied = load_scenario(tmp_path / "run" / "scenario.yaml")
    assert copied.files == (str(tmp_path / "run" / "reference.csv"),)
    np.testing.assert_array_equal(asked(copied), asked(loaded))


@pytest.mark.parametrize(
    ("rows", "text", "expected"),
    [
        (ROWS, SCENARIO.replace("way/", "nowhere/"), "phase 3: path 'nowhere/reference.csv': no such file"),
        (ROWS, SCENARIO.replace("path: way/reference.csv", "controller: pi"), "phase 3: path '': no such file"),
        (ROWS, SCENARIO.replace("way/reference.csv", "way/reference.csv, controller: pid"), "unknown controller 'pid'"),
        (ROWS.replace("reference_m", "voltage_V"), SCENARIO, "neither reference_m nor displacement_m"),
        (ROWS.replace("6e-6", "six"), SCENARIO, "row 3"),
        (ROWS.replace("7.05", "6.05"), SCENARIO, "row 3"),
        (ROWS.replace("6e-6", "nan"), SCENARIO, "row 3"),
    ],
)
def test_mistakes_are_one_line(tmp_path: Path, rows: str, text: str, expected: str) -> None:
    with pytest.raises(BenchError) as caught:
        scenario(tmp_path, rows, text)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)
