"""The one interface that all controllers share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from pzt_ros.physics.chain import Chain, ChainState
from pzt_ros.physics.signals import Array


@dataclass(frozen=True)
class Feedback:
    """What is known when the next block of drive is computed: the block that has just been measured.

    Attributes:
        time: sample times of that block [s, shape (n,)].
        voltage: applied across the ceramic [V, shape (n,)].
        measurement: displacement [m, shape (n,)].
        estimate: displacement as the observer has it [m, shape (n,)].
        reference: displacement that was asked of it [m, shape (n,)]; None if it was driven by voltage.
        model: state of the model chain at the end of that block. The control loop fills in these last two.
    """

    time: Array
    voltage: Array
    measurement: Array
    estimate: Array
    reference: Array | None = None
    model: ChainState = ()


@dataclass(frozen=True, kw_only=True)
class Controller(ABC):
    """From a block of reference to a block of drive voltage: gains are fields, memory goes in and comes out."""

    kind: ClassVar[str]

    @abstractmethod
    def init(self, model: Chain, feedback: Feedback) -> Any:
        """The state on taking over, with the stage as `feedback` shows it."""

    @abstractmethod
    def step(self, model: Chain, state: Any, time: Array, reference: Array, feedback: Feedback) -> tuple[Any, Array]:
        """The voltage across the ceramic [V, shape (n,)] for a block of displacement reference [m] at `time` [s]."""


def tracking_error(feedback: Feedback) -> Array:
    """Reference minus measurement over the block just measured [m, shape (n,)]; zero where nothing was asked."""
    if feedback.reference is None:
        return feedback.measurement * 0.0
    return feedback.reference - feedback.measurement
