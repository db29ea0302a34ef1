"""Learning control for periodic scans: every cycle is corrected by the errors of those before it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pzt_ros.controllers.broken_line import corners, line_through
from pzt_ros.controllers.controller import NEVER, Controller, Feedback, fade, model_offset, tracking_error
from pzt_ros.controllers.inverse import inverse_voltage
from pzt_ros.controllers.pi import sample_period
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter

BLEND = 0.05
"""Of a period, over which the correction comes in or goes out when the reference begins or ends to be periodic."""

MOST = 20_000
"""Places in a period: a scan of 1 Hz at 20 kHz has one for each sample, slower ones one for several."""

FINE, SLOW = 1.0 / 20.0, 1.0 / 6.0
"""Of a period: widest distance of the corners of the correction, and of those of its slow part."""

FIRST_SLOW = 1.0 / 100.0
"""Of a period: distance of the first corners of the slow part behind a turn."""

SAME = 1e-3
"""Of its peak to peak, by which a reference may differ from the cycle before and still be the same scan."""


@dataclass(frozen=True)
class Learned:
    """What is known of a scan; arrays have a number per place in the period [m, shape (n,)].

    Attributes:
        jump, start: offset of the model at take-over [m] and its time [s].
        asked: reference of the last cycle; NaN where there was none.
        used: correction in that cycle, as it was really added to the reference.
        error: tracking error of it.
        found: what the correction should have been, by the cycles so far, with the noise that is left in it.
        now: correction in use: a broken line through that.
        cycles: how many cycles of this very scan have been learned from.
        weight: share of the correction that is in use [-].
        next: time of the first sample of the cycle that comes [s].
    """

    jump: float
    start: float
    asked: Array
    used: Array
    error: Array
    found: Array
    now: Array
    cycles: int
    weight: float
    next: float


@dataclass(frozen=True, kw_only=True)
class Learning(Controller):
    """The inverse, and a correction of its reference that is learned from cycle to cycle of a periodic scan.

    After a cycle it is known what the correction should have been at each sample: the one in use plus the error that
    was left. The mean over the cycles of that, as a broken line, is the next correction. The mean takes the last cycle
    in by shares that fall with their number, so that noise is averaged; for its slow part, which has little noise and
    creeps with the stage, they fall less far. Where the reference is not that of the cycle before, there is no
    correction. Vendors call this dynamic digital linearization; it is iterative learning control (Bristow et al. 2006)
    on the inverse of the model.
    """

    kind: ClassVar[str] = "learning"
    takes_over_smoothly: ClassVar[bool] = True
    keeps_offset: ClassVar[bool] = True

    period: float = parameter(0.1, "s", "of the scan", bounds=(1e-3, 1e3))
    gain: float = parameter(1.0, "1", "share of the error learned from the first cycle", bounds=(0.0, 2.0))
    least_gain: float = parameter(0.2, "1", "share to which it falls, as 2/(cycles + 1)", bounds=(0.0, 2.0))
    slow_gain: float = parameter(0.5, "1", "share to which it falls for the slow part", bounds=(0.0, 2.0))
    smoothing: float = parameter(
        1e-4, "s", "distance of the first corners behind a turn; 0: every sample is one", bounds=(0.0, 10.0)
    )
    correction_limit: float = parameter(
        5e-6, "m", "the correction stays within plus and minus this", bounds=(0.0, 1e-3)
    )
    handover_time: float = parameter(0.1, "s", "over which the model's offset at take-over fades", bounds=(1e-3, NEVER))

    def init(self, model: Chain, feedback: Feedback) -> Learned:
        """Nothing learned."""
        start, none = float(feedback.time[-1]), np.empty(0)
        jump = model_offset(model, feedback)
        return Learned(jump, start, none, none, none, none, none, 0, 0.0, start + self.period)

    def step(
        self, model: Chain, state: Learned, time: Array, reference: Array, feedback: Feedback
    ) -> tuple[Learned, Array]:
        """Drive voltage [V]."""
        step = sample_period(time, feedback.time[-1])
        size = min(max(2, round(self.period / step)), MOST)
        if state.asked.size != size:
            nothing = np.zeros(size)
            state = dataclasses.replace(
                state, asked=np.full(size, np.nan), used=nothing, error=nothing, found=nothing,
                now=nothing, cycles=0, weight=0.0, next=float(feedback.time[-1]) + self.period,
            )  # fmt: skip
        state = self._listen(state, feedback)
        state, correction = self._correction(state, time, reference, step)
        offset = fade(state.jump, time - state.start, self.handover_time)
        return state, inverse_voltage(model, time, reference + offset + correction, feedback)

    def _listen(self, state: Learned, feedback: Feedback) -> Learned:
        """Take down the errors of a block; learn from the cycle when it is over."""
        error = tracking_error(feedback)
        error = np.where(error * feedback.cut > 0.0, 0.0, error)  # beyond the bounds there is nothing to learn
        noted = state.error.copy()
        noted[self._places(feedback.time, noted.size)] = error
        if feedback.time[-1] < state.next:
            return dataclasses.replace(state, error=noted)
        found = state.found + self._learned(state, state.used + noted - state.found)
        line = found
        if self.smoothing > 0.0:
            step = self.period / found.size
            line = line_through(found, corners(state.asked, self.smoothing / step, FINE * found.size))
        return dataclasses.replace(
            state,
            error=noted,
            found=found,
            now=np.clip(line, -self.correction_limit, self.correction_limit),
            cycles=state.cycles + 1,
            next=state.next + self.period,
        )

    def _learned(self, state: Learned, news: Array) -> Array:
        """What the mean takes in of a cycle that says something else [m, shape (n,)]."""
        share = self.gain * min(1.0, 2.0 / (state.cycles + 2))
        fine, slow = max(share, min(self.least_gain, self.gain)), max(share, min(self.slow_gain, self.gain))
        if slow <= fine:
            return fine * news
        few = corners(state.asked, FIRST_SLOW * news.size, SLOW * news.size)
        return fine * news + (slow - fine) * line_through(news, few)

    def _correction(self, state: Learned, time: Array, reference: Array, step: float) -> tuple[Learned, Array]:
        """What is added to a block of reference [m], and the note of it."""
        places = self._places(time, state.now.size)
        before = state.asked[places]
        known = np.all(np.abs(reference - before) <= SAME * np.ptp(state.asked))  # not where there was none: NaN
        per_sample = step / (BLEND * self.period)
        count = np.arange(1, len(time) + 1)
        if known:
            weight = np.minimum(state.weight + per_sample * count, 1.0)
        else:
            weight = np.maximum(state.weight - per_sample * count, 0.0)
        correction = weight * state.now[places]
        asked, used = state.asked.copy(), state.used.copy()
        asked[places], used[places] = reference, correction
        cycles = state.cycles if known or state.weight == 0.0 else 0
        return dataclasses.replace(state, asked=asked, used=used, weight=float(weight[-1]), cycles=cycles), correction

    def _places(self, time: Array, size: int) -> NDArray[np.int64]:
        """Where samples stand in the period [shape (n,)]."""
        return np.round(time * (size / self.period)).astype(np.int64) % size
