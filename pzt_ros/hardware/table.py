"""Every driver by name; a new one is one line here."""

from __future__ import annotations

from pzt_ros.errors import named
from pzt_ros.hardware.driver import AmplifierSettings, SensorSettings
from pzt_ros.hardware.gcs_drivers import GcsAmplifierSettings, GcsSensorSettings
from pzt_ros.hardware.replay import ReplayAmplifierSettings, ReplaySensorSettings
from pzt_ros.hardware.simulated import SimulatedAmplifierSettings, SimulatedSensorSettings

AMPLIFIERS: dict[str, type[AmplifierSettings]] = {
    driver.kind: driver for driver in (SimulatedAmplifierSettings, ReplayAmplifierSettings, GcsAmplifierSettings)
}
SENSORS: dict[str, type[SensorSettings]] = {
    driver.kind: driver for driver in (SimulatedSensorSettings, ReplaySensorSettings, GcsSensorSettings)
}


def find_amplifier(kind: str) -> type[AmplifierSettings]:
    """The settings class of that amplifier driver.

    Raises:
        BenchError: there is none.
    """
    return named(AMPLIFIERS, kind, "amplifier driver")


def find_sensor(kind: str) -> type[SensorSettings]:
    """The settings class of that sensor driver.

    Raises:
        BenchError: there is none.
    """
    return named(SENSORS, kind, "sensor driver")
