"""The control loop: the active controller, the model it may use, and the hand-over from one to the next."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from pzt_ros.controllers.bounds import Bounds
from pzt_ros.controllers.controller import Controller, Feedback, fade
from pzt_ros.controllers.modelled import Modelled
from pzt_ros.errors import BenchError
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import AMPLIFIER
from pzt_ros.physics.signals import REHEARSAL, Array, Rest, Signals
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference

VOLTAGE_TIME = 0.05
"""After this time [s] a reference of voltage is what it says, however long an offset of controllers may stay."""


class ControlLoop:
    """Turns references into drive, block by block, with whichever controller is active.

    The model's state follows the voltage that was really applied, whoever is in charge, so that a model-based
    controller can take over at any time. `active` names the controller in charge of displacement references. A
    reference of voltage goes straight through. When the source of the voltage changes, what would be a jump is added
    to the new one and fades out over `handover_time`, unless a controller itself begins at the voltage found. What
    controllers ask for is kept within `bounds`, and within them it is always a number; `limited` counts the samples
    where that made a difference.
    """

    def __init__(
        self,
        model: Chain,
        controllers: Mapping[str, Controller],
        rest: Rest,
        active: str = "open_loop",
        handover_time: float = 0.05,
        bounds: Bounds | None = None,
    ) -> None:
        self.controllers = dict(controllers)
        self.handover_time = handover_time
        self._model = Modelled(model, rest)
        self._amplifier = model.section(AMPLIFIER)
        self._amplifier_state = self._amplifier.init(rest)
        self._gain = math.prod(link.gain for link in self._amplifier.links if isinstance(link, Amplifier))
        self._bounds = bounds or Bounds()
        self._command: float | None = None
        self._cut = 0.0
        self.limited = 0
        self._source = VOLTAGE
        self._last: Reference | None = None
        self._state: Any = None
        self._jump = 0.0
        self._since = 0.0
        self._fading = handover_time
        self.select(active)

    def warm_up(self) -> None:
        """Compile now what the first block of each controller would have to wait for; no state is changed."""
        zeros = np.zeros_like(REHEARSAL)
        chain, rest = self._model.chain, self._model.state
        _, at_rest = chain.step(rest, Signals(REHEARSAL, zeros))
        y = at_rest.displacement
        feedback = Feedback(REHEARSAL, zeros, y, y, zeros, rest, y)
        self._bounds.keep(zeros, 0.0, REHEARSAL, 0.0)
        for controller in self.controllers.values():
            state = controller.init(chain, feedback)
            controller.step(chain, state, REHEARSAL, at_rest.displacement, feedback)

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

    def health(self) -> dict[str, str]:
        """Which controller is in charge, and what it has to say."""
        in_charge = self._source == self.active
        return {"controller": self.active, **(self.controllers[self.active].health(self._state) if in_charge else {})}

    def follow(self, time: Array, voltage: Array) -> None:
        """Let the model follow a block of applied voltage [V], unless it has already.

        `step` sees to it; who has the block earlier may save the time.
        """
        self._model.follow(time, voltage)

    def step(self, reference: Reference, feedback: Feedback) -> Array:
        """The command voltage [V, shape (n,)] for the block that `reference` asks for.

        Args:
            reference: of the block to come.
            feedback: the block before it, as applied and measured.
        """
        self.follow(feedback.time, feedback.voltage)
        self._begin_anew_after_a_gap(reference, feedback)
        asked = None
        if self._last is not None and self._last.quantity == DISPLACEMENT:
            asked = self._model.reading_of(self._last.time, self._last.values)
        feedback = Feedback(
            feedback.time, feedback.voltage, feedback.measurement, feedback.estimate,
            reference=asked, model=self._model.state, predicted=self._model.predicted, cut=self._cut,
            bounds=self._bounds,
        )  # fmt: skip
        self._last = reference
        drive = self._drive(reference, feedback)
        self._amplifier_state, wanted = self._amplifier.invert(self._amplifier_state, Signals(reference.time, drive))
        command = wanted.voltage
        if reference.quantity == DISPLACEMENT:
            command = self._bounded(command, reference.time, feedback)
        self._command = float(command[-1])
        return command

    def _begin_anew_after_a_gap(self, reference: Reference, feedback: Feedback) -> None:
        """The block just measured was not asked for here: the stage was disabled meanwhile, and is elsewhere."""
        period = reference.time[0] - feedback.time[-1]
        if self._last is not None and feedback.time[-1] - self._last.time[-1] > 0.5 * period:
            self._last, self._command, self._source = None, None, VOLTAGE
            self._cut = self._jump = 0.0

    def _bounded(self, wanted: Array, time: Array, feedback: Feedback) -> Array:
        """The command [V] within the bounds, which are those of the stack; what they took is kept for the next step."""
        across = self._gain * wanted
        last = float(feedback.voltage[-1]) if self._command is None else self._gain * self._command
        kept = self._bounds.keep(across, last, time, float(feedback.time[-1]))
        cut = float(across[-1] - kept[-1])
        self._cut = cut if math.isfinite(cut) else 0.0
        limited = int(np.count_nonzero(kept != across))
        self.limited += limited
        return kept / self._gain if limited else wanted

    def _drive(self, reference: Reference, feedback: Feedback) -> Array:
        """The voltage across the ceramic [V], with what is left of a hand-over."""
        source = VOLTAGE if reference.quantity == VOLTAGE else self.active
        changed = source != self._source
        if source == VOLTAGE:
            smooth, wanted = False, reference.values
        else:
            controller = self.controllers[source]
            if changed:
                self._cut, feedback = 0.0, dataclasses.replace(feedback, cut=0.0)
                self._state = controller.init(self._model.chain, feedback)
            smooth = controller.takes_over_smoothly
            chain, led = self._model.chain, self._model.led(reference.time, reference.values)
            self._state, wanted = controller.step(chain, self._state, reference.time, led, feedback)
        if changed:
            self._source, self._since = source, float(feedback.time[-1])
            self._fading = min(self.handover_time, VOLTAGE_TIME) if source == VOLTAGE else self.handover_time
            self._jump = 0.0 if smooth else float(feedback.voltage[-1] - wanted[0])
        if not self._jump or reference.time[0] - self._since > self._fading:
            return wanted
        return wanted + fade(self._jump, reference.time - self._since, self._fading)
