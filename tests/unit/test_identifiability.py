"""Which runs cannot tell which effects apart, from the drive alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pzt_ros.diagnosis.identifiability import alike_by_design, with_loads
from pzt_ros.diagnosis.remarks import of_names
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record

TIME = np.arange(0.0, 4.0, 1e-3)
LATE = {"sensor_lag", "amplifier_bandwidth", "mechanical_resonance", "slow_relaxation"}
IN_LOOP = frozenset({*LATE, "sensor_nonlinearity", "strain_polarization_hysteresis"})
SLOW = frozenset({"slow_relaxation", "thermal_drift", "bias_field"})


def record(voltage: Array) -> Record:
    return Record("run", {"time_s": TIME[: voltage.size], "voltage_V": voltage})


def sine(frequency: float = 7.0, amplitude: float = 40.0) -> Array:
    return 60.0 + amplitude * np.sin(2.0 * np.pi * frequency * TIME + 0.3)


def step(level: float = 100.0, back: float = 0.0) -> Array:
    return level * np.clip(TIME - 0.5, 0.0, 1.0) - back * np.clip(TIME - 2.5, 0.0, 1.0)


@pytest.mark.parametrize(
    ("voltages", "groups"),
    [
        ((sine(), sine()[:2500]), (IN_LOOP,)),
        ((sine(), sine(frequency=9.0)), ()),
        ((sine(), sine(amplitude=30.0)), ()),
        ((sine() + sine(frequency=11.0, amplitude=15.0),), ()),
        ((sine()[:200],), ()),  # not even two cycles
        ((step(), step(80.0)), (SLOW,)),
        ((-step(), step()), (SLOW,)),
        ((step(), step(back=50.0)), ()),
        ((step() + 0.1 * np.sin(300.0 * TIME),), (SLOW,)),  # what a reading of the voltage adds is no way back
        ((step(), sine()), ()),
    ],
)
def test_effects_that_a_drive_cannot_tell_apart(
    voltages: tuple[Array, ...], groups: tuple[frozenset[str], ...]
) -> None:
    found = alike_by_design([record(voltage) for voltage in voltages])
    assert tuple(each.effects for each in found) == groups
    assert all(each.remark for each in found)


@pytest.mark.parametrize("has_force", [False, True])
def test_a_load_may_be_what_a_curve_and_a_strain_law_explain_unless_a_force_was_recorded(has_force: bool) -> None:
    """An examiner's contact that was lost below half the stroke was a curve or a strain law, and no load."""
    time = np.linspace(0.0, 1.0, 11)
    columns = {"time_s": time, "voltage_V": time, "displacement_m": time} | ({"force_N": time} if has_force else {})
    run: Any = SimpleNamespace(record=Record("a.csv", columns))
    load = () if has_force else ("load_stiffness",)
    open_ones = [("sensor_nonlinearity", "strain_law"), ("sensor_nonlinearity", "bias_field")]
    assert with_loads(open_ones, [run.record]) == ((*open_ones[0], *load), open_ones[1])
    assert ["force_N" in remark for remark in of_names(["sensor_nonlinearity"], [run])] == [True] * (not has_force)
    assert of_names(["sensor_lag"], [run]) == []
