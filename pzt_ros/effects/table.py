"""The effects a stage may have: one file each, one entry here."""

from __future__ import annotations

import itertools
import math

from pzt_ros.effects.amplifier_bandwidth import AmplifierBandwidth
from pzt_ros.effects.amplifier_charge_limit import AmplifierChargeLimit
from pzt_ros.effects.amplifier_current_limit import AmplifierCurrentLimit
from pzt_ros.effects.bias_field import BiasField
from pzt_ros.effects.confounded import CONFOUNDED, LATE
from pzt_ros.effects.cross_coupling import CrossCoupling
from pzt_ros.effects.effect import AT_COMMAND, AT_DISPLACEMENT, AT_FIELD, AT_POLARIZATION, AT_SENSOR, Effect
from pzt_ros.effects.imprint import Imprint
from pzt_ros.effects.leakage import Leakage
from pzt_ros.effects.load_stiffness import LoadStiffness
from pzt_ros.effects.mains_hum import MainsHum
from pzt_ros.effects.mechanical_resonance import MechanicalResonance
from pzt_ros.effects.polarization_fatigue import PolarizationFatigue
from pzt_ros.effects.sensor_lag import SensorLag
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.effects.slow_relaxation import SlowRelaxation
from pzt_ros.effects.strain_polarization_hysteresis import StrainPolarizationHysteresis
from pzt_ros.effects.strain_polarization_lag import StrainPolarizationLag
from pzt_ros.effects.thermal_drift import ThermalDrift
from pzt_ros.effects.thermal_expansion import ThermalExpansion
from pzt_ros.effects.thermal_lag import ThermalLag

_MODES = tuple(25.0 * 1.25**step for step in range(24))
"""Frequencies to look for a mode at [Hz], up to 4 kHz: at this damping one answers within a quarter of itself."""

_TONES = ("sine", "cosine", "second_sine", "second_cosine", "third_sine", "third_cosine")


def _starts(**values: tuple[float, ...]) -> tuple[dict[str, float], ...]:
    """One start for each row of the table whose columns are given."""
    return tuple(dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True))


def _grid(**values: tuple[float, ...]) -> tuple[dict[str, float], ...]:
    """One start for each combination of the values given."""
    return tuple(dict(zip(values, row, strict=True)) for row in itertools.product(*values.values()))


__all__ = ["CONFOUNDED", "EFFECTS", "EFFECT_OF", "LATE", "reported"]

EFFECTS: tuple[Effect, ...] = (
    Effect(
        link=AmplifierBandwidth,
        place=AT_COMMAND,
        amplitude="time_constant",
        starts=_grid(time_constant=(1e-4, 5e-4, 2e-3, 1e-2), second_order=(0.1,)),
        free=("time_constant", "second_order"),
        additive=("second_order",),  # by its logarithm it would never leave none
        absence="loops that open in proportion to the frequency, and turns that come late on the axis of the voltage",
        next_experiment="a chirp or a step sampled at ten times the suspected corner, or the voltage logged",
    ),
    Effect(
        link=AmplifierCurrentLimit,
        place=AT_COMMAND,
        amplitude="inverse_slew",
        starts=_grid(inverse_slew=(1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3)),
        free=("inverse_slew",),
        limits=True,
        absence="an error right after the fastest steps of the drive, gone once the voltage has caught up",
        next_experiment="steps of several heights with the voltage at the ceramic logged: the slope stays the same",
    ),
    Effect(
        link=BiasField,
        place=AT_FIELD,
        amplitude="bias_voltage",
        starts=_starts(
            bias_voltage=(0.1, 0.1, 0.1, 0.1), drift_share=(0.0, 1.0, 1.0, 1.0), time_constant=(100.0, 3.0, 30.0, 300.0)
        ),
        free=("bias_voltage", "drift_share", "time_constant"),
        absence="a loop that lies off centre, or moves along the voltage as the run goes on",
        next_experiment="a bipolar loop through saturation: its two coercive voltages differ by twice the bias",
    ),
    Effect(
        link=Imprint,
        place=AT_FIELD,
        amplitude="settled_voltage",
        starts=_grid(settled_voltage=(0.1,), time_constant=(10.0, 30.0, 100.0)),
        free=("settled_voltage", "missing_voltage", "time_constant"),
        per_run=("missing_voltage",),
        linear=("settled_voltage", "missing_voltage"),
        variant_of=BiasField.kind,
        absence="a loop that moves along the voltage from run to run and as each goes on",
        next_experiment="a bipolar loop through saturation: its two coercive voltages differ by twice the bias",
    ),
    Effect(
        link=AmplifierChargeLimit,
        place=AT_FIELD,
        amplitude="inverse_current_density",
        starts=_grid(inverse_current_density=(1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.2, 0.4, 0.8, 1.6)),
        free=("inverse_current_density",),
        limits=True,
        variant_of=AmplifierCurrentLimit.kind,
        absence="an error right after the drive crosses the coercive field fast, gone once the charge has caught up",
        next_experiment="steps of several heights with the current logged: it stays at one value",
    ),
    Effect(
        link=PolarizationFatigue,
        place=AT_POLARIZATION,
        amplitude="loss",
        starts=_starts(
            loss=(1e-4,) * 6,
            exponent=(0.5, 1.0, 1.5, 1.0, 1.0, 1.0),
            saturation_cycles=(
                100.0,
                100.0,
                100.0,
                3.0,
                10.0,
                30.0,
            ),  # not never: no fit finds back from there
        ),
        free=("loss", "exponent", "saturation_cycles"),
        details=("remanent_polarization",),
        zero="remanent_polarization",
        goes_on="cycles_before",
        absence="a stroke that shrinks with the cycles gone through and stays as it is in a pause",
        next_experiment="the same loop before and after a pause without cycling, and before and after many cycles",
    ),
    Effect(
        link=StrainPolarizationHysteresis,
        place=AT_POLARIZATION,
        amplitude="polarization_lead",
        starts=_grid(
            polarization_lead=(1e-4,),
            turn_width=(0.003, 0.01, 0.03, 0.1, 0.3),
            spread_below=(0.3,),
            spread_above=(0.3,),
        ),
        free=("polarization_lead", "turn_width", "spread_below", "spread_above"),
        additive=("spread_below", "spread_above"),
        absence="a loop of displacement over polarization that does not depend on the rate",
        next_experiment="bipolar loops at two rates with polarization recorded: strain over P shows the loop",
    ),
    Effect(
        link=StrainPolarizationLag,
        place=AT_POLARIZATION,
        amplitude="lagging_share",
        starts=_grid(lagging_share=(1e-3,), play=(0.003, 0.01, 0.03, 0.1)),
        free=("lagging_share", "play"),
        needs=("polarization_C_per_m2",),
        absence="a loop of displacement over recorded polarization that does not depend on the rate, run through late",
        next_experiment="bipolar loops at two rates with polarization recorded: strain over P shows the loop",
        variant_of="strain_polarization_hysteresis",
    ),
    Effect(
        link=LoadStiffness,
        place=AT_DISPLACEMENT,
        amplitude="compliance",
        starts=_grid(compliance=(1e-10, 1e-9, 1e-8)),
        free=("compliance",),
        needs=("force_N",),
        absence="nothing: it is a gain, which the strain law takes up",
        next_experiment="the same run with and without the load, or with a second spring",
    ),
    Effect(
        link=CrossCoupling,
        place=AT_DISPLACEMENT,
        amplitude="coupling",
        starts=_grid(coupling=(1e-4,), bend=(-1e5, 0.0, 1e5)),
        free=("coupling", "bend"),
        needs=("neighbour_displacement_m",),
        absence="displacement that follows another axis of the stage, whatever its own drive does",
        next_experiment="a rest of this axis while the other one scans, with neighbour_displacement_m recorded",
    ),
    Effect(
        link=SlowRelaxation,
        place=AT_DISPLACEMENT,
        amplitude="share",
        starts=_starts(
            share=(1e-3,) * 6,
            shortest_time=(0.005, 0.05, 0.5, 5.0, 50.0, 0.1),
            longest_time=(0.05, 0.5, 5.0, 50.0, 500.0, 100.0),
        ),
        free=("share", "shortest_time", "longest_time"),
        details=("ends", "tilt"),
        absence="displacement that goes on in holds, in the direction it came from, by less and less per second",
        next_experiment="the same hold reached once from below and once from above: creep changes its sign",
    ),
    Effect(
        link=MechanicalResonance,
        place=AT_DISPLACEMENT,
        amplitude="share",
        starts=_grid(share=(1e-3,), frequency=_MODES, damping_ratio=(0.08,)),
        free=("share", "frequency", "damping_ratio"),
        absence="ringing after steps and turns, and a band of the spectrum about one frequency",
        next_experiment="a small step or a chirp sampled at ten times the suspected frequency",
    ),
    Effect(
        link=Leakage,
        place=AT_DISPLACEMENT,
        amplitude="areal_conductance",
        starts=_grid(areal_conductance=(1e-8, 1e-7, 1e-6)),
        free=("areal_conductance",),
        needs=("polarization_C_per_m2",),
        absence="recorded polarization that runs off in proportion to the mean voltage, while displacement does not",
        next_experiment="holds at two voltages of opposite sign with polarization recorded: leakage changes its sign",
    ),
    Effect(
        link=ThermalDrift,
        place=AT_SENSOR,
        amplitude="rate",
        starts=_grid(rate=(1e-10,), time_constant=(1e5, 100.0, 20.0, 4.0)),
        free=("rate", "time_constant", "expansion"),
        per_run=("rate",),
        linear=("rate", "expansion"),
        absence="a slow change of the displacement's zero, alike whatever the drive does",
        next_experiment="a rest at constant voltage as long as the run, or the same run with temperature_K recorded",
    ),
    Effect(
        link=ThermalExpansion,
        place=AT_SENSOR,
        amplitude="expansion",
        starts=_grid(expansion=(1e-10,)),
        free=("expansion",),
        needs=("temperature_K",),
        variant_of=ThermalDrift.kind,
        absence="a slow change of the displacement's zero that goes with the recorded temperature",
        next_experiment="a rest at constant voltage while the temperature is changed by some kelvin",
    ),
    Effect(
        link=ThermalLag,
        place=AT_SENSOR,
        amplitude="expansion",
        starts=_grid(expansion=(1e-9,), time_constant=(3.0, 10.0, 30.0, 100.0)),
        free=("expansion", "time_constant", "missing_expansion"),
        per_run=("missing_expansion",),
        linear=("expansion", "missing_expansion"),
        needs=("temperature_K",),
        variant_of=ThermalDrift.kind,
        absence="a slow change of the displacement's zero that comes after the recorded temperature",
        next_experiment="a rest at constant voltage while the temperature is changed by some kelvin",
    ),
    Effect(
        link=SensorNonlinearity,
        place=AT_SENSOR,
        amplitude="amplitude",
        starts=_grid(amplitude=(1e-4,), mix=(0.0, 0.25 * math.pi, 0.5 * math.pi, 0.75 * math.pi)),
        free=("amplitude", "mix", "quartic", "quintic", "sextic", "septic"),
        linear=("amplitude", "quartic", "quintic", "sextic", "septic"),
        spans=("centre", "range"),
        absence="an error that is a curve over the displacement, the same on both branches of a loop and at every rate",
        next_experiment="the same run with the sensor moved by half its range: the curve stays with the reading",
    ),
    Effect(
        link=SensorLag,
        place=AT_SENSOR,
        amplitude="lag",
        starts=_grid(lag=(1e-4, 5e-4, 2e-3, 1e-2), delay_share=(0.0, 1.0)),
        free=("lag", "delay_share"),
        absence="an error along the rate of the displacement: loops open in proportion to the frequency",
        next_experiment="a chirp or a step sampled at ten times the suspected corner, or a second frequency",
    ),
    Effect(
        link=MainsHum,
        place=AT_SENSOR,
        amplitude="sine",
        starts=_grid(sine=(1e-10,), frequency=(50.0, 60.0)),
        free=("detuning", *_TONES),
        per_run=_TONES,
        linear=_TONES,
        absence="a line in the spectrum at the frequency of the mains, in rest as well",
        next_experiment="a rest at constant voltage: the line stays, and moves with the mains",
        has_own_frequency=True,
    ),
)
"""In the order of the signal; several at one place stand in this order."""

EFFECT_OF: dict[str, Effect] = {effect.name: effect for effect in EFFECTS}


def reported(name: str) -> str:
    """As which a name is reported: variants of an effect share one, a shape of the base model has its own."""
    return EFFECT_OF[name].reported if name in EFFECT_OF else name
