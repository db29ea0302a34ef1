"""What the models are driven with: the fields of the thesis' experiments, sampled evenly or not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pzt_ros.physics.signals import Array, Signals

SAMPLE_RATE = 20e3
"""[Hz]"""

LAYER_THICKNESS = 1e-4
"""Of every model here [m]."""

NESTED_LEGS = (0, 2, -2, 2, -1, 1, -0.7, 0.7, -2, 0.4, -0.2, 0.8, 0.2, 1.2, 0.5, 2, -0.4, 0.2, -0.8, -0.2, -1.2)
"""Twenty legs with nested and biased loops that close singly and together [MV/m] (thesis set P3 of the oracle)."""


def turning_times(legs: Sequence[float], rate: float) -> Array:
    """When ramps through `legs` [MV/m] at `rate` [V/m/s] turn [s]; the first at 0."""
    return np.concatenate(([0.0], np.cumsum(np.abs(np.diff(legs)) * 1e6 / rate)))


def ramps(legs: Sequence[float], rate: float, at: Array) -> Signals:
    """Linear legs through the fields `legs` [MV/m] at `rate` [V/m/s], at the times `at` [s]."""
    field = np.interp(at, turning_times(legs, rate), np.array(legs) * 1e6)
    return Signals(time=at, voltage=field * LAYER_THICKNESS)


def sampled_ramps(rate: float, legs: Sequence[float] = NESTED_LEGS, samples: int | None = None) -> Signals:
    """The legs at 20 kHz, whole or the first `samples` of them."""
    count = int(turning_times(legs, rate)[-1] * SAMPLE_RATE)
    return ramps(legs, rate, np.arange(1, min(count, samples or count) + 1) / SAMPLE_RATE)


def multisine(highest: float, samples: int) -> Signals:
    """Twelve tones from a twentieth of the highest frequency [Hz] up to it, 1.5 MV/m peak, at 20 kHz, from 0."""
    rng = np.random.default_rng(3)
    time = np.arange(1, samples + 1) / SAMPLE_RATE
    tones = rng.uniform(0.05, 1.0, 12) * highest
    field = np.sin(2 * np.pi * np.outer(time, tones) + rng.uniform(0, 2 * np.pi, 12)) @ rng.uniform(0.3, 1.0, 12)
    field -= field[0] * np.exp(-time * highest)
    return Signals(time=time, voltage=1.5e6 * LAYER_THICKNESS * field / np.max(np.abs(field)))


def blocks(signals: Signals, size: int) -> Iterator[Signals]:
    """Cut voltage or polarization into blocks, as they travel between nodes."""
    for low in range(0, signals.time.size, size):
        part = slice(low, low + size)
        yield Signals(time=signals.time[part], voltage=signals.voltage[part], polarization=signals.polarization[part])
