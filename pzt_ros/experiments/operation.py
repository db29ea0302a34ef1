"""What manual operation is set to: the controller that begins, and the poling."""

from __future__ import annotations

from dataclasses import dataclass

from pzt_ros.experiments.phases import VoltageRamp
from pzt_ros.experiments.procedures import HOLD_TIME, POLING_VOLTAGE, RAMP_TIME
from pzt_ros.quantities import choice, parameter


@dataclass(frozen=True, kw_only=True)
class ManualOperation:
    """Settings of a run in which an operator says what happens."""

    controller: str = choice("inverse_pi", (), "controller in charge at first")
    poling_voltage: float = parameter(POLING_VOLTAGE, "V", "voltage the stage is poled at", bounds=(0.0, 200.0))
    poling_ramp: float = parameter(RAMP_TIME, "s", "time to get there, and to come back to 0 V", bounds=(1e-3, 1e3))
    poling_hold: float = parameter(HOLD_TIME, "s", "time to stay there", bounds=(1e-3, 1e4))

    def poling(self) -> tuple[VoltageRamp, ...]:
        """The thesis' initialisation (2.2.1): up along half a sine, held, back to 0 V."""
        return (
            VoltageRamp(to=self.poling_voltage, duration=self.poling_ramp),
            VoltageRamp(to=self.poling_voltage, duration=self.poling_hold),
            VoltageRamp(to=0.0, duration=self.poling_ramp),
        )
