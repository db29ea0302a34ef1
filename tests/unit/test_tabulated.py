"""Updates of an optimal field from a table of solutions: against solving anew, also where the active set changes."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

from pzt_ros.optimal.problem import Problem, load_problem
from pzt_ros.optimal.structured import Structured
from pzt_ros.optimal.tabulated import Tabulated
from pzt_ros.physics.signals import Array

FREE = dataclasses.replace(load_problem("case1"), intervals=20.0)
TURNS = dataclasses.replace(load_problem("case2"), intervals=40.0, field_max=2.5e6)
PROBLEMS = {"free": FREE, "turns": TURNS}


@functools.cache
def of(name: str) -> Tabulated:
    return Tabulated(PROBLEMS[name], places=16)


def solved(problem: Problem, start: float, level: float) -> Array:
    """The optimal field where x+ has changed by `start` and the set-point by the share `level` [V/m]."""
    changed = dataclasses.replace(
        problem,
        initial_phase_fraction=Structured(problem).start + start,
        set_point=tuple(p * (1.0 + level) for p in problem.set_point),
    )
    structured = Structured(changed)
    structured.begin(0.5e6)
    assert structured.solve()[2]
    return structured.field.copy()


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_table_is_met_at_its_places(name: str) -> None:
    for first, second in ((0, 0), (16, -16), (-5, 3)):
        start, level = (n * d.reach / 16 for n, d in zip((first, second), of(name).directions, strict=True))
        np.testing.assert_allclose(
            of(name).update(start, level).field, solved(PROBLEMS[name], start, level), atol=100.0
        )


def test_between_its_places_the_error_is_below_a_thousandth_of_the_change() -> None:
    random = np.random.default_rng(5)
    for _ in range(40):
        start, level = random.uniform(-0.005, 0.005), random.uniform(-0.01, 0.01)
        exact, found = solved(FREE, start, level), of("free").update(start, level)
        assert found.same_active_set
        assert np.max(np.abs(found.field - exact)) < 1e-3 * np.max(np.abs(exact - of("free").field))


def test_every_change_of_the_active_set_is_told() -> None:
    random, told, truth = np.random.default_rng(6), [], []
    nominal = of("turns").field >= 2.5e6 - 1.0
    for _ in range(60):
        start, level = random.uniform(-0.005, 0.005), random.uniform(-0.01, 0.01)
        exact, found = solved(TURNS, start, level), of("turns").update(start, level)
        truth.append(not np.array_equal(exact >= 2.5e6 - 1.0, nominal))
        told.append(not found.same_active_set)
        assert np.max(found.field) <= 2.5e6
        assert np.max(np.abs(found.field - exact)) < 0.03 * np.max(np.abs(exact - of("turns").field))
    assert 5 < sum(truth) < 55
    assert all(t for t, changed in zip(told, truth, strict=True) if changed)
    assert sum(told) <= sum(truth) + 6, "and few alarms are false"


def test_beyond_the_table_it_is_its_edge_and_says_so() -> None:
    far, edge = of("free").update(0.1, 0.0), of("free").update(of("free").directions[0].reach, 0.0)
    assert not far.same_active_set
    np.testing.assert_allclose(far.field, edge.field)
