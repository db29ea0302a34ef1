"""Effects that look alike on some records, and the experiment that tells them apart (diagnosis-methods.md 3.4)."""

from __future__ import annotations

_SHARP = "a chirp or a small step, sampled at ten times the suspected corner or faster"

_PAIRS: tuple[tuple[str, str, str], ...] = (
    (
        "sensor_lag",
        "amplifier_bandwidth",
        "Log the voltage at the ceramic; where that cannot be done, run"
        f" {_SHARP}: a lag before the ceramic smooths the hysteresis with it, a lag behind it does not.",
    ),
    ("sensor_lag", "mechanical_resonance", f"Run {_SHARP}: a mode overshoots, a lag does not."),
    ("amplifier_bandwidth", "mechanical_resonance", f"Run {_SHARP}: a mode overshoots, a lag does not."),
    (
        "amplifier_current_limit",
        "amplifier_bandwidth",
        "Run steps of two heights, one five times the other: with a limit the time to settle grows with the height.",
    ),
    (
        "amplifier_current_limit",
        "sensor_lag",
        "Run steps of two heights, one five times the other: with a limit the time to settle grows with the height.",
    ),
    (
        "sensor_lag",
        "slow_relaxation",
        "Run the same loop at a second frequency, ten times as high or as low: what a lag adds grows with the rate,"
        " creep hardly does.",
    ),
    (
        "amplifier_bandwidth",
        "slow_relaxation",
        "Run the same loop at a second frequency, ten times as high or as low: what a lag adds grows with the rate,"
        " creep hardly does.",
    ),
    (
        "sensor_lag",
        "sensor_nonlinearity",
        "Run the same amplitude at a fifth and at five times the frequency: the sensor's curve stays, what a lag adds"
        " grows with the rate.",
    ),
    (
        "slow_relaxation",
        "sensor_nonlinearity",
        "Run the same amplitude at a fifth and at five times the frequency: the sensor's curve stays, creep does not.",
    ),
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
