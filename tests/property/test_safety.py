"""Laws of the safety machine over random sequences of events, with a driver that fails in the middle of a block.

Whatever happens in whatever order: no voltage rises while there is a fault, nothing follows commands after a fault
without a reset that came after its cause was gone, and nothing leaves the window or exceeds the slew rate.
"""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from pzt_ros.hardware import machine
from pzt_ros.hardware.amplifier import Applied
from pzt_ros.hardware.driver import DriverError
from pzt_ros.hardware.guard import DISABLED, ENABLED, FAULT, RAMPING, GuardedAmplifier, Limits

RATE, SIZE = 1000.0, 4
LIMITS = Limits(voltage_min=-40.0, voltage_max=150.0, slew_rate=2e4, current=0.2, power=20.0, safe_rate=8e3)
SLEW_STEP, SAFE_STEP = LIMITS.slew_rate / RATE, LIMITS.safe_rate / RATE
SLACK = 1.0 + 1e-9
EVENTS_PER_SEQUENCE = 50
SEQUENCES = 2000


class Instrument:
    """A stack whose voltage is only what was put out, and what the test does to it."""

    def __init__(self, gain: float, voltage: float) -> None:
        self.gain = gain
        self.stack = voltage
        self.current = 0.0
        self.breaks_after: int | None = None
        self.reachable = True
        self.was_off = False
        self.moves: list[float] = []

    def notice(self) -> None:
        """A connection that broke because the instrument was off is noticed by the next call, once."""
        if self.was_off:
            self.was_off = False
            raise DriverError("was off")

    @property
    def voltage(self) -> float:
        self.notice()
        if not self.reachable:
            raise DriverError("not reachable")
        return self.stack

    def apply(self, time: np.ndarray, command_voltage: np.ndarray) -> Applied:
        self.notice()
        out = (self.gain * command_voltage).tolist()
        if self.breaks_after is not None or not self.reachable:
            out = out[: self.breaks_after if self.reachable else 0]
            self.moves += out
            self.stack = out[-1] if out else self.stack
            raise DriverError("broke off")
        self.moves += out
        self.stack = out[-1]
        return Applied(time, np.array(out), np.full(SIZE, self.current), np.zeros(SIZE))


class Ledger:
    """Keeps the books beside the guard, by rules of its own."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.instrument = Instrument(float(rng.choice([1.0, 27.8])), float(rng.choice([0.0, 0.0, 70.0, 160.0])))
        self.guard = GuardedAmplifier(self.instrument, LIMITS, RATE, SIZE)  # type: ignore[arg-type]
        self.needs_reset = bool(self.guard.reason)
        self.cause_lasts = False
        self.seen: set[tuple[str, str]] = set()

    def happen(self) -> None:
        """One random event, and the books afterwards."""
        before = self.instrument.stack
        state, faulty = self.guard.state, bool(self.guard.reason)
        self.instrument.moves = []
        name = NAMES[int(self.rng.choice(len(NAMES), p=WEIGHTS))]
        granted = getattr(self, name)()
        self.seen.add((state, name))
        self.check_moves(0.0 if name == "power_cycle" else before, self.instrument.moves, state, faulty)
        if self.instrument.moves and not abs(self.instrument.current) <= LIMITS.current:
            assert self.guard.reason, "no fault after too much current"
        if name == "enable" and granted == "" and state != ENABLED:
            assert not self.needs_reset, "enabled after a fault without a reset"
            assert not self.cause_lasts, "enabled while a cause is present"
        if name == "reset" and granted == "":
            assert state == FAULT
            assert not self.cause_lasts, "reset while the cause is present"
            self.needs_reset = False
        if self.guard.reason:
            self.needs_reset = True
            assert self.guard.state in (RAMPING, FAULT)
        else:
            assert not self.needs_reset, "the reason is gone without a reset"
        assert (self.guard.state == FAULT) <= (self.guard.command_voltage == 0.0)

    def check_moves(self, before: float, moves: list[float], state: str, faulty: bool) -> None:
        if not moves:
            return
        assert state in (ENABLED, RAMPING, DISABLED), f"something is put out in {state}"
        lowest, highest = min(LIMITS.voltage_min, before), max(LIMITS.voltage_max, before)
        last = before
        for value in moves:
            assert math.isfinite(value)
            assert lowest * SLACK <= value <= highest * SLACK
            assert abs(value - last) <= SLEW_STEP * SLACK + 1e-9
            if state != ENABLED:
                assert abs(value) <= abs(last) + 1e-9, "rises while nothing is to be followed"
                assert value * last >= 0.0, "swings through 0 V"
            if faulty:
                assert abs(value - last) <= SAFE_STEP * SLACK + 1e-9
            last = value

    # -- events

    def command(self) -> object:
        values = self.rng.uniform(-100.0, 250.0, SIZE) / self.instrument.gain
        return self.guard.apply(self.guard.next_block * SIZE / RATE, values)

    def hold_still(self) -> object:
        values = np.full(SIZE, self.guard.command_voltage)
        return self.guard.apply(self.guard.next_block * SIZE / RATE, values)

    def bad_command(self) -> object:
        values = self.rng.uniform(-100.0, 250.0, int(self.rng.integers(0, SIZE + 2)))
        if values.size and self.rng.random() < 0.5:
            values[0] = self.rng.choice([math.nan, math.inf, 1e300])
        first = self.guard.next_block * SIZE / RATE + float(self.rng.choice([0.0, 0.0, 1.0, -1.0, math.nan]))
        followed, in_turn = self.guard.state == ENABLED, first == self.guard.next_block * SIZE / RATE
        applied = self.guard.apply(first, values, float(self.rng.choice([0.0, 0.1, 9.0, math.nan])))
        if followed and in_turn and values.shape == (SIZE,) and not np.all(np.isfinite(values)):
            assert self.guard.reason, "no fault after a command that is no number"
        return applied

    def enable(self) -> str:
        answer = self.guard.enable()
        if answer == "":
            try:
                self.guard.hold()
            except DriverError:
                assert self.guard.reason
        return answer

    def disable(self) -> None:
        self.guard.disable()

    def discharge(self) -> None:
        self.guard.discharge()

    def reset(self) -> str:
        return self.guard.reset()

    def ramp(self) -> None:
        if self.guard.state == RAMPING:
            self.guard.ramp()

    def cause(self) -> None:
        self.guard.trip(str(self.rng.choice(machine.CAUSES)), "the test says so")

    def lasting_cause(self) -> None:
        self.cause_lasts = not self.cause_lasts
        self.guard.present(machine.SENDERS, "two" if self.cause_lasts else "")

    def draw_current(self) -> None:
        self.instrument.current = float(self.rng.choice([0.0, 0.0, 0.1, 0.3, -0.3, math.nan]))

    def break_off(self) -> None:
        self.instrument.breaks_after = int(self.rng.integers(0, SIZE + 1))

    def mend(self) -> None:
        self.instrument.breaks_after, self.instrument.reachable, self.instrument.current = None, True, 0.0

    def unplug(self) -> None:
        self.instrument.reachable = False

    def power_cycle(self) -> None:
        """The instrument was off and on again: 0 V, and nobody was told."""
        self.instrument.stack, self.instrument.was_off = 0.0, True

    def charge(self) -> None:
        """Somebody else charges the stack, which only happens where nothing is put out."""
        if self.guard.state == DISABLED:
            self.instrument.stack = float(self.rng.uniform(-60.0, 180.0))


OFTEN = {"command": 8.0, "hold_still": 1.0, "enable": 5.0, "reset": 3.0, "ramp": 10.0, "mend": 4.0, "disable": 1.0}
RARELY = ("bad_command", "discharge", "cause", "lasting_cause", "draw_current", "break_off", "unplug", "charge")
NAMES = [*OFTEN, *RARELY, "power_cycle"]
WEIGHTS = np.array([*OFTEN.values(), *[0.7] * len(RARELY), 0.3])
WEIGHTS /= WEIGHTS.sum()


def sequences(count: int, seed: int) -> set[tuple[str, str]]:
    """Check so many sequences; returns which event was tried in which state."""
    rng = np.random.default_rng(seed)
    seen: set[tuple[str, str]] = set()
    for _ in range(count):
        ledger = Ledger(rng)
        for _ in range(EVENTS_PER_SEQUENCE):
            ledger.happen()
        seen |= ledger.seen
    return seen


@pytest.mark.parametrize("part", range(4))
def test_laws_of_the_safety_machine(part: int) -> None:
    seen = sequences(SEQUENCES // 4, 20261121 + part)
    shown = (DISABLED, ENABLED, RAMPING, FAULT)
    assert seen == {(state, name) for state in shown for name in NAMES}, "an event was never tried in a state"


if __name__ == "__main__":  # a long series: python tests/property/test_safety.py 100000
    number = int(sys.argv[1])
    sequences(number, 1)
    print(f"{number} sequences of {EVENTS_PER_SEQUENCE} events: no law was broken")
