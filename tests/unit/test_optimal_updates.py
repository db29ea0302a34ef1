"""The benchmark of updates counts what it says."""

from __future__ import annotations

import dataclasses

import numpy as np

from pzt_benchmarks.optimal_updates import LEVEL, ONCE, TWICE, Outcome, judge
from pzt_ros.optimal.problem import load_problem
from pzt_ros.optimal.sensitivity import sensitivity


def test_counts() -> None:
    outcome = Outcome([1e-4, 2e-3], told=[True, False, True, False], changed=[True, False, False, True])
    assert outcome.within == 0.5
    assert outcome.untold == 1
    assert outcome.row()[-3:] == ("2", "1 of 2", "1")


def test_judges_against_solving_anew() -> None:
    problem = dataclasses.replace(load_problem("case1"), intervals=20.0)
    updates = {"first": sensitivity(problem, 1), "second": sensitivity(problem, 2)}
    found = judge(problem, updates, LEVEL, 8)
    assert set(found) == {"first", "second", ONCE, TWICE}
    assert all(len(outcome.errors) == 8 for outcome in found.values())
    assert 1e-4 < np.median(found["first"].errors) < 0.2
    assert np.median(found[TWICE].errors) < 0.3 * np.median(found[ONCE].errors)
    assert not any(found["first"].changed)
