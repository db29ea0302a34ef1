"""Optimal control problems and their solvers: against the thesis, against one another, and against the ceramic."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy import special

from pzt_ros.errors import BenchError
from pzt_ros.optimal import expressions
from pzt_ros.optimal.interval import STAGE
from pzt_ros.optimal.inverse import inverse_field
from pzt_ros.optimal.inverse_erfc import place
from pzt_ros.optimal.law import rate
from pzt_ros.optimal.memory import law_without_history, material_of
from pzt_ros.optimal.problem import Problem, load_problem
from pzt_ros.optimal.radau import STAGES
from pzt_ros.optimal.solution import Solution, simulate
from pzt_ros.optimal.solve import solve
from pzt_ros.optimal.structured import Structured
from pzt_ros.optimal.transcription import FIELD_SCALE, collocation
from pzt_ros.physics import parametrized_single_branch as branch
from pzt_ros.physics.parametrized_single import ParametrizedSingle

CASE_1, CASE_2 = load_problem("case1"), load_problem("case2")

LIMITS: dict[str, dict[str, float]] = {
    "3.0 MV/m": {"field_max": 3.0e6},
    "2.5 MV/m": {"field_max": 2.5e6},
    "2.2 MV/m": {"field_max": 2.2e6},
    "slew": {"slew_rate": 8e9, "initial_field": 0.0},
    "current": {"current": 0.8},
    "all of them, and weights": {
        "current": 0.8, "field_max": 2.5e6, "slew_rate": 8e9, "initial_field": 0.0, "rate_weight": 1e-26,
        "end_weight": 1e-3,
    },
}  # fmt: skip


UNIQUE = ("3.0 MV/m", "2.5 MV/m", "2.2 MV/m", "current")
"""Limits under which the optimum is one; with a slew limit there are several, less than 1 % apart."""


@functools.cache
def solved(problem: str, solver: str, **changes: float) -> Solution:
    return solve(dataclasses.replace(load_problem(problem), **changes), solver)


def limited(problem: str, solver: str, limits: str) -> Solution:
    return solved(problem, solver, intervals=40.0, **LIMITS[limits])


# The rates


def test_place_is_the_inverse_of_erfc() -> None:
    y = np.concatenate([np.logspace(-15, -1, 200), np.linspace(0.1, 1.9, 200), 2.0 - np.logspace(-14, -1, 50)])
    found = np.array([place(value) for value in y])
    np.testing.assert_allclose(found, -special.erfcinv(y), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("distribution", ["coercive_without_history", "interaction"])
def test_rates_are_those_of_the_ceramic(distribution: str) -> None:
    problem = dataclasses.replace(CASE_1, ceramic=ParametrizedSingle(distribution=distribution))
    m, law = problem.ceramic.material, law_without_history(problem.ceramic)
    x, field = (axis.ravel() for axis in np.meshgrid(np.linspace(0.02, 0.98, 25), np.linspace(-2e6, 2e6, 41)))
    ours = rate(np.array(law), material_of(problem), x, field)
    theirs = [
        branch.evaluate(m, branch.position(m, share, 1.0 - share), e, 0.0)[2] for share, e in zip(x, field, strict=True)
    ]
    np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-9 / m.relaxation_time)
    f = expressions.switching(material_of(problem))
    casadi = [float(f(a, e, np.array(law))) for a, e in zip(x, field, strict=True)]
    # erfinv of CasADi is that good
    np.testing.assert_allclose(casadi, theirs, rtol=3e-5, atol=3e-6 * float(np.max(np.abs(theirs))))


# The thesis' two cases


@pytest.mark.parametrize("solver", ["collocation", "shooting", "riccati", "simulation"])
def test_case_1_is_the_thesis(solver: str) -> None:
    found = solved("case1", solver)
    assert found.converged
    assert np.max(found.field) == pytest.approx(3.325e6, abs=0.01e6)
    assert found.field[-1] == pytest.approx(1.922e6, abs=0.005e6)
    assert found.phase_fraction[0] == 0.5
    assert found.phase_fraction[-1] == pytest.approx(0.829, abs=0.001)
    assert np.all(np.diff(found.phase_fraction) > -1e-9), "the phase fraction increases monotonously"


@pytest.mark.parametrize("solver", ["collocation", "riccati"])
def test_case_2_needs_a_positive_field_first_and_a_negative_one_at_last(solver: str) -> None:
    found = solved("case2", solver)
    first = (found.problem.grid > 0.2e-3) & (found.problem.grid < 1.3e-3)
    last = found.problem.grid > 2.9e-3
    assert np.all(found.field[first] > 1e6)
    assert np.all(found.field[last] < -0.5e6)
    np.testing.assert_allclose(found.polarization[first], 0.1, atol=2e-3)
    np.testing.assert_allclose(found.polarization[last], 0.1, atol=2e-3)


@pytest.mark.parametrize(("case", "solver"), [("case1", "shooting"), ("case2", "collocation"), ("case2", "riccati")])
def test_the_ceramic_itself_does_what_the_solver_says(case: str, solver: str) -> None:
    found = solved(case, solver)
    assert found.model_error < 1e-3
    assert found.simulated.cost == pytest.approx(found.cost, rel=0.2)


# The structured solver against IPOPT, on the same programme


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("case", ["case1", "case2"])
def test_structured_solver_finds_the_optimum_of_ipopt(case: str, limits: str) -> None:
    ours, theirs = limited(case, "riccati", limits), limited(case, "collocation", limits)
    assert ours.converged
    assert theirs.converged
    if limits in UNIQUE:
        assert ours.cost == pytest.approx(theirs.cost, rel=2e-4)
        np.testing.assert_allclose(ours.field, theirs.field, atol=5e3)
    assert ours.cost == pytest.approx(theirs.cost, rel=0.01)


@pytest.mark.parametrize("limits", ["2.5 MV/m", "slew", "all of them, and weights"])
@pytest.mark.parametrize("case", [CASE_1, CASE_2], ids=["case1", "case2"])
def test_structured_solution_meets_the_optimality_conditions(case: Problem, limits: str) -> None:
    """The gradient is a sum of those of what holds, with multipliers of the right signs (Karush, Kuhn, Tucker)."""
    problem = dataclasses.replace(case, **LIMITS[limits])
    structured = Structured(problem)
    structured.begin(1.5e6)
    structured.solve()
    programme = collocation(problem)
    z = np.concatenate([structured.field / FIELD_SCALE, structured.plan[:-1, STAGE : STAGE + STAGES].ravel()])
    f, g = programme.cost, programme.constraints
    evaluate = ca.Function(
        "all", [programme.z, programme.p], [ca.gradient(f, programme.z), g, ca.jacobian(g, programme.z)]
    )
    gradient, values, rows = (np.array(part) for part in evaluate(z, programme.parameters))
    every = np.concatenate([values.ravel(), z])
    low, high = np.concatenate([programme.g_low, programme.z_low]), np.concatenate([programme.g_high, programme.z_high])
    at_low, at_high = every - low < 1e-6, high - every < 1e-6
    held = at_low | at_high
    normals = np.vstack([rows, np.eye(z.size)])[held]
    multipliers, *_ = np.linalg.lstsq(normals.T, -gradient.ravel(), rcond=None)
    residual = gradient.ravel() + normals.T @ multipliers
    assert np.max(np.abs(residual)) < 1e-5 * np.max(np.abs(gradient))
    sides = 1.0 * at_high[held] - at_low[held]
    assert np.count_nonzero(sides) >= 5, "limits hold, or this tests nothing"
    assert np.all(multipliers[sides > 0] > -1e-6)
    assert np.all(multipliers[sides < 0] < 1e-6)


@pytest.mark.parametrize("limits", LIMITS)
def test_limits_are_kept(limits: str) -> None:
    found = limited("case1", "riccati", limits)
    problem = found.problem
    assert np.min(found.field) >= problem.field_min
    assert np.max(found.field) <= problem.field_max
    assert np.max(np.abs(np.diff(found.field))) <= problem.field_step * (1.0 + 1e-12)
    assert np.max(np.abs(np.diff(found.polarization))) <= problem.charge_step * (1.0 + 1e-6)
    if not math.isnan(problem.initial_field):
        assert found.field[0] == problem.initial_field


def test_an_active_limit_costs_less_than_the_clipped_inverse() -> None:
    for limits in ("2.5 MV/m", "2.2 MV/m"):
        found = limited("case1", "riccati", limits)
        clipped = simulate(found.problem, inverse_field(found.problem)).cost
        assert found.simulated.cost < 0.8 * clipped


def test_without_a_limit_the_inverse_misses_only_between_the_points_of_the_grid() -> None:
    costs = []
    for intervals in (80.0, 320.0, 1280.0):
        problem = dataclasses.replace(CASE_1, intervals=intervals)
        costs.append(simulate(problem, inverse_field(problem)).cost)
    assert costs[1] < costs[0] / 10
    assert costs[2] < costs[1] / 10
    assert costs[2] < 1e-13  # 2e-9 of (0.2 C/m^2)^2 times 4 ms


def test_random_problems_stay_finite_and_inside_their_limits() -> None:
    rng = np.random.default_rng(5)
    for _ in range(60):
        low, high = sorted(rng.uniform(-4e6, 4e6, 2))
        first = float(rng.uniform(low, high))
        problem = dataclasses.replace(
            CASE_1,
            intervals=20.0,
            set_point=tuple(rng.uniform(-0.3, 0.3, 3)),
            initial_phase_fraction=float(rng.uniform(0.05, 0.95)),
            field_min=float(low),
            field_max=float(high),
            slew_rate=float(10 ** rng.uniform(8.5, 10.5)),
            initial_field=first,
        )
        structured = Structured(problem)
        structured.begin(first)
        cost, _, _ = structured.solve()
        assert math.isfinite(cost)
        for _ in range(3):
            structured.iterate(float(rng.uniform(0.05, 0.95)))
            field = structured.field
            assert np.all(np.isfinite(structured.plan))
            assert np.min(field) >= low
            assert np.max(field) <= high
            assert np.max(np.abs(np.diff(field))) <= problem.field_step * (1.0 + 1e-12)


@pytest.mark.parametrize("limits", ["3.0 MV/m", "2.5 MV/m"])
def test_one_real_time_iteration_nearly_solves_a_problem_that_has_changed_a_little(limits: str) -> None:
    problem = dataclasses.replace(CASE_1, **LIMITS[limits])
    changed = Structured(dataclasses.replace(problem, initial_phase_fraction=0.5001))
    changed.begin(1.5e6)
    changed.solve()
    structured = Structured(problem)
    structured.begin(1.5e6)
    structured.solve()
    before = np.max(np.abs(structured.field - changed.field))
    structured.iterate(0.5001)
    once = np.max(np.abs(structured.field - changed.field))
    structured.iterate(0.5001)
    assert once < 0.02 * before
    assert np.max(np.abs(structured.field - changed.field)) < max(0.1 * once, 20.0)


@pytest.mark.parametrize("broken", [math.nan, math.inf, -1e9])
def test_an_iteration_that_fails_leaves_the_previous_plan(broken: float) -> None:
    structured = Structured(CASE_1)
    structured.begin(1.5e6)
    structured.solve()
    before = structured.field.copy()
    assert structured.iterate(broken) == math.inf
    np.testing.assert_array_equal(structured.field, before)
    structured.ask(np.full((CASE_1.steps, 3), math.nan))
    assert structured.iterate(0.5) == math.inf
    np.testing.assert_array_equal(structured.field, before)
    structured.ask(CASE_1.set_point_at(CASE_1.stage_times))
    assert structured.iterate(0.5) < 1e-10


# Ceramics with history


def test_fixed_and_free_sequence_of_reversals_agree() -> None:
    fixed, free = solved("history", "collocation"), solved("history", "simulation")
    assert fixed.converged
    assert free.converged
    assert fixed.simulated.cost == pytest.approx(free.cost, rel=0.01)
    assert fixed.cost == pytest.approx(free.cost, rel=0.01)
    np.testing.assert_allclose(fixed.phase_fraction, free.phase_fraction, atol=2e-3)
    assert fixed.model_error < 2e-3, "the branches of the transcription are those of the ceramic"


@pytest.mark.parametrize("solver", ["collocation", "simulation"])
def test_both_limits_hold_with_history(solver: str) -> None:
    found = solved("history", solver)
    assert np.max(found.field) == pytest.approx(0.7e6, rel=1e-6)
    assert np.min(found.field) == pytest.approx(-0.02e6, rel=1e-6)
    clipped = simulate(found.problem, inverse_field(found.problem))
    assert found.simulated.cost < 0.8 * clipped.cost


def test_slew_and_current_hold_through_the_ceramic_itself() -> None:
    ours, theirs = (
        solved("case1", solver, intervals=20.0, current=0.5, **LIMITS["slew"])
        for solver in ("simulation", "collocation")
    )
    assert ours.converged
    assert ours.cost == pytest.approx(theirs.cost, rel=0.05), "the grid is coarse, and only one of them sees that"
    assert np.max(np.abs(np.diff(ours.polarization))) <= ours.problem.charge_step * (1 + 1e-3)


# What cannot be solved


@pytest.mark.parametrize(
    ("solver", "changes", "words"),
    [
        ("riccati", {}, "without history"),
        ("shooting", {}, "unstable"),
        ("collocation", {"segments": None}, "segments"),
        ("collocation", {"initial_phase_fraction": 0.3}, "initial_phase_fraction"),
        ("newton", {}, "known are auto"),
    ],
)
def test_a_solver_says_what_it_cannot_solve(solver: str, changes: dict[str, Any], words: str) -> None:
    problem: Problem = dataclasses.replace(load_problem("history"), **changes)
    with pytest.raises(BenchError, match=words) as error:
        solve(problem, solver)
    assert "\n" not in str(error.value)
