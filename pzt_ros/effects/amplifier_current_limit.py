"""Current limit of the amplifier where the record has only the command, into a load of constant capacitance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.effects.rate_limit import RateLimit, rate_of
from pzt_ros.physics.link import AMPLIFIER
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class AmplifierCurrentLimit(RateLimit):
    """The voltage follows the command no faster than the largest current charges the capacitance: |dU/dt| <= I/C.

    Given as C/I, so that 0 is no limit. The capacitance is taken as constant.
    """

    kind: ClassVar[str] = "amplifier_current_limit"
    section: ClassVar[str] = AMPLIFIER
    limited: ClassVar[str] = "voltage"

    inverse_slew: float = parameter(
        0.0, "s/V", "capacitance over largest current; 0 for no limit", symbol="C/I", bounds=(0.0, 1e3)
    )

    @property
    def fastest(self) -> float:
        """Largest rate of change [V/s]."""
        return rate_of(self.inverse_slew)
