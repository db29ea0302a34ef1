"""Offline simulation: the thesis' chains against the reference solutions, and the way in and out of files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array
from pzt_ros.records import read_csv
from pzt_ros.sysid import simulate as simulation
from pzt_ros.sysid.simulate import read_drive, simulate_csv, with_accuracy

GOLDEN = Path(__file__).parents[1] / "golden" / "data"
LAYER = 1e-4  # [m], so that V = E times it
CHAINS = {"P1": "thesis-p1", "P2": "thesis-p2", "P3": "thesis-p3", "P4": "thesis-p2"}
CASES = sorted(path.name for path in GOLDEN.glob("P*.csv") if "prerun" not in path.name)


def write_drive(path: Path, time: Array, voltage: Array) -> Path:
    rows = "".join(f"{t!r},{v!r}\n" for t, v in zip(time.tolist(), voltage.tolist(), strict=True))
    path.write_text("time_s,voltage_V\n" + rows)
    return path


@pytest.mark.parametrize("case", CASES)
def test_follows_the_reference_at_every_row(case: str, tmp_path: Path) -> None:
    reference = np.loadtxt(GOLDEN / case, delimiter=",", skiprows=1)
    drive = write_drive(tmp_path / "drive.csv", reference[:, 0], reference[:, 1] * LAYER)
    chain = with_accuracy(load_chain(CHAINS[case[:2]]), simulation.ACCURACY)
    assert simulate_csv(chain, drive, tmp_path / "run.csv") == len(reference)
    run = read_csv(tmp_path / "run.csv")
    np.testing.assert_array_equal(run.time, reference[:, 0])
    assert run.polarization is not None
    assert run.phase_fraction is not None
    np.testing.assert_allclose(run.polarization, reference[:, 3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(run.phase_fraction, reference[:, 2], rtol=0, atol=1e-6)
    # the reference's strain is in percent; the actuator has 8 mm of ceramic
    np.testing.assert_allclose(run.displacement, reference[:, 4] / 100 * 8e-3, rtol=0, atol=1e-10)


def test_blocks_do_not_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    time = np.linspace(3.0, 5.0, 1001)
    drive = write_drive(tmp_path / "drive.csv", time, 60 * np.sin(7 * time))
    simulate_csv(load_chain("thesis-p3"), drive, tmp_path / "whole.csv")
    monkeypatch.setattr(simulation, "_ROWS", 37)
    simulate_csv(load_chain("thesis-p3"), drive, tmp_path / "blocks.csv")
    assert (tmp_path / "blocks.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()


def test_rows_far_apart_give_the_same_as_rows_close_together(tmp_path: Path) -> None:
    corners = np.array([0.0, 2.0, 5.0, 6.0]), np.array([0.0, 140.0, -35.0, 90.0])
    fine = np.linspace(0.0, 6.0, 6001)
    chain = with_accuracy(load_chain("thesis-p2"), 1e-8)
    simulate_csv(chain, write_drive(tmp_path / "coarse.csv", *corners), tmp_path / "a.csv")
    simulate_csv(chain, write_drive(tmp_path / "fine.csv", fine, np.interp(fine, *corners)), tmp_path / "b.csv")
    coarse, close = read_csv(tmp_path / "a.csv"), read_csv(tmp_path / "b.csv")
    at_corners = np.searchsorted(fine, corners[0])
    np.testing.assert_allclose(coarse.displacement, close.displacement[at_corners], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("quoted", 'time_s,voltage_V\n"0.0",0.0\n1.0,10.0\n2.0,20.0\n'),
        ("other columns", "note,voltage_V,time_s\n7,0.0,0.0\n8,10.0,1.0\n9,20.0,2.0\n"),
        ("windows", "time_s,voltage_V\r\n0.0,0.0\r\n1.0,10.0\r\n2.0,20.0\r\n"),
        ("quoted late", 'time_s,voltage_V\n0.0,0.0\n1.0,"10.0"\n2.0,20.0\n'),
    ],
)
def test_reads_what_read_csv_reads(name: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "drive.csv").write_bytes(text.encode())
    monkeypatch.setattr(simulation, "_ROWS", 1)
    blocks = list(read_drive(tmp_path / "drive.csv"))
    np.testing.assert_array_equal(np.concatenate([time for time, _ in blocks]), [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(np.concatenate([voltage for _, voltage in blocks]), [0.0, 10.0, 20.0])


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("time_s,voltage_V\n", "at least 2"),
        ("time_s,voltage_V\n0,1\n", "at least 2"),
        ("time_s,displacement_m\n0,1\n1,1\n", "voltage_V is missing"),
        ("time_s,voltage_V\n0,1\n1,x\n", "row 3"),
        ("time_s,voltage_V\n0,1\n1,2\n1,3\n", "row 4"),
        ("time_s,voltage_V\n0,1\n1,nan\n2,3\n", "row 3"),
        ("time_s,voltage_V\n0,1\n1\n2,3\n", "row 3"),
        ("", "empty"),
    ],
)
def test_a_bad_drive_leaves_one_line_and_no_file(
    text: str, part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulation, "_ROWS", 2)
    (tmp_path / "drive.csv").write_text(text)
    with pytest.raises(BenchError, match=part):
        simulate_csv(load_chain("thesis-p1"), tmp_path / "drive.csv", tmp_path / "run.csv")
    assert not (tmp_path / "run.csv").exists()
    assert list(tmp_path.iterdir()) == [tmp_path / "drive.csv"]


def test_an_accuracy_out_of_reach_is_refused() -> None:
    with pytest.raises(BenchError, match="accuracy"):
        with_accuracy(load_chain("thesis-p1"), 0.0)
