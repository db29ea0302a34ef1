"""The one interface that all controllers share."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from pzt_ros.controllers.bounds import Bounds
from pzt_ros.physics.chain import Chain, ChainState
from pzt_ros.physics.signals import ABSENT, Array, Signals


@dataclass(frozen=True)
class Feedback:
    """What is known when the next block of drive is computed: the block that has just been measured.

    Attributes:
        time: sample times of that block [s, shape (n,)].
        voltage: applied across the ceramic [V, shape (n,)].
        measurement: displacement [m, shape (n,)].
        estimate: displacement as the observer has it [m, shape (n,)].
        reference: displacement that was asked of it, as the model's sensor reads it [m, shape (n,)]; None if it was
            driven by voltage.
        model: state of the model chain at the end of that block.
        predicted: reading as the model has it by itself [m, shape (n,)]; empty where nobody ran it.
        cut: what the bounds took from the last voltage that was asked for [V]; positive if that was too high.
        bounds: what may be asked for.

    The control loop fills in the last five.
    """

    time: Array
    voltage: Array
    measurement: Array
    estimate: Array
    reference: Array | None = None
    model: ChainState = ()
    predicted: Array = field(default_factory=lambda: ABSENT)
    cut: float = 0.0
    bounds: Bounds = Bounds()  # noqa: RUF009 - it is frozen


NEVER = 1e9
"""What fades over this time [s] stays."""


@dataclass(frozen=True, kw_only=True)
class Controller(ABC):
    """From a block of reference to a block of drive voltage: gains are fields, memory goes in and comes out."""

    kind: ClassVar[str]
    takes_over_smoothly: ClassVar[bool]
    """Whether its first voltage after `init` continues the one found; otherwise the control loop fades the jump out."""
    keeps_offset: ClassVar[bool] = False
    """Whether the offset found on taking over stays where an operator moves the stage: it would fade over a
    `handover_time` [s], and nothing that is measured would keep the stage in its place meanwhile.
    """

    @abstractmethod
    def init(self, model: Chain, feedback: Feedback) -> Any:
        """The state on taking over, with the stage as `feedback` shows it."""

    @abstractmethod
    def step(self, model: Chain, state: Any, time: Array, reference: Array, feedback: Feedback) -> tuple[Any, Array]:
        """The voltage across the ceramic [V, shape (n,)] for a block of displacement reference [m] at `time` [s]."""

    def health(self, state: Any) -> dict[str, str]:
        """What an operator may want to know, by name; nothing by default."""
        return {}


def model_offset(model: Chain, feedback: Feedback) -> float:
    """What the model reads too much now, against what was asked or else measured [m].

    With this added to its reference, an inverse begins at the voltage found.
    """
    _, now = model.step(feedback.model, Signals(feedback.time[-1:], feedback.voltage[-1:]))
    measured = feedback.measurement[np.isfinite(feedback.measurement)]
    asked = measured.mean() if measured.size else now.displacement[-1]
    if feedback.reference is not None and math.isfinite(feedback.reference[-1]):
        asked = feedback.reference[-1]
    return float(now.displacement[-1] - asked)


def fade(amount: float, since: Array, duration: float) -> Array:
    """`amount`, fading as half a cosine over `duration` [s]; `since` is the time from its beginning [s, shape (n,)]."""
    return amount * 0.5 * (1.0 + np.cos(np.pi * np.clip(since / duration, 0.0, 1.0)))


def tracking_error(feedback: Feedback) -> Array:
    """Reference minus measurement over the block just measured [m, shape (n,)].

    It is zero where nothing was asked, and where nothing was measured (a sample that is no finite number).
    """
    if feedback.reference is None:
        return np.zeros_like(feedback.measurement)
    error = feedback.reference - feedback.measurement
    return error if math.isfinite(error.sum()) else np.where(np.isfinite(error), error, 0.0)
