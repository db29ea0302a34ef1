"""Receding-horizon optimal control: the exact inverse, and where a limit holds, the optimum over the block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.controllers.controller import Controller, Feedback, model_offset, tracking_error
from pzt_ros.controllers.inverse import inverse_voltage
from pzt_ros.controllers.pi import proportional_integral, sample_period
from pzt_ros.optimal.block import Limits, Start, miss, optimal_block, rehearse
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.one_equation import OneEquation
from pzt_ros.physics.signals import Array, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class RecedingHorizon(Controller):
    """Each block is an optimal control problem over its samples, with window, slew rate and current as limits.

    Without an active limit its solution is the exact inverse. With one, a few real-time iterations start from the
    inverse held in its limits; their plan counts only if the ceramic's own model misses the reference less with it.
    What is left when there is no plan: the inverse within its limits, and where that is no number, the last voltage. A
    ceramic that is not parametrized, or a link between amplifier and ceramic, leaves it at that. The integral of the
    tracking error moves the reference, as in `inverse_pi`.
    """

    kind: ClassVar[str] = "receding_horizon"
    takes_over_smoothly: ClassVar[bool] = True

    integral_gain: float = parameter(30.0, "1/s", "share of the error per second", symbol="Ki", bounds=(0.0, 1e5))
    integral_limit: float = parameter(5e-6, "m", "the correction stays within plus and minus this", bounds=(0.0, 1e-3))
    current: float = parameter(0.2, "A", "largest mean current of a sample", bounds=(1e-6, 10.0))
    iterations: float = parameter(5.0, "1", "real-time iterations at most", bounds=(1.0, 100.0))

    def init(self, model: Chain, feedback: Feedback) -> tuple[float, float]:
        """The correction [m] with which the inverse begins at the voltage found; and what limits took so far [V]."""
        rehearse()
        return model_offset(model, feedback), 0.0

    def step(
        self, model: Chain, state: tuple[float, float], time: Array, reference: Array, feedback: Feedback
    ) -> tuple[tuple[float, float], Array]:
        """Drive voltage [V]."""
        integral, cut = state
        step = self.integral_gain * sample_period(time, feedback.time[-1])
        integral, correction = proportional_integral(
            tracking_error(feedback), integral, 0.0, step, self.integral_limit, cut + feedback.cut
        )
        wanted = inverse_voltage(model, time, reference + correction, feedback)
        voltage = self._plan(model, time, reference + correction, wanted, feedback)
        cut = float(wanted[-1] - voltage[-1])
        return (integral, cut if np.isfinite(cut) else 0.0), voltage

    def _plan(self, model: Chain, time: Array, target: Array, wanted: Array, feedback: Feedback) -> Array:
        """The voltage [V] over a block by which the model reads `target` [m], or misses it least.

        `wanted` [V] is that of the exact inverse.
        """
        bounds = feedback.bounds
        before, last = float(feedback.time[-1]), float(feedback.voltage[-1])
        if not np.isfinite(last):
            return wanted
        held = bounds.keep(wanted, last, time, before)
        ceramic = model.links[0] if model.links else None
        if not isinstance(ceramic, OneEquation):
            return held
        start = Start(feedback.model[0], before, last / ceramic.layer_thickness)
        behind = Chain(model.name, model.links[1:])
        _, signals = behind.invert(feedback.model[1:], Signals(time, displacement=target))
        p = signals.polarization
        if not np.all(np.isfinite(p)) or self._is_free(ceramic, start, time, wanted, held):
            return held
        guess = held / ceramic.layer_thickness
        limits = Limits(
            bounds.voltage_min / ceramic.layer_thickness, bounds.voltage_max / ceramic.layer_thickness,
            bounds.slew_rate / ceramic.layer_thickness, self.current,
        )  # fmt: skip
        field = optimal_block(ceramic, start, time, p, guess, limits, int(self.iterations))
        if field is None or self._costs_more(ceramic, start, time, p, field, guess):
            return held
        return bounds.keep(field * ceramic.layer_thickness, last, time, before)

    def _is_free(self, ceramic: OneEquation, start: Start, time: Array, wanted: Array, held: Array) -> bool:
        """Whether the inverse keeps all limits by itself."""
        return bool(np.array_equal(wanted, held)) and self._peak(ceramic, start, time, held) <= self.current

    def _costs_more(
        self, ceramic: OneEquation, start: Start, time: Array, p: Array, field: Array, guess: Array
    ) -> bool:
        """Whether a plan is worse than the inverse held in window and slew; one that keeps the current is not."""
        voltage = guess * ceramic.layer_thickness
        if self._peak(ceramic, start, time, voltage) > self.current:
            return False
        return not miss(ceramic, start, time, p, field) <= miss(ceramic, start, time, p, guess)

    def _peak(self, ceramic: OneEquation, start: Start, time: Array, voltage: Array) -> float:
        """The largest mean current of a sample under a voltage [A]."""
        times = np.concatenate([[start.time], time])
        voltages = np.concatenate([[start.field * ceramic.layer_thickness], voltage])
        _, out = ceramic.step(start.state, Signals(times, voltages))
        rates = np.diff(out.polarization) / np.diff(times)
        return float(ceramic.electrode_area * np.max(np.abs(rates)))
