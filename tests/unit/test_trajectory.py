"""Trajectories: the path through the points, how one replaces another, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from pzt_ros.errors import BenchError
from pzt_ros.experiments.trajectory import Path, Trajectory, joined

NONE = float("nan")
HOLD = Path.held(10.0, 3e-6)
"""What is followed when a trajectory comes at 12 s."""
NOW = 12.0


def asked(*points: tuple[float, ...], start: float = 0.0, joints: tuple[str, ...] = ("x",)) -> Trajectory:
    """A trajectory of points (time, position) or (time, position, velocity)."""
    rows = np.array([(*point, NONE)[:3] for point in points]).reshape(-1, 3)
    return Trajectory(joints, start, rows[:, 0], rows[:, 1], rows[:, 2])


def into(trajectory: Trajectory, path: Path = HOLD, now: float = NOW) -> Path:
    return joined(trajectory, "x", path, now)


def test_positions_alone_are_joined_by_straight_lines_from_the_present_reference() -> None:
    path = into(asked((0.5, 5e-6), (0.7, 4e-6), (2.0, 8e-6)))
    time = np.linspace(11.0, 16.0, 1001)
    expected = np.interp(time, [12.0, 12.5, 12.7, 14.0], [3e-6, 5e-6, 4e-6, 8e-6])
    np.testing.assert_allclose(path.value(time), expected, rtol=0, atol=1e-18)


def test_positions_with_velocities_are_joined_by_cubics() -> None:
    path = into(asked((0.5, 5e-6, 2e-6), (0.7, 4e-6, -1e-6), (2.0, 8e-6, 0.0)))
    time = np.linspace(12.0, 14.0, 1001)
    knots, places, slopes = [12.0, 12.5, 12.7, 14.0], [3e-6, 5e-6, 4e-6, 8e-6], [0.0, 2e-6, -1e-6, 0.0]
    np.testing.assert_allclose(path.value(time), CubicHermiteSpline(knots, places, slopes)(time), rtol=0, atol=1e-17)
    assert path.value(np.array([15.0]))[0] == 8e-6, "held after the last point"


def test_a_segment_is_a_cubic_only_if_both_its_points_have_a_velocity() -> None:
    path = into(asked((1.0, 5e-6, 1e-6), (2.0, 6e-6), (3.0, 4e-6)))
    first, after = np.linspace(12.0, 13.0, 101), np.linspace(13.0, 15.0, 101)
    cubic = CubicHermiteSpline([12.0, 13.0], [3e-6, 5e-6], [0.0, 1e-6])
    np.testing.assert_allclose(path.value(first), cubic(first), rtol=0, atol=1e-17)
    np.testing.assert_allclose(
        path.value(after), np.interp(after, [13, 14, 15], [5e-6, 6e-6, 4e-6]), rtol=0, atol=1e-17
    )


@pytest.mark.parametrize("velocity", [(), (0.0,)])
def test_a_new_trajectory_replaces_the_present_one_where_it_is(velocity: tuple[float, ...]) -> None:
    first = into(asked((4.0, 11e-6)))  # 2 um/s from 3 um on
    second = into(asked((1.0, 0.0, *velocity)), first, 13.0)
    assert second.value(np.array([13.0]))[0] == pytest.approx(5e-6, abs=1e-17)
    assert second.value(np.array([14.0, 20.0])).tolist() == [0.0, 0.0]
    step = 1e-6
    slope = float(np.diff(second.value(np.array([13.0, 13.0 + step])))[0]) / step
    assert slope == pytest.approx(2e-6 if velocity else -5e-6, rel=1e-4), "a cubic goes on as fast as it was"


def test_a_trajectory_for_later_lets_the_present_one_go_on_until_then() -> None:
    first = into(asked((4.0, 11e-6)))
    second = into(asked((1.0, 0.0), start=14.0), first, 13.0)
    time = np.array([13.0, 13.5, 14.0, 14.5, 15.0])
    np.testing.assert_allclose(second.value(time), [5e-6, 6e-6, 7e-6, 3.5e-6, 0.0], rtol=0, atol=1e-17)
    third = into(asked((1.0, 1e-6), start=13.8), second, 13.5)
    time = np.array([13.6, 13.8, 14.3, 14.8])
    expected = [6.2e-6, 6.6e-6, 3.8e-6, 1e-6]
    np.testing.assert_allclose(third.value(time), expected, rtol=0, atol=1e-17, err_msg="the one that waited is gone")
    assert third.before is not None
    assert third.before.before is None, "no chain of old trajectories"


def test_of_a_trajectory_that_has_begun_the_rest_is_followed() -> None:
    path = into(asked((1.0, 9e-6), (4.0, 6e-6), (6.0, 5e-6), start=10.0))
    time = np.array([12.0, 13.0, 14.0, 16.0])
    np.testing.assert_allclose(path.value(time), [3e-6, 4.5e-6, 6e-6, 5e-6], rtol=0, atol=1e-17)


def test_a_point_for_now_is_where_it_begins() -> None:
    path = into(asked((0.0, 4e-6), (1.0, 6e-6)))
    np.testing.assert_allclose(path.value(np.array([12.0, 12.5])), [4e-6, 5e-6], rtol=0, atol=1e-17)


def test_no_points_ask_for_a_stop() -> None:
    path = into(asked(), into(asked((4.0, 11e-6))), 13.0)
    np.testing.assert_allclose(path.value(np.array([13.0, 20.0])), 5e-6, rtol=0, atol=1e-17)


@pytest.mark.parametrize(
    ("trajectory", "expected"),
    [
        (asked((1.0, 0.0), joints=("y",)), "joint_names are ['y'], expected ['x']"),
        (asked((1.0, 0.0), joints=("x", "y")), "joint_names are ['x', 'y'], expected ['x']"),
        (asked((1.0, 0.0), joints=()), "joint_names are [], expected ['x']"),
        (asked((1.0, 0.0), (2.0, NONE)), "the position of point 2 is nan m"),
        (asked((1.0, float("inf"))), "the position of point 1 is inf m"),
        (asked((NONE, 0.0)), "the time_from_start of point 1 is nan s"),
        (asked((1.0, 0.0, float("inf"))), "the velocity of point 1 is inf m/s"),
        (asked((1.0, 12.0)), "the position of point 1 is 12 m; give a finite number of at most 1 m, in SI units"),
        (asked((1.0, 0.0, 1e300), (2.0, 0.0)), "the velocity of point 1 is 1e+300 m/s"),
        (asked((1e300, 0.0)), "the time_from_start of point 1 is 1e+300 s"),
        (asked((1.0, 0.0), (1.0, 1e-6)), "time_from_start of point 2 is 1 s; times begin"),
        (asked((1.0, 0.0), (0.5, 1e-6)), "time_from_start of point 2 is 0.5 s; times begin"),
        (asked((-1.0, 0.0), (0.5, 1e-6)), "time_from_start of point 1 is -1 s; times begin"),
        (asked((1.0, 0.0, 1e-6)), "the last point has a velocity of 1e-06 m/s"),
        (asked((1.0, 0.0), start=10.0), "it is over at 11.000 s of the run's own time, and it is 12.000 s now"),
        (asked((1.0, 0.0), start=1.7e9), "it begins at 1700000000.000 s of the run's own time"),
    ],
)
def test_what_is_malformed_is_refused(trajectory: Trajectory, expected: str) -> None:
    with pytest.raises(BenchError) as caught:
        into(trajectory)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)
