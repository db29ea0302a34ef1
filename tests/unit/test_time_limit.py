"""A diagnosis that is out of time ends with what it has, says so, and names nothing that it could not weigh."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pzt_benchmarks.residual_court.cases import Spec, make_case
from pzt_benchmarks.residual_court.files import CaseFiles, write_case
from pzt_ros.chains import load_chain
from pzt_ros.cli import main
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.diagnosis.identified_densities import Densities, on_densities
from pzt_ros.diagnosis.report import Report
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.time_limit import TimeLimit
from pzt_ros.diagnosis.undeclared import Bases
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.records import read_csv

PLAYS = Spec("effect_wrong", "play_sum", ("mains_hum",), 5.0, "short", seed=6)


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> CaseFiles:
    """Of a hum beside plays: simulated."""
    return write_case(make_case(PLAYS), tmp_path_factory.mktemp("plays"))


def cut(case: CaseFiles, monkeypatch: pytest.MonkeyPatch, asks: int) -> tuple[Report, int]:
    """The diagnosis whose time is up when it is asked for so many times, and how often it was."""
    asked: list[None] = []

    def is_over(limit: TimeLimit, needed: float = 0.0) -> bool:
        asked.append(None)
        limit.has_cut = len(asked) > asks
        return limit.has_cut

    monkeypatch.setattr(TimeLimit, "is_over", is_over)
    assert case.declared is not None
    train, test = ([read_csv(path) for path in paths] for paths in (case.train, case.test))
    return diagnose(train, test, load_chain(case.declared), workers=IN_THIS_PROCESS), len(asked)


@pytest.mark.parametrize("asks", [0, 2])
def test_it_ends_wherever_its_time_is_up(case: CaseFiles, asks: int, monkeypatch: pytest.MonkeyPatch) -> None:
    report, asked = cut(case, monkeypatch, asks)
    assert asks < asked <= asks + 12  # whatever is on its way ends soon
    assert report.is_cut
    assert "The time limit" in report.verdict
    assert {effect.name for effect in report.effects} <= {"mains_hum"}
    assert report.remains.present or report.effects  # that something is missing is said even so
    assert report.after.test <= report.before.test


def test_the_command_says_what_was_left_out(
    case: CaseFiles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["diagnose", *map(str, case.train), "--test", *map(str, case.test), "--model", str(case.declared)]
    monkeypatch.setattr(sys, "argv", ["pzt", *words, "--out", str(tmp_path), "--time-limit", "0"])
    with pytest.raises(SystemExit) as end:
        main()
    assert not end.value.code
    assert "The time limit of 0 s was reached before all was tried" in " ".join(capsys.readouterr().out.split())
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["time_limit_reached"] is True
    assert [each["name"] for each in report["effects"]] == ["mains_hum"]  # its line stands out of whatever is left
    assert report["unexplained"]["present"]


def test_without_time_for_a_lattice_relays_are_what_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing was returned where the limit was reached while elements were searched, which ended in an error."""
    declared: Any = SimpleNamespace(ratios=[3.0, 3.0], staged=SimpleNamespace(has_past=False))
    relays: Any = SimpleNamespace(ratios=[2.0, 2.0], staged=SimpleNamespace(has_past=False))
    densities = Densities(Bases(declared, relays), Search(limit=TimeLimit(0.0)))
    (branch,) = on_densities(densities, Thresholds())
    assert branch.final is relays
    searched = Branch("identified", relays, ())
    vars(densities)["on_relays"] = searched  # what was searched before is kept
    assert on_densities(densities, Thresholds()) == [searched]


def test_time_is_up_once_and_for_all() -> None:
    limit, over = TimeLimit(), TimeLimit(0.0)
    assert not limit.is_over()
    assert not limit.has_cut
    assert not over.has_cut  # nothing was left out yet
    assert over.is_over()
    short = TimeLimit(100.0)
    assert not short.is_over(60.0)
    assert short.is_over(120.0)  # what needs longer than is left is not begun
    assert short.has_cut
    over.seconds = math.inf
    assert over.is_over()
    assert over.has_cut
