"""Runs of a stage from rest, with ramps to random places and holds there, and a polycrystal for it."""

from __future__ import annotations

from typing import Any

import numpy as np

from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.records import Record

NOISE = 12e-9
FIELDS: Any = {
    "coercive_field": 5e5,
    "coercive_field_spread": 8e10,
    "interaction_field_spread": 1.2e11,
    "relaxation_time": 5e-3,
    "domain_polarization": 0.21,
    "reciprocal_permittivity": 2.5e7,
}
"""Of a polycrystal that switches within 120 V [SI]."""


def run_of(chain: Chain, name: str, duration: float, seed: int) -> Record:
    """Ramps to places drawn between 0 and 120 V and holds there, from rest at 0."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 2e-3)
    corners, volts = [0.0, 0.2], [0.0, 0.0]
    while corners[-1] < duration:
        corners += [corners[-1] + rng.uniform(0.1, 0.6)]
        corners += [corners[-1] + rng.uniform(0.05, 0.5)]
        volts += 2 * [rng.uniform(0.0, 120.0)]
    voltage = np.interp(time, corners, volts)
    _, out = chain.step(chain.init(Rest()), Signals(time=time, voltage=voltage))
    read = out.displacement + NOISE * rng.standard_normal(time.size)
    return Record(name, {"time_s": time, "voltage_V": voltage, "displacement_m": read})


def runs_of(chain: Chain) -> tuple[list[Record], list[Record]]:
    return [run_of(chain, "train", 8.0, 1), run_of(chain, "more", 6.0, 2)], [run_of(chain, "test", 8.0, 3)]
