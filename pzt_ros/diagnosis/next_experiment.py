"""The drive of the experiment that decides between effects which the runs at hand cannot tell apart.

A new design costs one function and one line in `DESIGNS`. Which experiment decides what: diagnosis-methods.md 3.4.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pzt_ros.diagnosis.programme import Programme
from pzt_ros.effects.confounded import LATE_OR_LIMITED
from pzt_ros.effects.table import CONFOUNDED, EFFECT_OF, reported
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record, write_table

FILE = "next_experiment.csv"
"""Beside report.json: `time_s, voltage_V`, evenly sampled, from 0 V."""

LONGEST = 120.0
"""No drive takes longer than this [s]."""

HIGHEST = 150.0
"""No drive goes beyond plus or minus this [V], whatever the runs did."""

_FAST_RATE, _SLOW_RATE = 10_000.0, 250.0  # samples per second: for what happens in milliseconds, and in seconds
_SLEWS = (2e4, 1e5)  # V/s; 0.2 A drive 10 and 2 uF so fast
_FAST_TIMES = (1e-4, 1e-2)  # s, of what is looked for at the fast rate
_SLOW_TIMES = (1.0, 8.0)  # s
_SMALLEST_RANGE = 1.0  # V
_NESTED = (0.15, 0.8, 0.3, 0.65, 0.45, 0.5)  # turns of the loops at the beginning, as shares of the range


@dataclass(frozen=True)
class NextExperiment:
    """A drive to be played at the bench.

    Attributes:
        time: evenly spaced, from 0 [s, shape (n,)].
        voltage: commanded, from 0 V [V, shape (n,)].
        why: what it decides, and by what.
    """

    time: Array
    voltage: Array
    why: str

    @property
    def rate(self) -> float:
        """Samples per second."""
        return 1.0 / float(self.time[1] - self.time[0])

    @property
    def sentence(self) -> str:
        """What the file holds, in words."""
        return (
            f"Its drive is in {FILE}: {self.time[-1]:.3g} s at {self.rate:.5g} samples/s,"
            f" {self.voltage.min():.4g} to {self.voltage.max():.4g} V."
        )


@dataclass(frozen=True)
class Bench:
    """What the given runs say about the bench and the suspects.

    Attributes:
        low, high: voltages that the runs used, and no more than HIGHEST [V].
        frequency: of a loop over their range at the mean rate of the most moving run [Hz].
        slew: steepest change that is asked for [V/s].
        times: time constants of the suspects as refitted, by name of effect [s].
    """

    low: float
    high: float
    frequency: float
    slew: float
    times: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, records: Sequence[Record], links: Sequence[Link] = ()) -> Bench:
        """From the runs, and the effects' links as they were refitted."""
        low = max(min(float(r.voltage.min()) for r in records), -HIGHEST)
        high = min(max(float(r.voltage.max()) for r in records), HIGHEST)
        rates = [np.abs(np.diff(r.voltage) / np.diff(r.time)) for r in records]
        spans = [max(float(np.ptp(r.voltage)), 1e-9) for r in records]
        frequency = max(float(np.mean(rate)) / (2.0 * span) for rate, span in zip(rates, spans, strict=True))
        slew = float(np.clip(max(float(rate.max()) for rate in rates), *_SLEWS))
        times = {link.kind: _TIME_OF[link.kind](link) for link in links if link.kind in _TIME_OF}
        return cls(low, high, frequency, slew, times)

    @property
    def span(self) -> float:
        """[V]."""
        return self.high - self.low

    def at(self, share: float) -> float:
        """A voltage within the range, 0 the lowest and 1 the highest [V]."""
        return self.low + share * self.span

    def longest(self, limits: tuple[float, float]) -> float:
        """Longest time constant of the suspects within limits; their geometric mean where none is known [s]."""
        known = max(self.times.values(), default=math.sqrt(limits[0] * limits[1]))
        return float(np.clip(known, *limits))

    def begun(self, rate: float, seconds: float) -> Programme:
        """The whole range, so that what was before is forgotten, and nested loops: the base has to be known, too.

        Without the loops fits of the base end beside the truth, and what they leave hides what is to be decided.
        """
        made = Programme(rate, self.slew, self.low, self.high)
        made.to(self.high, seconds).hold(0.3 * seconds).to(self.low, seconds).hold(0.3 * seconds)
        made.to(self.high, 0.7 * seconds)
        for share in _NESTED:
            made.to(self.at(share), 0.5 * seconds)
        return made.hold(seconds)


def _time_of(name: str) -> Callable[[Link], float]:
    return lambda link: float(getattr(link, name))


_TIME_OF: dict[str, Callable[[Link], float]] = {
    "sensor_lag": _time_of("lag"),
    "amplifier_bandwidth": _time_of("time_constant"),
    "mechanical_resonance": lambda link: 1.0 / (2.0 * math.pi * float(getattr(link, "frequency"))),  # noqa: B009
    "slow_relaxation": _time_of("longest_time"),
    "thermal_drift": _time_of("time_constant"),
    "bias_field": _time_of("time_constant"),
}

Design = Callable[[Bench], Programme]
"""From what is known of the bench and the suspects to a drive."""


def _fast(bench: Bench) -> Programme:
    """Steps of two heights, short tall pulses, a chirp to ten times the corner, and large loops below and above it.

    What smooths the voltage before the ceramic keeps it from switching in a short pulse or loop, so less stays behind;
    what smooths behind it does not. A mode overshoots; with a limit the time to settle grows with the height.
    """
    constant = bench.longest(_FAST_TIMES)
    corner = 1.0 / (2.0 * math.pi * constant)
    rate = float(np.clip(20.0 / constant, 0.2 * _FAST_RATE, _FAST_RATE))
    rest = float(np.clip(8.0 * constant, 0.02, 0.08))
    made = bench.begun(rate, 0.15)
    for share in (0.08, 0.4):
        made.pulse(bench.at(0.5 + share), rest, rest).pulse(bench.at(0.5 - share), rest, rest)
    for turn, back in ((0.95, 0.0), (0.05, 1.0)):
        made.to(bench.at(back), 0.2).to(bench.at(0.5), 0.1).hold(rest)
        for widths in (0.0, 1.0, 4.0):
            made.pulse(bench.at(turn), widths * constant, rest)
    made.chirp(0.1 * bench.span, 0.3 * corner, min(10.0 * corner, 0.1 * rate), 0.4).hold(rest)
    made.to(bench.at(0.1), 0.1)
    for turn, times_corner in ((0.9, 0.1), (0.9, 0.3), (0.9, 1.0), (0.6, 1.0), (0.9, 3.0)):
        frequency = min(times_corner * corner, 0.02 * rate)
        made.loops(bench.at(turn), frequency, max(1, round(0.2 * frequency))).hold(rest)
    return made


def _frequencies(bench: Bench) -> Programme:
    """Loops of one amplitude at three frequencies a decade apart, and a step."""
    middle = float(np.clip(bench.frequency, 0.5, 20.0))
    rate = float(np.clip(500.0 * middle, _SLOW_RATE, 0.5 * _FAST_RATE))
    made = bench.begun(rate, 0.5 / min(middle, 1.0)).to(bench.at(0.1), 0.5)
    for frequency, count in ((0.1 * middle, 2), (middle, 4), (10.0 * middle, 20)):
        made.loops(bench.at(0.9), frequency, count).hold(0.5)
    made.to(bench.at(0.6)).hold(2.0)
    return made


def _holds(bench: Bench) -> Programme:
    """Holds in the middle reached from above and from below in turn, each after as long at the end it comes from."""
    hold = 1.5 * bench.longest(_SLOW_TIMES)
    made = bench.begun(_SLOW_RATE, 1.0)
    for end in (1.0, 0.0, 1.0, 0.0):
        made.to(bench.at(end), 0.5).hold(hold).to(bench.at(0.5), 0.5).hold(hold)
    return made


def _pause(bench: Bench) -> Programme:
    """Cycles, a pause as long, cycles again."""
    made = bench.begun(_SLOW_RATE, 1.0).to(bench.low, 0.5)
    for _ in range(2):
        made.loops(bench.high, 2.0, 40).hold(20.0)
    made.loops(bench.high, 2.0, 20).hold(2.0)
    return made


def _flat_rest(bench: Bench) -> Programme:
    """Loops, a rest where the loop is flat, loops again."""
    made = bench.begun(_SLOW_RATE, 1.0).to(bench.low, 1.0)
    for _ in range(3):
        made.loops(bench.high, 0.5, 3).to(bench.high, 1.0).hold(20.0).to(bench.low, 1.0)
    return made


def _offsets(bench: Bench) -> Programme:
    """The whole loop, minor loops of two heights about five offsets from either side, the whole loop again."""
    made = bench.begun(_SLOW_RATE, 1.0).to(bench.low, 1.0).loops(bench.high, 0.25, 2)
    for offsets in ((0.1, 0.3, 0.5, 0.7), (0.9, 0.7, 0.5, 0.3)):
        made.to(bench.at(round(offsets[0])), 1.0)
        for offset in offsets:
            made.to(bench.at(offset), 0.8).hold(0.5)
            for height in (0.15, 0.3):
                made.loops(bench.at(offset + math.copysign(height, 0.5 - offset)), 1.0, 2)
    made.to(bench.low, 1.0).loops(bench.high, 0.25, 2).hold(1.0)
    return made


def _cycled(bench: Bench) -> Programme:
    """Whole loops before and after many cycles, and after a rest."""
    made = bench.begun(_SLOW_RATE, 1.0).to(bench.low, 1.0).loops(bench.high, 0.5, 3)
    made.loops(bench.high, 3.0, 100).loops(bench.high, 0.5, 3).hold(20.0).loops(bench.high, 0.5, 3)
    return made


def _two_ends(bench: Bench) -> Programme:
    """Long holds at both ends of the range, twice."""
    made = bench.begun(_SLOW_RATE, 1.0)
    for share in (1.0, 0.0, 1.0, 0.0):
        made.to(bench.at(share), 1.0).hold(20.0)
    return made


def for_amplitudes(bench: Bench) -> Programme:
    """Loops from both ends to turns all over the range, and nested ones."""
    made = bench.begun(_SLOW_RATE, 1.0)
    for end in (0.0, 1.0):
        made.to(bench.at(end), 1.0)
        for share in np.linspace(0.15, 0.95, 9):
            made.loops(bench.at(end + (1.0 - 2.0 * end) * share), 0.5, 1)
    for share in np.linspace(0.95, 0.1, 10):
        made.to(bench.at(0.5 + 0.5 * share), 0.7).to(bench.at(0.5 - 0.5 * share), 0.7)
    return made.hold(1.0)


def for_unexplained(bench: Bench) -> Programme:
    """A rest, loops at two amplitudes and three rates, a step and a rest."""
    slowest = float(np.clip(0.3 * bench.frequency, 0.05, 0.5))
    made = bench.begun(500.0, 1.0).hold(5.0).to(bench.at(0.1), 0.5)
    for frequency, count in ((slowest, 1), (5.0 * slowest, 3), (25.0 * slowest, 10)):
        made.loops(bench.at(0.9), frequency, count).loops(bench.at(0.5), frequency, count).hold(1.0)
    return made.to(bench.at(0.6)).hold(5.0)


_SLOW_OR_CURVED = ("slow_relaxation", "sensor_nonlinearity")

DESIGNS: dict[frozenset[str], Design] = {
    **{frozenset(pair): _fast for pair in itertools.combinations(LATE_OR_LIMITED, 2)},
    **{frozenset(pair): _frequencies for pair in itertools.product(LATE_OR_LIMITED, _SLOW_OR_CURVED)},
    frozenset(_SLOW_OR_CURVED): _frequencies,
    frozenset(("slow_relaxation", "thermal_drift")): _holds,
    frozenset(("polarization_fatigue", "thermal_drift")): _pause,
    frozenset(("polarization_fatigue", "slow_relaxation")): _pause,
    frozenset(("polarization_fatigue", "bias_field")): _cycled,
    frozenset(("bias_field", "thermal_drift")): _flat_rest,
    frozenset(("bias_field", "sensor_nonlinearity")): _offsets,
    frozenset(("bias_field", "strain_polarization_hysteresis")): _offsets,
    frozenset(("strain_polarization_hysteresis", "sensor_nonlinearity")): _offsets,
    frozenset(("leakage", "thermal_drift")): _two_ends,
    frozenset(("sensor_nonlinearity", "strain_law")): _offsets,
    frozenset(("load_stiffness", "strain_law")): _offsets,
    frozenset(("bias_field", "hysteresis_density")): _cycled,
}
"""Pair of names, as in CONFOUNDED -> what tells them apart."""


def design_between(names: Sequence[str]) -> tuple[str, Design]:
    """In words and as a design, what tells the first of some effects from the next that a design is known for."""
    causes = [reported(name) for name in names]
    for other in causes[1:]:
        pair = frozenset((causes[0], other))
        if pair in DESIGNS:
            return CONFOUNDED[pair], DESIGNS[pair]
    return "; ".join(EFFECT_OF[cause].next_experiment for cause in causes if cause in EFFECT_OF) + ".", for_unexplained


def designed(design: Design, bench: Bench, why: str) -> NextExperiment | None:
    """A design made for a bench; None where what the runs used leaves no voltages for it."""
    if bench.span < _SMALLEST_RANGE:
        return None
    programme = design(bench).to(0.0, 0.5)
    inside = programme.time <= LONGEST
    return NextExperiment(programme.time[inside], programme.voltage[inside], why)


def save(proposed: NextExperiment | None, out: Path) -> None:
    """Write the drive into a folder, or remove what an earlier diagnosis left there.

    Raises:
        BenchError: the file cannot be written.
    """
    path = out / FILE
    if proposed is None:
        path.unlink(missing_ok=True)
    else:
        write_table(path, ("time_s", "voltage_V"), (proposed.time, proposed.voltage))
