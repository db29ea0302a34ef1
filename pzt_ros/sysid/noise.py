"""The noise floor of a measurement, estimated from the run itself (diagnosis-methods.md 6)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pzt_ros.physics.signals import Array

NORMAL = 1.4826
"""Standard deviation over median absolute value, for normal noise."""

_TRIM = 3.0  # standard deviations from which a third difference counts as an outlier
_LEFT = 0.97334  # of a normal variance within three standard deviations
_TRIMS = 4
_THIRD_DIFFERENCE = math.sqrt(20.0)  # 1 + 9 + 9 + 1: what a third difference makes of white noise


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of a measurement [m, rms].

    Attributes:
        rms: estimator A on single samples; at least what the resolution of the reading makes.
        of_means: estimator A on means of 4 samples, scaled back by 2; white noise gives the same as `rms`.
    """

    rms: float
    of_means: float

    @property
    def is_white(self) -> bool:
        """False where slower noise, or motion too fast for the sampling, makes `rms` a doubtful figure."""
        return self.of_means <= 1.3 * self.rms

    @property
    def caveat(self) -> str:
        """What a reader has to know about the figure; empty when nothing."""
        if self.is_white:
            return ""
        return f"noise not white, or motion fast for the sampling: means of 4 give {self.of_means * 1e9:.3g} nm"


def noise_floor(displacement: Array) -> NoiseFloor:
    """Noise floor of evenly sampled displacement [m]: spread of its third differences over sqrt 20.

    Right to 15 % for white noise on a signal that is smooth between samples; far too small where the sensor filters.
    """
    steps = np.abs(np.diff(displacement))
    moving = steps[steps > 0.0]
    resolution = float(moving.min()) if moving.size else 0.0
    repeats = displacement.size > 1 and np.count_nonzero(steps == 0.0) > 0.05 * steps.size
    least = resolution / math.sqrt(12.0) if repeats else 0.0
    means = displacement[: displacement.size // 4 * 4].reshape(-1, 4).mean(axis=1)
    single = _third_difference(displacement)
    return NoiseFloor(max(single, least), 2.0 * _third_difference(means))


def _third_difference(values: Array) -> float:
    return spread_of([values]) if values.size >= 8 else 0.0


def spread_of(stretches: Sequence[Array], parts: int | None = None) -> float:
    """Noise of stretches of a measurement: spread of third differences over sqrt 20; 0 without any.

    Of the third differences those count that are no outliers: the median finds the scale whatever the outliers are; the
    squares within three of it, which do not mind the steps of a quantised reading, say it to a third of the median's
    scatter.

    Args:
        stretches: of values, each shape (n,).
        parts: the samples of a difference lie so many-th of a stretch apart, so that it sees noise as slow as that;
            None for neighbours.
    """
    if not stretches:
        return 0.0
    sizes = np.abs(np.concatenate([_differences(s, s.size // parts if parts else 1) for s in stretches]))
    scale = float(NORMAL * np.median(sizes))
    for _ in range(_TRIMS):
        kept = sizes[sizes <= _TRIM * scale]
        if not kept.size or scale == 0.0:
            break
        scale = math.sqrt(float(np.mean(kept**2)) / _LEFT)
    return scale / _THIRD_DIFFERENCE


def _differences(values: Array, stride: int) -> Array:
    """Third differences of samples so far apart."""
    length = values.size - 3 * stride
    samples = [values[k * stride : k * stride + length] for k in range(4)]
    found: Array = samples[3] - 3.0 * samples[2] + 3.0 * samples[1] - samples[0]
    return found
