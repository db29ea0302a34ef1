"""The effects that a story may hide in its stage: which one and how large is drawn from the seed."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from random import Random

from pzt_ros.chains import load_chain
from pzt_ros.effects.insert import with_effect
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import Link
from pzt_ros.physics.sensor import DisplacementSensor

STAGE = "bench-stage"
NOISE_RMS, RESOLUTION = 5e-9, 1e-9
"""Of the sensor that the story gives the stage [m]: a capacitive one in place of the thesis' 0.1 um."""


@dataclass(frozen=True)
class Hidden:
    """An effect to hide, and how large it may be.

    Attributes:
        name: of the effect.
        ranges: lowest and highest value of each parameter [SI]; drawn evenly over the logarithm.
    """

    name: str
    ranges: Mapping[str, tuple[float, float]]

    def drawn(self, chance: Random) -> Link:
        """The effect's link with values drawn within their ranges."""
        values = {name: low * (high / low) ** chance.random() for name, (low, high) in self.ranges.items()}
        return EFFECT_OF[self.name].link(**values)


HIDDEN: tuple[Hidden, ...] = (
    Hidden("slow_relaxation", {"share": (0.10, 0.20), "shortest_time": (0.03, 0.08), "longest_time": (3.0, 6.0)}),
    Hidden("bias_field", {"bias_voltage": (5.0, 10.0)}),
    Hidden("mechanical_resonance", {"share": (0.4, 0.6), "frequency": (62.0, 80.0), "damping_ratio": (0.03, 0.05)}),
)
"""What lies between the voltage across the ceramic and the true displacement, and is there in every run alike."""

LEFT_OUT: dict[str, str] = {
    "strain_polarization_hysteresis": "the diagnosis does not find its way to it from a model fitted without it",
    "strain_polarization_lag": "is found only where the polarization is recorded, which the story does not",
    "amplifier_bandwidth": "the bag holds the voltage across the ceramic, so a slow amplifier is no error of the model",
    "amplifier_current_limit": "as the bandwidth of the amplifier",
    "amplifier_charge_limit": "as the bandwidth of the amplifier",
    "sensor_lag": "the inverse of what moves the stage tracks the truth; that the reading is late matters little",
    "sensor_nonlinearity": "as the lag of the sensor: who knows only the reading cannot track the truth",
    "thermal_drift": "its rate belongs to one run; the next run cannot know it",
    "mains_hum": "its phase belongs to one run; the next run cannot know it",
    "polarization_fatigue": "the simulated stage begins every run as new, a real one would go on where it was",
    "imprint": "what is missing of it belongs to one run; the next run cannot know it",
    "cross_coupling": "the story has one axis",
    "load_stiffness": "is a gain, which the strain law takes up",
    "leakage": "changes the charge that is measured, not the displacement",
    "thermal_expansion": "no temperature is recorded in the story",
    "thermal_lag": "as the expansion",
}
"""Every other effect of the library, and why it is not hidden."""


def hidden_link(seed: int) -> Link:
    """The effect that the seed hides; the same for a seed on every machine."""
    chance = Random(seed)
    return HIDDEN[int(chance.random() * len(HIDDEN))].drawn(chance)


def stage_with(link: Link) -> Chain:
    """The bench stage with a hidden effect, read by a capacitive sensor."""
    chain = load_chain(STAGE).with_links(_better_sensor)
    notes = {"description": f"{STAGE} with a hidden effect, read by a capacitive sensor; made by pzt demo"}
    return dataclasses.replace(with_effect(chain, link), name=f"{STAGE}-hidden", notes=notes)


def _better_sensor(link: Link) -> Link:
    if isinstance(link, DisplacementSensor):
        return dataclasses.replace(link, noise_rms=NOISE_RMS, resolution=RESOLUTION)
    return link
