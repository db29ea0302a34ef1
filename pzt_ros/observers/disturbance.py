"""Observer with an additive displacement disturbance (methods.md section 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.observers.observer import Estimate, Observer
from pzt_ros.physics.chain import Chain, ChainState
from pzt_ros.physics.signals import ABSENT, Array, Rest, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True)
class DisturbanceState:
    """Memory: the model's state, the disturbance [m] (NaN before the first measurement), last time [s]."""

    model: ChainState
    disturbance: float
    time: float


@dataclass(frozen=True, kw_only=True)
class DisturbanceObserver(Observer):
    """Runs the model on the applied voltage and lets one slow disturbance take up what the measurement says beyond it.

    w' = L (y - y_model - w). The first measurement sets w, because the sensor's zero is wherever it happened to be. A
    sample that is no number leaves w as it is.
    """

    kind: ClassVar[str] = "disturbance"

    gain: float = parameter(
        100.0, "1/s", "how fast the disturbance follows the measurement", symbol="L", bounds=(0.0, 1e5)
    )

    def init(self, model: Chain, rest: Rest) -> DisturbanceState:
        """Model at rest, disturbance unknown."""
        return DisturbanceState(model.behind_amplifier.init(rest), math.nan, rest.time)

    def predict(
        self, model: Chain, state: DisturbanceState, time: Array, voltage: Array, charge: Array = ABSENT
    ) -> tuple[DisturbanceState, Signals]:
        """The model over a block of applied voltage [V]."""
        memory, predicted = model.behind_amplifier.step(state.model, Signals(time, voltage))
        return DisturbanceState(memory, state.disturbance, state.time), predicted

    def correct(
        self, state: DisturbanceState, predicted: Signals, measurement: Array
    ) -> tuple[DisturbanceState, Estimate]:
        """Let the disturbance follow what the measurement [m] says beyond the model."""
        time, residual = predicted.time, measurement - predicted.displacement
        step = float(time[-1] - time[0]) / (len(time) - 1) if len(time) > 1 else max(float(time[0]) - state.time, 0.0)
        found, disturbance, innovation = _follow(residual, state.disturbance, 1.0 - math.exp(-self.gain * step))
        estimate = Estimate(
            time,
            predicted.displacement + disturbance,
            predicted.polarization,
            predicted.phase_fraction,
            innovation,
            disturbance,
        )
        return DisturbanceState(state.model, found, float(time[-1])), estimate


@njit(cache=True)
def _follow(residual: Array, start: float, share: float) -> tuple[float, Array, Array]:
    """First-order filter of the model residual: its end, its course (0 until it begins), the innovations before it."""
    disturbance = np.zeros_like(residual)
    innovation = np.zeros_like(residual)
    w = start
    for i in range(len(residual)):
        if math.isfinite(residual[i]):
            if math.isnan(w):
                w = residual[i]
            innovation[i] = residual[i] - w
            w += share * innovation[i]
        if not math.isnan(w):
            disturbance[i] = w
    return w, disturbance, innovation
