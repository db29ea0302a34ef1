"""Every effect of the court by name."""

from __future__ import annotations

from . import effects_actuator as actuator
from . import effects_outside as outside
from . import effects_reading as reading
from .effect import Effect

INSIDE: dict[str, type[Effect]] = {
    each.name: each
    for each in (
        actuator.Creep, actuator.StrainLead, reading.ThermalDrift, actuator.Resonance, reading.SensorLag,
        reading.SensorNonlinearity, actuator.CurrentLimit, actuator.AmplifierBandwidth, reading.MainsHum,
        actuator.Fatigue, actuator.BiasField, actuator.Leakage, actuator.Load,
    )
}  # fmt: skip
"""Effects of contract.md."""

OUTSIDE: dict[str, type[Effect]] = {
    each.name: each
    for each in (
        outside.Backlash, outside.GainDrift, outside.Tone, outside.Telegraph, outside.SlowWave, outside.FringeError,
        outside.SelfHeating, outside.LostReadings,
    )
}  # fmt: skip
"""Effects that no link of the library is."""

OWN_PROTOCOL = {"leakage": "with_polarization", "load_stiffness": "loaded"}
"""Effects that only a record with more columns can show."""

PLAIN = tuple(name for name in INSIDE if name not in OWN_PROTOCOL)
"""Effects that displacement alone can show."""


def effect_class(name: str) -> type[Effect]:
    """By name, inside or outside the library."""
    return {**INSIDE, **OUTSIDE}[name]
