"""What an operator asks for while a run goes on: positions at times, and the path through them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array

MOST_AHEAD = 3600.0
"""A trajectory may begin so long after now [s]; a stamp further ahead is of another clock."""

LARGEST = {"time_from_start": (1e6, "s"), "position": (1.0, "m"), "velocity": (1e3, "m/s")}
"""No stage goes further, or faster, or takes longer; a larger number is a mistake of units, or none at all."""


@dataclass(frozen=True)
class Trajectory:
    """Positions and, where they are given, velocities of one axis at times.

    Attributes:
        joints: names of the axes it is meant for.
        start: when it begins, in the run's own time [s]; 0 for now.
        time: of the points after `start` [s, shape (n,)]; no points ask for a stop.
        position: [m, shape (n,)].
        velocity: [m/s, shape (n,)]; NaN at a point that has none.
    """

    joints: tuple[str, ...]
    start: float
    time: Array
    position: Array
    velocity: Array


@dataclass(frozen=True)
class Path:
    """A position as a function of the run's own time: through knots, then held.

    Between two knots with a velocity it is a cubic, between others a straight line.

    Attributes:
        time: of the knots [s, shape (n,)], rising.
        position: [m, shape (n,)].
        velocity: [m/s, shape (n,)]; NaN where there is none.
        before: what is followed until the first knot; none: its position is held.
    """

    time: Array
    position: Array
    velocity: Array
    before: Path | None = field(default=None, repr=False)

    @classmethod
    def held(cls, time: float, position: float) -> Path:
        """Staying where it is [s, m]."""
        return cls(np.array([time]), np.array([position]), np.array([0.0]))

    @property
    def begin(self) -> float:
        """Time of the first knot [s]."""
        return float(self.time[0])

    @property
    def end(self) -> float:
        """From this time on the last position is held [s]."""
        return float(self.time[-1])

    def value(self, time: Array) -> Array:
        """Position [m, shape (n,)] at `time` [s, shape (n,)]."""
        position, _ = self._segments(time)
        if self.before is not None and np.any(time < self.begin):
            position = np.where(time < self.begin, self.before.value(time), position)
        return position

    def velocity_at(self, time: float) -> float:
        """Velocity [m/s] with which it comes to its place at `time` [s]."""
        if self.before is not None and time <= self.begin:
            return self.before.velocity_at(time)
        return 0.0 if time <= self.begin or time >= self.end else float(self._segments(np.array([time]))[1][0])

    def _segments(self, time: Array) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s], the position held before the first knot and after the last."""
        if len(self.time) == 1:
            return np.full_like(time, self.position[0]), np.zeros_like(time)
        left = np.clip(np.searchsorted(self.time, time) - 1, 0, len(self.time) - 2)
        width = self.time[left + 1] - self.time[left]
        part = np.clip((time - self.time[left]) / width, 0.0, 1.0)
        start, way = self.position[left], self.position[left + 1] - self.position[left]
        first, last = self.velocity[left] * width, self.velocity[left + 1] * width
        straight = np.isnan(first) | np.isnan(last)
        first, last = np.where(straight, way, first), np.where(straight, way, last)
        # a cubic Hermite segment; it is the straight line where both ends have the line's own slope
        bend, twist = 3.0 * way - 2.0 * first - last, first + last - 2.0 * way
        position = start + part * (first + part * (bend + part * twist))
        position = np.where(part < 1.0, position, self.position[left + 1])
        return position, (first + part * (2.0 * bend + part * 3.0 * twist)) / width


def joined(trajectory: Trajectory, axis: str, path: Path, now: float) -> Path:
    """The path from the present one into a trajectory.

    Args:
        trajectory: what is asked.
        axis: the name it has to be for.
        path: that is followed at present.
        now: time of the last sample that was given out [s].

    Raises:
        BenchError: it is for another axis, malformed, over already, or begins in another hour.
    """
    _check(trajectory, axis)
    here = float(path.value(np.array([now]))[0])
    if not trajectory.time.size:
        return Path.held(now, here)
    start = trajectory.start or now
    time = start + trajectory.time
    if start > now + MOST_AHEAD or time[-1] <= now:
        when = "begins" if start > now else "is over"
        raise BenchError(
            f"it {when} at {start if start > now else time[-1]:.3f} s of the run's own time, and it is {now:.3f} s now;"
            " stamp it as joint_states are, or with 0 for now"
        )
    start = max(start, now)
    position = float(path.value(np.array([start]))[0])
    late = time <= start
    if late.any() and trajectory.start == 0.0:  # a point for now itself: the path begins there
        position = float(trajectory.position[late][-1])
    ahead = ~late
    return Path(
        np.concatenate(([start], time[ahead])),
        np.concatenate(([position], trajectory.position[ahead])),
        np.concatenate(([path.velocity_at(start)], trajectory.velocity[ahead])),
        before=_alone(path, now) if start > now else None,
    )


def check_numbers(time: Array, position: Array, velocity: Array) -> None:
    """Whether these can be numbers of points, by `LARGEST`; a velocity may be NaN, which is none.

    Raises:
        BenchError: one cannot; it is named.
    """
    for name, values in (("position", position), ("time_from_start", time), ("velocity", velocity)):
        largest, unit = LARGEST[name]
        sound = np.abs(values) <= largest
        if name == "velocity":
            sound |= np.isnan(values)
        if not np.all(sound):
            first = int(np.argmin(sound))
            raise BenchError(
                f"the {name} of point {first + 1} is {values[first]:g} {unit};"
                f" give a finite number of at most {largest:g} {unit}, in SI units"
            )


def _alone(path: Path, now: float) -> Path:
    """The path without what it followed before its first knot, once that has passed; else what is followed now."""
    if path.before is None:
        return path
    return path.before if path.begin > now else Path(path.time, path.position, path.velocity)


def _check(trajectory: Trajectory, axis: str) -> None:
    if trajectory.joints != (axis,):
        raise BenchError(f"joint_names are {list(trajectory.joints)}, expected ['{axis}']")
    check_numbers(trajectory.time, trajectory.position, trajectory.velocity)
    rising = np.diff(trajectory.time, prepend=-1.0) > 0.0
    if not np.all(rising) or np.any(trajectory.time < 0.0):
        first = int(np.argmin(rising & (trajectory.time >= 0.0)))
        raise BenchError(
            f"time_from_start of point {first + 1} is {trajectory.time[first]:g} s;"
            " times begin at 0 s or later and rise from point to point"
        )
    if trajectory.velocity.size and abs(np.nan_to_num(trajectory.velocity[-1])) > 0.0:
        raise BenchError(
            f"the last point has a velocity of {trajectory.velocity[-1]:g} m/s, but it is held; give 0 or none there"
        )
