"""The model that a control loop carries along: what it says now, and what controllers invert of it."""

from __future__ import annotations

import math

import numpy as np

from pzt_ros.controllers.pi import sample_period
from pzt_ros.physics.chain import Chain, ChainState
from pzt_ros.physics.link import ACTUATOR, SENSOR
from pzt_ros.physics.signals import ABSENT, Array, Rest, Signals


class Modelled:
    """Actuator and sensor of a model, following the voltage that was applied.

    Controllers invert `chain`, the model without the dynamics that `Link.prompt` leaves out. A reference is for the
    stage, not for a sensor that lags behind it. And a mode has to be led from where it is wanted, not from where it is:
    an inverse that starts from the state of a mode feeds it back sample by sample, and is unstable. So `led` shapes the
    reference for the mode, and what is compared with measurements (`predicted`, `reading_of`) has all dynamics.
    """

    def __init__(self, model: Chain, rest: Rest) -> None:
        whole = model.behind_amplifier
        self.chain = whole.with_links(lambda link: link.prompt())
        self.state: ChainState = self.chain.init(rest)
        self.predicted = ABSENT
        self._followed = -math.inf
        late = [i for i, link in enumerate(whole.links) if link.prompt() is not link]
        self._alike = late[0] if late else len(whole.links)
        self._front = Chain("up to the first dynamics", self.chain.links[: self._alike])
        self._behind = Chain("from there on, without them", self.chain.links[self._alike :])
        self._moving = _Running(Chain("from there on", whole.links[self._alike :]), rest)
        modes = tuple(whole.links[i] for i in late if whole.links[i].section == ACTUATOR)
        self._modes = _Running(Chain("modes", modes), rest)
        self._still = _Running(self._modes.chain.with_links(lambda link: link.prompt()), rest)
        self._shape = np.zeros(2)
        self._sensor = _Running(whole.section(SENSOR), rest)
        self._prompt = _Running(self.chain.section(SENSOR), rest)

    def follow(self, time: Array, voltage: Array) -> None:
        """Move on with a block of applied voltage [V], unless that is done already."""
        if time[-1] <= self._followed:
            return
        before, moved = self._front.step(self.state[: self._alike], Signals(time, voltage))
        after, seen = self._behind.step(self.state[self._alike :], moved)
        if self._behind.links:
            seen = self._moving.step(moved)
        self.state, self.predicted = before + after, seen.displacement
        self._followed = float(time[-1])

    def led(self, time: Array, reference: Array) -> Array:
        """The reference that makes a mode give `reference` [m]; block after block, evenly sampled.

        Where an inverse looks back, what it adds to the reference is a sample late; that is carried on by a sample as a
        parabola, which leaves an error of third order in the step.
        """
        if not self._modes.chain.links:
            return reference
        needed = self._still.step(self._modes.invert(Signals(time, displacement=reference))).displacement
        shape = np.concatenate((self._shape, needed - reference))
        self._shape = shape[-2:]
        step = sample_period(time, self._followed)
        if not any(link.inverse_looks_back(step) for link in self._modes.chain.links):
            return needed
        led: Array = reference + 3.0 * (shape[2:] - shape[1:-1]) + shape[:-2]
        return led

    def reading_of(self, time: Array, reference: Array) -> Array:
        """What the sensor reads of a stage that follows the reference [m]; block after block."""
        if self._sensor.chain.links == self._prompt.chain.links:
            return reference
        needed = self._prompt.invert(Signals(time, displacement=reference))
        return self._sensor.step(needed).displacement


class _Running:
    """A chain and where it is."""

    def __init__(self, chain: Chain, rest: Rest) -> None:
        self.chain = chain
        self._state = chain.init(rest)

    def step(self, signals: Signals) -> Signals:
        self._state, out = self.chain.step(self._state, signals)
        return out

    def invert(self, signals: Signals) -> Signals:
        self._state, out = self.chain.invert(self._state, signals)
        return out
