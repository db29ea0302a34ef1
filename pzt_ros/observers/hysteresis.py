"""The hysteresis observer: finds the state of a stage whose history and offset nobody knows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.observers.observer import Estimate, Observer
from pzt_ros.observers.slow_filter import (
    CREEP,
    CREEPS,
    DISTURBANCE,
    FROZEN,
    HISTORY,
    LAST,
    MISSING,
    ORIGIN,
    RATE,
    READING,
    REJECTED,
    SINCE,
    ZERO,
    Tuning,
    follow,
)
from pzt_ros.physics.chain import Chain, ChainState
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.signals import ABSENT, Array, Rest, Signals
from pzt_ros.quantities import parameter

MOST_TURNS = 6
"""Turning points of a history that is made up."""

ANY_POLARIZATION = 1.0
"""A charge meter counts from where the ceramic is when it begins, which may be anywhere within this [C/m^2]."""

MIXTURE_ERROR = 2.5e-3
"""What a mixture of made-up histories misses of the polarization, rms [C/m^2]: a charge meter is far better than that,
and believed to its own noise it would pull the mixture where no history is (docs/observer.md)."""

SLOWEST, FASTEST = 20.0, 2000.0
"""Its rates [V/s]."""


@dataclass(frozen=True)
class HysteresisState:
    """Memory: a model chain for each history that is thought possible, and the filter over them.

    Attributes:
        rest: before the first sample.
        members: state of each chain; empty before the first sample.
        mean, covariance: of the filter's states (slow_filter) [shapes (m,), (m, m)].
        notes: of the filter (slow_filter).
    """

    rest: Rest
    members: tuple[ChainState, ...]
    mean: Array
    covariance: Array
    notes: Array

    def as_dict(self) -> dict[str, Array]:
        """Plain arrays, as `numpy.savez` takes them; `HysteresisState.of` makes the same state of them."""
        links = zip(*self.members, strict=True)
        saved = {f"link_{number}": np.stack(states) for number, states in enumerate(links)}
        rest = np.array([self.rest.time, self.rest.voltage, float(self.rest.seed)])
        return {"rest": rest, "mean": self.mean, "covariance": self.covariance, "notes": self.notes, **saved}

    @classmethod
    def of(cls, saved: Mapping[str, Array]) -> HysteresisState:
        """The state that was saved.

        Raises:
            BenchError: something is missing.
        """
        for name in ("rest", "mean", "covariance", "notes"):
            if name not in saved:
                raise BenchError(f"saved observer state: '{name}' is missing; save it with as_dict()")
        links = [saved[f"link_{number}"] for number in range(sum(name.startswith("link_") for name in saved))]
        members = tuple(tuple(np.array(link[j]) for link in links) for j in range(len(links[0]) if links else 0))
        if members and saved["mean"].shape != (HISTORY + len(members),):
            raise BenchError(
                f"saved observer state: {saved['mean'].size} states for {len(members)} histories, expected"
                f" {HISTORY + len(members)}; it is of another version, start without it"
            )
        time, voltage, seed = saved["rest"]
        arrays = (np.array(saved[name], dtype=np.float64) for name in ("mean", "covariance", "notes"))
        return cls(Rest(float(time), float(voltage), int(seed)), members, *arrays)


@dataclass(frozen=True)
class Foreseen(Signals):
    """The mean of all histories, as a prediction, and what each of them says beyond it.

    Attributes:
        base: reading, polarization and phase fraction [shape (3, n)].
        deviation: of each history from it, over the root of their number [shape (3, n, members)].
        charge: measured, over the electrodes' area; NaN where it is not used [C/m^2, shape (n,)].
        area: of the electrodes [m^2].
    """

    base: Array = field(default_factory=lambda: np.empty((3, 0)))
    deviation: Array = field(default_factory=lambda: np.empty((3, 0, 0)))
    charge: Array = field(default_factory=lambda: np.empty(0))
    area: float = 0.0


@dataclass(frozen=True, kw_only=True)
class HysteresisObserver(Observer):
    """Runs the model from many histories that it may have had, and lets the measurement say which mixture it is.

    Polycrystals answer linearly to the occupancy of their domains at the start (identified_lattice_kernel), and
    histories with the same reversals later differ by a constant or less (wiping-out). So reading, polarization and
    phase fraction are taken as the mean of some dozen members plus a combination of their deviations from it. A Kalman
    filter finds the combination together with a disturbance (offset, then a random walk with a rate) and three decaying
    displacements (creep that began before). With one member, the state at rest, it is that filter alone. Where the
    amplifier measures charge, `charge_noise_rms` lets the filter use it, whatever zero that meter has.

    The disturbance is let go faster while the mean innovation differs from 0 by more than chance. Readings are not
    believed where they are no number, far from what is expected (unless for longer than `patience`), or the same again
    and again while the stage must have moved.
    """

    kind: ClassVar[str] = "hysteresis"

    members: float = parameter(48.0, "1", "histories that are followed; 1: the state at rest", bounds=(1.0, 500.0))
    lowest_voltage: float = parameter(-40.0, "V", "lowest reversal that a history may have had", bounds=(-1e3, 1e3))
    highest_voltage: float = parameter(150.0, "V", "highest reversal that a history may have had", bounds=(-1e3, 1e3))
    noise_rms: float = parameter(42e-9, "m", "of the sensor, with its least step over root 12", bounds=(1e-15, 1e-3))
    offset_std: float = parameter(1e-4, "m", "of the unknown offset", bounds=(0.0, 1.0))
    disturbance_density: float = parameter(
        3e-8, "m/s^(1/2)", "root of the variance per second by which the disturbance wanders", bounds=(0.0, 1e-3)
    )
    drift_rate_std: float = parameter(1e-8, "m/s", "of the rate of drift at the start", bounds=(0.0, 1e-3))
    creep_std: float = parameter(2e-8, "m", "of each of the three decaying displacements", bounds=(0.0, 1e-3))
    shortest_creep: float = parameter(0.1, "s", "the fastest of them", bounds=(1e-4, 1e5))
    longest_creep: float = parameter(10.0, "s", "the slowest", bounds=(1e-4, 1e5))
    gate: float = parameter(6.0, "1", "standard deviations beyond which a reading is a spike", bounds=(2.0, 1e3))
    patience: float = parameter(5e-3, "s", "after which spikes in a row are believed", bounds=(0.0, 1e3))
    adaptation_time: float = parameter(1e-3, "s", "over which the mean innovation is taken", bounds=(1e-6, 1e3))
    charge_noise_rms: float = parameter(0.0, "C", "of the charge meter; 0: charge is not used", bounds=(0.0, 1.0))
    charge_drift: float = parameter(
        1e-6,
        "C/s^(1/2)",
        "root of the variance per second by which its zero wanders",
        bounds=(0.0, 1.0),
    )

    def init(self, model: Chain, rest: Rest) -> HysteresisState:
        """Nothing known; the histories are made up when the first voltage is."""
        return HysteresisState(rest, (), np.empty(0), np.empty((0, 0)), np.empty(0))

    def predict(
        self, model: Chain, state: HysteresisState, time: Array, voltage: Array, charge: Array = ABSENT
    ) -> tuple[HysteresisState, Signals]:
        """Every history over a block of applied voltage [V]."""
        behind = model.behind_amplifier
        if not state.members:
            state = self._begin(behind, state.rest, float(time[0]), float(voltage[0]))
        signals = Signals(time, voltage)
        stepped = [behind.step(member, signals) for member in state.members]
        each = np.empty((3, len(time), len(stepped)))
        for j, (_, out) in enumerate(stepped):
            for quantity, values in enumerate((out.displacement, out.polarization, out.phase_fraction)):
                each[quantity, :, j] = values if values.size else 0.0
        base = each.mean(axis=2)
        each = (each - base[:, :, None]) / math.sqrt(max(len(stepped) - 1, 1))
        area = sum(link.electrode_area for link in behind.links if isinstance(link, Ferroelectric))
        used = self.charge_noise_rms > 0.0 and charge.size and area > 0.0
        foreseen = Foreseen(
            time, voltage, displacement=base[0], polarization=base[1], phase_fraction=base[2],
            base=base, deviation=each,
            charge=charge / area if used else np.full_like(time, math.nan), area=area,
        )  # fmt: skip
        return dataclasses.replace(state, members=tuple(member for member, _ in stepped)), foreseen

    def correct(
        self, state: HysteresisState, predicted: Signals, measurement: Array
    ) -> tuple[HysteresisState, Estimate]:
        """Take the readings [m] in, sample by sample."""
        assert isinstance(predicted, Foreseen)
        mean, covariance, notes = state.mean.copy(), state.covariance.copy(), state.notes.copy()
        out = np.empty((8, len(measurement)))
        follow(
            mean, covariance, notes, self._tuning(predicted.area), predicted.time, np.ascontiguousarray(measurement),
            predicted.charge, predicted.base, predicted.deviation, out,
        )  # fmt: skip
        state = dataclasses.replace(state, mean=mean, covariance=covariance, notes=notes)
        y, p, x, y_std, p_std, x_std, innovation, disturbance = out
        return state, Estimate(predicted.time, y, p, x, innovation, disturbance, y_std, p_std, x_std)

    def health(self, state: HysteresisState) -> dict[str, float]:
        """Samples that were not believed so far, and how sure the disturbance is."""
        if not state.members:
            return {}
        rejected, missing, frozen = state.notes[[REJECTED, MISSING, FROZEN]]
        return {
            "rejected_samples": float(rejected),
            "missing_samples": float(missing),
            "frozen_samples": float(frozen),
            "disturbance_std_m": math.sqrt(max(state.covariance[DISTURBANCE, DISTURBANCE], 0.0)),
        }

    def slow_disturbances(self, state: HysteresisState) -> tuple[Array, Array]:
        """Disturbance [m], its rate [m/s] and the decaying displacements [m], and their covariance."""
        return state.mean[:ZERO].copy(), state.covariance[:ZERO, :ZERO].copy()

    def _tuning(self, area: float) -> Tuning:
        per_area = 1.0 / area if area > 0.0 else 0.0
        return Tuning(
            noise=self.noise_rms**2,
            disturbance=self.disturbance_density**2,
            rate=self.drift_rate_std**2 / self.longest_creep,
            creep=self.creep_std**2,
            gate=self.gate,
            patience=self.patience,
            memory=self.adaptation_time,
            times=np.geomspace(self.shortest_creep, self.longest_creep, CREEPS),
            charge=(self.charge_noise_rms * per_area) ** 2 + (MIXTURE_ERROR**2 if self.members > 1.0 else 0.0),
            zero=(self.charge_drift * per_area) ** 2,
        )

    def _begin(self, model: Chain, rest: Rest, time: float, voltage: float) -> HysteresisState:
        """Histories that end at the voltage found [V], and a filter that knows nothing else."""
        random = np.random.default_rng(rest.seed)
        count = int(self.members)
        members = [model.init(dataclasses.replace(rest, time=time, voltage=voltage))]
        members += [self._made_up(model, rest, time, voltage, random) for _ in range(count - 1)]
        variance = np.zeros(HISTORY + count)
        variance[DISTURBANCE], variance[RATE] = self.offset_std**2, self.drift_rate_std**2
        variance[CREEP:ZERO], variance[ZERO] = self.creep_std**2, ANY_POLARIZATION**2
        variance[HISTORY:] = 1.0
        notes = np.zeros(ORIGIN + 1 + count)
        notes[LAST], notes[SINCE], notes[READING] = time, math.nan, math.nan
        return HysteresisState(rest, tuple(members), np.zeros(variance.size), np.diag(variance), notes)

    def _made_up(
        self, model: Chain, rest: Rest, time: float, voltage: float, random: np.random.Generator
    ) -> ChainState:
        """The state after a random history that ends at a voltage [V] now [s]."""
        turns = random.uniform(self.lowest_voltage, self.highest_voltage, random.integers(1, MOST_TURNS + 1))
        levels = np.concatenate(([0.0], turns, [voltage]))
        rates = np.exp(random.uniform(math.log(SLOWEST), math.log(FASTEST), levels.size - 1))
        lasts = np.abs(np.diff(levels)) / rates + 1e-3
        ends = time - np.concatenate((np.cumsum(lasts[::-1])[::-1], [0.0]))
        state = model.init(dataclasses.replace(rest, time=float(ends[0]), voltage=0.0))
        after, _ = model.step(state, Signals(ends[1:], levels[1:]))
        return after
