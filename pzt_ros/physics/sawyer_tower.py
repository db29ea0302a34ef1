"""The amplifier with what hangs on it: the ceramic, and in series the reference capacitor of Sawyer and Tower.

The charge that the ceramic takes decides over the current limit and over the reference capacitor's voltage, and both
decide over the voltage at the ceramic: within one sample each waits for the other. So this compiled function steps them
together, with a copy of the ceramic as the load (thesis 2.1.3; docs/decisions/0005).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload

from pzt_ros.errors import BenchError
from pzt_ros.physics import (
    front_kernel,
    parametrized_branch,
    parametrized_inverse,
    parametrized_kernel,
    parametrized_single_branch,
    parametrized_single_kernel,
    polycrystal_kernel,
)
from pzt_ros.physics.compiling import OUTER, WITHIN, copy_onto
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.front import Front
from pzt_ros.physics.front_shares import Fronts
from pzt_ros.physics.linear_response import lag_inverse, lag_step
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.parametrized_single import ParametrizedSingle
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.signals import Array
from pzt_ros.physics.switching import FIELD_LIMIT, INVERSE_TOLERANCE

NO_COMPENSATION, LAST, EXTRAPOLATED = 0, 1, 2

# State: time [s], input of the lag, its output, output of the amplifier [V]; with a load also the voltage across the
# ceramic [V], its P, P at rest [C/m^2], the capacitor's last two voltages [V], the last step [s], the change of the
# capacitor's voltage over that of the ceramic [-], then the state of the ceramic.
TIME, INPUT, LAGGED, OUTPUT = 0, 1, 2, 3
VOLTAGE, POLARIZATION, AT_REST, REFERENCE, REFERENCE_BEFORE, STEP, SHARE, HEAD = 4, 5, 6, 7, 8, 9, 10, 11

_TOLERANCE = 1e-9  # of the voltages around the loop [V]
_MOST_TRIALS = 60
_SAME_PERIOD = 1.001  # a step no longer than that many periods of the computer is one of its own


class Circuit(NamedTuple):
    """The numbers of the amplifier and of the measuring circuit; 0 stands for no lag, limit or capacitor.

    Attributes:
        gain: output over command [-].
        time_constant: of the lag [s].
        slew_rate, voltage, current, power: largest change [V/s], voltage [V], current [A] and power [W] of the output.
        elastance: 1/C_r of the reference capacitor [1/F].
        area: of the ceramic's electrodes [m^2].
        compensation: NO_COMPENSATION, LAST or EXTRAPOLATED.
        period: of the computer that compensates [s].
    """

    gain: float
    time_constant: float
    slew_rate: float
    voltage: float
    current: float
    power: float
    elastance: float
    area: float
    compensation: int
    period: float


@njit(cache=True, inline="always")
def _polycrystal_inverse(state, ceramic, time, p, voltage, x):  # type: ignore[no-untyped-def]
    limit = FIELD_LIMIT * ceramic.layer_thickness
    polycrystal_kernel.run_inverse(state, ceramic, time, p, voltage, x, limit, INVERSE_TOLERANCE)


@njit(cache=True, inline="always")
def _front_inverse(state, ceramic, time, p, voltage, x):  # type: ignore[no-untyped-def]
    limit = FIELD_LIMIT * ceramic.layer_thickness
    front_kernel.run_inverse(state, ceramic, time, p, voltage, x, limit, INVERSE_TOLERANCE)


class Compiled(NamedTuple):
    """How compiled code runs a kind of ceramic: the link's attribute with its numbers, their type, two functions."""

    link: type[Any]
    attribute: str
    numbers: type
    run: Any
    invert: Any


CERAMICS = (
    Compiled(Polycrystal, "elements", polycrystal_kernel.Elements, polycrystal_kernel.run, _polycrystal_inverse),
    Compiled(Front, "fronts", Fronts, front_kernel.run, _front_inverse),
    Compiled(
        Parametrized,
        "material",
        parametrized_branch.Material,
        parametrized_kernel.run,
        parametrized_inverse.run_inverse,
    ),
    Compiled(
        ParametrizedSingle,
        "material",
        parametrized_single_branch.Material,
        parametrized_single_kernel.run,
        parametrized_single_kernel.run_inverse,
    ),
)
"""Every ceramic that can be a load; a new one is one entry here."""


def compiled_form(load: Ferroelectric) -> Any:
    """The numbers of a ceramic as its compiled functions take them.

    Raises:
        BenchError: a ceramic that has none here.
    """
    for ceramic in CERAMICS:
        if isinstance(load, ceramic.link):
            return getattr(load, ceramic.attribute)
    raise BenchError(
        f"amplifier: '{load.kind}' cannot be its load; use lattice, quadrature, front, parametrized or"
        " parametrized_single"
    )


def ceramic_run(state: Array, ceramic: Any, time: Array, voltage: Array, p: Array, x: Array) -> None:
    """Voltage to polarization, whichever ceramic it is; only within compiled code."""
    raise NotImplementedError


def ceramic_invert(state: Array, ceramic: Any, time: Array, p: Array, voltage: Array, x: Array) -> None:
    """Polarization to voltage, whichever ceramic it is; only within compiled code."""
    raise NotImplementedError


def _entry(ceramic: Any) -> Compiled:
    """The ceramic whose numbers have that Numba type."""
    return next(entry for entry in CERAMICS if entry.numbers is ceramic.instance_class)


@overload(ceramic_run)
def _ceramic_run(state, ceramic, time, voltage, p, x):  # type: ignore[no-untyped-def]
    step = _entry(ceramic).run

    def run(state, ceramic, time, voltage, p, x):  # type: ignore[no-untyped-def]
        step(state, ceramic, time, voltage, p, x)

    return run


@overload(ceramic_invert)
def _ceramic_invert(state, ceramic, time, p, voltage, x):  # type: ignore[no-untyped-def]
    step_back = _entry(ceramic).invert

    def invert(state, ceramic, time, p, voltage, x):  # type: ignore[no-untyped-def]
        step_back(state, ceramic, time, p, voltage, x)

    return invert


@njit(**WITHIN)
def _usable(state: Array, time: float, value: float) -> bool:
    return time >= state[TIME] and math.isfinite(time) and math.isfinite(value)


@njit(**WITHIN)
def _output(state: Array, circuit: Circuit, step: float, demand: float) -> float:
    """What the amplifier puts out for a demand [V], before its load has a say: lag, window, slew limit."""
    if circuit.time_constant > 0.0:
        state[LAGGED] = lag_step(state[LAGGED], state[INPUT], demand, step, circuit.time_constant)
    else:
        state[LAGGED] = demand
    state[INPUT] = demand
    output = state[LAGGED]
    if circuit.voltage > 0.0:
        output = min(max(output, -circuit.voltage), circuit.voltage)
    if circuit.slew_rate > 0.0:
        most = circuit.slew_rate * step
        output = min(max(output, state[OUTPUT] - most), state[OUTPUT] + most)
    return output


@njit(**WITHIN)
def _demand(state: Array, circuit: Circuit, step: float, output: float) -> float:
    """The demand for which the lag gives `output` [V]; window and slew limit cannot be undone."""
    demand = output
    if circuit.time_constant > 0.0:
        demand = lag_inverse(output, state[LAGGED], state[INPUT], step, circuit.time_constant)
    state[INPUT], state[LAGGED], state[OUTPUT] = demand, output, output
    return demand


@njit(**OUTER)
def run_bare(state: Array, circuit: Circuit, time: Array, command: Array, voltage: Array) -> int:
    """Command to output voltage without a load; `state` moves in place. Returns the first unusable sample, else -1."""
    for k in range(time.size):
        if not _usable(state, time[k], command[k]):
            return k
        state[OUTPUT] = _output(state, circuit, time[k] - state[TIME], circuit.gain * command[k])
        state[TIME], voltage[k] = time[k], state[OUTPUT]
    return -1


@njit(**OUTER)
def invert_bare(state: Array, circuit: Circuit, time: Array, voltage: Array, command: Array) -> int:
    """Output voltage wanted to command; otherwise as `run_bare`."""
    for k in range(time.size):
        if not _usable(state, time[k], voltage[k]):
            return k
        command[k] = _demand(state, circuit, time[k] - state[TIME], voltage[k]) / circuit.gain
        state[TIME] = time[k]
    return -1


@njit(**WITHIN)
def _compensation(state: Array, circuit: Circuit, step: float) -> float:
    """What the computer adds to the drive: the capacitor's voltage as last measured, or led on to this sample [V]."""
    if circuit.compensation == NO_COMPENSATION:
        return 0.0
    if circuit.compensation == LAST or state[STEP] <= 0.0 or step > _SAME_PERIOD * circuit.period:
        return state[REFERENCE]
    return state[REFERENCE] + (state[REFERENCE] - state[REFERENCE_BEFORE]) * step / state[STEP]


@njit(**WITHIN)
def _lateness(circuit: Circuit, step: float) -> float:
    """The part of a step's change of U_r that the compensation does not know at its end [-].

    All of it where samples are the computer's own. Where they are further apart the computer measures in between, and
    is one period behind: with the extrapolation not even that.
    """
    if circuit.compensation == NO_COMPENSATION or step <= _SAME_PERIOD * circuit.period:
        return 1.0
    return circuit.period / step if circuit.compensation == LAST else 0.0


@njit(**WITHIN)
def _measured(state: Array, circuit: Circuit, time: float, voltage: float, polarization: float) -> None:
    """Keep what a sample ends with."""
    reference = circuit.elastance * circuit.area * (polarization - state[AT_REST])
    known = (1.0 - _lateness(circuit, time - state[TIME])) * (reference - state[REFERENCE])
    state[INPUT] += known
    state[LAGGED] += known
    state[REFERENCE_BEFORE], state[REFERENCE] = state[REFERENCE], reference
    state[STEP], state[TIME] = time - state[TIME], time
    state[VOLTAGE], state[POLARIZATION], state[OUTPUT] = voltage, polarization, voltage + reference


@njit(**WITHIN)
def _shared_out(state, elastance, area, ceramic, trial, one, available):  # type: ignore[no-untyped-def]
    """Voltage of the ceramic and its polarization when it shares `available` [V] with a capacitor empty so far.

    The share that the capacitor takes is nearly the same from sample to sample, so that two or three trials do.
    """
    time, v, p, x = one
    share = state[SHARE]
    voltage = (available + share * state[VOLTAGE]) / (1.0 + share)
    before, voltage_before = 0.0, 0.0
    for n in range(_MOST_TRIALS):
        copy_onto(trial, state[HEAD:])
        v[0] = voltage
        ceramic_run(trial, ceramic, time, v, p, x)
        taken = elastance * area * (p[0] - state[POLARIZATION])
        miss = voltage + taken - available
        if abs(miss) <= _TOLERANCE * (1.0 + share):
            break
        if n > 0 and abs(voltage - voltage_before) > 1e3 * _TOLERANCE:
            share = max((taken - before) / (voltage - voltage_before), 0.0)
        before, voltage_before = taken, voltage
        voltage -= miss / (1.0 + share)
    state[SHARE] = share
    return voltage, p[0]


@njit(**OUTER)
def run_loaded(state, circuit, ceramic, time, command, voltage):  # type: ignore[no-untyped-def]
    """Command to the voltage across the ceramic; `state` moves in place. Returns the first unusable sample, else -1.

    Where the charge of a sample would take more than the current or power limit, the ceramic gets the charge that the
    limit allows: its own inverse says at which voltage.
    """
    trial = np.empty(state.size - HEAD)
    one = (np.empty(1), np.empty(1), np.empty(1), np.empty(1))
    for k in range(time.size):
        if not _usable(state, time[k], command[k]):
            return k
        step = time[k] - state[TIME]
        demand = circuit.gain * command[k] + _compensation(state, circuit, step)
        output = _output(state, circuit, step, demand)
        one[0][0] = time[k]
        elastance = circuit.elastance * _lateness(circuit, step)
        v, p = _shared_out(state, elastance, circuit.area, ceramic, trial, one, output - state[REFERENCE])
        most = circuit.current if circuit.current > 0.0 else math.inf
        if circuit.power > 0.0:
            most = min(most, circuit.power / max(abs(output), 1e-3))
        way = p - state[POLARIZATION]
        if abs(way) * circuit.area > most * step:
            p = state[POLARIZATION] + math.copysign(most * step / circuit.area, way)
            copy_onto(trial, state[HEAD:])
            one[2][0] = p
            ceramic_invert(trial, ceramic, one[0], one[2], one[1], one[3])
            v = one[1][0]
        copy_onto(state[HEAD:], trial)
        _measured(state, circuit, time[k], v, p)
        voltage[k] = v
    return -1


@njit(**OUTER)
def invert_loaded(state, circuit, ceramic, time, voltage, command):  # type: ignore[no-untyped-def]
    """Voltage wanted across the ceramic to command; otherwise as `run_loaded`. Limits cannot be undone."""
    p, x = np.empty(1), np.empty(1)
    for k in range(time.size):
        if not _usable(state, time[k], voltage[k]):
            return k
        step = time[k] - state[TIME]
        ceramic_run(state[HEAD:], ceramic, time[k : k + 1], voltage[k : k + 1], p, x)
        taken = circuit.elastance * _lateness(circuit, step) * circuit.area * (p[0] - state[POLARIZATION])
        compensation = _compensation(state, circuit, step)
        demand = _demand(state, circuit, step, voltage[k] + taken + state[REFERENCE])
        command[k] = (demand - compensation) / circuit.gain
        _measured(state, circuit, time[k], voltage[k], p[0])
    return -1


@njit(**OUTER)
def _run_discharge(state, resistance, area, ceramic, time, voltage, polarization):  # type: ignore[no-untyped-def]
    """A resistor R takes in a step h what a capacitor of h/R takes that is empty at each sample's start."""
    trial = np.empty(state.size - HEAD)
    one = (np.empty(1), np.empty(1), np.empty(1), np.empty(1))
    for k in range(time.size):
        if not _usable(state, time[k], 0.0):
            return k
        step = time[k] - state[TIME]
        if step > 0.0:
            one[0][0] = time[k]
            v, p = _shared_out(state, resistance / step, area, ceramic, trial, one, 0.0)
            copy_onto(state[HEAD:], trial)
            state[TIME], state[VOLTAGE], state[POLARIZATION] = time[k], v, p
        voltage[k], polarization[k] = state[VOLTAGE], state[POLARIZATION]
    return -1


def discharge(
    load: Ferroelectric, memory: Array, start: tuple[float, float, float], time: Array, resistance: float = 10e3
) -> tuple[Array, Array, Array]:
    """A ceramic that is left alone with a resistor across it, as the thesis' relays do (2.1.3; 10 kOhm).

    The charge leaves at the mean current of each sample step (backward Euler), so samples set the accuracy.

    Args:
        load, memory: the ceramic and its state.
        start: time [s], voltage [V] and polarization [C/m^2] of the last sample before.
        time: sample times [s].
        resistance: [ohm].

    Returns:
        the ceramic's state after, its voltage [V] and polarization [C/m^2].

    Raises:
        BenchError: time that runs back, or a ceramic that cannot be run here.
    """
    head = np.zeros(HEAD)
    head[[TIME, VOLTAGE, POLARIZATION]] = start
    state = np.concatenate((head, memory))
    voltage, polarization = np.empty_like(time), np.empty_like(time)
    numbers = compiled_form(load)
    bad = _run_discharge(state, resistance, load.electrode_area, numbers, time, voltage, polarization)
    if bad >= 0:
        raise BenchError(f"discharge: time {time[bad]:.9g} s at sample {bad} is not after the one before; sort it")
    return state[HEAD:], voltage, polarization
