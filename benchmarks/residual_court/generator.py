"""A specimen on its bench: runs made of truth, effects and noise."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from .drives import Drive
from .effect import BIAS, CHARGE, CURRENT, DRIVE, LEAD, MOTION, POLARIZATION, READING, Effect, Run, smooth_walk
from .families import Truth
from .protocols import PROTOCOLS, Protocol
from .specimens import specimen

Array = NDArray[np.float64]

NOISE = 12e-9
"""Rms of the sensor's noise [m]."""

POLARIZATION_NOISE = 3e-4
"""Rms of the noise of recorded polarization [C/m^2]."""

ROOM = 293.0
"""Temperature at the first sample [K]."""

READINGS = ("white", "coloured", "quantised", "gaps")
"""White noise; noise with memory; white noise and a least step; white noise and missing samples."""


@dataclass(frozen=True)
class Motion:
    """What happens in a run before noise: reading [m], P as recorded [C/m^2], voltage at the ceramic [V]."""

    reading: Array
    polarization: Array
    applied: Array


@dataclass
class Bench:
    """One specimen with the runs that a protocol asks for."""

    truth: Truth
    protocol: Protocol
    seed: int
    runs_before: int = 0
    runs: list[Run] = field(default_factory=list)

    def __post_init__(self) -> None:
        for number, drive in enumerate(self.protocol.drives, start=self.runs_before):
            rng = np.random.default_rng([self.seed, number, 7])
            warming = 1.5 * (1 - np.exp(-drive.time / rng.uniform(8.0, 25.0)))
            temperature = ROOM + rng.choice((-1, 1)) * warming + 0.4 * smooth_walk(rng, drive.time, 5.0)
            self.runs.append(Run(drive.time, drive.command, temperature, number, self.seed, drive.loaded))

    @cached_property
    def clean_polarization(self) -> list[Array]:
        """P of each run without any effect [C/m^2]."""
        return [self.truth.polarization(run.time, run.command, 0.0, np.inf)[0] for run in self.runs]

    @cached_property
    def travel(self) -> list[float]:
        """Way of P before each run [C/m^2]."""
        ways = [float(np.abs(np.diff(p)).sum()) for p in self.clean_polarization]
        return [float(each) for each in np.concatenate([[0.0], np.cumsum(ways)[:-1]])]

    def motion(self, number: int, effects: Sequence[Effect]) -> Motion:
        """One run with effects, every sample of it, also the hidden ones."""
        bare = self.runs[number]
        run = replace(bare, travel=self.travel[number])
        by_stage: dict[str, list[Effect]] = {}
        for effect in effects:
            by_stage.setdefault(effect.stage, []).append(effect)

        def through(stage: str, values: Array) -> Array:
            for effect in by_stage.get(stage, []):
                values = effect.act(run, values)
            return values

        applied, polarization = run.command, self.clean_polarization[number]
        if {DRIVE, BIAS, CURRENT} & set(by_stage):
            limit = float(through(CURRENT, np.array(np.inf)))
            bias = through(BIAS, np.zeros_like(run.time))
            polarization, applied = self.truth.polarization(run.time, through(DRIVE, run.command), bias, limit)
        polarization = through(POLARIZATION, polarization)
        moved = through(MOTION, self.truth.displacement(through(LEAD, polarization)))
        return Motion(through(READING, moved), through(CHARGE, polarization), applied)

    def record(self, number: int, effects: Sequence[Effect], reading: str) -> dict[str, Array]:
        """What is written down of a run: columns by their names in contract.md."""
        drive, run = self.protocol.drives[number], self.runs[number]
        motion = self.motion(number, effects)
        rng = run.rng("reading")
        shown = slice(drive.hidden, None)
        count = run.time.size - drive.hidden
        displacement = motion.reading[shown] + rng.uniform(-4e-6, 4e-6) + NOISE * _noise(rng, count, reading)
        if reading == "quantised":
            displacement = 2 * NOISE * np.round(displacement / (2 * NOISE))
        columns = {
            "time_s": run.time[shown] - run.time[drive.hidden],
            "voltage_V": run.command[shown],
            "displacement_m": displacement,
        }
        if self.protocol.polarization:
            charge = motion.polarization[shown] + POLARIZATION_NOISE * rng.normal(size=count)
            columns["polarization_C_per_m2"] = charge - charge[0]
        if any(getattr(effect, "measured", False) for effect in effects):
            columns["temperature_K"] = run.temperature[shown] + 2e-3 * rng.normal(size=count)
        if any(each.loaded for each in self.protocol.drives):
            columns["force_N"] = self._force(motion, effects, run)[shown]
        if reading == "gaps":
            kept = _kept(rng, count)
            columns = {name: values[kept] for name, values in columns.items()}
        return columns

    def _force(self, motion: Motion, effects: Sequence[Effect], run: Run) -> Array:
        """What the spring pushes with [N]."""
        stiffness = sum(each.parameters().get("load_stiffness", 0.0) for each in effects)
        return stiffness * motion.reading if run.loaded else np.zeros_like(run.time)


def _noise(rng: np.random.Generator, count: int, reading: str) -> Array:
    """Noise of unit rms."""
    if reading == "quantised":
        return 0.8 * rng.normal(size=count)  # the least step adds the rest
    white = rng.normal(size=count)
    if reading != "coloured":
        return white
    slow = signal.lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], rng.normal(size=count))
    return 0.8 * white + 0.6 * slow


def _kept(rng: np.random.Generator, count: int) -> NDArray[np.bool_]:
    """All samples but single ones and a few stretches of up to 50."""
    kept = rng.random(count) > 0.01
    for start in rng.integers(10, count - 60, size=6):
        kept[start : start + rng.integers(5, 50)] = False
    kept[:2] = True
    return kept


def bench(family: str, protocol: str, seed: int) -> Bench:
    """A specimen of a family with its runs; the same for the same seed."""
    rng = np.random.default_rng([seed, zlib.crc32(family.encode())])
    truth = specimen(family, rng)
    return Bench(truth, PROTOCOLS[protocol](np.random.default_rng([seed, zlib.crc32(protocol.encode())])), seed)


def more_runs(bench: Bench, drive: Drive, count: int) -> Bench:
    """The same specimen afterwards, driven `count` times as asked."""
    protocol = replace(bench.protocol, train=(), test=(), score=(drive,) * count)
    return Bench(bench.truth, protocol, bench.seed, runs_before=bench.runs_before + len(bench.runs))
