"""The one interface that all stages of the signal chain share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.physics.change import Change, by_differences
from pzt_ros.physics.signals import Array, Rest, Signals

State = Array
"""A link's memory: a flat array of floats, so that it can be copied, stored and compared."""

AMPLIFIER, ACTUATOR, SENSOR = "amplifier", "actuator", "sensor"
SECTIONS = (AMPLIFIER, ACTUATOR, SENSOR)
"""The parts of the chain that live in one device each, in the order of the signal."""


def no_state() -> State:
    """The state of a link without memory."""
    return np.empty(0)


@dataclass(frozen=True, kw_only=True)
class Link(ABC):
    """One stage of the signal chain: parameters are fields, memory goes in and comes out.

    A link is final: to change one a little, write another. `step` never changes the state it is given.
    """

    kind: ClassVar[str]
    section: ClassVar[str]
    remembers: ClassVar[bool] = False
    """Whether what was before its first sample shows in it for seconds."""
    follows_turns: ClassVar[bool] = False
    """Whether which way the polarization came to its first sample shows in it until that turns."""

    def noiseless(self) -> Link:
        """The same link without what no model can know: noise, least steps. Links that have such override this."""
        return self

    def prompt(self) -> Link:
        """The same link without its dynamics, where an inverse had better not look at the state they are in.

        These are a mode, which rings when its state is fed back sample by sample, and the lag of a sensor, which is not
        the stage's. Such links override this.
        """
        return self

    def inverse_looks_back(self, step: float) -> bool:
        """Whether at this sample step [s] `invert` takes differences of what is wanted, and so comes a sample late."""
        return False

    def carry(self, signals: Signals, change: Change) -> Change:
        """What small changes of a block change of its outcome, from rest at its first sample.

        By differences here, a pass for each; links that know their slope override this, since a fit has hundreds.
        """
        rest = Rest(time=float(signals.time[0]), voltage=float(signals.voltage[0]))
        return by_differences(lambda block: self.step(self.init(rest), block)[1], signals, change)

    @abstractmethod
    def init(self, rest: Rest) -> State:
        """The state at rest, before the first sample."""

    @abstractmethod
    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Pass a block of samples on towards the sensor."""

    @abstractmethod
    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """What has to come in so that the given block comes out; the state moves as in `step`."""
