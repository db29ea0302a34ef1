"""What the stack, the amplifier and a run stand."""

from __future__ import annotations

from dataclasses import dataclass

from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What the stack and the amplifier stand (thesis 2.1: used from -40 to 150 V, amplifier 200 mA)."""

    voltage_min: float = parameter(-40.0, "V", "lowest voltage across the stack", bounds=(-200.0, 0.0))
    voltage_max: float = parameter(150.0, "V", "highest voltage across the stack", bounds=(0.0, 200.0))
    slew_rate: float = parameter(2e5, "V/s", "fastest change of the voltage", bounds=(1.0, 5e8))
    current: float = parameter(0.2, "A", "largest current into the stack", bounds=(1e-6, 10.0))
    power: float = parameter(30.0, "W", "largest voltage times current at the stack", bounds=(1e-6, 1e4))
    safe_rate: float = parameter(500.0, "V/s", "rate of the ramp to 0 V that makes the stage safe", bounds=(1.0, 1e5))
    command_timeout: float = parameter(
        0.5, "s", "silence of the commands, on the wall clock, before the stage is made safe", bounds=(0.005, 60.0)
    )
    command_age: float = parameter(
        0.0, "s", "a command may come this long after the block before it, on the wall clock; 0: as command_timeout",
        bounds=(0.0, 60.0),
    )  # fmt: skip
    sensor_timeout: float = parameter(
        0.0, "s", "a block put out is measured within this time, on the wall clock; 0: as command_timeout",
        bounds=(0.0, 60.0),
    )  # fmt: skip
    stuck_voltage: float = parameter(
        100.0, "V", "a reading that stays the same to the bit while the voltage moves by more than this is stuck",
        bounds=(0.1, 400.0),
    )  # fmt: skip
    discrepancy: float = parameter(
        5e-6, "m", "largest median of a block's innovation: sensor against observer", bounds=(1e-9, 1e-2)
    )
    capacitance_min: float = parameter(
        0.0, "F", "a stack that takes less charge than this a volt is not connected; 0: not looked at, for an "
        "amplifier that measures no current", bounds=(0.0, 1e-2),
    )  # fmt: skip

    late_after: float = parameter(
        4.0, "1", "in real time a command is late that comes more block periods than this after the block before it",
        bounds=(1.0, 1e4),
    )  # fmt: skip
    late_commands: float = parameter(
        50.0, "1", "so many late ones among the last late_window commands are too many; 0: only counted",
        bounds=(0.0, 1e6),
    )  # fmt: skip
    late_window: float = parameter(100.0, "1", "commands that late_commands are counted among", bounds=(1.0, 1e6))
    temperature: float = parameter(
        358.15, "K", "highest temperature, where the driver measures one", bounds=(200.0, 600.0)
    )

    @property
    def oldest_command(self) -> float:
        """A command that comes longer than this after the block before it is too old [s]."""
        return self.command_age or self.command_timeout

    @property
    def longest_unmeasured(self) -> float:
        """A block that is not measured after this time was lost by the sensor [s]."""
        return self.sensor_timeout or self.command_timeout

    @property
    def ramp_rate(self) -> float:
        """Rate of the ramp to 0 V [V/s]: the safe rate, unless even that is too fast."""
        return min(self.safe_rate, self.slew_rate)

    @property
    def declared_safe_time(self) -> float:
        """Within this wall-clock time after the last command the stack is at 0 V [s]; 0.2 s are for the machine."""
        return self.command_timeout + max(-self.voltage_min, self.voltage_max) / self.ramp_rate + 0.2
