"""Current limit of the amplifier where the record has only the command: two ways in which the load answers it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.effects.rate_limit import RateLimit, rate_of
from pzt_ros.physics.link import ACTUATOR, AMPLIFIER
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


@dataclass(frozen=True, kw_only=True)
class AmplifierChargeLimit(RateLimit):
    """The polarization follows that of the command no faster than the largest current charges it: |dP/dt| <= I/A.

    Where the ceramic switches, most of its charge is polarization that switches, and its capacitance is many times that
    of other places. As long as a leg goes one way, and but for the rate that switching itself feels, a limited charge
    is the polarization of the command, later. After a turn that the voltage did not reach, it is that only nearly.
    """

    kind: ClassVar[str] = "amplifier_charge_limit"
    section: ClassVar[str] = ACTUATOR
    limited: ClassVar[str] = "polarization"

    inverse_current_density: float = parameter(
        0.0, "m^2/A", "electrode area over largest current; 0 for no limit", symbol="A/I", bounds=(0.0, 1e3)
    )

    @property
    def fastest(self) -> float:
        """Largest rate of change [C/(m^2 s)]."""
        return rate_of(self.inverse_current_density)
