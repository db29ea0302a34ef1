"""`pzt bench`: its tables and verdicts, what it compares, its mistakes, and the pages written from it."""

from __future__ import annotations

import importlib.util
import json
import math
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from pzt_benchmarks import convergence, radau, speed
from pzt_benchmarks.__main__ import BENCHMARKS, run
from pzt_benchmarks.drives import NESTED_LEGS, blocks, ramps, sampled_ramps, turning_times
from pzt_benchmarks.first_call import KINDS
from pzt_benchmarks.links import link_of
from pzt_benchmarks.memory import MODELS, simulate_minutes
from pzt_benchmarks.report import Provenance, Report, provenance, read_report, with_part
from pzt_benchmarks.table import Figure, Table, Target, number
from pzt_ros.errors import BenchError
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.signals import Rest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def pages() -> ModuleType:
    """docs/make_performance.py"""
    spec = importlib.util.spec_from_file_location("make_performance", ROOT / "docs" / "make_performance.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("value", "target", "asked", "verdict"),
    [
        (3.0, Target(3.0), "≤ 3 s", "met"),
        (3.1, Target(3.0), "≤ 3 s", "**not met**"),
        (40.0, Target(40.0, True), "≥ 40 s", "met"),
        (math.nan, Target(40.0, True), "≥ 40 s", "**not met**"),
        (100.0, Target(150.0, aim=50.0), "≤ 150 s (aim ≤ 50)", "met, aim not reached"),
        (160.0, Target(150.0, aim=50.0), "≤ 150 s (aim ≤ 50)", "**not met**"),
        (1.1, Target(None, True, aim=1.0), "aim ≥ 1 s", "aim reached"),
        (0.9, Target(None, True, aim=1.0), "aim ≥ 1 s", "aim not reached"),
        (0.9, None, "", ""),
    ],
)
def test_verdicts(value: float, target: Target | None, asked: str, verdict: str) -> None:
    assert Figure("x", value, "s", target).row() == ("x", f"{number(value)} s", asked, verdict)


@pytest.mark.parametrize(("value", "text"), [(0.1234, "0.123"), (99.94, "99.9"), (1234.5, "1,234"), (1e-9, "1e-09")])
def test_numbers_have_three_digits(value: float, text: str) -> None:
    assert number(value) == text


def test_a_report_comes_back_from_its_file(tmp_path: Path) -> None:
    table = Table("title", ("a", "b"), [("1", "2"), ("3", "4")], "a note")
    report = Report(Provenance("pzt bench", "machine", "versions", "commit", "2026-01-01"), [table])
    report.write(tmp_path / "r.json")
    report.write(tmp_path / "r.md")
    assert read_report(tmp_path / "r.json").markdown() == report.markdown()
    page = (tmp_path / "r.md").read_text()
    assert "| a | b |\n| --- | --- |\n| 1 | 2 |\n| 3 | 4 |\n\na note" in page
    assert "2026-01-01, commit commit" in page


def test_provenance_names_machine_commit_and_day() -> None:
    found = provenance("pzt bench physics")
    assert all((found.command, found.machine, found.versions, found.commit, found.day))
    assert "cores" in found.machine
    assert "numba" in found.versions
    assert f"Load before: {found.load}." in found.line()


@pytest.mark.parametrize(
    ("names", "out", "message"),
    [
        (["phyics"], None, "known are ticks, measured, physics"),
        ([], "x.pdf", r"\.md or \.json"),
        ([], "x.md", "is a dir"),
    ],
)
def test_mistakes_are_one_line_before_anything_runs(
    tmp_path: Path, names: list[str], out: str | None, message: str
) -> None:
    (tmp_path / "x.md").mkdir()
    with pytest.raises(BenchError, match=message) as error:
        run(names, True, tmp_path / out if out else None, "pzt bench")
    assert "\n" not in str(error.value)


def test_every_benchmark_has_its_file() -> None:
    for module in BENCHMARKS.values():
        assert importlib.util.find_spec(f"pzt_benchmarks.{module}") is not None


def test_radau_solves_the_same_equations() -> None:
    """Our step and SciPy's, with SciPy's rates and with ours, agree on one short leg."""
    model, legs = Quadrature(), (0.0, 0.5)
    given = [
        radau.radau(model, rates(model), legs, 1e-5, 1e-8, True) for rates in (radau.scipy_rates, radau.compiled_rates)
    ]
    for at, fraction in given:
        assert at.size > 3
        np.testing.assert_allclose(fraction, radau.fine_fraction(legs, at), rtol=0, atol=1e-6)


def test_equal_error_takes_the_quickest_that_is_good_enough() -> None:
    runs = [radau.Run("a", 1.0, 1e-3), radau.Run("b", 2.0, 1e-5), radau.Run("c", 3.0, 1e-6), radau.Run("d", 2.5, 1e-7)]
    assert radau.quickest(runs, 1e-5) == runs[1]
    assert radau.quickest(runs, 5e-6) == runs[3]
    assert radau.quickest(runs, 1e-8) is None


def test_the_ratio_is_that_of_the_better_method() -> None:
    ours = {"a": [radau.Run("a", 2.0, 1e-6)], "b": [radau.Run("b", 1.0, 1e-6)], "c": [radau.Run("c", 0.1, 1e-3)]}
    assert radau.ratios(radau.Run("Radau", 10.0, 1e-5), ours) == (10.0, ["2000.00", "5", "1000.00", "10", "-", "-"])


def test_lattices_have_the_domains_they_are_named_after() -> None:
    lattice = speed.lattice_of(66_800)
    assert 66_800 <= lattice.init(Rest()).size - 3 < 70_000


def test_speed_counts_samples_and_domains() -> None:
    found = speed.speed("q", Quadrature(), sampled_ramps(1e7, samples=50), 20, repeats=1)
    assert found.domains == 256
    assert found.real_time == pytest.approx(1.0 / (20e3 * found.seconds))


def test_drives_turn_where_they_say() -> None:
    turns = turning_times(NESTED_LEGS, 1e7)
    np.testing.assert_allclose(ramps(NESTED_LEGS, 1e7, turns).voltage, 100.0 * np.array(NESTED_LEGS))
    signals = sampled_ramps(1e7, samples=1001)
    assert np.max(np.abs(np.diff(signals.voltage))) <= 1e7 / 20e3 * 1e-4 * (1 + 1e-9)
    pieces = list(blocks(signals, 100))
    assert [piece.time.size for piece in pieces] == [100] * 10 + [1]
    np.testing.assert_array_equal(np.concatenate([piece.voltage for piece in pieces]), signals.voltage)


def test_every_link_of_the_first_calls_is_there() -> None:
    assert [link_of(kind).kind for kind in KINDS] == list(KINDS)


@pytest.mark.parametrize("model", MODELS)
def test_long_runs_count_their_samples(model: str) -> None:
    found = simulate_minutes(model, 0.001)
    assert found["samples"] == 1200
    assert found["peak"] > 1e7


def test_grids_of_the_convergence_study_share_out_their_nodes() -> None:
    coercive, interaction = convergence.counted(Quadrature, 16).nodes()
    expected = Quadrature().nodes()  # the thesis' own
    np.testing.assert_array_equal(coercive, expected[0])
    np.testing.assert_array_equal(interaction, expected[1])
    for model in convergence.FINE:
        assert all(nodes[1].sum() == pytest.approx(1.0, abs=1e-12) for nodes in model.nodes())


def test_best_rule_is_read_from_the_points() -> None:
    def point(rule: str, grid: str, rms: float) -> convergence.Point:
        return convergence.Point(rule, grid, 1, rms, rms, 1.0)

    points = [
        point("a", "4 x 4", 1e-2),
        point("a", "8 x 8", 1e-3),
        point("b", "4 x 4", 5e-2),
        point("b", "8 x 8", 1e-4),
    ]
    assert convergence.best_up_to(points, "a") == "4 x 4"
    assert convergence.best_up_to(points, "b") == "none"


def test_performance_pages_are_what_was_measured(pages: ModuleType) -> None:
    report = read_report(pages.MEASURED)
    assert json.loads(pages.MEASURED.read_text(encoding="utf-8"))["commit"]
    assert pages.PAGE.read_text(encoding="utf-8") == report.markdown()
    readme = pages.README.read_text(encoding="utf-8")
    assert pages.BEGIN + pages.readme_part(report) + pages.END in readme
    assert with_part(readme, pages.BEGIN, pages.END, pages.readme_part(report)) == readme
    assert with_part(readme, pages.BEGIN, pages.END, "") != readme
