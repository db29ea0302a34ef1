"""What a click asks of the stage, as points of a trajectory; nothing outside the envelope leaves this file."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pzt_ros.errors import BenchError, named
from pzt_ros.experiments.trajectory import Path, check_numbers

Point = tuple[float, float, float | None]
"""Time from the start [s], displacement [m], velocity [m/s] or None: between two points with one the way is a cubic,
between others it is straight, as `joint_trajectory` has it."""

MOST_POINTS = 400
"""Of one trajectory. Whether it can be followed is seen in 0.35 ms a point, and meanwhile no block goes out: 400 points
take 0.14 s on our machine, and commands may be silent for 0.5 s."""

SHORTEST = 0.05
"""Of a move [s]."""

FLYBACK = 0.2
"""Share of a period in which a raster line goes back."""

SINE_POINTS = 8
"""Of a cycle: the cubics between them stay within 0.1 % of the sine."""

NEAREST = 1e-9
"""Points are so far apart in time [s]: messages count in nanoseconds."""

LOOKED_AT = 16
"""Places between two points that are held against the envelope."""


@dataclass(frozen=True)
class Envelope:
    """Where the stage may be sent, and how fast.

    Attributes:
        low, high: displacement [m].
        speed: largest [m/s].
    """

    low: float
    high: float
    speed: float

    def check(self, points: list[Point], here: float) -> list[Point]:
        """The points, if a stage at rest `here` [m] may follow them; none is a stop, which it always may.

        Raises:
            BenchError: the way is outside or too fast, a number is none, times do not rise, or there are too many.
        """
        if not points:
            return points
        if len(points) > MOST_POINTS:
            raise BenchError(f"the trajectory has {len(points)} points, at most {MOST_POINTS} go; ask for fewer cycles")
        table = np.array([(time, place, math.nan if v is None else v) for time, place, v in points], dtype=np.float64)
        check_numbers(*table.T)
        time, place, velocity = np.concatenate(([[0.0, here, 0.0]], table)).T
        if not np.all(np.diff(time) >= NEAREST):
            raise BenchError("the times of the trajectory do not rise; give points in the order of time")
        self._check_way(Path(time, place, velocity), here)
        return points

    def _check_way(self, path: Path, here: float) -> None:
        shares = np.arange(LOOKED_AT) / LOOKED_AT
        times = np.append((path.time[:-1, None] + np.diff(path.time)[:, None] * shares).ravel(), path.time[-1])
        places = path.value(times)
        lowest, highest = float(places.min()), float(places.max())
        # a stage that was left outside may come back, but not go further out
        if lowest < min(self.low, here) - 1e-12 or highest > max(self.high, here) + 1e-12:
            worst = lowest if lowest < min(self.low, here) - 1e-12 else highest
            raise BenchError(f"{um(worst)} is outside the window of {um(self.low)} to {um(self.high)}; stay inside")
        fastest = float(np.max(np.abs(np.diff(places)) / np.diff(times)))
        if fastest > self.speed * (1.0 + 1e-6):
            raise BenchError(f"it takes {um(fastest)}/s, the limit is {um(self.speed)}/s; slow it down or go less far")


def jog(envelope: Envelope, here: float, step: float, speed: float) -> list[Point]:
    """From `here` by `step` [m], never faster than `speed` [m/s].

    Raises:
        BenchError: out of the envelope, or no numbers.
    """
    _finite(step=step, speed=speed)
    if step == 0.0:
        raise BenchError("a step of 0 um goes nowhere; give a step")
    _within("speed", speed, 1e-9, envelope.speed, lambda value: f"{um(value)}/s")
    return envelope.check([ease(here, here + step, speed)], here)


def scan(
    envelope: Envelope, here: float, *, shape: str, low: float, peak_to_peak: float, rate: float, cycles: float
) -> list[Point]:
    """From `here` [m] to `low` [m], then whole cycles of a shape at `rate` [Hz], which end at `low`.

    Raises:
        BenchError: out of the envelope, too fast, too long, unknown shape, or no numbers.
    """
    _finite(lowest=low, amplitude=peak_to_peak, rate=rate, cycles=cycles)
    wave = named(SHAPES, shape, "shape")
    _within("amplitude", peak_to_peak, 1e-9, envelope.high - envelope.low, um)
    _within("rate", rate, 1e-3, 1e3, lambda value: f"{value:g} Hz")
    most = (MOST_POINTS - 1) // len(wave)
    if cycles != int(cycles) or not 1 <= cycles <= most:
        raise BenchError(f"{cycles:g} cycles of this shape: give a whole number of 1 to {most}")
    points = [ease(here, low, min(envelope.speed, 2.0 * peak_to_peak * rate))]
    begin = points[0][0]
    for cycle in range(int(cycles)):
        points += [
            (begin + (cycle + t) / rate, low + peak_to_peak * x, None if v is None else peak_to_peak * rate * v)
            for t, x, v in wave
        ]
    return envelope.check(points, here)


def ease(start: float, to: float, speed: float) -> Point:
    """A move from rest to rest: a cubic, which is fastest in the middle, 1.5 times its mean."""
    return max(1.5 * abs(to - start) / speed, SHORTEST), to, 0.0


def _sine() -> list[Point]:
    parts = [k / SINE_POINTS for k in range(1, SINE_POINTS + 1)]
    angle = 2.0 * math.pi
    return [(t, 0.5 * (1.0 - math.cos(angle * t)), round(0.5 * angle * math.sin(angle * t), 12)) for t in parts]


SHAPES: dict[str, list[Point]] = {
    "triangle": [(0.5, 1.0, None), (1.0, 0.0, None)],
    "sine": _sine(),
    "raster line": [(1.0 - FLYBACK, 1.0, None), (1.0, 0.0, None)],
}
"""One cycle each, from (0, 0): times and places from 0 to 1, velocities in these units."""


def um(value: float) -> str:
    """A length [m] for people."""
    return f"{1e6 * value:.4g} um"


def _finite(**numbers: object) -> None:
    for name, number in numbers.items():
        if isinstance(number, bool) or not isinstance(number, (int, float)) or not math.isfinite(number):
            raise BenchError(f"{name} is {'empty' if number is None else number!r}; give a number")


def _within(what: str, value: float, lowest: float, highest: float, say: Callable[[float], str]) -> None:
    if not lowest <= value <= highest:
        raise BenchError(f"{what} of {say(value)} is outside {say(lowest)} to {say(highest)}; choose one inside")
