"""The report of a run, from run folders that the in-process loop fills: no ROS is needed to make or to read them."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
import shutil
import textwrap
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_making import PERIOD, START, block_bytes, check_one_line, serialized

from pzt_ros.bags.writer import BagWriter, Qos, typestore
from pzt_ros.blocks import BLOCK_TYPE
from pzt_ros.errors import BenchError, RunFailedError
from pzt_ros.loop import Tick, run_in_process
from pzt_ros.report.figures import thin
from pzt_ros.report.health import NodeHealth
from pzt_ros.report.health import summarize as summarize_health
from pzt_ros.report.run import read_summary, write_run_report
from pzt_ros.report.rundata import read_run
from pzt_ros.report.verdict import completeness
from pzt_ros.scenario import load_scenario

SCENARIO = """
    scenario: short
    plant: bench-stage
    model: thesis-p2
    controllers:
      open_loop: {gain: 6.5e-8 m/V, voltage_at_zero: -60 V}
    phases:
      - {phase: voltage, to: 150 V, duration: 0.1 s}
      - {phase: voltage, to: 0 V, duration: 0.1 s}
      - {phase: move, to: 4 um, duration: 0.05 s, controller: open_loop}
      - {phase: scan, low: 4 um, peak_to_peak: 4 um, frequency: 20 Hz, cycles: 3}
      - {phase: voltage, to: 150 V, duration: 0.1 s}
      - {phase: voltage, to: 0 V, duration: 0.1 s}
      - {phase: move, to: 4 um, duration: 0.05 s, controller: inverse_pi}
      - {phase: scan, low: 4 um, peak_to_peak: 4 um, frequency: 20 Hz, cycles: 3}
"""
VOLTAGE_ONLY = """
    plant: bench-stage
    model: thesis-p2
    phases:
      - {phase: voltage, to: 100 V, duration: 0.05 s}
"""
BLOCKS: dict[str, tuple[tuple[str, ...], Callable[[Tick], Any]]] = {
    "applied": (
        ("time_s", "voltage_V", "current_A", "charge_C"),
        lambda t: (t.applied.time, t.applied.voltage, t.applied.current, t.applied.charge),
    ),
    "truth": (("time_s", "displacement_m"), lambda t: (t.truth.time, t.truth.displacement)),
    "measurement": (("time_s", "displacement_m"), lambda t: (t.truth.time, t.measurement)),
    "reference": (("time_s", "displacement_m"), lambda t: (t.reference.time, t.reference.values)),
}
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"


def diagnostic_status(name: str, level: int, message: str, values: dict[str, str]) -> Any:
    types = typestore().types
    pairs = [types["diagnostic_msgs/msg/KeyValue"](key, value) for key, value in values.items()]
    return types["diagnostic_msgs/msg/DiagnosticStatus"](level, name, message, "pzt_ros", pairs)


def diagnostics_bytes(*statuses: Any) -> bytes:
    types = typestore().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](1, 0), "")
    return serialized(types[DIAGNOSTICS](header, list(statuses)), DIAGNOSTICS)


def make_run(
    folder: Path, text: str, topics: Any = BLOCKS, lost: tuple[tuple[str, int], ...] = (), **provenance: Any
) -> list[Tick]:
    """A run folder as bringup leaves it, with only the blocks of `topics` in its bag, and none that was `lost`."""
    folder.mkdir(parents=True)
    (folder / "scenario.yaml").write_text(textwrap.dedent(text), encoding="utf-8")
    noted = {
        "scenario": "short", "simulated": True, "namespace": "/stage", "seed": 1, "command": ["pzt", "run"],
        "versions": {"pzt_ros": "0.1.0"}, "outcome": {"exit_code": 0, "sentence": "run complete", "status": {}},
    }  # fmt: skip
    (folder / "run.json").write_text(json.dumps({**noted, **provenance}), encoding="utf-8")
    ticks: list[Tick] = []
    run_in_process(load_scenario(folder / "scenario.yaml"), ticks.append)
    with BagWriter(folder / "bag") as writer:
        channels = {name: writer.add_topic(f"/stage/{name}", BLOCK_TYPE, Qos(depth=10)) for name in topics}
        health = writer.add_topic("/diagnostics", DIAGNOSTICS, Qos(depth=10))
        for number, tick in enumerate(ticks):
            now = START + number * PERIOD
            for name, channel in channels.items():
                columns, values_of = BLOCKS[name]
                asked = tick.reference is not None and tick.reference.quantity == "displacement"
                if (name != "reference" or asked) and (name, number) not in lost:
                    writer.write(channel, block_bytes(columns, np.column_stack(values_of(tick))), now)
            writer.flush()
        status = diagnostic_status("/stage/amplifier", 1, "enabled", {"limited: slew rate": "7", "reason": ""})
        writer.write(health, diagnostics_bytes(status), START + len(ticks) * PERIOD)
    return ticks


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Tick]]:
    folder = tmp_path_factory.mktemp("run") / "short"
    ticks = make_run(folder, SCENARIO)
    write_run_report(folder)
    return folder, ticks


class Page(HTMLParser):
    """Every address in the page, every opened tag that was not closed, and its text."""

    VOID = frozenset({"meta", "img", "br", "source", "link"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attributes if name in ("src", "srcset", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def page_of(folder: Path) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def test_numbers_are_those_of_the_samples(made: tuple[Path, list[Tick]]) -> None:
    folder, ticks = made
    rows = read_summary(folder)["tracking"]
    assert [row["name"] for row in rows] == ["open_loop", "inverse_pi"]
    spans = load_scenario(folder / "scenario.yaml").experiment().spans()
    for row in rows:
        _, begin, end = spans[row["phase"] - 1]
        own = [t for t in ticks if begin + 0.05 - 1e-9 <= t.truth.time[0] < end - 1e-9]  # 20 Hz: a cycle is 50 ms
        for key in ("truth", "measurement"):
            error = np.concatenate(
                [t.reference.values - (t.truth.displacement if key == "truth" else t.measurement) for t in own]
            )
            assert row["against"][key]["rms_m"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
            assert row["against"][key]["max_m"] == pytest.approx(np.abs(error).max(), rel=1e-12)
            assert row["against"][key]["rms_percent_of_stroke"] == pytest.approx(
                100.0 * np.sqrt(np.mean(error**2)) / 4e-6
            )
    ratio = rows[0]["against"]["truth"]["rms_m"] / rows[1]["against"]["truth"]["rms_m"]
    assert rows[1]["better_than_open_loop"] == pytest.approx(ratio)


def test_page_is_whole_and_needs_nothing_else(made: tuple[Path, list[Tick]]) -> None:
    page = page_of(made[0])
    assert page.open == []
    assert len(page.addresses) == 2 * 4  # four figures, light and dark
    for address in page.addresses:
        assert address.startswith("data:image/png;base64,")
        assert base64.b64decode(address.partition(",")[2]).startswith(b"\x89PNG\r\n")
    raw = (made[0] / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://|@import|url\(|<script", raw)
    assert "prefers-color-scheme: dark" in raw


def test_page_says_what_matters(made: tuple[Path, list[Tick]]) -> None:
    text = page_of(made[0]).text
    assert "SIMULATED" in text
    assert "In simulation, inverse_pi follows the 4 µm triangle at 20 Hz" in text
    assert "cut short" not in text
    assert "limited: slew rate: 7" in text  # the amplifier's own count
    saved = {path.name for path in (made[0] / "figures").iterdir()}
    assert {"overview.png", "loops.png", "tracking.png", "course.png"} <= saved


def copy_of(made: tuple[Path, list[Tick]], tmp_path: Path, **provenance: Any) -> Path:
    folder = tmp_path / "copy"
    shutil.copytree(made[0], folder)
    noted = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    noted.update(provenance)
    (folder / "run.json").write_text(json.dumps(noted), encoding="utf-8")
    return folder


def test_killed_run_is_reported_as_far_as_it_came(made: tuple[Path, list[Tick]], tmp_path: Path) -> None:
    folder = copy_of(made, tmp_path, outcome=None)
    (folder / "bag" / "metadata.yaml").unlink()
    file = next((folder / "bag").glob("*.mcap"))
    with file.open("r+b") as stream:
        stream.truncate(file.stat().st_size * 45 // 100)
    write_run_report(folder)
    summary, text = read_summary(folder), page_of(folder).text
    assert "did not end properly" in summary["incomplete"]
    assert summary["incomplete"] in text
    assert "cut off or damaged" in text
    assert [row["name"] for row in summary["tracking"]] == ["open_loop"]
    assert summary["recorded_s"] < summary["asked_s"]


def test_failed_and_interrupted_runs_say_so(made: tuple[Path, list[Tick]], tmp_path: Path) -> None:
    folder = copy_of(made, tmp_path, outcome={"exit_code": 1, "sentence": "process 'plant' died"})
    data = read_run(folder)
    assert completeness(data).startswith("This run failed: process 'plant' died. 0.80 of 0.80 s were recorded")
    stopped = dataclasses.replace(data, provenance={"outcome": {"exit_code": 0, "sentence": "stopped"}}, duration=5.0)
    assert completeness(stopped).startswith("This run was cut short: stopped. 0.80 of 5.00 s")


def test_measured_run_is_not_called_simulated(made: tuple[Path, list[Tick]], tmp_path: Path) -> None:
    folder = copy_of(made, tmp_path, simulated=False)
    write_run_report(folder)
    summary, text = read_summary(folder), page_of(folder).text
    assert list(summary["tracking"][0]["against"]) == ["measurement"]
    assert "MEASURED" in text
    assert "imulat" not in text.replace("simulation only", "")


def test_voltage_alone(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    make_run(folder, VOLTAGE_ONLY, [name for name in BLOCKS if name != "reference"])
    write_run_report(folder)
    assert read_summary(folder)["tracking"] == []
    assert "the voltage ran from 0.0 to 100.0 V" in page_of(folder).text
    assert {path.name for path in (folder / "figures").glob("*[a-z].png")} >= {"loops.png", "course.png"}


def test_what_the_bag_lacks_is_counted_and_said(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    topics = [name for name in BLOCKS if name != "reference"]
    ticks = make_run(folder, VOLTAGE_ONLY, topics, (("applied", 3), ("applied", 4), ("truth", 0), ("measurement", 2)))
    size = len(ticks[0].truth.time)
    write_run_report(folder)
    summary = read_summary(folder)
    assert summary["missing_samples"] == {"applied": 2 * size, "measurement": size, "truth": 0}  # begins later: no gap
    assert f"lacks {2 * size} samples of applied and {size} samples of measurement between" in summary["gaps"]
    assert summary["gaps"] in page_of(folder).text


def test_nothing_is_said_of_gaps_where_there_are_none(made: tuple[Path, list[Tick]]) -> None:
    summary = read_summary(made[0])
    assert summary["gaps"] == ""
    assert set(summary["missing_samples"].values()) == {0}


def test_nothing_measured_is_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    make_run(folder, VOLTAGE_ONLY, ["applied"])
    with pytest.raises(RunFailedError) as caught:
        write_run_report(folder)
    check_one_line(caught.value, str(folder), "nothing was measured")


@pytest.mark.parametrize("content", [None, "[1, 2]", "{"])
def test_not_a_run_folder(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "run.json").write_text(content, encoding="utf-8")
    with pytest.raises(BenchError) as caught:
        write_run_report(tmp_path)
    check_one_line(caught.value, str(tmp_path))


def test_health_is_the_last_word_and_the_median_rate() -> None:
    def said(level: int, state: str, rate: str, refused: str) -> Any:
        return diagnostic_status("/stage/plant", level, state, {"ticks_per_second": rate, "refused on drive": refused})

    found = summarize_health([said(0, "ready", "0", "0"), said(0, "running", "300", "0"), said(2, "late", "100", "5")])
    assert found == [NodeHealth("/stage/plant", "error", "late", 200.0, {"refused on drive": 5}, "")]


def test_thinning_keeps_every_spike() -> None:
    values = np.sin(np.arange(100_000) / 5000.0)
    values[77_777], values[12] = 9.0, np.nan
    x, y = thin(np.arange(100_000.0), values)
    assert len(y) < 10_000
    assert np.all(np.diff(x) >= 0.0)
    assert np.nanmax(y) == 9.0
    assert x[np.nanargmax(y)] == 77_777
