"""`pzt diagnose` as a user types it: what it refuses, how it reads `--test A B`, what it prints and writes."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pzt_ros.chains import load_chain, shipped_chains
from pzt_ros.cli import main
from pzt_ros.cli.diagnose import _spread
from pzt_ros.diagnosis import baselines as baselines_module
from pzt_ros.diagnosis.baselines import baselines
from pzt_ros.diagnosis.checks import check_runs
from pzt_ros.diagnosis.data import RunData, split
from pzt_ros.diagnosis.page import error_rows, quantity, write_page
from pzt_ros.diagnosis.remains import Remains
from pzt_ros.diagnosis.report import FoundEffect, Report, Tried
from pzt_ros.diagnosis.views import by_band, over_hold, over_voltage
from pzt_ros.effects.insert import with_effect
from pzt_ros.effects.sensor_lag import SensorLag
from pzt_ros.errors import BenchError
from pzt_ros.records import Record, write_csv
from pzt_ros.sysid.run import Start, free_run

NOISE = 5e-9
COUNT = 2000
RADII = 50.0 / 41.0 * np.array([0.0, 8.0, 16.0, 24.0, 32.0])  # among the play sum's own under 100 V


def record(name: str, gain: float = 1e-7, seed: int = 0, volts: float = 100.0, periods: float = 5.0) -> Record:
    """A loop of five play operators and noise [1 kHz, 2 s]."""
    rng = np.random.default_rng(seed)
    time = np.arange(COUNT) * 1e-3
    voltage = 0.5 * volts * (1.0 - np.cos(2.0 * np.pi * periods * time / 2.0))
    y = 0.5 * gain * voltage
    for radius in RADII:
        y = y + 0.1 * gain * play(voltage, radius)
    return Record(
        name, {"time_s": time, "voltage_V": voltage, "displacement_m": y + NOISE * rng.standard_normal(COUNT)}
    )


def play(voltage: np.ndarray, radius: float) -> np.ndarray:
    """A play operator sample by sample, from rest at 0 V."""
    state, out = 0.0, []
    for v in voltage:
        state = max(v - radius, min(v + radius, state))
        out.append(state)
    return np.array(out)


def with_columns(run: Record, **columns: np.ndarray) -> Record:
    """The same run with other samples."""
    return dataclasses.replace(run, columns={**run.columns, **columns})


def data(*records: Record) -> list[RunData]:
    """The first to fit, the rest to test."""
    runs = [RunData(r, {}, NOISE) for r in records]
    return split(runs[:1], runs[1:])


def pzt(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    """Exit code of the program."""
    monkeypatch.setattr(sys, "argv", ["pzt", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    return int(end.value.code or 0)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("a --test b c --out d", "a --test b --test c --out d"),
        ("--test b --test c --out d a", "--test b --test c --out d a"),
        ("a b --out d --test c", "a b --out d --test c"),
        ("a --test=b --out d", "a --test=b --out d"),
        ("a --json --test b c e --model m", "a --json --test b --test c --test e --model m"),
    ],
)
def test_words_after_test_are_all_test_runs(typed: str, meant: str) -> None:
    assert list(_spread(typed.split())) == meant.split()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of runs, good and bad, as the working directory."""
    monkeypatch.chdir(tmp_path)
    good, other = record("a"), record("b", seed=1)
    still, flat = np.full(COUNT, 3.0), np.full(COUNT, 1e-6)
    hiss = NOISE * np.random.default_rng(2).standard_normal(COUNT)
    runs = {
        "a": good,
        "b": other,
        "short": good.between(0.0, 0.1),
        "constant": with_columns(good, voltage_V=still),
        "monitor": with_columns(good, voltage_V=still + 1e6 * hiss),
        "flat": with_columns(good, displacement_m=flat),
        "hiss": with_columns(good, displacement_m=flat + hiss),
        "tenfold": record("t", gain=1e-6, seed=3),
        "volts": record("v", gain=1e-5, volts=3.0, seed=4),
    }
    for name, run in runs.items():
        write_csv(run, tmp_path / f"{name}.csv")
    shutil.copy("a.csv", "copy.csv")
    text = Path("a.csv").read_text().splitlines(keepends=True)
    Path("cut.csv").write_text("".join(text)[:-4])
    Path("tail.csv").write_text("".join(text)[:-5])  # the exponent is gone, what is left is a number
    Path("empty.csv").write_text("")
    Path("nan.csv").write_text("".join([*text[:500], "9.0,1.0,nan\n"]))
    Path("back.csv").write_text("".join([*text[:500], text[100]]))
    Path("word.csv").write_text("".join([*text[:500], "9.0,1.0,low\n"]))
    Path("columns.csv").write_text("time_s,voltage_V\n0,1\n1,2\n")
    Path("file").write_text("in the way")
    Path("bag").mkdir()
    Path("loose.yaml").write_text("links:\n  - {link: electrostriction}\n")
    return tmp_path


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("nosuch.csv --test b.csv", "nosuch.csv: no such file"),
        ("empty.csv --test b.csv", "empty.csv: the file is empty"),
        ("cut.csv --test b.csv", "cut.csv row 2001, column displacement_m"),
        ("tail.csv --test b.csv", "tail.csv: displacement_m ends with"),
        ("nan.csv --test b.csv", "nan.csv row 501, column displacement_m: 'nan'"),
        ("back.csv --test b.csv", "back.csv row 501: time_s"),
        ("word.csv --test b.csv", "word.csv row 501, column displacement_m: 'low' is not a number"),
        ("columns.csv --test b.csv", "displacement_m is missing"),
        ("bag --test b.csv", "bag"),
        ("a.csv --test columns.csv", "displacement_m is missing"),
        ("a.csv --test b.csv --model nosuch", "chain 'nosuch': no such file"),
        ("a.csv --test b.csv --model loose.yaml", "no link for the ceramic"),
        ("short.csv --test b.csv", "short.csv: 101 samples, a diagnosis needs at least 200"),
        ("a.csv --test short.csv", "short.csv: 101 samples"),
        ("constant.csv --test b.csv", "constant.csv: voltage_V stays at 3 V"),
        ("monitor.csv --test b.csv", "monitor.csv: voltage_V stays at"),
        ("flat.csv --test b.csv", "flat.csv: displacement_m stays at 1e-06 m"),
        ("hiss.csv --test b.csv", "no more than its noise"),
        ("a.csv a.csv --test b.csv", "a.csv: is given twice"),
        ("a.csv --test b.csv a.csv", "a.csv: is given twice"),
        ("a.csv --test copy.csv", "copy.csv: holds the same data as a.csv"),
        ("a.csv --test tenfold.csv", "tenfold.csv: moves by"),
        ("a.csv --test volts.csv", "each over its own range of voltage"),
        ("a.csv --test b.csv --out file", "--out file: cannot be written"),
        ("a.csv --test b.csv --jobs 2 --dask tcp://host:8786", "give one of them"),
        ("a.csv --test b.csv --dask localhost", "--dask localhost: is no address of a scheduler"),
    ],
)
def test_a_mistake_ends_in_one_line_and_code_2(
    words: str, message: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = words.split() if "--out" in words else [*words.split(), "--out", "found"]
    assert pzt(monkeypatch, "diagnose", *typed) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("warning: ")]
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert message in lines[0]
    assert not (folder / "found" / "report.json").exists()


def test_help_shows_an_example(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert pzt(monkeypatch, "diagnose", "--help") == 0
    assert "pzt diagnose" in capsys.readouterr().out.partition("Example:")[2]


def test_a_first_rise_is_compared_with_a_rise() -> None:
    """A court case was refused: 91 nm/V on the way up from rest, 30 on the way down that took most of the other run."""
    time = np.arange(COUNT) * 1e-3
    up = np.interp(time, [0.0, 2.0], [0.0, 150.0])
    there_and_back = np.interp(time, [0.0, 0.2, 2.0], [0.0, 150.0, 0.0])
    fall = np.where(time > 0.2, 30e-9 * there_and_back + 150.0 * 61e-9, 91e-9 * there_and_back)
    noise = NOISE * np.random.default_rng(6).standard_normal(COUNT)
    rises, falls = (
        Record(name, {"time_s": time, "voltage_V": voltage, "displacement_m": moved + noise})
        for name, voltage, moved in (("up", up, 91e-9 * up), ("back", there_and_back, fall))
    )
    check_runs([rises], [falls])
    scaled = with_columns(falls, displacement_m=4.0 * falls.displacement)
    with pytest.raises(BenchError, match=r"back: moves by 364 nm/V where up moves by 91 nm/V"):
        check_runs([rises], [scaled])


def test_a_first_rise_is_no_rise_like_others() -> None:
    """An examiner's case was refused: the only rise of a run was its first, which went 3.2 times as far as others."""
    time = np.arange(COUNT) * 1e-3
    once = np.interp(time, [0.0, 0.4, 2.0], [0.0, 100.0, 60.0])
    again = np.interp(time, [0.0, 0.2, 0.5, 2.0], [0.0, 100.0, 0.0, 100.0])
    noise = NOISE * np.random.default_rng(7).standard_normal(COUNT)

    def moved(voltage: Any, gain: float) -> Any:
        before = time <= time[np.argmax(voltage > 99.5)]
        return gain * np.where(before, voltage, 100.0 + 0.31 * (voltage - 100.0)) + noise

    runs = [
        Record(name, {"time_s": time, "voltage_V": voltage, "displacement_m": moved(voltage, gain)})
        for name, voltage, gain in (("often", again, 160e-9), ("once", once, 160e-9), ("other", once, 660e-9))
    ]
    check_runs(runs[:1], runs[1:2])
    with pytest.raises(BenchError, match=r"other: moves by 660 nm/V where often moves by 160 nm/V"):
        check_runs(runs[:1], runs[2:])


def test_runs_of_one_actuator_may_differ_as_a_ceramic_does() -> None:
    """Small and large loops, another zero, drift of half the motion: none of that is another actuator."""
    whole, part = record("whole"), record("part", volts=40.0, seed=1)
    drifted = with_columns(record("d", seed=2), displacement_m=record("d", seed=2).displacement + 2.5e-6 * whole.time)
    check_runs([whole], [part, drifted])
    with pytest.raises(BenchError, match=r"whole: moves by .* nm/V where other moves by .* a ratio of"):
        check_runs([record("other", gain=4e-7, seed=5)], [whole])


def test_play_sum_finds_a_play_sum() -> None:
    """The truth is in its family, so that only the noise is left; a line leaves the loop."""
    found = baselines(data(record("a"), record("b", volts=80.0, seed=1)))
    assert found["play sum"].score == pytest.approx(NOISE, rel=0.1)
    assert found["straight line"].score > 20.0 * NOISE
    y = record("a").displacement
    v = np.column_stack((np.ones(COUNT), record("a").voltage))
    left = y - v @ np.linalg.lstsq(v, y, rcond=None)[0]
    assert found["straight line"].train == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-6)


def test_last_cycle_leaves_twice_the_noise_power() -> None:
    runs = data(record("a"), record("b", seed=1, periods=10.0))
    found = baselines(runs)["last cycle"]
    assert baselines_module._period(runs[1].record) == pytest.approx(0.2, rel=1e-3)
    assert found.score == pytest.approx(math.sqrt(2.0) * NOISE, rel=0.1)
    aperiodic = with_columns(record("c"), voltage_V=np.linspace(0.0, 100.0, COUNT) ** 1.5)
    assert "last cycle" not in baselines(data(record("a"), aperiodic))


def test_bands_add_up_to_the_variance() -> None:
    run = data(record("a"))[0]
    residual = 3e-8 * np.sin(2.0 * np.pi * 50.0 * run.record.time)
    seen = by_band([run], [residual])
    assert np.nansum(seen.rms**2) == pytest.approx(np.var(residual), rel=1e-9)
    line = int(np.nanargmax(seen.rms))
    assert seen.edges[line] < 50.0 < seen.edges[line + 1]
    assert np.nansum(seen.noise**2) == pytest.approx(NOISE**2, rel=0.01)


def test_holds_are_counted_along_the_last_step() -> None:
    """Creep towards the last step rises in holds after steps up and down alike."""
    time = np.arange(4000) * 1e-3
    voltage = np.where((time // 1.0) % 2 == 0, 0.0, 50.0)
    since = time % 1.0
    creep = 1e-8 * np.log10(1.0 + since / 0.01) * np.where(voltage > 0.0, 1.0, -1.0)
    run = RunData(Record("steps", {"time_s": time, "voltage_V": voltage, "displacement_m": creep}), {}, NOISE)
    seen = over_hold([run], [creep])
    assert seen is not None
    assert len(seen.each) == 3  # the first began before the run
    late = int(np.argmin(np.abs(seen.time - 0.5)))
    assert seen.mean[late] == pytest.approx(1e-8 * math.log10(51.0), rel=0.1)
    ramp = dataclasses.replace(run, record=with_columns(run.record, voltage_V=time))
    assert over_hold([ramp], [creep]) is None


def test_branches_part_where_the_residual_has_a_loop() -> None:
    run = data(record("a"))[0]
    rate = np.gradient(run.record.voltage)
    seen = over_voltage([run], [1e-8 * np.sign(rate)])
    middle = len(seen.centres) // 2
    assert seen.rising[middle] - seen.falling[middle] == pytest.approx(2e-8, rel=1e-6)


@pytest.mark.parametrize(
    ("value", "std", "unit", "text"),
    [
        (5.0012e5, 140.0, "V/m", "500.12 ± 0.14 kV/m"),
        (9.954e-4, 4.6e-6, "s", "995.4 ± 4.6 µs"),
        (1.2e11, 2.6e7, "V^2/m^2", "(1.20000 ± 0.00026)·10¹¹ V²/m²"),
        (0.0501, 3.5e-4, "1", "0.05010 ± 0.00035"),
        (0.26, None, "C/m^2", "0.2600 C/m²"),
        (0.0, 0.01, "m", "0.000 ± 0.010 m"),
    ],
)
def test_a_parameter_is_written_to_two_digits_of_its_error(
    value: float, std: float | None, unit: str, text: str
) -> None:
    found = quantity({"value": value, "std": std, "unit": unit})
    assert found == text


@pytest.mark.parametrize(
    ("interval", "text"),
    [
        ([2.1e-3, 2.9e-3], "2.41 ± 0.12 ms, 95 %: 2.10 to 2.90"),
        ([2.1e-3, None], "2.41 ± 0.12 ms, 95 %: at least 2.10"),
        ([None, 2.9e-3], "2.41 ± 0.12 ms, 95 %: at most 2.90"),
        ([None, None], "2.41 ± 0.12 ms, 95 %: anything"),
    ],
)
def test_an_interval_is_said_beside_the_value(interval: list[float | None], text: str) -> None:
    assert quantity({"value": 2.41e-3, "std": 0.12e-3, "unit": "s", "interval_95": interval}) == text


def plant(seed: int) -> Record:
    """thesis-p1 under a few ramps of random height [1 kHz, 2 s], with noise."""
    rng = np.random.default_rng(seed)
    time = np.arange(COUNT) * 1e-3
    voltage = np.interp(time, np.linspace(0.0, 2.0, 9), [0.0, 150.0, *rng.uniform(-40.0, 150.0, 6), 0.0])
    blank = Record("plant", {"time_s": time, "voltage_V": voltage, "displacement_m": time})
    y = free_run(load_chain("thesis-p1"), blank, Start(), slice(None), COUNT).displacement
    return with_columns(blank, displacement_m=y + NOISE * rng.standard_normal(COUNT))


class Outside(HTMLParser):
    """Collects what a page would load from elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("src", "srcset", "href") and value and not value.startswith(("data:", "#")):
                self.found.append(f"{tag} {value[:60]}")


def found_report() -> Report:
    """Two runs, one effect added, two that cannot be told apart, made by hand."""
    runs = data(record("a"), record("<b>", seed=1))
    generic = baselines(runs)
    declared = load_chain("thesis-p1")
    lag = {"value": 1.2e-3, "std": 4e-5, "unit": "s"}
    repaired = dataclasses.replace(
        with_effect(declared, SensorLag(lag=1.2e-3)), notes={"fit": {"parameters": {"sensor_lag.lag": lag}}}
    )
    nan = math.nan
    return Report(
        train=(runs[0],),
        test=(runs[1],),
        noise=NOISE,
        base={"model": "parametrized"},
        before=generic["straight line"],
        after=generic["play sum"],
        baseline=declared,
        model=repaired,
        effects=(FoundEffect("sensor_lag", "sensor", 2e-8, 6e-9, {"lag": lag}, 0.97),),
        tried=(
            Tried(1, "gaussian", "sensor_lag", 6e-9, 2e4, 1e4, 0.99, 0.98, True, "explains 98 %"),
            Tried(1, "gaussian", "bias_field", 2e-8, 0.1, -0.2, -1e-5, 0.01, False, "sensor_lag explains more"),
            Tried(1, "gaussian", "leakage", nan, nan, nan, nan, nan, False, "cannot be seen without polarization"),
        ),
        not_identifiable=(("thermal_drift", "slow_relaxation"),),
        remains=Remains(6e-9, 1.2, 1.4, True, "largest in <b>: 1.2 x noise"),
        next_experiment="To confirm sensor_lag: a chirp",
        verdict="Missing: sensor lag. Something unexplained remains: largest in <b>: 1.2 x noise.",
        baselines=generic,
        command="pzt diagnose a --test b --out found",
    )


def test_the_page_says_what_was_found(tmp_path: Path) -> None:
    report = found_report()
    write_page(report, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    for text in (
        "Missing: sensor lag.",
        "1.200 ± 0.040 ms",
        "Not identifiable from these runs: thermal drift or slow relaxation",
        "leakage</dt><dd>cannot be seen without polarization",
        "sensor lag explains more",
        "To confirm sensor lag: a chirp.",
        report.runs[1].record.sha256,
        "&lt;b&gt;",
    ):
        assert text in page
    words = re.sub(r"data:image/png;base64,[^\"]*", "", page)
    assert not re.search(r"\bnan\b|\binf\b|<b>:", words)
    assert page.count("data:image/png") == 10  # five figures in two themes
    assert error_rows(report)[-1].after.rms == pytest.approx(report.after.score)
    assert error_rows(report)[1].before.share == report.before.nrmse


def test_a_diagnosis_writes_its_report(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("diagnose", "plant.csv", "--test", "again.csv", "--model", "quick.yaml", "--out", "found", "--json")
    chain = yaml.safe_load(shipped_chains()["thesis-p1"].read_text())
    Path("quick.yaml").write_text(yaml.safe_dump({**chain, "free": ["parametrized.relaxation_time"]}))
    for name, seed in (("plant.csv", 0), ("again.csv", 1)):
        write_csv(plant(seed), name)
    assert pzt(monkeypatch, *words) == 0
    printed = capsys.readouterr()
    assert printed.err == ""  # no progress where the output is no terminal
    found = json.loads(printed.out)
    assert found["train"] == ["plant.csv"]
    assert found["test"] == ["again.csv"]
    assert set(found["baselines"]) >= {"straight line", "play sum"}
    assert found["after"]["score_rms_m"] <= found["baselines"]["straight line"]["score_rms_m"]
    written = json.loads(Path("found/report.json").read_text())
    assert {k: written[k] for k in written} == {k: found[k] for k in written}
    page = Path("found/report.html").read_text(encoding="utf-8")
    outside = Outside()
    outside.feed(page)
    assert outside.found == []
    assert len(page) < 3e6
    assert found["runs"][0]["sha256"] in page
    assert "pzt diagnose plant.csv --test again.csv" in page
