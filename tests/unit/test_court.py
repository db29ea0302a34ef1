"""The court with the library's own diagnosis, on a few seconds of data: it runs, it resumes, it makes its page."""

from __future__ import annotations

from pathlib import Path

from pzt_benchmarks.residual_court import outcome as said
from pzt_benchmarks.residual_court.cases import Spec
from pzt_benchmarks.residual_court.court import hold, read_results
from pzt_benchmarks.residual_court.scoreboard import markdown
from pzt_benchmarks.residual_court.trial import Trial

SPEC = Spec("effect_right", "gaussian", ("mains_hum",), 10.0, "short", seed=22)


def test_a_small_court_is_held_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    told: list[str] = []
    results = tmp_path / "results.jsonl"
    trial = Trial(tmp_path / "cases")
    outcomes = hold([SPEC], trial, results, 1, lambda left, outcome: told.append(outcome.name))
    assert told == [SPEC.name] == [outcome.name for outcome in outcomes]
    assert outcomes[0].failure == ""
    assert outcomes[0].verdict == said.RIGHT
    assert max(outcomes[0].after) < 0.3 * max(outcomes[0].before)
    assert "| right effect alone, structure right, 1x |" in markdown(outcomes, "# Page")

    told.clear()
    again = hold([SPEC], trial, results, 1, lambda left, outcome: told.append(outcome.name))
    assert told == []
    assert again == outcomes == read_results(results)
