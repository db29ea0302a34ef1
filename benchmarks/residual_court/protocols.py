"""Which runs a case consists of: to fit, to choose by, and one that nobody saw."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .drives import HIGH, LOW, Drive, Program, burst, poled, sines, wander


@dataclass(frozen=True)
class Protocol:
    """Runs in the order in which they are made: those to train on, to test with, and the fresh one for the score."""

    train: tuple[Drive, ...]
    test: tuple[Drive, ...]
    score: tuple[Drive, ...]
    polarization: bool = False

    @property
    def drives(self) -> tuple[Drive, ...]:
        """All of them in order."""
        return (*self.train, *self.test, *self.score)

    @property
    def known(self) -> int:
        """How many of them a diagnosis may see."""
        return len(self.train) + len(self.test)


def _loops(rng: np.random.Generator, seconds: float) -> Drive:
    """Once down and up as far as any run will go, then minor loops."""
    program = poled(3.0, 1.5).to(LOW, 1.2, smooth=True).hold(0.4).to(HIGH, 1.0)
    return wander(program, rng, seconds, (40.0, 400.0)).drive()


def _mixed(rng: np.random.Generator, seconds: float, frequencies: tuple[float, ...]) -> Drive:
    """Loops at other rates than in training, then sines at other frequencies."""
    program = wander(poled(3.0, 0.8), rng, 0.6 * seconds, (8.0, 600.0))
    plan = tuple((frequency, max(1.0, round(1.2 * frequency))) for frequency in frequencies)
    return sines(program, rng, plan).until(seconds).drive()


def slow(rng: np.random.Generator) -> Protocol:
    """40 s to train on, 30 s to test, 25 s to score, all at 1 kHz."""
    sweep = sines(poled(2.5, 0.5), rng, ((0.2, 1), (1.0, 2), (5.0, 5), (25.0, 12))).until(14.0).drive()
    return Protocol(
        (_loops(rng, 26.0), sweep),
        (_mixed(rng, 30.0, (0.5, 3.0, 14.0, 25.0)),),
        (_mixed(rng, 25.0, (0.35, 2.0, 8.0, 20.0)),),
    )


def short(rng: np.random.Generator) -> Protocol:
    """A few seconds of each, for tests of the court itself."""
    return Protocol(
        (wander(poled(1.5, 0.3), rng, 6.0, (40.0, 400.0)).drive(),),
        (wander(poled(1.2, 0.2), rng, 4.0, (30.0, 500.0)).drive(),),
        (wander(poled(1.0, 0.4), rng, 4.0, (30.0, 500.0)).drive(),),
    )


def standard(rng: np.random.Generator) -> Protocol:
    """The slow runs, and with each part one second at 10 kHz (diagnosis-methods.md 3.2)."""
    runs = slow(rng)
    return Protocol((*runs.train, burst(rng)), (*runs.test, burst(rng)), (*runs.score, burst(rng)))


def with_polarization(rng: np.random.Generator) -> Protocol:
    """The slow runs, with polarization recorded."""
    return replace(slow(rng), polarization=True)


def loaded(rng: np.random.Generator) -> Protocol:
    """The slow runs; a spring stands against the actuator in the second half of each part."""
    runs = slow(rng)
    first, second = runs.train
    return Protocol(
        (first, replace(second, loaded=True)),
        (*runs.test, replace(_mixed(rng, 15.0, (1.5, 10.0)), loaded=True)),
        tuple(replace(drive, loaded=True) for drive in runs.score),
    )


def unknown_start(rng: np.random.Generator) -> Protocol:
    """Records that begin inside minor loops which nobody recorded: no poling, no virgin state."""

    def begun(seconds: float) -> Drive:
        program = wander(poled(2.0, 0.3), rng, 2.3 + rng.uniform(4.0, 8.0), (60.0, 300.0))
        hidden = program.duration
        program = wander(program, rng, hidden + 0.6 * seconds, (20.0, 400.0))
        return sines(program, rng, ((0.5, 1), (3.0, 3), (15.0, 10))).until(hidden + seconds).drive(hidden)

    return Protocol((begun(26.0), begun(14.0)), (begun(30.0),), (begun(25.0),))


def one_sine(rng: np.random.Generator) -> Protocol:
    """One frequency and one amplitude in steady state, all that some benches ever record."""
    frequency = float(np.exp(rng.uniform(np.log(8.0), np.log(20.0))))
    amplitude, middle = rng.uniform(30, 60), rng.uniform(55, 75)

    def steady(seconds: float) -> Drive:
        program = poled(2.0, 0.3).to(middle, 0.5, smooth=True).sine(amplitude, frequency, round(2 * frequency))
        hidden = program.duration
        cycles = max(2.0, round(seconds * frequency))
        return program.sine(amplitude, frequency, cycles).drive(hidden)

    return Protocol((steady(20.0),), (steady(10.0),), (steady(10.0),))


def one_hold(rng: np.random.Generator) -> Protocol:
    """One step and one hold."""
    level, rise = rng.uniform(90, 130), rng.uniform(1.0, 3.0)

    def run(seconds: float) -> Drive:
        return Program().hold(0.5).to(level, rise, smooth=True).hold(seconds).drive()

    return Protocol((run(30.0),), (run(20.0),), (run(20.0),))


PROTOCOLS: dict[str, Callable[[np.random.Generator], Protocol]] = {
    "standard": standard,
    "slow": slow,
    "short": short,
    "with_polarization": with_polarization,
    "loaded": loaded,
    "unknown_start": unknown_start,
    "one_sine": one_sine,
    "one_hold": one_hold,
}
