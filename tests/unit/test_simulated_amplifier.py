"""The simulated amplifier: the current into the ceramic, its charge, and the gain."""

from __future__ import annotations

import dataclasses

import numpy as np

from pzt_ros.chains import load_chain
from pzt_ros.hardware.amplifier import SimulatedAmplifier
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import ACTUATOR
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.reference import block_times


def test_simulated_amplifier_says_current_and_charge() -> None:
    """Charge is the integral of the current, and area times the change of polarization (thesis 2.1: 2000 mm^2)."""
    chain = load_chain("thesis-p2")
    amplifier = SimulatedAmplifier(chain, Rest())
    time = block_times(0, 400, 20e3)
    parts = []
    for block in range(5):
        now = block_times(block, 400, 20e3)
        parts.append(amplifier.apply(now, 75.0 * (1 - np.cos(np.pi * now / now[-1]))))
    charge = np.concatenate([p.charge for p in parts])
    current = np.concatenate([p.current for p in parts])
    np.testing.assert_allclose(np.cumsum(current) * (time[1] - time[0]), charge, rtol=0, atol=1e-9 * np.max(charge))
    whole = SimulatedAmplifier(chain, Rest())
    at_once = whole.apply(np.concatenate([p.time for p in parts]), np.concatenate([p.voltage for p in parts]))
    np.testing.assert_allclose(at_once.charge, charge, rtol=1e-12, atol=1e-18)
    assert amplifier.voltage == parts[-1].voltage[-1]


def test_simulated_amplifier_knows_its_gain() -> None:
    plain = load_chain("thesis-p2")
    assert SimulatedAmplifier(plain, Rest()).gain == 1.0
    amplified = dataclasses.replace(plain, links=(Amplifier(gain=27.8), *plain.links))
    amplifier = SimulatedAmplifier(amplified, Rest())
    assert amplifier.gain == 27.8
    applied = amplifier.apply(block_times(0, 4, 1e3), np.array([0.0, 1.0, 2.0, 3.6]))
    np.testing.assert_allclose(applied.voltage, [0.0, 27.8, 55.6, 100.08])


def test_charge_is_polarization_times_area() -> None:
    """Q = P A with the 2000 mm^2 of the thesis' stack, beside a plant that is stepped on its own."""
    chain = load_chain("thesis-p2")
    time = block_times(0, 400, 20e3)
    voltage = 75.0 * (1 - np.cos(np.pi * time / time[-1]))
    charge = SimulatedAmplifier(chain, Rest()).apply(time, voltage).charge
    plant: Chain = chain.section(ACTUATOR)
    _, out = plant.step(plant.init(Rest()), Signals(time, voltage))
    np.testing.assert_allclose(charge - charge[0], 2000e-6 * (out.polarization - out.polarization[0]), rtol=1e-12)
    assert np.ptp(charge) > 1e-4


def test_a_sample_that_takes_no_time_draws_no_current() -> None:
    """The first sample of a run stands at the time of rest: a charge over no time is not a number."""
    amplifier = SimulatedAmplifier(load_chain("thesis-p2"), Rest())
    applied = amplifier.apply(block_times(0, 4, 1e3), np.full(4, 10.0))
    assert applied.current[0] == 0.0
    assert np.all(np.isfinite(applied.current))


def test_warm_up_leaves_no_trace() -> None:
    chain, time = load_chain("bench-stage"), block_times(0, 50, 20e3)
    fresh, warm = SimulatedAmplifier(chain, Rest()), SimulatedAmplifier(chain, Rest())
    warm.warm_up()
    voltage = np.linspace(0.0, 50.0, 50)
    np.testing.assert_array_equal(fresh.apply(time, voltage).current, warm.apply(time, voltage).current)
