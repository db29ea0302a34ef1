"""The broken line of learning control, against closed forms and NumPy's own least squares."""

from __future__ import annotations

import numpy as np
import pytest

from pzt_ros.controllers.broken_line import corners, line_through

SIZE = 200
PHASE = np.arange(SIZE) / SIZE
TRIANGLE = 1.0 - np.abs(1.0 - 2.0 * PHASE)


@pytest.mark.parametrize("shift", [0, 1, 37, 150])
def test_corners_are_close_together_behind_the_turns(shift: int) -> None:
    reference = np.roll(TRIANGLE, shift)
    at = corners(reference, 1.0, 20.0)
    for turn in (np.argmin(reference), np.argmax(reference)):
        behind = np.sort((at - turn) % SIZE)[:4]
        np.testing.assert_array_equal(behind, [0, 1, 2, 5])  # 0, 1, 2.5, 4.75: 1, 1.5, 2.25 ... apart
    assert np.max(np.diff(at)) <= 30
    assert np.all(np.diff(at) > 0)


def test_noise_on_the_reference_makes_no_turns() -> None:
    noise = 2e-3 * np.random.default_rng(0).normal(size=SIZE)
    assert abs(corners(TRIANGLE + noise, 1.0, 20.0).size - corners(TRIANGLE, 1.0, 20.0).size) <= 1


def test_a_reference_of_many_turns_has_even_corners() -> None:
    at = corners(np.random.default_rng(0).normal(size=SIZE), 1.0, 20.0)
    np.testing.assert_array_equal(np.unique(np.diff(at)), 20)


def test_a_broken_line_is_met_exactly() -> None:
    at = np.array([3, 50, 60, 170])
    heights = np.array([1.0, -2.0, 4.0, 0.5])
    line = np.interp(np.arange(SIZE), [*(at - SIZE), *at, *(at + SIZE)], np.tile(heights, 3))
    np.testing.assert_allclose(line_through(line, at), line, atol=1e-12)


def test_it_is_the_line_of_least_squares() -> None:
    at = np.array([0, 20, 90, 91, 140])
    hats = np.stack([line_through(np.interp(np.arange(SIZE), [*at, SIZE], [*row, row[0]]), at) for row in np.eye(5)])
    values = np.random.default_rng(1).normal(size=SIZE)
    best, *_ = np.linalg.lstsq(hats.T, values, rcond=None)
    np.testing.assert_allclose(line_through(values, at), best @ hats, atol=1e-12)


def test_one_corner_is_the_mean() -> None:
    np.testing.assert_allclose(line_through(TRIANGLE, np.array([7])), TRIANGLE.mean())
