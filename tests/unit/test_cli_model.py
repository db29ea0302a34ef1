"""`pzt chains`, `simulate`, `fit`, `predict` as a user types them: files, exit codes, one line for every mistake."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from bag_making import START, block_bytes

from pzt_ros.bags.writer import BagWriter, Qos
from pzt_ros.blocks import BLOCK_TYPE
from pzt_ros.chains import load_chain, parse_chain, shipped_chains
from pzt_ros.cli import main
from pzt_ros.records import Record, read_csv, write_csv
from pzt_ros.sysid.run import Start, free_run

NOISE = 20e-9


def pzt(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    """Exit code of the program."""
    monkeypatch.setattr(sys, "argv", ["pzt", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    return int(end.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a measured run of thesis-p2 and a chain file whose two free parameters are off."""
    folder = tmp_path_factory.mktemp("runs")
    chain = load_chain("thesis-p2")
    time = np.arange(0.0, 10.0, 0.01)
    voltage = 55 + 95 * np.sin(2 * np.pi * 0.5 * time) * (1 - 0.06 * time)
    blank = Record("run", {"time_s": time, "voltage_V": voltage, "displacement_m": time})
    y = free_run(chain, blank, Start((150.0,), 1.0, 5e-6), slice(None), time.size).displacement
    y = y + NOISE * np.random.default_rng(0).standard_normal(time.size)
    write_csv(Record("run", {**blank.columns, "displacement_m": y}), folder / "run.csv")
    guess = yaml.safe_load(shipped_chains()["thesis-p2"].read_text())
    guess["links"][0].update(start="negative", barrier_ascending="0.3 MV/m", relaxation_time="50 ms")
    guess["free"] = ["parametrized.barrier_ascending", "parametrized.relaxation_time"]
    (folder / "guess.yaml").write_text(yaml.safe_dump(guess))
    return folder


@pytest.fixture(scope="module")
def fit_output(folder: Path) -> dict[str, object]:
    """What `pzt fit --json` prints for the first half; it leaves model.yaml in the folder."""
    import contextlib
    import io

    text = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(text):
        words = ("fit", folder / "run.csv", "--model", folder / "guess.yaml", "--out", folder / "model.yaml")
        assert pzt(patch, *words, "--until", 5, "--json") == 0
    found: dict[str, object] = json.loads(text.getvalue())
    return found


def test_fit_writes_a_model_with_its_uncertainty(folder: Path, fit_output: dict[str, object]) -> None:
    truth = load_chain("thesis-p2").links[0]
    parameters = fit_output["parameters"]
    assert isinstance(parameters, dict)
    for name in ("barrier_ascending", "relaxation_time"):
        found = parameters[f"parametrized.{name}"]
        assert abs(found["value"] - getattr(truth, name)) < 3 * found["std"]
    model = load_chain(folder / "model.yaml")
    assert model.notes["fit"]["command"].startswith("pzt fit ")
    assert model.notes["fit"]["runs"][0]["rms_m"] == pytest.approx(NOISE, rel=0.1)
    assert model.notes["start"]["runs"][0]["sha256"] == read_csv(folder / "run.csv").sha256
    assert model.links[0].barrier_ascending == parameters["parametrized.barrier_ascending"]["value"]  # type: ignore[attr-defined]


def test_fit_prints_a_report(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("fit", folder / "run.csv", "--model", folder / "guess.yaml", "--out", folder / "other.yaml")
    monkeypatch.setenv("COLUMNS", "120")
    assert pzt(monkeypatch, *words, "--until", 3, "--profile") == 0
    printed = capsys.readouterr()
    assert "relaxation_time" in printed.out
    for found in load_chain(folder / "other.yaml").notes["fit"]["parameters"].values():
        low, high = found["interval_95"]
        assert low < found["value"] < high
        assert f"{low:.4g} to" in printed.out
    assert "other.yaml" in printed.out
    assert printed.err == ""  # no progress where the output is no terminal


def test_predict_states_the_error_of_the_second_half(
    folder: Path,
    fit_output: dict[str, object],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = (
        "predict",
        "--model",
        folder / "model.yaml",
        folder / "run.csv",
        "--out",
        folder / "out.csv",
        "--from",
        5.005,
    )
    assert pzt(monkeypatch, *words, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["rms_m"] < 1.1 * NOISE
    assert found["rule"] == "as fitted to this run"
    run, out = read_csv(folder / "run.csv"), read_csv(folder / "out.csv", ("time_s", "displacement_m"))
    part = run.time >= 5.005
    np.testing.assert_array_equal(out.time, run.time[part])
    assert list(out.columns) == ["time_s", "displacement_m", "polarization_C_per_m2"]
    error = run.displacement[part] - out.displacement
    assert np.sqrt(np.mean(error**2)) == pytest.approx(found["rms_m"], rel=1e-9)
    assert pzt(monkeypatch, *words) == 0
    assert "nm rms" in capsys.readouterr().out


def test_lost_readings_are_said(
    folder: Path, fit_output: dict[str, object], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = read_csv(folder / "run.csv")
    shaken = run.displacement.copy()
    shaken[300] = 1.0
    write_csv(Record("lost", {**run.columns, "displacement_m": shaken}), folder / "lost.csv")
    words = ("predict", folder / "lost.csv", "--model", folder / "model.yaml", "--out", folder / "out.csv", "--json")
    assert pzt(monkeypatch, *words) == 0
    said = capsys.readouterr()
    assert "warning: lost.csv: 1 reading stands alone and does not count in displacement_m" in said.err
    assert json.loads(said.out)["rms_m"] < 1.2 * NOISE


def test_simulate_writes_a_row_for_each_row(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "drive.csv").write_text("time_s,voltage_V\n0,0\n5,150\n15,150\n20,-30\n")
    assert pzt(monkeypatch, "simulate", folder / "drive.csv", "--model", "thesis-p1", "--out", folder / "sim.csv") == 0
    header = (folder / "sim.csv").read_text().splitlines()[0]
    assert header == "time_s,voltage_V,displacement_m,polarization_C_per_m2,phase_fraction"
    assert read_csv(folder / "sim.csv").voltage.tolist() == [0.0, 150.0, 150.0, -30.0]


def test_chains_lists_and_prints(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert pzt(monkeypatch, "chains") == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in shipped_chains())
    for name in shipped_chains():
        assert pzt(monkeypatch, "chains", name) == 0
        assert parse_chain(yaml.safe_load(capsys.readouterr().out), name).name == name


@pytest.mark.parametrize("command", ["chains", "simulate", "fit", "predict"])
def test_help_shows_an_example(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pzt(monkeypatch, command, "--help") == 0
    assert f"pzt {command}" in capsys.readouterr().out.partition("Example:")[2]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("chains nosuch", "no shipped chain 'nosuch'"),
        ("simulate full-moon --model thesis-p1 --out x.csv", "drive 'full-moon': no such file"),
        ("simulate run.csv --model nosuch --out x.csv", "chain 'nosuch': no such file"),
        ("simulate run.csv --model thesis-p1 --out x.csv --accuracy 5", "--accuracy"),
        ("simulate . --model thesis-p1 --out x.csv", "is a directory"),
        ("fit missing.csv --model guess.yaml --out x.yaml", "missing.csv: no such file"),
        ("fit run.csv --model nosuch --out x.yaml", "chain 'nosuch': no such file"),
        ("fit run.csv --model guess.yaml --out x.yaml --until 0.05", "samples to fit, at least 10 are needed"),
        ("fit run.csv --model guess.yaml --out x.yaml --from 99", "choose a span"),
        ("fit run.csv run.csv --model guess.yaml --out x.yaml", "give each run once"),
        ("fit constant.csv --model guess.yaml --out x.yaml", "voltage stays at 3 V"),
        ("fit still.csv --model guess.yaml --out x.yaml", "displacement_m stays at 0 m"),
        ("fit volts.csv --model guess.yaml --out x.yaml", "displacement_m is missing"),
        ("fit run.csv --model free.yaml --out x.yaml", "free: unknown parameter 'parametrized.colour'"),
        ("predict run.csv --model thesis-p2 --out x.csv --from 99", "choose a span"),
        ("predict run.csv --model start.yaml --out x.csv", "'start:' is not as pzt fit writes it"),
    ],
)
def test_a_mistake_ends_in_one_line_and_code_2(
    words: str,
    message: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    times = range(40)
    Path("constant.csv").write_text("time_s,voltage_V,displacement_m\n" + "".join(f"{t},3,{t % 5}e-9\n" for t in times))
    Path("still.csv").write_text("time_s,voltage_V,displacement_m\n" + "".join(f"{t},{t % 9},0\n" for t in times))
    Path("volts.csv").write_text("time_s,voltage_V\n0,1\n1,2\n")
    chain = yaml.safe_load(Path("guess.yaml").read_text())
    Path("free.yaml").write_text(yaml.safe_dump({**chain, "free": ["parametrized.colour"]}))
    Path("start.yaml").write_text(yaml.safe_dump({**chain, "start": {"runs": "all"}}))
    assert pzt(monkeypatch, *words.split()) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ")
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert not Path("x.csv").exists()
    assert not Path("x.yaml").exists()


def test_a_bag_is_the_same_run_as_its_csv(
    folder: Path,
    fit_output: dict[str, object],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = read_csv(folder / "run.csv")
    with BagWriter(folder / "bag") as writer:
        for topic, column, values in (
            ("/stage/applied", "voltage_V", run.voltage),
            ("/stage/measurement", "displacement_m", run.displacement),
        ):
            channel = writer.add_topic(topic, BLOCK_TYPE, Qos(depth=1000))
            for low in range(0, len(run), 100):
                block = np.column_stack([run.time[low : low + 100], values[low : low + 100]])
                writer.write(channel, block_bytes(("time_s", column), block), START + low)
    words = ("--model", folder / "guess.yaml", "--out", folder / "bag.yaml", "--until", 5, "--json")
    assert pzt(monkeypatch, "fit", folder / "bag", *words) == 0
    assert json.loads(capsys.readouterr().out)["parameters"] == fit_output["parameters"]
    words = ("--model", folder / "model.yaml", "--out", folder / "bag.csv", "--json")
    assert pzt(monkeypatch, "predict", folder / "bag", *words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["rule"] == "as fitted to this run"
    assert found["rms_m"] < 1.1 * NOISE
