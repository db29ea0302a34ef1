"""The least point in a box: against SciPy's bounded least squares, and by the conditions that make it the least."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize

from pzt_ros.sysid.bounded_quadratic import bounded_minimum


@pytest.mark.parametrize("seed", range(12))
def test_bounded_minimum_same_as_bounded_least_squares(seed: int) -> None:
    """Correlated columns, some coordinates fixed, some without bounds."""
    random = np.random.default_rng(seed)
    n, p = 60, 25
    a = random.normal(size=(n, p)) + 3.0 * random.normal(size=(n, 1))
    b = random.normal(size=n)
    low, high = np.full(p, -0.05), random.uniform(0.0, 0.1, p)
    low[:5], high[5:10] = -np.inf, np.inf
    high[20] = low[20]
    found = bounded_minimum(a.T @ a, -a.T @ b, low, high)
    loose = high + 1e-12 * (high == low)
    expected = optimize.lsq_linear(a, b, (low, loose), method="bvls", tol=1e-14).x
    np.testing.assert_allclose(found, expected, atol=1e-8)
    assert np.all(found >= low)
    assert np.all(found <= high)


@pytest.mark.parametrize("seed", range(6))
def test_nearly_alike_columns(seed: int) -> None:
    """Smooth bumps side by side, weights that may not be negative: no force inside, none away from a bound."""
    random = np.random.default_rng(seed)
    x, p = np.linspace(0.0, 1.0, 900)[:, None], 120
    a = np.exp(-(((x - np.linspace(0.0, 1.0, p)) * 40.0) ** 2))
    a /= np.linalg.norm(a, axis=0)
    gram, gradient = a.T @ a + 1e-7 * np.eye(p), -a.T @ (np.sin(9.0 * x[:, 0]) + 0.1 * random.normal(size=900))
    low, high = np.zeros(p), np.where(np.arange(p) % 3 == 0, 0.3, np.inf)
    found = bounded_minimum(gram, gradient, low, high)
    force = gram @ found + gradient
    small = 1e-7 * np.max(np.abs(gradient))
    on_low, on_high = found == low, found == high
    assert np.count_nonzero(on_low) > 20
    assert np.count_nonzero(on_high) > 3
    assert np.all(force[on_low] >= -small)
    assert np.all(force[on_high] <= small)
    assert np.all(np.abs(force[~on_low & ~on_high]) <= small)
    assert np.all((low <= found) & (found <= high))


def test_nothing_to_choose() -> None:
    """No bound in the way is a plain solution; fixed coordinates stay; no force, no step."""
    gram, gradient = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([1.0, -1.0])
    free = np.full(2, np.inf)
    np.testing.assert_allclose(bounded_minimum(gram, gradient, -free, free), -np.linalg.solve(gram, gradient))
    np.testing.assert_array_equal(bounded_minimum(gram, gradient, np.zeros(2), np.zeros(2)), 0.0)
    np.testing.assert_array_equal(bounded_minimum(gram, np.zeros(2), np.zeros(2), free), 0.0)
    np.testing.assert_allclose(bounded_minimum(gram, gradient, np.array([0.0, -9.0]), np.array([0.0, 9.0])), [0.0, 1.0])


@pytest.mark.parametrize("seed", range(20))
def test_bounds_of_every_size(seed: int) -> None:
    """Rooms from 1e-9 to 1e9, some closed on one side, coordinates that nothing pulls: least, and without a warning."""
    random, p = np.random.default_rng(seed), 12
    a = random.normal(size=(40, p))
    gram = a.T @ a / 40.0
    gram[:3], gram[:, :3] = 0.0, 0.0
    gram[np.diag_indices(p)] += 1e-4
    gradient = random.normal(size=p) * 10.0 ** random.uniform(-4.0, 4.0)
    gradient[:3] = 0.0
    low, high = -(10.0 ** random.uniform(-9.0, 9.0, p)), 10.0 ** random.uniform(-9.0, 9.0, p)
    low[random.integers(p, size=2)], high[random.integers(p, size=2)] = 0.0, 0.0
    found = bounded_minimum(gram, gradient, low, high)
    force = gram @ found + gradient
    small = 1e-8 * (np.max(np.abs(gradient)) + np.abs(gram) @ np.abs(found))
    assert np.all((low <= found) & (found <= high))
    assert np.all((force >= -small) | (found == high))
    assert np.all((force <= small) | (found == low))


@pytest.mark.parametrize("room", [1e-310, 1e-200, 1e-30])
def test_next_to_no_room_is_none(room: float) -> None:
    """A coordinate a rounding away from its bound: a force over so little slack overflowed on a measured run."""
    gram = np.array([[1.0, 0.5], [0.5, 1.0]])
    found = bounded_minimum(gram, np.array([-1.0, -1.0]), np.array([-room, -1.0]), np.array([room, 1.0]))
    assert found[0] == pytest.approx(room)
    assert found[1] == pytest.approx(1.0 - 0.5 * room)
