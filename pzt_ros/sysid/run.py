"""One measured run as a fit sees it: the part that counts, and the chain run over it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pzt_ros.errors import BenchError
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.chain import Chain, ChainState
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import Link, State
from pzt_ros.physics.loaded import Loaded
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.records import Record
from pzt_ros.sysid.fading import fading_course

CHUNK = 250_000
"""Samples that run through a chain at once; bounds the memory that long records take."""

_AT_REST, _NOT_AN_OFFSET, _NOT_ZERO = 0.02, 0.01, 1e-3  # of the largest voltage
FIRST = 10
"""Samples that say whether a run begins driven."""


@dataclass(frozen=True)
class Span:
    """A part of a record by time [s]; None means from its start, or to its end."""

    start: float | None = None
    end: float | None = None

    def of(self, record: Record) -> tuple[int, int]:
        """Indices of its first sample and of the one after its last.

        Raises:
            BenchError: fewer than two samples lie in it.
        """
        start = record.time[0] if self.start is None else self.start
        end = record.time[-1] if self.end is None else self.end
        part = record.between(start, end)
        first = int(np.searchsorted(record.time, part.time[0]))
        return first, first + len(part)


@dataclass(frozen=True)
class Start:
    """What happened before the first sample, and where the zero of the displacement is.

    From the chain's own initial state at 0 V the drive goes through `prior_voltages`, each in `leg` seconds, and on to
    the first sample in as long a leg, or in `approach`. Without any, it comes to the first sample's voltage directly.

    Attributes:
        prior_voltages: reversal points of the voltage before the first sample [V].
        leg: duration of each ramp [s].
        offset: reading at zero displacement of the chain [m].
        occupancy: x+ at the first sample on the grid of an identified lattice; empty for its own initial state.
        values: parameters that belong to this run and not to the stage [SI], by `link.parameter`.
        fading: what dies out after the first sample [m], by `fading_course`; none where nothing does.
        approach: from the last reversal to the first sample where that is no leg [s]: a faster ramp, or a leg and a
            wait. Inside minor loops all that follows remembers how far the ceramic had come to rest.
    """

    prior_voltages: tuple[float, ...] = ()
    leg: float = 1.0
    offset: float = 0.0
    occupancy: tuple[float, ...] = ()
    values: tuple[tuple[str, float], ...] = ()
    fading: tuple[float, ...] = ()
    approach: float | None = None

    @property
    def unknowns(self) -> int:
        """How many numbers a search or a fit finds of the history: its reversals, and its approach if it has one."""
        return len(self.prior_voltages) + (self.approach is not None)

    @property
    def without_reading(self) -> Start:
        """The same without what only the reading has: offset, and what dies out."""
        return replace(self, offset=0.0, fading=())

    def reading(self, time: Array, begin: float) -> Array:
        """What a reading has beyond the chain's displacement at some times [s, shape (n,)] of a run that begins [s].

        Returns:
            Offset, and what dies out [m, shape (n,)].
        """
        return self.offset + fading_course(time, begin, self.fading)

    def __str__(self) -> str:
        if self.occupancy:
            return "a fitted occupancy"
        begins = "the chain's own initial state"
        if self.prior_voltages:
            begins = "prior reversals at " + ", ".join(f"{v:.4g}" for v in self.prior_voltages) + " V"
        return begins if self.approach is None else f"{begins}, left {self.approach:.3g} s before"


def begins_driven(record: Record) -> bool:
    """Whether the voltage is up already at the first sample, by 2 % of its peak, or on its way to 0 V there.

    The record then has a past. A start at 0 V that is recorded some samples late moves away from there as fast as it
    had come; one that stands where it begins, by a percent, was there before.
    """
    early = record.voltage[:FIRST] * np.sign(record.voltage[0])
    first, last = float(early[0]), float(early[-1])
    peak = float(np.max(np.abs(record.voltage)))
    falls = bool(np.all(np.diff(early) < 0.0))  # noise would not, so often in a row
    passes = first > _NOT_ZERO * peak and (last < 0.0 or falls)
    stands = first > _NOT_AN_OFFSET * peak and first > abs(last - first)
    return first > _AT_REST * peak or passes or stands


def usual_past(starts: Sequence[Start], driven: Sequence[bool]) -> Start:
    """History of a run from rest that was not fitted: of the last fitted one from rest, or the reversals of the first.

    What a stage goes through it keeps: one that had never been driven before the first of them had been before others.

    Args:
        starts: of the fitted runs, in the order in which they were taken.
        driven: which of them begin driven; what was before such a run says little of one from rest.
    """
    from_rest = [start for start, begins in zip(starts, driven, strict=True) if not begins]
    if not from_rest:
        return Start(starts[0].prior_voltages)
    return Start(from_rest[-1].prior_voltages, from_rest[-1].leg, approach=from_rest[-1].approach)


def first_half(samples: int) -> int:
    """How many of so many samples tell: the past of a run that begins driven, and what a diagnosis chooses by."""
    return samples // 2


def typical_leg(record: Record) -> float:
    """How long the run takes on average to cross its range of voltage [s]; prior legs are as long."""
    travel = float(np.sum(np.abs(np.diff(record.voltage))))
    span = float(np.ptp(record.voltage))
    duration = float(record.time[-1] - record.time[0])
    return duration * span / travel if travel > 0.0 else duration


def prepared_drive(record: Record, start: Start, gain: float = 1.0) -> tuple[Rest, Signals]:
    """Rest, and the drive before the first sample, behind a gain [-].

    A run that starts at 0 V without a prior history rests there: its first step has no length.
    """
    return drive_before(float(record.time[0]), gain * float(record.voltage[0]), start, gain)


def drive_before(first_time: float, first_voltage: float, start: Start, gain: float = 1.0) -> tuple[Rest, Signals]:
    """The same for a run that begins at some time [s] with some voltage across the ceramic [V]."""
    nothing = Signals(time=np.empty(0), voltage=np.empty(0))
    if start.occupancy:
        return Rest(time=first_time, voltage=first_voltage, occupancy=np.array(start.occupancy)), nothing
    if not start.prior_voltages and first_voltage == 0.0:
        return Rest(time=first_time), nothing
    approach = start.leg if start.approach is None else start.approach
    left, arrived = first_time - approach, first_time - max(approach - start.leg, 0.0)
    legs = len(start.prior_voltages)
    times = left - start.leg * np.arange(legs - 1, -1, -1.0)
    before = Signals(time=times, voltage=gain * np.array(start.prior_voltages))
    if arrived < first_time:
        before = Signals(time=np.append(times, arrived), voltage=np.append(before.voltage, first_voltage))
    return Rest(time=left - start.leg * legs), before


def free_run(chain: Chain, record: Record, start: Start, picks: NDArray[np.intp] | slice, end: int) -> Signals:
    """What the chain says over the recorded voltage, never looking at the measurement.

    The chain runs over every sample up to index `end`, `picks` says at which ones its signals are kept.

    Raises:
        BenchError: the chain gives no displacement, or none that is finite.
    """
    chain = with_own_values(chain, start)
    state = begun(chain.links, record, start)
    kept: list[Signals] = []
    wanted = np.zeros(len(record), dtype=bool)
    wanted[picks] = True
    for low in range(0, end, CHUNK):
        part = slice(low, min(low + CHUNK, end))
        state, out = chain.step(state, drive_of(record, part))
        kept.append(_pick(out, wanted[part]))
    joined = _joined(kept, chain)
    reading = start.reading(joined.time, float(record.time[0]))
    return joined.replace(displacement=joined.displacement + reading)


def begun(links: Sequence[Link], record: Record, start: Start) -> ChainState:
    """The states at the first sample, one a link: the ceramic and what carries it with the history, others at rest.

    Those that follow turns have gone there with the ceramic. A history is reversals of the voltage as it was recorded,
    which only the amplifier takes to the ceramic: what effects made of a command that nobody knows it does not say.
    """
    at_first = Rest(time=float(record.time[0]), voltage=float(record.voltage[0]))
    states, gain, way = [], 1.0, np.empty(0)
    for link in links:
        if isinstance(link, Amplifier):
            rest, before = prepared_drive(record, start, gain)
            rest = replace(rest, voltage=link.gain * rest.voltage)  # at rest it is at the voltage of the ceramic
            states.append(_after(link, rest, before))
            gain *= link.gain
            at_first = replace(at_first, voltage=link.gain * at_first.voltage)
        elif isinstance(link, Ferroelectric):
            state, way = begun_ceramic(link, record, start, gain)
            states.append(state)
        elif isinstance(link, Loaded):
            states.append(_after(link, *prepared_drive(record, start, gain)))
        else:
            states.append(turned(link, at_first, way))
    return tuple(states)


def turned(link: Link, rest: Rest, way: Array) -> State:
    """The state of a link before its first sample, to which the polarization went by way of others [C/m^2, (k,)]."""
    state = link.init(rest)
    return link.step(state, by_way_of(way))[0] if link.follows_turns and way.size else state


def by_way_of(way: Array) -> Signals:
    """Polarizations [C/m^2, shape (k,)] without a time, for links that know none."""
    return Signals(time=np.zeros(way.size), voltage=np.zeros(way.size), polarization=way)


def begun_ceramic(link: Ferroelectric, record: Record, start: Start, gain: float) -> tuple[State, Array]:
    """The state of the ceramic at the first sample, behind an amplifier with a gain [-].

    Returns:
        And the polarization at the reversals before [C/m^2, shape (k,)]; none where no history is known.
    """
    rest, before = prepared_drive(record, start, gain)
    state = link.init(rest)
    if not before.time.size:
        return state, np.empty(0)
    state, out = link.step(state, before)
    return state, out.polarization[: len(start.prior_voltages)]  # where it waits it does not turn


def amplifier_gain(chain: Chain) -> float:
    """Voltage across the ceramic over the voltage that is recorded [-]."""
    return math.prod(link.gain for link in chain.links if isinstance(link, Amplifier))


def _after(link: Link, rest: Rest, before: Signals) -> State:
    state = link.init(rest)
    return link.step(state, before)[0] if before.time.size else state


def with_own_values(chain: Chain, start: Start) -> Chain:
    """The chain with the parameters that belong to the run.

    Raises:
        BenchError: a parameter that the chain has not.
    """
    if not start.values:
        return chain
    changes: dict[str, dict[str, float]] = {}
    for name, value in start.values:
        kind, _, field = name.partition(".")
        changes.setdefault(kind, {})[field] = value
    try:
        return chain.with_links(lambda link: replace(link, **changes[link.kind]) if link.kind in changes else link)
    except TypeError:
        raise BenchError(
            f"{chain.name}: start: unknown parameter among {', '.join(n for n, _ in start.values)}"
        ) from None


def drive_of(record: Record, part: slice = slice(None)) -> Signals:
    """What enters the chain: the recorded voltage, and whatever of its surroundings is known."""
    signals = Signals(time=record.time[part], voltage=record.voltage[part])
    known = {"temperature": record.temperature, "force": record.force, "neighbour": record.neighbour}
    return signals.replace(**{name: values[part] for name, values in known.items() if values is not None})


def _pick(out: Signals, wanted: NDArray[np.bool_]) -> Signals:
    names = ("time", "voltage", "polarization", "phase_fraction", "displacement")
    values = {name: getattr(out, name) for name in names}
    return Signals(**{name: value[wanted] for name, value in values.items() if value.size})


def _joined(parts: list[Signals], chain: Chain) -> Signals:
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])}
    displacement = joined["displacement"]
    if displacement.size != joined["time"].size:
        raise BenchError(f"{chain.name}: the chain gives no displacement; add a link such as electrostriction")
    bad = np.flatnonzero(~np.isfinite(displacement))
    if bad.size:
        raise BenchError(
            f"{chain.name}: the chain's displacement is {displacement[bad[0]]} at {joined['time'][bad[0]]:.6g} s;"
            " its parameters are out of reason for this drive"
        )
    return Signals(**joined)


def check_usable(record: Record, span: Span, least: int) -> None:
    """Raise BenchError unless the counted part moves, is driven and has at least `least` samples."""
    first, after = span.of(record)
    if after - first < least:
        raise BenchError(
            f"{record.name}: {after - first} samples to fit, at least {least} are needed for this many parameters;"
            " give a longer run or free fewer parameters"
        )
    voltage, displacement = record.voltage[first:after], record.displacement[first:after]
    if np.ptp(voltage) == 0.0:
        raise BenchError(f"{record.name}: the voltage stays at {voltage[0]:.6g} V; a fit needs a run that is driven")
    if np.ptp(displacement) == 0.0:
        raise BenchError(
            f"{record.name}: displacement_m stays at {displacement[0]:.6g} m while the voltage moves; nothing to fit,"
            " check the sensor"
        )


def rms(values: Array) -> float:
    """Root of the mean square."""
    return math.sqrt(float(np.mean(np.square(values)))) if values.size else 0.0
