"""Faults of the instruments themselves: currents, open and shorted stacks, an amplifier that does not answer.

They cannot be made with the instruments of a test machine, so the whole loop runs in this process, with the library
objects of the nodes in the order of the nodes, and simulated instruments that can be harmed. Times are of the run.
"""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from pzt_benchmarks.soak.fault import FOUND, SAFE, Fault, Seen
from pzt_ros.chains import load_chain
from pzt_ros.errors import RunFailedError
from pzt_ros.hardware.amplifier import AmplifierDriver, Applied, SimulatedAmplifier
from pzt_ros.hardware.driver import DriverError
from pzt_ros.hardware.guard import DISABLED, FAULT, RAMPING, GuardedAmplifier
from pzt_ros.hardware.limits import Limits
from pzt_ros.hardware.stage import SimulatedStage, Truth
from pzt_ros.hardware.watch import Watch
from pzt_ros.loop import InProcessLoop, Tick
from pzt_ros.physics.signals import Array, Rest
from pzt_ros.scenario import load_scenario

LIMITS = Limits()
SCENARIO = """
scenario: up and down
plant: bench-stage
model: thesis-p2
limits: {capacitance_min: 50 nF}
phases:
  - {phase: voltage, to: 120 V, duration: 0.3 s}
  - {phase: voltage, to: 20 V, duration: 0.2 s, shape: linear}
  - {phase: move, to: 4 um, duration: 0.1 s, controller: open_loop}
  - {phase: scan, low: 4 um, peak_to_peak: 7 um, frequency: 5 Hz, cycles: 20, controller: inverse}
"""


class Instrument:
    """The simulated amplifier, until it is harmed."""

    def __init__(self, driver: AmplifierDriver) -> None:
        self._driver = driver
        self.gain = driver.gain
        self.short = False
        self.open = False
        self.spike = 0.0
        self.silent = False
        self.history = [driver.voltage]

    def replace(self, driver: AmplifierDriver) -> None:
        """Another one, whose stack has the voltage that it has."""
        self._driver, self.history = driver, [driver.voltage]

    @property
    def voltage(self) -> float:
        """At the output [V]."""
        self._answer()
        return self.history[-1]

    def _answer(self) -> None:
        if self.silent:
            raise DriverError("the amplifier does not answer")

    def apply(self, time: Array, command_voltage: Array) -> Applied:
        """Put out a block; into a short the current is whatever one ohm lets through, into nothing there is none."""
        self._answer()
        applied = self._driver.apply(time, command_voltage)
        self.history += applied.voltage.tolist()
        current = applied.current
        if self.short:
            current = applied.voltage / 1.0
        elif self.open:
            current = np.zeros_like(time)
        return Applied(time, applied.voltage, current + self.spike, applied.charge)


class Stage:
    """The simulated stage; one whose stack is not connected, or shorted, stays where it is."""

    def __init__(self, stage: SimulatedStage, instrument: Instrument) -> None:
        self._stage = stage
        self._instrument = instrument
        self._last: Truth | None = None

    def step(self, time: Array, voltage: Array) -> Truth:
        """The block that the stack really gets."""
        if (self._instrument.open or self._instrument.short) and self._last is not None:
            still = self._last
            fill = np.ones_like(time)
            return Truth(time, still.displacement[-1] * fill, still.polarization[-1] * fill, still.phase_fraction)
        self._last = self._stage.step(time, voltage)
        return self._last


class Rig:
    """The closed loop in one process, with the watch of the amplifier node beside it."""

    def __init__(self, folder: Path) -> None:
        path = folder / "rig.yaml"
        path.write_text(SCENARIO, encoding="utf-8")
        self.loop = InProcessLoop(load_scenario(path))
        self.amplifier = self.loop.amplifier
        self.instrument = Instrument(self.amplifier.driver)
        self.amplifier.driver = self.instrument  # type: ignore[assignment]
        self.loop.stage = Stage(self.loop.stage, self.instrument)  # type: ignore[assignment]
        self.watch = Watch(self.amplifier)
        self.now = 0.0

    def run(self, blocks: int) -> Tick:
        """From the start, so many blocks."""
        tick = self._seen(self.loop.start())
        for _ in range(blocks):
            tick = self.follow(tick)
            assert self.amplifier.state == "enabled", self.amplifier.reason
        return tick

    def follow(self, tick: Tick) -> Tick:
        """One more block."""
        after = self.loop.step(tick)
        assert after is not None, "the scenario is over"
        return self._seen(after)

    def _seen(self, tick: Tick) -> Tick:
        begin = float(tick.applied.time[0])
        self.now = float(tick.applied.time[-1])
        self.watch.put_out(tick.applied, self.now)
        self.watch.measured(begin, tick.measurement)
        self.watch.estimated(begin, tick.estimate.innovation)
        return tick

    def ramp_down(self) -> float:
        """Let the amplifier ramp, block by block; the time of the run when 0 V is reached [s]."""
        loop = self.loop
        while self.amplifier.state == RAMPING:
            before = len(self.instrument.history)
            self.amplifier.ramp()
            self.now += self.amplifier.block_size / self.amplifier.sample_rate
            fall = np.diff(np.abs(self.instrument.history[before - 1 :]))
            assert np.all(fall <= 1e-9), "the voltage rises on the way to 0 V"
            assert self.now < 60.0, f"never at 0 V: {loop.amplifier.reason}"
        return self.now


def bench(folder: Path) -> Any:
    """A folder is all that is needed; every fault has a rig of its own."""
    return nullcontext(folder)


def harmed(kind: str, value: Any, says: str) -> Any:
    """One of the instrument's attributes is set in the middle of a run, `silent` for a tenth of a second."""

    def perform(folder: Path, rng: np.random.Generator) -> Seen:
        rig = Rig(folder)
        tick = rig.run(int(rng.integers(30, 300)))
        setattr(rig.instrument, kind, value)
        begin = rig.now
        while rig.amplifier.state != RAMPING and rig.now < begin + 5.0:
            before = rig.amplifier.next_block
            try:
                tick = rig.follow(tick)
            except RunFailedError:  # the amplifier took no command: right, once it ramps
                if rig.amplifier.next_block != before or rig.amplifier.state != RAMPING:
                    raise
        rig.instrument.silent = False
        seconds = rig.ramp_down() - begin
        if rig.amplifier.state == FAULT and rig.instrument.history[-1] == 0.0 and says in rig.amplifier.reason:
            return Seen(SAFE, seconds)
        return Seen(f"{rig.amplifier.state}: {rig.amplifier.reason}", seconds)

    return perform


def charged(folder: Path, rng: np.random.Generator) -> Seen:
    """The stack has a voltage before anything was put out."""
    rig = Rig(folder)
    found = float(rng.uniform(-60.0, 180.0))
    rig.instrument.replace(SimulatedAmplifier(load_chain("bench-stage"), Rest(voltage=found)))
    amplifier: GuardedAmplifier = rig.amplifier
    refused = amplifier.enable()
    inside = LIMITS.voltage_min <= found <= LIMITS.voltage_max
    if inside != (refused == "") or (inside and amplifier.hold().voltage[0] != found):
        return Seen(f"at {found:.1f} V enable says {refused or 'yes'!r}", 0.0)
    begin = rig.now
    amplifier.discharge()
    seconds = rig.ramp_down() - begin
    step = float(np.max(np.abs(np.diff(rig.instrument.history))))
    if amplifier.state == DISABLED and step <= LIMITS.slew_rate / amplifier.sample_rate * (1 + 1e-9):
        return Seen(FOUND, seconds)
    return Seen(f"{amplifier.state}, a step of {step:.1f} V", seconds)


def row(name: str, made: str, kind: str, value: Any, says: str) -> Fault:
    """A row whose reaction is the ramp to 0 V."""
    return Fault(
        name, made, SAFE, LIMITS.declared_safe_time, "until 0 V, time of the run", bench, harmed(kind, value, says)
    )


INSTRUMENT_FAULTS = (
    row("over-current", "the current reads 0.3 A more", "spike", 0.3, "current of"),
    row("current NaN", "the current reads NaN", "spike", float("nan"), "current of"),
    row("shorted stack", "1 ohm instead of the stack", "short", True, "current of"),
    row("open stack",
        "no current, and the stage moves no more; with `limits.capacitance_min`", "open", True, "is it connected?"),
    row("amplifier does not answer", "its driver fails until the fault is noticed", "silent", True, "not answer"),
    Fault("power-up with a charged stack", "-60 to 180 V at the stack before `enable`", FOUND,
          LIMITS.declared_safe_time, "of `discharge`, time of the run", bench, charged),
)  # fmt: skip
