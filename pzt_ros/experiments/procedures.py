"""The thesis' experiments: five steps around one family of loops (thesis 2.2.1 and appendix B).

One description, two uses: the phases go into a scenario for the graph, and the drive made of the same phases into an
offline simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.experiments.phases import VoltageRamp
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import to_si

POLING_VOLTAGE = 150.0
LOWEST_VOLTAGE = -40.0
"""Ends of the actuator range [V]; further down the stack is poled the other way."""

MOST_VOLTAGE = 150.0
"""No experiment goes beyond, up or down [V]: a stack broke after some time at 200 V (thesis 2.1.1)."""

LAYER_THICKNESS = 1e-4  # of the thesis' stack [m]; turns a rate in kV/mm/s into one in V/s

RAMP_TIME, HOLD_TIME = 5.0, 10.0  # [s]
HALF_SINE, LINEAR = "half-sine", "linear"
FORMS = (HALF_SINE, LINEAR)

SAMPLES_PER_LEG, SLOWEST_SAMPLING, FASTEST_SAMPLING = 200.0, 1e3, 20e3
LEAST_PER_LEG, MOST_SAMPLING = 10.0, 1e6
_ROWS = 100_000


@dataclass(frozen=True)
class Family:
    """One kind of experiment: where the voltage turns, as a function of the reversal voltage [V].

    Attributes:
        description: for people.
        turns: the voltages it goes to one after the other, from 150 V; the last one is held.
        reversals: reversal voltages of the thesis [V], the first one by default; empty where there is none.
    """

    description: str
    turns: Callable[[float], tuple[float, ...]]
    reversals: tuple[float, ...] = ()


FAMILIES: dict[str, Family] = {
    "full-loop": Family("150 to -150 V and back", lambda rev: (-POLING_VOLTAGE, POLING_VOLTAGE)),
    "type1": Family(
        "down to the reversal voltage and back to 150 V",
        lambda rev: (rev, POLING_VOLTAGE),
        (-40.0, -20.0, 0.0, 20.0, 50.0, 100.0),
    ),
    "type2": Family(
        "down to -40 V, up to the reversal voltage and back to -40 V",
        lambda rev: (LOWEST_VOLTAGE, rev, LOWEST_VOLTAGE),
        (-20.0, 0.0, 20.0, 50.0, 100.0, 150.0),
    ),
    "type3": Family(
        "down to the reversal voltage, a loop of 50 V upwards",
        lambda rev: (rev, rev + 50.0, rev),
        (-40.0, -20.0, 0.0, 20.0, 50.0, 100.0),
    ),
    "type4": Family(
        "down to -40 V, up to the reversal voltage, a loop of 50 V downwards",
        lambda rev: (LOWEST_VOLTAGE, rev, rev - 50.0, rev),
        (20.0, 50.0, 100.0, 150.0),
    ),
    "relaxation": Family(
        "down to the reversal voltage, which is held", lambda rev: (rev,), (-20.0, -40.0, 0.0, 20.0, 50.0, 100.0)
    ),
}
"""Every named experiment; a new one is one entry here."""

# Table 2.2: the fastest drives at which the amplifier was reliable, sines in Hz and straight lines in V/s
_SAFE = {"full": {HALF_SINE: 1.0, LINEAR: 100.0}, "actuator": {HALF_SINE: 100.0, LINEAR: 1e4}}
_UNIT = {HALF_SINE: "Hz", LINEAR: "V/s"}


@dataclass(frozen=True)
class Procedure:
    """One experiment with its numbers; `procedure` reads it from text and checks it.

    Attributes:
        family: name in FAMILIES.
        form: how the voltage goes from turn to turn, half-sine or linear.
        rate: cycles per second of the half-sines [Hz], or slope of the straight lines [V/s].
        reversal: the reversal voltage [V]; NaN for a family that has none.
    """

    family: str
    form: str
    rate: float
    reversal: float

    @property
    def turns(self) -> tuple[float, ...]:
        """The voltages at which the experiment turns, the last one held [V]."""
        return FAMILIES[self.family].turns(self.reversal)

    def phases(self) -> tuple[VoltageRamp, ...]:
        """Poling within 5 s, 10 s hold, the experiment, 10 s hold at its last voltage, 5 s back to 0 V."""
        last = self.turns[-1]
        legs, voltage = [], POLING_VOLTAGE
        for turn in self.turns:
            if turn != voltage:
                legs.append(VoltageRamp(to=turn, duration=self._duration(turn - voltage), shape=self.form))
            voltage = turn
        return (
            VoltageRamp(to=POLING_VOLTAGE, duration=RAMP_TIME),
            VoltageRamp(to=POLING_VOLTAGE, duration=HOLD_TIME),
            *legs,
            VoltageRamp(to=last, duration=HOLD_TIME),
            VoltageRamp(to=0.0, duration=RAMP_TIME),
        )

    def sampling(self, rate: Any = None) -> float:
        """A sample rate [Hz] from text such as `20 kHz`; by default 200 samples a leg, from 1 to the thesis' 20 kHz.

        Raises:
            BenchError: not a frequency, or too few samples to show the experiment, or more than a machine can hold.
        """
        shortest = min(phase.duration for phase in self.phases())
        if rate is None:
            return min(max(SAMPLES_PER_LEG / shortest, SLOWEST_SAMPLING), FASTEST_SAMPLING)
        value = to_si(rate, "Hz", f"{self.family}: sample rate")
        least, most = LEAST_PER_LEG / shortest, MOST_SAMPLING
        if not least <= value <= most:
            raise BenchError(
                f"{self.family}: a sample rate of {value:g} Hz is outside {least:g} to {most:g} Hz, the lower one for"
                f" {LEAST_PER_LEG:g} samples in the shortest leg of {shortest:g} s; choose one between"
            )
        return value

    def drive(self, sample_rate: float) -> Iterator[tuple[Array, Array]]:
        """Blocks of times [s] and voltages [V] from 0 s and 0 V on, every turn among the samples."""
        return drive_of(self.phases(), sample_rate)

    @property
    def warning(self) -> str:
        """What to know before the real stack is driven so; empty where Table 2.2 has no objection."""
        kind = "full" if min(self.turns) < LOWEST_VOLTAGE else "actuator"
        safe, unit = _SAFE[kind][self.form], _UNIT[self.form]
        if self.rate <= safe * (1.0 + 1e-9):
            return ""
        return (
            f"{self.family}: {self.rate:g} {unit} is beyond the {safe:g} {unit} at which the amplifier was reliable"
            f" over the {kind} range (thesis, table 2.2); the model may be asked, a real stack should not"
        )

    def _duration(self, way: float) -> float:
        return 0.5 / self.rate if self.form == HALF_SINE else abs(way) / self.rate


def procedure(family: str, rate: Any = None, form: str | None = None, reversal: Any = None) -> Procedure:
    """An experiment from text with units, as the command line and a scenario give it.

    Args:
        family: name in FAMILIES.
        rate: frequency such as `0.1 Hz`, or slope such as `1 kV/mm/s` or `100 V/s`; 0.1 Hz or 0.1 kV/mm/s by default.
        form: half-sine or linear; by default what the rate's unit says.
        reversal: reversal voltage such as `-20 V`; the family's first one by default.

    Raises:
        BenchError: no such family or form, a rate of the wrong kind, a voltage that breaks stacks.
    """
    if family not in FAMILIES:
        raise BenchError(f"no experiment '{family}'; there are {', '.join(FAMILIES)}")
    if form is not None and form not in FORMS:
        raise BenchError(f"{family}: no form '{form}'; there are {', '.join(FORMS)}")
    form, value = _rate(family, rate, form)
    chosen = Procedure(family, form, value, _reversal(family, reversal))
    beyond = max(chosen.turns, key=abs)
    if abs(beyond) > MOST_VOLTAGE:
        raise BenchError(
            f"{family}: reversal {chosen.reversal:g} V leads to {beyond:g} V, the limit is +-{MOST_VOLTAGE:g} V"
            " (stacks break down at 200 V); choose a reversal voltage further in"
        )
    return chosen


def _rate(family: str, rate: Any, form: str | None) -> tuple[str, float]:
    """Form and rate in Hz or V/s."""
    if rate is None:
        rate = "0.1 kV/mm/s" if form == LINEAR else "0.1 Hz"
    where = f"{family}: rate"
    frequency, slope, voltage_slope = (_read(rate, unit, where) for unit in ("Hz", "V/m/s", "V/s"))
    if frequency is not None:
        found, value = HALF_SINE, frequency
    elif slope is not None:
        found, value = LINEAR, slope * LAYER_THICKNESS
    elif voltage_slope is not None:
        found, value = LINEAR, voltage_slope
    else:
        raise BenchError(f"{where}: {rate!r} is neither a frequency nor a slope; write it like '0.1 Hz' or '1 kV/mm/s'")
    if form is not None and form != found:
        example = "0.1 Hz" if form == HALF_SINE else "1 kV/mm/s"
        raise BenchError(f"{where}: {rate!r} does not fit the form {form}; write it like '{example}'")
    if not value > 0.0:
        raise BenchError(f"{where}: {rate!r} is not above 0; the experiment would never end")
    return found, value


def _read(value: Any, unit: str, where: str) -> float | None:
    """The value in SI, or None if it is not of that unit's kind."""
    try:
        return to_si(value, unit, where)
    except BenchError:
        return None


def _reversal(family: str, reversal: Any) -> float:
    known = FAMILIES[family].reversals
    if not known:
        if reversal is not None:
            raise BenchError(f"{family}: takes no reversal voltage, it turns at +-{POLING_VOLTAGE:g} V; leave it out")
        return float("nan")
    return known[0] if reversal is None else to_si(reversal, "V", f"{family}: reversal")


def phases_of(entry: Mapping[str, Any], where: str) -> tuple[VoltageRamp, ...]:
    """The phases for a scenario's line `{experiment: type1, rate: 1 Hz, form: half-sine, reversal: -20 V}`.

    Raises:
        BenchError: unknown key, or as `procedure`.
    """
    for key in entry:
        if key not in ("experiment", "rate", "form", "reversal"):
            raise BenchError(f"{where}: unknown key {key!r}; known are experiment, rate, form, reversal")
    try:
        chosen = procedure(str(entry["experiment"]), entry.get("rate"), entry.get("form"), entry.get("reversal"))
    except BenchError as error:
        raise BenchError(f"{where}: {error}") from None
    return chosen.phases()


def drive_of(phases: Sequence[VoltageRamp], sample_rate: float) -> Iterator[tuple[Array, Array]]:
    """Blocks of times [s] and voltages [V] of voltage phases one after the other, from 0 s and 0 V on.

    Samples lie a period apart, and the end of each phase is one more: no turn is cut off between two samples.
    """
    begin, voltage = 0.0, 0.0
    yield np.array([begin]), np.array([voltage])
    for phase in phases:
        first, after = _samples_inside(begin, phase.length, sample_rate)
        for low in range(first, after, _ROWS):
            time = np.arange(low, min(low + _ROWS, after)) / sample_rate
            yield time, phase.value(voltage, time - begin)
        begin, voltage = begin + phase.length, phase.to
        yield np.array([begin]), np.array([voltage])


def _samples_inside(begin: float, length: float, sample_rate: float) -> tuple[int, int]:
    """First sample after `begin`, and the first not before its end, both with a margin for rounding."""
    margin = 1e-6
    first = int(np.floor(begin * sample_rate + margin)) + 1
    return first, int(np.ceil((begin + length) * sample_rate - margin))
