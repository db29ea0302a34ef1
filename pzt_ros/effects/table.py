"""The optional links of the signal chain: one file each, one line here."""

from __future__ import annotations

from pzt_ros.physics.link import Link
from pzt_ros.physics.strain_hysteresis import StrainHysteresis
from pzt_ros.physics.structure import Structure

EFFECTS: tuple[type[Link], ...] = (StrainHysteresis, Structure)
"""What a stage may have beyond amplifier, ceramic, electrostriction and sensor; a new one is one line here."""
