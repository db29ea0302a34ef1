"""Updates of an optimal field: against solving anew."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
import pytest

from pzt_ros.optimal.problem import Problem, load_problem
from pzt_ros.optimal.sensitivity import Sensitivity, sensitivity
from pzt_ros.optimal.structured import Structured
from pzt_ros.physics.signals import Array

FREE = dataclasses.replace(load_problem("case1"), intervals=40.0)
BOUND = dataclasses.replace(FREE, field_max=2.5e6)
STARTED = dataclasses.replace(FREE, initial_field=0.0, slew_rate=2e10)
PROBLEMS = {"free": FREE, "bound": BOUND, "started": STARTED}


@functools.cache
def of(name: str, order: int) -> Sensitivity:
    return sensitivity(PROBLEMS[name], order)


def solved(problem: Problem, parameters: Array, names: tuple[str, ...]) -> Array:
    """The optimal field for other parameters, by the structured solver [V/m]."""
    changes: dict[str, Any] = {"initial_phase_fraction": float(parameters[0])}
    if "E0" in names:
        changes["initial_field"] = float(parameters[1])
    corners = len(problem.set_point)
    structured = Structured(dataclasses.replace(problem, set_point=tuple(parameters[-corners:].tolist()), **changes))
    structured.begin(0.0)
    _, _, converged = structured.solve()
    assert converged
    return structured.field.copy()


@pytest.mark.parametrize("name", PROBLEMS)
def test_first_order_is_the_derivative_of_the_solution(name: str) -> None:
    update = of(name, 1)
    for k, parameter in enumerate(update.space.names):
        nudge = 1e-5 * update.space.sizes[k]
        up, down = (update.nominal + sign * nudge * np.eye(update.nominal.size)[k] for sign in (1.0, -1.0))
        derivative = (
            solved(PROBLEMS[name], up, update.space.names) - solved(PROBLEMS[name], down, update.space.names)
        ) / 2
        ours = update.update(up).field - update.field
        np.testing.assert_allclose(ours, derivative, atol=0.005 * np.max(np.abs(derivative)), err_msg=parameter)


def test_errors_shrink_with_the_order_of_the_update() -> None:
    """First order: four times when the change is halved; second order: eight times."""
    errors: dict[int, list[float]] = {1: [], 2: []}
    for share in (0.02, 0.01):
        parameters = of("free", 1).nominal * np.array([1.0, 1.0, 1.0 + share, 1.0 + share])
        exact = solved(FREE, parameters, of("free", 1).space.names)
        for order, found in errors.items():
            found.append(float(np.max(np.abs(of("free", order).update(parameters).field - exact))))
    assert 3.0 < errors[1][0] / errors[1][1] < 5.5
    assert errors[2][0] / errors[2][1] > 5.5
    assert errors[2][0] < 0.2 * errors[1][0]


def test_a_change_of_the_active_set_is_told() -> None:
    update = of("bound", 2)
    assert update.active.bounds.size >= 2
    told, truth = [], []
    held = np.flatnonzero(update.field >= 2.5e6 - 1.0)
    for level in np.linspace(0.85, 1.15, 31):
        parameters = update.nominal * np.array([1.0, level, level, level])
        exact = solved(BOUND, parameters, update.space.names)
        truth.append(not np.array_equal(np.flatnonzero(exact >= 2.5e6 - 1.0), held))
        found = update.update(parameters)
        told.append(not found.same_active_set)
        assert np.all(np.isfinite(found.field))
        assert np.max(found.field) <= 2.5e6 + 1.0
    assert any(truth)
    assert not all(truth)
    assert all(t for t, changed in zip(told, truth, strict=True) if changed), "no change goes untold"
    assert sum(told) <= sum(truth) + 6, "and few alarms are false"
    assert not told[15], "the solution itself is no change"


def test_an_update_keeps_the_window_and_the_nominal_field() -> None:
    update = of("bound", 2)
    np.testing.assert_allclose(update.update(update.nominal).field, update.field, rtol=1e-12)
    far = update.update(update.nominal * np.array([1.1, 1.0, 1.3, 1.3]))
    assert not far.same_active_set
    assert np.max(far.field) <= 2.5e6
    assert np.min(far.field) >= -6e6
