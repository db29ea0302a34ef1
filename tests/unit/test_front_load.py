"""The amplifier with a Sawyer-Tower that drives a front ceramic, against the same with a lattice of domains."""

from __future__ import annotations

import numpy as np
import pytest

from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.front import Front
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.sawyer_tower import discharge
from pzt_ros.physics.signals import Array, Rest, Signals

C_R, AREA = 133.5e-6, 2e-3
MATERIAL = {
    "coercive_field_spread": 1e11,
    "interaction_field_spread": 1e11,
    "relaxation_time": 0.05,
    "domain_polarization": 0.215,
    "reciprocal_permittivity": 2.8e7,
}
FRONT, LATTICE = Front(**MATERIAL), Lattice(**MATERIAL, spacing=0.7, accuracy=1e-5)
TIME = np.arange(1, 1001) / 1e3
COMMAND = 75.0 * (1.0 - np.cos(2 * np.pi * TIME)) - 40.0 * np.sin(6 * np.pi * TIME)


def run(ceramic: Front | Lattice, **amplifier: float | str) -> tuple[Array, Array]:
    """Voltage across the ceramic [V] and its polarization since rest [C/m^2]."""
    chain = Chain("loaded", (Amplifier(**amplifier), ceramic))
    state = chain.init(Rest())
    _, at_rest = ceramic.step(state[1], Signals(np.zeros(1), np.zeros(1)))
    _, out = chain.step(state, Signals(TIME, COMMAND))
    return out.voltage, out.polarization - at_rest.polarization[0]


def test_series_capacitor_takes_what_is_missing() -> None:
    """Kirchhoff for the front, and the share of either as with the lattice: 0.3 % of x+ are 20 mV here."""
    voltage, polarization = run(FRONT, reference_capacitance=C_R)
    np.testing.assert_allclose(voltage + AREA * polarization / C_R, COMMAND, rtol=0, atol=2e-8)
    expected, polarization_expected = run(LATTICE, reference_capacitance=C_R)
    assert np.max(np.abs(expected - COMMAND)) > 2.0
    np.testing.assert_allclose(voltage, expected, rtol=0, atol=0.02)
    assert np.sqrt(np.mean((polarization - polarization_expected) ** 2)) < 2 * 0.215 * 1e-3


def test_current_limit_as_with_the_lattice() -> None:
    """Where the limit holds, charge is given and the voltage follows from the inverse of the model."""
    current = 2e-3
    voltage, polarization = run(FRONT, reference_capacitance=C_R, current_limit=current)
    assert np.max(np.abs(np.diff(polarization))) * AREA * 1e3 == pytest.approx(current, rel=1e-6)
    expected, polarization_expected = run(LATTICE, reference_capacitance=C_R, current_limit=current)
    assert np.max(np.abs(expected - COMMAND)) > 10.0
    np.testing.assert_allclose(polarization, polarization_expected, rtol=0, atol=2 * 0.215 * 3e-3)
    assert np.sqrt(np.mean((voltage - expected) ** 2)) < 0.3


def test_command_is_found_again() -> None:
    chain = Chain("loaded", (Amplifier(reference_capacitance=C_R), FRONT))
    voltage, _ = run(FRONT, reference_capacitance=C_R)
    _, back = chain.links[0].invert(chain.links[0].init(Rest()), Signals(TIME, voltage))
    np.testing.assert_allclose(back.voltage, COMMAND, rtol=0, atol=1e-6)


def test_discharge_as_with_the_lattice() -> None:
    ends = []
    for ceramic in (FRONT, LATTICE):
        state, out = ceramic.step(ceramic.init(Rest()), Signals(TIME[:500], COMMAND[:500]))
        start = (TIME[499], COMMAND[499], out.polarization[-1])
        ends.append(discharge(ceramic, state, start, TIME[499] + np.linspace(0.05, 10.0, 200))[1])
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=0.5)
    assert 0.0 <= ends[0][-1] < 1.0 < ends[0][0]
