"""What all models of the ceramic share: its geometry."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.physics.link import ACTUATOR, Link
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class Ferroelectric(Link, ABC):
    """Voltage to polarization. The field is E = U / h over each layer; the charge on the electrodes is Q = P A."""

    section: ClassVar[str] = ACTUATOR
    knows_no_rate: ClassVar[bool] = False
    """Whether P depends on the order of the fields only."""

    layer_thickness: float = parameter(1e-4, "m", "thickness of one ceramic layer", symbol="h", bounds=(1e-8, 0.1))
    electrode_area: float = parameter(2e-3, "m^2", "area of all layers together", symbol="A", bounds=(1e-12, 10.0))
