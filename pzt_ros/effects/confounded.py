"""Effects that look alike on some records, and the experiment that tells them apart (diagnosis-methods.md 3.4)."""

from __future__ import annotations

_SHARP = "small steps, short tall pulses and a chirp, sampled at ten times the suspected corner or faster"
_LATE = ("sensor_lag", "amplifier_bandwidth", "mechanical_resonance")
LATE = frozenset(_LATE)
"""Effects that make a reading late by a while: a density identified beside one of them is nearly right for all."""
LATE_OR_LIMITED = (*_LATE, "amplifier_current_limit")

_HEIGHTS = "Run steps of two heights, one five times the other: with a limit the time to settle grows with the height."
_RINGS = f"Run {_SHARP}: a mode overshoots, a lag does not."
_DECADES = "Run the same loop at three frequencies, a decade apart, and a step with a hold"
_LAG = f"{_DECADES}: what a lag adds grows with the rate"

_PAIRS: tuple[tuple[str, str, str], ...] = (
    (
        "sensor_lag",
        "amplifier_bandwidth",
        f"Log the voltage at the ceramic; where that cannot be done, run {_SHARP}: a short pulse switches less where"
        " the lag is before the ceramic, and all where it is behind.",
    ),
    ("sensor_lag", "mechanical_resonance", _RINGS),
    ("amplifier_bandwidth", "mechanical_resonance", _RINGS),
    ("amplifier_current_limit", "amplifier_bandwidth", _HEIGHTS),
    ("amplifier_current_limit", "sensor_lag", _HEIGHTS),
    ("amplifier_current_limit", "mechanical_resonance", _HEIGHTS),
    *((late, "slow_relaxation", f"{_LAG}, creep hardly does.") for late in LATE_OR_LIMITED),
    *((late, "sensor_nonlinearity", f"{_LAG}, the sensor's curve stays.") for late in LATE_OR_LIMITED),
    ("slow_relaxation", "sensor_nonlinearity", f"{_DECADES}: the sensor's curve stays, creep does not."),
    (
        "slow_relaxation",
        "thermal_drift",
        "Hold the same voltage twice for as long, reached once from below and once from above: creep changes its sign,"
        " drift does not.",
    ),
    (
        "polarization_fatigue",
        "thermal_drift",
        "Cycle, pause at constant voltage for as long, cycle again: fatigue stands still in the pause, drift goes on.",
    ),
    (
        "polarization_fatigue",
        "slow_relaxation",
        "Cycle, pause at constant voltage for as long, cycle again: fatigue stands still in the pause, creep does not.",
    ),
    (
        "polarization_fatigue",
        "bias_field",
        "Run a bipolar loop through saturation before and after many cycles: fatigue lowers both ends, a bias moves the"
        " loop along the voltage.",
    ),
    (
        "bias_field",
        "thermal_drift",
        "Rest for as long as the run at a voltage where the loop is flat: drift goes on there, a bias shows only where"
        " the loop is steep.",
    ),
    (
        "bias_field",
        "sensor_nonlinearity",
        "Run a bipolar loop, or the same loop about a second offset voltage: a bias stays with the voltage, the"
        " curve of the sensor with the reading.",
    ),
    (
        "bias_field",
        "strain_polarization_hysteresis",
        "Record the polarization over a bipolar loop: a bias moves it along the voltage, the strain's loop leaves it.",
    ),
    (
        "strain_polarization_hysteresis",
        "sensor_nonlinearity",
        "Run minor loops about two offsets: the sensor's curve is one for all, strain hysteresis opens each loop.",
    ),
    (
        "leakage",
        "thermal_drift",
        "Hold two voltages of opposite sign for as long each, with polarization recorded: leakage changes its sign.",
    ),
    (
        "sensor_nonlinearity",
        "strain_law",
        "Move the sensor by half its range and repeat the run, or measure with a second sensor: the strain law stays"
        " with the polarization, the sensor's curve with the reading.",
    ),
    (
        "load_stiffness",
        "strain_law",
        "Run the same drive with and without the load, or with a second spring of known stiffness: displacement alone"
        " cannot tell a load from the gain.",
    ),
    (
        "bias_field",
        "hysteresis_density",
        "Run bipolar loops of several amplitudes with polarization recorded, before and after a long rest: a skewed"
        " density is there at once and stays, a bias builds up.",
    ),
)

CONFOUNDED: dict[frozenset[str], str] = {frozenset((one, other)): experiment for one, other, experiment in _PAIRS}
"""Pair of names -> what to run next.

Beside effects there are `strain_law` and `hysteresis_density`: shapes of the base model that can take their place.
"""
