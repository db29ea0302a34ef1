"""The one interface that all observers share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import ABSENT, REHEARSAL, Array, Rest, Signals


@dataclass(frozen=True)
class Estimate:
    """What the observer makes of a block [each of shape (n,)].

    Attributes:
        time: sample times [s].
        displacement: as the sensor would read it without noise [m].
        polarization: [C/m^2].
        phase_fraction: [-].
        innovation: measurement minus the observer's one-step prediction [m]; 0 where nothing was measured.
        disturbance: what the model lacks, as a displacement [m].
        displacement_std, polarization_std, phase_fraction_std: standard deviations; empty where the observer has none.
    """

    time: Array
    displacement: Array
    polarization: Array
    phase_fraction: Array
    innovation: Array
    disturbance: Array
    displacement_std: Array = field(default_factory=lambda: ABSENT)
    polarization_std: Array = field(default_factory=lambda: ABSENT)
    phase_fraction_std: Array = field(default_factory=lambda: ABSENT)


@dataclass(frozen=True, kw_only=True)
class Observer(ABC):
    """The chain run beside the measurement and pulled towards it: gains are fields, memory goes in and comes out."""

    kind: ClassVar[str]

    @abstractmethod
    def init(self, model: Chain, rest: Rest) -> Any:
        """The state at rest."""

    @abstractmethod
    def predict(
        self, model: Chain, state: Any, time: Array, voltage: Array, charge: Array = ABSENT
    ) -> tuple[Any, Signals]:
        """What the model makes of a block of applied voltage [V], as it is behind the amplifier.

        It needs no measurement of displacement, so it can be done while the block is still being measured. The charge
        [C] that the amplifier has measured comes with its voltage; an observer may use it.
        """

    @abstractmethod
    def correct(self, state: Any, predicted: Signals, measurement: Array) -> tuple[Any, Estimate]:
        """Pull a predicted block towards its measurement [m]."""

    def warm_up(self, model: Chain, state: Any) -> None:
        """Compile now what the first block would have to wait for; no state is changed."""
        zeros = np.zeros_like(REHEARSAL)
        self.update(model, state, REHEARSAL, zeros, zeros)

    def health(self, state: Any) -> dict[str, float]:
        """What an operator may want to know, by name; nothing by default."""
        return {}

    def update(
        self, model: Chain, state: Any, time: Array, voltage: Array, measurement: Array, charge: Array = ABSENT
    ) -> tuple[Any, Estimate]:
        """Predict and correct."""
        state, predicted = self.predict(model, state, time, voltage, charge)
        return self.correct(state, predicted, measurement)
