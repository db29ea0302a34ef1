"""Whether a stage can follow a reference at all: said before it is tried, with the error that is to be expected."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from pzt_ros.controllers.bounds import Bounds
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain, ChainState
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.signals import Array, Signals

STRETCH = 1.1
"""By which a reference that is too fast is slowed down until it no longer is."""

NEAR, LEAST = 0.05, 1e-7
"""Error that a lag of the sensor may well make, of the peak to peak and [m]; more is out of reach."""

SLOWEST = 20.0
"""Times slower: what is still too fast then will never do."""


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """What the model makes of a reference, its exact inverse kept within bounds.

    Attributes:
        time, reference, displacement: of the samples [s, m, m, each of shape (n,)]; displacement as the stage would go.
        wanted, voltage: of the exact inverse, and as the bounds let it [V, shape (n,)].
        current: into the ceramic [A, shape (n,)].
        state: of the model afterwards.
        too_far, too_fast: what cannot be, in words; empty where all can.
    """

    time: Array
    reference: Array
    displacement: Array
    wanted: Array
    voltage: Array
    current: Array
    state: ChainState
    too_far: str = ""
    too_fast: str = ""

    @property
    def feasible(self) -> bool:
        """Whether the reference can be followed."""
        return not (self.too_far or self.too_fast)

    @property
    def error(self) -> Array:
        """That is to be expected [m, shape (n,)]."""
        return self.reference - self.displacement

    @property
    def in_words(self) -> str:
        """One line: what is in the way, and the error to be expected."""
        rms, largest = float(np.sqrt(np.mean(self.error**2))), float(np.max(np.abs(self.error)))
        reasons = " and ".join(reason for reason in (self.too_far, self.too_fast) if reason) or "can be followed"
        return f"{reasons}; expected error {1e6 * rms:.3g} um rms, {1e6 * largest:.3g} um at most"


def forecast(
    model: Chain, state: ChainState, signals: Signals, bounds: Bounds, *, last: tuple[float, float], current: float
) -> Forecast:
    """What comes of a reference.

    Args:
        model: what follows the amplifier.
        state: of it now.
        signals: time [s] and displacement that is asked for [m].
        bounds: of voltage and slew.
        last: time [s] and voltage [V] now.
        current: largest current into the ceramic [A].

    Raises:
        BenchError: a reference that is not finite.
    """
    time, reference = signals.time, signals.displacement
    if not np.all(np.isfinite(reference)):
        first = int(np.argmin(np.isfinite(reference)))
        raise BenchError(f"reference of {reference[first]} m at {time[first]:.6g} s; give finite numbers")
    before, now = last
    _, inverse = model.invert(state, signals)
    kept = bounds.keep(inverse.voltage, now, time, before)
    area = sum(link.electrode_area for link in model.links if isinstance(link, Ferroelectric))
    _, at_last = model.step(state, _point(last))
    after, out = model.step(state, Signals(time, kept))
    steps = np.diff(time, prepend=before)
    drawn = area * np.diff(out.polarization, prepend=at_last.polarization[-1:]) / steps
    found = Forecast(
        time=time, reference=reference, displacement=out.displacement, wanted=inverse.voltage, voltage=kept,
        current=drawn, state=after,
    )  # fmt: skip
    slew = np.abs(np.diff(inverse.voltage, prepend=now)) / steps
    return dataclasses.replace(
        found,
        too_far=_beyond_window(found, bounds),
        too_fast=_too_fast(time, slew, bounds.slew_rate * (1.0 + 1e-9), "V/s", "slew rate")
        or _too_fast(time, np.abs(drawn), current, "A", "current"),
    )


def _beyond_window(found: Forecast, bounds: Bounds) -> str:
    outside = np.maximum(found.wanted - bounds.voltage_max, bounds.voltage_min - found.wanted)
    worst = int(np.argmax(outside))
    if outside[worst] <= 0.0:
        return _out_of_reach(found)
    return (
        f"{1e6 * found.reference[worst]:.4g} um at {found.time[worst]:.4g} s is beyond the stroke: it takes"
        f" {found.wanted[worst]:.4g} V of {bounds.voltage_min:g} to {bounds.voltage_max:g} V"
    )


def _out_of_reach(found: Forecast) -> str:
    """What no voltage gives, such as a stack shorter than without strain."""
    worst = int(np.argmax(np.abs(found.error)))
    if abs(found.error[worst]) <= max(NEAR * np.ptp(found.reference), LEAST):
        return ""
    return (
        f"{1e6 * found.reference[worst]:.4g} um at {found.time[worst]:.4g} s is out of reach: the model comes to"
        f" {1e6 * found.displacement[worst]:.4g} um"
    )


def _too_fast(time: Array, values: Array, limit: float, unit: str, what: str) -> str:
    worst = int(np.argmax(values))
    if values[worst] <= limit:
        return ""
    return f"at {time[worst]:.4g} s it takes a {what} of {values[worst]:.3g} {unit}, the limit is {limit:.3g} {unit}"


def require(found: Forecast) -> None:
    """Refuse what cannot be followed.

    Raises:
        BenchError: with the reason, the error to be expected, and what to do.
    """
    if not found.feasible:
        advice = "lower the stroke" if found.too_far else "slow it down"
        raise BenchError(f"reference refused: {found.in_words}; {advice}, or let it be re-planned")


def replanned(
    model: Chain, state: ChainState, signals: Signals, bounds: Bounds, *, last: tuple[float, float], current: float
) -> tuple[Forecast, float]:
    """The nearest reference that the stage can follow, and how many times slower it is.

    What is too fast is slowed down as a whole, on samples as far apart as before. What is too far becomes what the
    stage can reach: the forecast's `displacement`, with its `error` against what was asked for. Arguments as of
    `forecast`.

    Raises:
        BenchError: too fast at any pace.
    """
    slower, here = 1.0, float(model.step(state, _point(last))[1].displacement[-1])
    found = forecast(model, state, signals, bounds, last=last, current=current)
    while found.too_fast:
        slower *= STRETCH
        if slower > SLOWEST:
            raise BenchError(f"reference refused: {found.in_words}; {SLOWEST:g} times slower it still is")
        stretched = stretch(signals, (last[0], here), slower)
        found = forecast(model, state, stretched, bounds, last=last, current=current)
    return found, slower


def stretch(signals: Signals, start: tuple[float, float], slower: float) -> Signals:
    """The same path that many times slower, from a time [s] and place [m], on samples as far apart as before."""
    begin, here = start
    step = float(signals.time[-1] - begin) / len(signals.time)
    time: Array = begin + step * np.arange(1.0, round(len(signals.time) * slower) + 1.0)
    places = np.concatenate(([here], signals.displacement))
    path = np.interp(begin + (time - begin) / slower, np.concatenate(([begin], signals.time)), places)
    return Signals(time, displacement=path)


def _point(last: tuple[float, float]) -> Signals:
    return Signals(np.array([last[0]]), np.array([last[1]]))
