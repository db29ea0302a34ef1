"""The voltage amplifier between the command and the ceramic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.physics.link import AMPLIFIER, Link, State, no_state
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class Amplifier(Link):
    """A gain: the voltage across the ceramic is `gain` times the command."""

    kind: ClassVar[str] = "amplifier"
    section: ClassVar[str] = AMPLIFIER

    gain: float = parameter(1.0, "1", "voltage across the ceramic over command voltage", bounds=(1e-3, 1e4))

    def init(self, rest: Rest) -> State:
        """No memory."""
        return no_state()

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Command voltage to drive voltage."""
        return state, signals.replace(voltage=self.gain * signals.voltage)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Drive voltage to command voltage."""
        return state, signals.replace(voltage=signals.voltage / self.gain)
