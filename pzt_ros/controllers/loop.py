"""The control loop: the active controller, the model it may use, and the hand-over from one to the next."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from pzt_ros.controllers.controller import Controller, Feedback, fade
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import AMPLIFIER
from pzt_ros.physics.signals import REHEARSAL, Array, Rest, Signals
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference


class ControlLoop:
    """Turns references into drive, block by block, with whichever controller is active.

    The model's state follows the voltage that was really applied, whoever is in charge, so that a model-based
    controller can take over at any time. `active` names the controller in charge of displacement references. A
    reference of voltage goes straight through. When the source of the voltage changes, what would be a jump is added
    to the new one and fades out over `handover_time`, unless a controller itself begins at the voltage found.
    """

    def __init__(
        self,
        model: Chain,
        controllers: Mapping[str, Controller],
        rest: Rest,
        active: str = "open_loop",
        handover_time: float = 0.05,
    ) -> None:
        self.controllers = dict(controllers)
        self.handover_time = handover_time
        self._model = model.behind_amplifier
        self._amplifier = model.section(AMPLIFIER)
        self._amplifier_state = self._amplifier.init(rest)
        self._model_state = self._model.init(rest)
        self._followed = -math.inf
        self._source = VOLTAGE
        self._last: Reference | None = None
        self._state: Any = None
        self._jump = 0.0
        self._since = 0.0
        self.select(active)

    def warm_up(self) -> None:
        """Compile now what the first block of each controller would have to wait for; no state is changed."""
        zeros = np.zeros_like(REHEARSAL)
        _, at_rest = self._model.step(self._model_state, Signals(REHEARSAL, zeros))
        feedback = Feedback(REHEARSAL, zeros, at_rest.displacement, at_rest.displacement, zeros, self._model_state)
        for controller in self.controllers.values():
            state = controller.init(self._model, feedback)
            controller.step(self._model, state, REHEARSAL, at_rest.displacement, feedback)

    def select(self, name: str) -> None:
        """Give displacement references to another controller from the next block on.

        Raises:
            BenchError: no controller of that name.
        """
        if name not in self.controllers:
            raise BenchError(f"controller '{name}' is unknown; known are {', '.join(self.controllers)}")
        self.active = name

    def replace(self, controller: Controller) -> None:
        """Put other gains into place; a controller in charge keeps its state."""
        self.controllers[controller.kind] = controller

    def follow(self, time: Array, voltage: Array) -> None:
        """Let the model follow a block of applied voltage [V], unless it has already.

        `step` sees to it; who has the block earlier may save the time.
        """
        if time[-1] > self._followed:
            self._model_state, _ = self._model.step(self._model_state, Signals(time, voltage))
            self._followed = float(time[-1])

    def step(self, reference: Reference, feedback: Feedback) -> Array:
        """The command voltage [V, shape (n,)] for the block that `reference` asks for.

        Args:
            reference: of the block to come.
            feedback: the block before it, as applied and measured.
        """
        self.follow(feedback.time, feedback.voltage)
        asked = self._last.values if self._last is not None and self._last.quantity == DISPLACEMENT else None
        feedback = dataclasses.replace(feedback, reference=asked, model=self._model_state)
        self._last = reference
        drive = self._drive(reference, feedback)
        self._amplifier_state, command = self._amplifier.invert(self._amplifier_state, Signals(reference.time, drive))
        return command.voltage

    def _drive(self, reference: Reference, feedback: Feedback) -> Array:
        """The voltage across the ceramic [V], with what is left of a hand-over."""
        source = VOLTAGE if reference.quantity == VOLTAGE else self.active
        changed = source != self._source
        if source == VOLTAGE:
            smooth, wanted = False, reference.values
        else:
            controller = self.controllers[source]
            if changed:
                self._state = controller.init(self._model, feedback)
            smooth = controller.takes_over_smoothly
            self._state, wanted = controller.step(self._model, self._state, reference.time, reference.values, feedback)
        if changed:
            self._source, self._since = source, float(feedback.time[-1])
            self._jump = 0.0 if smooth else float(feedback.voltage[-1] - wanted[0])
        if not self._jump or reference.time[0] - self._since > self.handover_time:
            return wanted
        return wanted + fade(self._jump, reference.time - self._since, self.handover_time)
