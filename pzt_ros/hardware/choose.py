"""Which instruments a run uses, out of a YAML file.

amplifier: {driver: gcs, host: 192.168.0.10, volts_per_unit: 1 V}
sensor: {driver: gcs, host: 192.168.0.10, metres_per_unit: 1 um}
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pzt_ros.chains import read_yaml
from pzt_ros.errors import BenchError
from pzt_ros.hardware.driver import AmplifierSettings, SensorSettings
from pzt_ros.hardware.simulated import SimulatedAmplifierSettings, SimulatedSensorSettings
from pzt_ros.hardware.table import find_amplifier, find_sensor
from pzt_ros.quantities import build, choices_of, parameters_of


@dataclass(frozen=True)
class Drivers:
    """The instruments of a run; simulated ones where nothing else is said."""

    amplifier: AmplifierSettings = field(default_factory=SimulatedAmplifierSettings)
    sensor: SensorSettings = field(default_factory=SimulatedSensorSettings)

    @property
    def simulated(self) -> bool:
        """Whether nothing real, and nothing recorded, takes part."""
        return {self.amplifier.kind, self.sensor.kind} == {"simulated"}

    @property
    def needs_plant(self) -> bool:
        """Whether the simulated plant has to run."""
        return self.sensor.reads_truth


def load_drivers(path: str | Path) -> Drivers:
    """The instruments named in a YAML file.

    Raises:
        BenchError: no such file, unknown driver or setting, bad unit, value out of bounds.
    """
    if not Path(path).is_file():
        raise BenchError(f"drivers '{path}': no such file; check the path")
    data, where = read_yaml(path, {}, "drivers")
    if not isinstance(data, dict) or not set(data) <= {"amplifier", "sensor"}:
        raise BenchError(f"{where}: expected 'amplifier:' and 'sensor:', each with 'driver: name' and its settings")
    chosen = {}
    for role, find in (("amplifier", find_amplifier), ("sensor", find_sensor)):
        if role in data:
            chosen[role] = _settings(data[role], f"{where}: {role}", find)
    return Drivers(**chosen)


def _settings(entry: Any, where: str, find: Any) -> Any:
    if not isinstance(entry, dict) or not isinstance(entry.get("driver"), str):
        raise BenchError(f"{where}: expected 'driver: name' and its settings, found {entry!r}")
    try:
        cls = find(entry["driver"])
    except BenchError as error:
        raise BenchError(f"{where}: {error}") from None
    return build(cls, {key: value for key, value in entry.items() if key != "driver"}, where)


def as_parameters(settings: AmplifierSettings | SensorSettings) -> dict[str, Any]:
    """The ROS parameters that choose a driver and set it."""
    numbers = {name: float(getattr(settings, name)) for name in parameters_of(settings)}
    words = {name: str(getattr(settings, name)) for name in choices_of(settings)}
    own = {**numbers, **words}
    return {"driver": settings.kind, **({settings.kind: own} if own else {})}
