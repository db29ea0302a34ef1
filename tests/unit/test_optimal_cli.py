"""`pzt optimal`: what it writes, the names that others read, and one line for what it cannot solve."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from pzt_ros.cli.app import build
from pzt_ros.errors import BenchError
from pzt_ros.optimal.problem import Problem, load_problem, parse_problem, shipped_problems
from pzt_ros.records import read_csv

CONTRACT = (
    "peak_field_V_per_m",
    "end_field_V_per_m",
    "end_phase_fraction",
    "cost",
    "solver",
    "iterations",
    "solve_time_s",
)
CASE_1 = yaml.safe_load(shipped_problems()["case1"].read_text(encoding="utf-8"))


def run(*words: str) -> str:
    result = CliRunner().invoke(build(), ["optimal", *words], catch_exceptions=True)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.output


def test_writes_what_the_contract_names(tmp_path: Path) -> None:
    out = tmp_path / "case1"
    found = json.loads(run("case1", "--solver", "riccati", "--out", str(out), "--json"))
    assert all(name in found for name in CONTRACT)
    assert found["solver"] == "riccati"
    assert found["peak_field_V_per_m"] == pytest.approx(3.325e6, abs=1e4)
    assert json.loads((out / "solution.json").read_text(encoding="utf-8")) == {
        key: value for key, value in found.items() if key != "out"
    }
    drive = read_csv(out / "solution.csv", ("time_s", "voltage_V"))
    assert drive.time[-1] == pytest.approx(4e-3)
    assert max(drive.voltage) == pytest.approx(1e-4 * found["peak_field_V_per_m"])
    for name in ("over-time", "over-loops"):
        assert (out / f"{name}.png").stat().st_size > 10_000
        assert (out / f"{name}.svg").read_text(encoding="utf-8").startswith("<?xml")
    with pytest.raises(BenchError, match="--overwrite"):
        run("case1", "--solver", "riccati", "--out", str(out))


def test_tells_what_it_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pzt_ros.cli.optimal.write", lambda found, out: None)
    text = run("case2", "--solver", "riccati", "--out", str(tmp_path), "--overwrite")
    assert "peak field 3.265" in text
    assert "end -0.607" in text


def test_every_shipped_problem_loads() -> None:
    assert {"case1", "case2", "history"} <= set(shipped_problems())
    for name in shipped_problems():
        problem = load_problem(name)
        assert isinstance(problem, Problem)
        assert problem.name == name
        assert problem.description


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"horizon": "4 V"}, r"horizon: '4 V' cannot be read as s"),
        ({"horizon": None}, "horizon"),
        ({"intervals": 3.5}, "no whole number"),
        ({"intervals": 1e9}, "outside"),
        ({"field_max": "-7 MV/m"}, "not below field_max"),
        ({"initial_field": "7 MV/m"}, "outside field_min to field_max"),
        ({"initial_phase_fraction": 1.5}, "outside"),
        ({"set_point": {"unit": "C/m^2", "values": [0, 1]}}, "2 values for 3 set_point_times"),
        ({"set_point_times": {"unit": "ms", "values": [0, 0, 1]}}, "do not increase"),
        ({"set_point": [1, 2, 3]}, "expected {unit"),
        ({"ceramic": None}, "ceramic"),
        ({"ceramic": "no-chain"}, "no such file"),
        ({"ceramic": "thesis-q1"}, "no parametrized ceramic"),
        ({"ceramic": {"link": "parametrized"}}, "is missing"),
        ({"wieght": 3}, "unknown parameter 'wieght'"),
        ({"name": "x"}, "unknown key 'name'"),
        ({"segments": [{"direction": "sideways", "until": "4 ms"}]}, "neither up nor down"),
        ({"segments": [{"direction": "up", "until": "3 ms"}]}, "the last segment ends"),
        ({"segments": [{"direction": "up", "until": "3 ms"}, {"direction": "up", "until": "4 ms"}]}, "alternate"),
        ({"segments": 3}, "expected a list"),
    ],
)
def test_a_bad_problem_is_one_line(change: dict[str, object], words: str) -> None:
    with pytest.raises(BenchError, match=words) as error:
        parse_problem({**CASE_1, **change}, "mine.yaml")
    assert "\n" not in str(error.value)


def test_no_problem_at_all_is_one_line(tmp_path: Path) -> None:
    for content in ("", "3", "- a", "problem: [", "\x00"):
        path = tmp_path / "mine.yaml"
        path.write_text(content, encoding="utf-8")
        with pytest.raises(BenchError) as error:
            load_problem(path)
        assert "\n" not in str(error.value)
    with pytest.raises(BenchError, match="shipped are case1, case2"):
        run("case9", "--out", str(tmp_path / "x"))
    with pytest.raises(BenchError, match="solver 'newton' is unknown"):
        run("case1", "--solver", "newton", "--out", str(tmp_path / "x"))
    assert not (tmp_path / "x").exists()
