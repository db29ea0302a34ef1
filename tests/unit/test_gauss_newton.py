"""Bounded least squares, against SciPy's solvers and problems whose answer is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import optimize

from pzt_ros.errors import BenchError
from pzt_ros.sysid.gauss_newton import solve

FREE = (np.full(2, -np.inf), np.full(2, np.inf))


class Rosenbrock:
    """Two runs of one sample each; minimum 0 at (1, 1)."""

    def residuals(self, vector: np.ndarray) -> list[np.ndarray]:
        x, y = vector
        return [np.array([10.0 * (y - x * x)]), np.array([1.0 - x])]

    def linearise(self, vector: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        jacobians = [np.array([[-20.0 * vector[0], 10.0]]), np.array([[-1.0, 0.0]])]
        return self.residuals(vector), jacobians


@dataclass
class Decay:
    """log tau, amplitude, offset of an exponential on unevenly sampled runs; refuses tau below 0.05."""

    times: list[np.ndarray]
    data: list[np.ndarray]
    dtype: type = np.float64

    def residuals(self, vector: np.ndarray) -> list[np.ndarray]:
        if vector[0] < math.log(0.05):
            raise BenchError("too fast")
        fall = [np.exp(-t / math.exp(vector[0])) for t in self.times]
        return [vector[1] * f + vector[2] - d for f, d in zip(fall, self.data, strict=True)]

    def linearise(self, vector: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        tau = math.exp(vector[0])
        jacobians = [
            np.stack([vector[1] * np.exp(-t / tau) * t / tau, np.exp(-t / tau), np.ones_like(t)], axis=1)
            for t in self.times
        ]
        return self.residuals(vector), [j.astype(self.dtype) for j in jacobians]


@pytest.fixture
def decay() -> Decay:
    random = np.random.default_rng(5)
    times = [np.sort(random.uniform(0, 3, 9000)), np.sort(random.uniform(0, 1, 40))]
    return Decay(times, [2.0 * np.exp(-t / 0.3) + 0.1 + 0.01 * random.normal(size=t.size) for t in times])


def test_valley_is_followed_to_its_end() -> None:
    found = solve(Rosenbrock(), np.array([-1.2, 1.0]), *FREE, most_steps=60, tolerance=1e-14)
    np.testing.assert_allclose(found.vector, 1.0, atol=1e-7)
    assert found.cost < 1e-14


def test_bound_is_kept_and_the_rest_optimal() -> None:
    upper = np.array([0.5, np.inf])
    found = solve(Rosenbrock(), np.array([-1.2, 1.0]), FREE[0], upper, most_steps=60, tolerance=1e-14)
    np.testing.assert_allclose(found.vector, [0.5, 0.25], atol=1e-7)
    assert found.converged


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_same_as_scipy(decay: Decay, dtype: type) -> None:
    decay.dtype = dtype
    low, high = np.full(3, -10.0), np.full(3, 10.0)
    other = optimize.least_squares(lambda v: np.concatenate(decay.residuals(v)), [0.0, 1.0, 0.0], xtol=1e-13)
    found = solve(decay, np.array([0.0, 1.0, 0.0]), low, high, most_steps=50, tolerance=1e-12)
    np.testing.assert_allclose(found.vector, other.x, atol=1e-5)
    assert found.cost == pytest.approx(2 * other.cost, rel=1e-9)
    np.testing.assert_array_equal(np.concatenate(found.residuals), np.concatenate(decay.residuals(found.vector)))


def test_prior_is_weighed_like_samples(decay: Decay) -> None:
    rows, targets = np.array([[0.0, 300.0, 0.0]]), np.array([300.0 * 1.9])
    low, high = np.full(3, -10.0), np.full(3, 10.0)
    stacked = lambda v: np.concatenate([*decay.residuals(v), rows @ v - targets])
    other = optimize.least_squares(stacked, [0.0, 1.0, 0.0], xtol=1e-13)
    found = solve(decay, np.array([0.0, 1.0, 0.0]), low, high, most_steps=50, tolerance=1e-12, prior=(rows, targets))
    np.testing.assert_allclose(found.vector, other.x, atol=1e-5)
    assert 1.9 < found.vector[1] < 2.0


def test_start_beyond_a_bound_and_refused_steps(decay: Decay) -> None:
    low, high = np.array([-9.0, 0.0, -1.0]), np.array([3.0, 9.0, 1.0])
    told: list[float] = []
    found = solve(
        decay,
        np.array([5.0, -4.0, 0.0]),
        low,
        high,
        most_steps=80,
        tolerance=1e-10,
        progress=lambda step, cost: told.append(cost),
    )
    assert math.exp(found.vector[0]) == pytest.approx(0.3, rel=0.01)
    assert told == sorted(told, reverse=True)
    assert len(told) >= found.steps


def test_ends_after_so_many_steps() -> None:
    found = solve(Rosenbrock(), np.array([-1.2, 1.0]), *FREE, most_steps=2, tolerance=1e-14)
    assert found.steps == 2
    assert not found.converged
    np.testing.assert_array_equal(found.residuals[0], Rosenbrock().residuals(found.vector)[0])


def test_no_jacobian_is_made_for_nothing(decay: Decay, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[np.ndarray] = []
    linearise = decay.linearise
    monkeypatch.setattr(decay, "linearise", lambda vector: asked.append(vector) or linearise(vector))
    there = solve(decay, np.zeros(3), *(np.full(3, b) for b in (-9.0, 9.0)), most_steps=0, tolerance=1e-6)
    assert (there.steps, asked) == (0, [])
    found = solve(decay, np.zeros(3), *(np.full(3, b) for b in (-9.0, 9.0)), most_steps=3, tolerance=1e-6)
    assert (found.steps, len(asked)) == (3, 3)


def test_refused_start_is_said(decay: Decay) -> None:
    decay.data[0][7] = np.nan
    with pytest.raises(BenchError, match="not finite where the fit starts"):
        solve(decay, np.zeros(3), np.full(3, -9.0), np.full(3, 9.0), most_steps=5, tolerance=1e-6)
