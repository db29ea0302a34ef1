"""The experiments of chapter 2 on a simulated actuator, with all instruments that its chain has."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from pzt_ros.chains import load_chain
from pzt_ros.experiments.procedures import Procedure, procedure
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import ACTUATOR, AMPLIFIER, SENSOR
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_hysteresis import StrainHysteresis

ACTUATOR_CHAIN = "p802"
SEED = 1
_POLING = 2  # phases before the experiment: to 150 V, hold


@dataclass(frozen=True, eq=False)
class Record:
    """What is recorded of an experiment: steps 3 and 4 of the procedure, from 1.5 kV/mm to the end of the hold.

    Attributes:
        time: from the beginning of step 3 [s], shape (n,).
        field: across the ceramic [kV/mm].
        polarization: [C/m^2].
        strain: of the stack [%].
        reading: the strain as the displacement sensor reads it [%]; the strain itself where the chain has no sensor.
        current: that charges the ceramic [mA].
        ends: sample at which each leg ends, the hold last.
    """

    time: Array
    field: Array
    polarization: Array
    strain: Array
    reading: Array
    current: Array
    ends: tuple[int, ...]

    def leg(self, number: int) -> slice:
        """The samples of a leg from turn to turn, 0 for the first; the turns belong to both legs."""
        ends = (0, *self.ends)
        number = number % len(self.ends)
        return slice(ends[number], ends[number + 1] + 1)

    @property
    def driven(self) -> slice:
        """All but the hold."""
        return slice(0, self.ends[-2] + 1)

    @property
    def hold(self) -> slice:
        """The hold at the end."""
        return self.leg(-1)


@functools.cache
def experiment(
    family: str, rate: str, reversal: float | None = None, chain: str = ACTUATOR_CHAIN, samples: int = 200
) -> Record:
    """Run an experiment of chapter 2 on a shipped chain.

    Args:
        family: name in `FAMILIES`.
        rate: such as `0.1 Hz` or `0.1 kV/mm/s`.
        reversal: reversal field [kV/mm].
        chain: name of the chain.
        samples: per leg, and per hold, where they lie denser at the beginning.
    """
    volts = None if reversal is None else f"{100 * reversal:g} V"
    chosen = procedure(family, rate, reversal=volts)
    time, voltage, ends = _drive(chosen, samples)
    return _record(load_chain(chain), time, voltage, ends)


def _drive(chosen: Procedure, samples: int) -> tuple[Array, Array, list[int]]:
    """Times [s], command voltages [V] and the last sample of each phase, without the way back to 0 V."""
    time, voltage, ends = [0.0], [0.0], []
    for phase in chosen.phases()[:-1]:
        at_rest = phase.to == voltage[-1]
        parts = np.geomspace(1e-4, 1.0, samples) if at_rest else np.arange(1, samples + 1) / samples
        values = phase.value(voltage[-1], phase.length * parts)
        time, voltage = [*time, *(time[-1] + phase.length * parts)], [*voltage, *values]
        ends.append(len(time) - 1)
    return np.array(time), np.array(voltage), ends


def _record(chain: Chain, time: Array, voltage: Array, ends: list[int]) -> Record:
    mechanics, sensor = chain.section(AMPLIFIER, ACTUATOR), chain.section(SENSOR)
    rest = Rest(seed=SEED)
    _, moved = mechanics.step(mechanics.init(rest), Signals(time, voltage))
    _, read = sensor.step(sensor.init(rest), moved)
    ceramic = next(link for link in chain.links if isinstance(link, Ferroelectric))
    stack = next(link for link in chain.links if isinstance(link, (Electrostriction, StrainHysteresis)))
    begin = ends[_POLING - 1]
    charge = ceramic.electrode_area * moved.polarization[begin:]
    percent = 100.0 / stack.active_length
    return Record(
        time=time[begin:] - time[begin],
        field=moved.voltage[begin:] / ceramic.layer_thickness / 1e6,
        polarization=moved.polarization[begin:],
        strain=percent * moved.displacement[begin:],
        reading=percent * read.displacement[begin:],
        current=1e3 * np.gradient(charge, time[begin:]),
        ends=tuple(end - begin for end in ends[_POLING:]),
    )


def crossing(x: Array, y: Array, level: float = 0.0) -> float:
    """The x at which y first passes `level`, linear between samples."""
    passed = np.flatnonzero(np.diff(np.sign(y - level)) != 0)
    if passed.size == 0:
        return float("nan")
    k = int(passed[0])
    return float(x[k] + (level - y[k]) * (x[k + 1] - x[k]) / (y[k + 1] - y[k]))


def steepest(record: Record, leg: int) -> float:
    """The field at which the polarization changes fastest over a leg [kV/mm]."""
    part = record.leg(leg)
    slope = np.gradient(record.polarization[part], record.field[part])[1:-1]  # next to a turn dE is next to 0
    moved = np.abs(np.diff(record.field[part]))[1:] > 0.2 * np.max(np.abs(np.diff(record.field[part])))
    return float(record.field[part][1:-1][np.argmax(np.where(moved, slope, 0.0))])


def mean_gap(record: Record, values: Array, first: int, second: int) -> float:
    """How far apart two legs there and back are at the same field, on average [unit of `values`]."""
    there, back = record.leg(first), record.leg(second)
    sign = 1.0 if record.field[there][-1] > record.field[there][0] else -1.0
    field = np.linspace(record.field[there][0], record.field[there][-1], 200)
    out = np.interp(sign * field, sign * record.field[there], values[there])
    home = np.interp(-sign * field, -sign * record.field[back], values[back])
    return float(np.mean(np.abs(out - home)))


def rms_apart(first: Array, second: Array) -> float:
    """RMS difference of two curves, sample by sample, over the span of the first [%]."""
    return float(100.0 * np.sqrt(np.mean((first - second) ** 2)) / np.ptp(first))
