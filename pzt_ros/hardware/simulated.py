"""The simulated instruments: the amplifier with its load, and the sensor that reads the plant's truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.hardware.amplifier import SimulatedAmplifier
from pzt_ros.hardware.driver import AmplifierSettings, Bench, SensorSettings
from pzt_ros.hardware.stage import SimulatedSensor


@dataclass(frozen=True, kw_only=True)
class SimulatedAmplifierSettings(AmplifierSettings):
    """The amplifier of the chain; its own parameters stand in the chain's file."""

    kind: ClassVar[str] = "simulated"

    def build(self, bench: Bench) -> SimulatedAmplifier:
        """The amplifier links of the chain, with the ceramic as their load."""
        return SimulatedAmplifier(bench.chain, bench.rest)


@dataclass(frozen=True, kw_only=True)
class SimulatedSensorSettings(SensorSettings):
    """The sensor of the chain; its own parameters stand in the chain's file."""

    kind: ClassVar[str] = "simulated"
    reads_truth: ClassVar[bool] = True

    def build(self, bench: Bench) -> SimulatedSensor:
        """The sensor links of the chain."""
        return SimulatedSensor(bench.chain, bench.rest)
