"""Drives that go straight from corner to corner, and what a hysteresis link answers."""

from __future__ import annotations

import numpy as np

from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.switching import Switching


def walk(corners: list[float], samples: int = 40) -> Array:
    """Straight from corner to corner, beginning at 0 V; every corner is the last of so many samples [V]."""
    legs = zip([0.0, *corners], corners, strict=False)
    return np.concatenate([np.linspace(begin, end, samples + 1)[1:] for begin, end in legs])


def polarization(link: Switching, voltage: Array, interval: float = 1e-3) -> Array:
    """P from rest at 0 V on [C/m^2]."""
    time = interval * np.arange(1, voltage.size + 1)
    return link.step(link.init(Rest()), Signals(time, voltage))[1].polarization
