"""Bandwidth of the amplifier where the record has only the command."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.effects.mode import STATE_SIZE, follow, lead
from pzt_ros.physics.link import AMPLIFIER, Link, State
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameter

_FAR_ABOVE = 1e-12
"""Of the time constant: a second pole that is none."""

_SHRINKS = 0.72
"""Errors of the exact inverse, per sample: its noise gain is 13.4 at most. One pole asks for a step as long as it."""


@dataclass(frozen=True, kw_only=True)
class AmplifierBandwidth(Link):
    """A low-pass of second order between command and voltage across the ceramic, in balance at the first sample.

    1 / (1 + T p + c (T p)^2): with c = 0 one pole, up to 1/4 two real ones, at 1/2 Butterworth's.
    """

    kind: ClassVar[str] = "amplifier_bandwidth"
    section: ClassVar[str] = AMPLIFIER

    time_constant: float = parameter(0.0, "s", "by which a ramp comes late", symbol="T", bounds=(0.0, 10.0))
    second_order: float = parameter(
        0.0, "1", "its coefficient: none with one pole, 0.25 with two equal ones", symbol="c", bounds=(0.0, 1.0)
    )

    def init(self, rest: Rest) -> State:
        """See `mode`; deflection and velocity in V and V/s."""
        return np.zeros(STATE_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Command to voltage."""
        after, out = state.copy(), np.empty_like(signals.voltage)
        follow(after, signals.time, signals.voltage, out, *self._mode)
        return after, signals.replace(voltage=out)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage wanted to command.

        Exact where sampling is slower than the time constant, else by differences: first order in the step.
        """
        after, command = state.copy(), np.empty_like(signals.voltage)
        lead(after, signals.time, signals.voltage, command, *self._mode, _SHRINKS)
        return after, signals.replace(voltage=command)

    @property
    def _mode(self) -> tuple[float, float, float]:
        """Frequency [rad/s], damping and share of the mode that does the same."""
        if self.time_constant == 0.0:
            return 1.0, 1.0, 0.0
        root = math.sqrt(max(self.second_order, _FAR_ABOVE))
        return 1.0 / (root * self.time_constant), 0.5 / root, 1.0
