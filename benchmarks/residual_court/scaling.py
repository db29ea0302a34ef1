"""How large an effect is: the rms that it leaves after the base has adapted, in units of the noise.

Refitting the base is replaced by a projection onto its tangents (every parameter of the truth, a shift of P, and an
offset of each run), within bounds: a parameter that would have to change by more than half is no longer on its tangent.
The size is that in the run where it is largest, among those that a diagnosis sees.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from .effect import BIAS, CHARGE, CURRENT, DRIVE, Effect
from .families import AREA
from .generator import NOISE, POLARIZATION_NOISE, Bench

Array = NDArray[np.float64]

STRIDE = 6
"""Every how many samples the projection looks; tangents are worked out on every second sample."""

_TRIALS = 9
_WANDER = 0.5  # relative change of a parameter that a tangent may stand for
_CLOSE = 0.03  # relative error of the size that is good enough
_CLOSE_BEFORE = 0.08  # where every trial has to run the ceramic anew


@dataclass(frozen=True)
class Absorber:
    """Tangents of all runs below each other with an offset for each run, and their QR decomposition."""

    columns: Array
    orthonormal: Array
    triangle: Array
    bounds: Array

    @classmethod
    def of(cls, tangents: list[Array]) -> Absorber:
        """From the tangents of each run [shape (n, k), each for a change by the whole of a parameter]."""
        shared = np.vstack(tangents)
        shared = shared[:, np.abs(shared).max(axis=0) > 0]
        offsets = np.zeros((shared.shape[0], len(tangents)))
        start = 0
        for column, each in enumerate(tangents):
            offsets[start : start + each.shape[0], column] = 1.0
            start += each.shape[0]
        columns = np.hstack([shared, offsets])
        bounds = np.concatenate([np.full(shared.shape[1], _WANDER), np.full(len(tangents), np.inf)])
        return cls(columns, *np.linalg.qr(columns), bounds)

    def left_of(self, change: Array) -> Array:
        """What the base cannot follow."""
        scale = np.linalg.norm(self.triangle, axis=0)
        aim = self.orthonormal.T @ change
        size = np.linalg.norm(aim) or 1.0
        bounds = self.bounds * scale / size
        found = optimize.lsq_linear(self.triangle / scale, aim / size, (-bounds, bounds), tol=1e-12)
        return change - self.columns @ (found.x * size / scale)


@dataclass
class Projection:
    """What the base can absorb, over all runs that a diagnosis sees.

    Attributes:
        picks: samples looked at, for each run.
        clean: reading and polarization there without any effect.
        absorbers: of displacement and of polarization.
    """

    bench: Bench
    picks: list[slice]
    clean: list[tuple[Array, Array]]
    absorbers: tuple[Absorber, Absorber]

    @classmethod
    def of(cls, bench: Bench) -> Projection:
        """Tangents of the truth on the runs to train and to test."""
        numbers = range(bench.protocol.known)
        picks = [slice(bench.protocol.drives[number].hidden, None, STRIDE) for number in numbers]
        clean, tangents = [], []
        for number, pick in zip(numbers, picks, strict=True):
            motion = bench.motion(number, ())
            clean.append((motion.reading[pick], motion.polarization[pick]))
            tangents.append(_tangents(bench, number))
        absorbers = [Absorber.of([each[channel] for each in tangents]) for channel in (0, 1)]
        return cls(bench, picks, clean, (absorbers[0], absorbers[1]))

    def left(self, effects: tuple[Effect, ...]) -> list[Array]:
        """What effects leave after projection, in units of the noise, for each run."""
        channel, noise = (1, POLARIZATION_NOISE) if effects[0].stage == CHARGE else (0, NOISE)
        changes = []
        for number, pick in enumerate(self.picks):
            motion = self.bench.motion(number, effects)
            values = motion.polarization if channel else motion.reading
            changes.append(values[pick] - self.clean[number][channel])
        change = np.concatenate(changes)
        change = self.absorbers[channel].left_of(change) / noise
        return np.split(change, np.cumsum([each.size for each in changes])[:-1])

    def size(self, effect: Effect) -> float:
        """See the module."""
        return max(float(np.sqrt(np.mean(left**2))) for left in self.left((effect,)))

    def scaled(self, effect: Effect, wanted: float) -> tuple[Effect, float]:
        """The effect with the amplitude that has the size wanted, and the size reached.

        Multiplies by the missing ratio to the power that the last two trials show; where the effect grows no further,
        the largest amplitude allowed is taken.
        """
        if effect.stage == CURRENT:
            effect = dataclasses.replace(effect, amplitude=1.4 / self._peak_current())
        close = _CLOSE_BEFORE if effect.stage in (DRIVE, BIAS, CURRENT) else _CLOSE
        tried: list[tuple[float, float]] = []
        for _ in range(_TRIALS):
            size = self.size(effect)
            tried.append((effect.amplitude, size))
            if abs(size / wanted - 1) < close:
                break
            factor = _factor(tried, wanted)
            amplitude = min(effect.amplitude * factor, effect.most)
            if amplitude == effect.amplitude:
                break
            effect = dataclasses.replace(effect, amplitude=amplitude)
        amplitude, size = min(tried, key=lambda each: abs(np.log(max(each[1], 1e-9) / wanted)))
        return dataclasses.replace(effect, amplitude=amplitude), size

    def _peak_current(self) -> float:
        """Largest current of all runs without a limit [A]."""
        bench = self.bench
        return max(
            float(np.max(np.abs(np.diff(bench.clean_polarization[number])))) * AREA / bench.runs[number].step
            for number in range(len(self.picks))
        )


def _tangents(bench: Bench, number: int) -> tuple[Array, Array]:
    """Of displacement and polarization, at the samples that the projection looks at."""
    run, hidden = bench.runs[number], bench.protocol.drives[number].hidden
    odd = hidden % 2
    dy, dp = bench.truth.tangents(run.time[odd::2], run.command[odd::2])
    shown = slice((hidden - odd) // 2, None, STRIDE // 2)
    return dy[shown], dp[shown]


def _factor(tried: list[tuple[float, float]], wanted: float) -> float:
    """By what to multiply the last amplitude."""
    amplitude, size = tried[-1]
    below = [each for each in tried if each[1] < wanted]
    above = [each for each in tried if each[1] >= wanted]
    if below and above:
        (a0, s0), (a1, s1) = max(below), min(above)
        if s0 < 1e-2 * wanted:  # an effect that sets in suddenly: halfway
            return float(np.sqrt(a0 * a1)) / amplitude
        if a1 > a0:  # between two trials, by a power law
            power = np.log(s1 / s0) / np.log(a1 / a0)
            return float(a0 * (wanted / s0) ** (1 / max(power, 0.3)) / amplitude)
    if size < 1e-2 * wanted:
        return 3.0
    return float(np.clip(wanted / size, 0.2, 5.0))
