"""The voltage amplifier between the command and the ceramic, with the circuit that measures the charge."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics import sawyer_tower as circuit
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import AMPLIFIER, State, no_state
from pzt_ros.physics.loaded import Loaded
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import choice, parameter

COMPENSATIONS = {"none": circuit.NO_COMPENSATION, "last": circuit.LAST, "extrapolated": circuit.EXTRAPOLATED}


@dataclass(frozen=True, kw_only=True)
class Amplifier(Loaded):
    """Gain, then a first-order lag, the voltage window, the slew limit, and what the load makes of it.

    Current, power and the reference capacitor need to know what the ceramic draws. Then the link runs a copy of the
    ceramic of its chain (`load`), sample by sample, to find the voltage that ceramic gets. What is 0 is not there.
    """

    kind: ClassVar[str] = "amplifier"
    section: ClassVar[str] = AMPLIFIER

    gain: float = parameter(1.0, "1", "voltage across the ceramic over command voltage", bounds=(1e-3, 1e4))
    bandwidth: float = parameter(0.0, "Hz", "corner of a first-order lag; 0 for no lag", bounds=(0.0, 1e9))
    voltage_limit: float = parameter(0.0, "V", "largest output voltage, up or down; 0 for any", bounds=(0.0, 1e5))
    slew_rate: float = parameter(0.0, "V/s", "fastest change of the output; 0 for any", bounds=(0.0, 1e12))
    current_limit: float = parameter(0.0, "A", "largest output current; 0 for any", symbol="i_max", bounds=(0.0, 1e3))
    power_limit: float = parameter(0.0, "W", "largest voltage times current; 0 for any", bounds=(0.0, 1e6))
    reference_capacitance: float = parameter(
        0.0, "F", "Sawyer-Tower capacitor in series with the ceramic; 0 for none", symbol="C_r", bounds=(0.0, 1.0)
    )
    compensation: str = choice(
        "none",
        tuple(COMPENSATIONS),
        "what the computer adds to the drive for the capacitor: its voltage as last measured",
    )
    compensation_rate: float = parameter(
        20e3, "Hz", "samples per second of the computer that compensates", bounds=(1.0, 1e7)
    )

    @property
    def feels_load(self) -> bool:
        """Whether the voltage depends on what the ceramic draws."""
        return self.current_limit > 0.0 or self.power_limit > 0.0 or self.reference_capacitance > 0.0

    @property
    def _is_gain(self) -> bool:
        return not (self.feels_load or self.bandwidth > 0.0 or self.voltage_limit > 0.0 or self.slew_rate > 0.0)

    @cached_property
    def _circuit(self) -> circuit.Circuit:
        return circuit.Circuit(
            gain=float(self.gain),
            time_constant=1.0 / (2.0 * math.pi * self.bandwidth) if self.bandwidth > 0.0 else 0.0,
            slew_rate=float(self.slew_rate),
            voltage=float(self.voltage_limit),
            current=float(self.current_limit),
            power=float(self.power_limit),
            elastance=1.0 / self.reference_capacitance if self.reference_capacitance > 0.0 else 0.0,
            area=float(self.load.electrode_area) if self.load is not None else 0.0,
            compensation=COMPENSATIONS[self.compensation],
            period=1.0 / self.compensation_rate,
        )

    def init(self, rest: Rest) -> State:
        """At rest at the ceramic's voltage, the reference capacitor empty.

        Raises:
            BenchError: it needs to know its load and has none, or a load it cannot run.
        """
        if self._is_gain:
            return no_state()
        v = rest.voltage
        head = [rest.time, v, v, v]
        if not self.feels_load:
            return np.array(head)
        ceramic, _ = self._ceramic()
        memory = ceramic.init(rest)
        here = Signals(time=np.array([rest.time]), voltage=np.array([v]))
        _, out = ceramic.step(memory, here)
        p = float(out.polarization[0])
        return np.array([*head, v, p, p, 0.0, 0.0, 0.0, 0.0, *memory])

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Command voltage to the voltage across the ceramic.

        Raises:
            BenchError: a sample that is not finite or time that runs back.
        """
        if self._is_gain:
            return state, signals.replace(voltage=self.gain * signals.voltage)
        after, voltage = state.copy(), np.empty_like(signals.voltage)
        if self.feels_load:
            _, numbers = self._ceramic()
            bad = circuit.run_loaded(after, self._circuit, numbers, signals.time, signals.voltage, voltage)
        else:
            bad = circuit.run_bare(after, self._circuit, signals.time, signals.voltage, voltage)
        _check(bad, signals)
        return after, signals.replace(voltage=voltage)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage wanted across the ceramic to command voltage; window and limits cannot be undone.

        The lag is undone exactly where sampling is slower than its time constant, else by differences.

        Raises:
            BenchError: as `step`.
        """
        if self._is_gain:
            return state, signals.replace(voltage=signals.voltage / self.gain)
        after, command = state.copy(), np.empty_like(signals.voltage)
        if self.feels_load:
            _, numbers = self._ceramic()
            bad = circuit.invert_loaded(after, self._circuit, numbers, signals.time, signals.voltage, command)
        else:
            bad = circuit.invert_bare(after, self._circuit, signals.time, signals.voltage, command)
        _check(bad, signals)
        return after, signals.replace(voltage=command)

    def _ceramic(self) -> tuple[Ferroelectric, Any]:
        """The load and its numbers."""
        if self.load is None:
            raise BenchError(
                "amplifier: current_limit, power_limit and reference_capacitance act through the ceramic, and the chain"
                " has none; set them to 0 or add a ferroelectric link"
            )
        return self.load, circuit.compiled_form(self.load)


def _check(bad: int, signals: Signals) -> None:
    if bad >= 0:
        time, voltage = signals.time[bad], signals.voltage[bad]
        raise BenchError(
            f"amplifier: sample {bad} ({time:.9g} s, {voltage:.6g} V) is not finite or not after the one before;"
            " drop or sort it"
        )
