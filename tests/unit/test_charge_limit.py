"""The current limit into the ceramic as it is, against the amplifier that steps it sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.effects.amplifier_charge_limit import AmplifierChargeLimit
from pzt_ros.effects.insert import with_effect
from pzt_ros.errors import BenchError
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.bouc_wen import BoucWen
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.front import Front
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain import Electrostriction

TIME = np.arange(3000) * 1e-3
COMMAND = 120.0 * np.sin(2 * np.pi * 3 * TIME) * np.minimum(TIME, 1.0) + 20.0 * np.sin(2 * np.pi * 17 * TIME)
"""Cycles of growing amplitude with minor loops."""

LATTICE = load_chain("p802").links[1]
PARAMETRIZED = load_chain("thesis-p2").links[0]
ANY = [LATTICE, PARAMETRIZED, Front(), IdentifiedLattice(), Preisach(), BoucWen()]


def ceramic_of(link: object) -> Ferroelectric:
    assert isinstance(link, Ferroelectric)
    return link


def limited(ceramic: Ferroelectric, current: float) -> Chain:
    """The ceramic behind a limit that the largest current of its slow drive is so many times of [-]."""
    return Chain("limited", (AmplifierChargeLimit(inverse_current_density=1.0 / current), ceramic))


def run(chain: Chain, command: Array = COMMAND) -> Signals:
    return chain.step(chain.init(Rest()), Signals(TIME[: command.size], voltage=command))[1]


def fastest(ceramic: Ferroelectric) -> float:
    """Largest rate of the polarization of the command [C/(m^2 s)]."""
    return float(np.max(np.abs(np.diff(run(Chain("free", (ceramic,))).polarization)))) * 1e3


@pytest.mark.parametrize("ceramic", [LATTICE, PARAMETRIZED], ids=["lattice", "parametrized"])
@pytest.mark.parametrize("share", [0.7, 0.2, 0.05])
def test_it_leads_where_the_amplifier_leads_that_steps_its_load(ceramic: Ferroelectric, share: float) -> None:
    density = share * fastest(ceramic)
    amplifier = Amplifier(current_limit=density * ceramic.electrode_area)
    found, expected = run(limited(ceramic, density)), run(Chain("stepped", (amplifier, ceramic)))
    assert np.max(np.abs(expected.voltage - COMMAND)) > 1.0
    np.testing.assert_allclose(found.voltage, expected.voltage, rtol=0, atol=1e-3)
    np.testing.assert_allclose(found.polarization, expected.polarization, rtol=0, atol=1e-7)


@pytest.mark.parametrize("link", ANY, ids=lambda link: link.kind)
def test_the_charge_keeps_to_the_limit_and_blocks_do_not_matter(link: Ferroelectric) -> None:
    chain = limited(ceramic_of(link), density := 0.3 * fastest(link))
    whole = run(chain)
    rate = np.abs(np.diff(whole.polarization, prepend=whole.polarization[0])) * 1e3
    free = whole.voltage == COMMAND
    assert 0.05 < np.mean(free) < 0.95
    assert np.max(rate) <= density * (1 + 1e-4)
    np.testing.assert_allclose(rate[1:][~free[1:]], density, rtol=1e-4)  # as fast as it may, wherever it is late
    state, parts = chain.init(Rest()), []
    for first in range(0, TIME.size, 37):
        part = slice(first, first + 37)
        state, out = chain.step(state, Signals(TIME[part], voltage=COMMAND[part]))
        parts.append(out.voltage)
    np.testing.assert_allclose(np.concatenate(parts), whole.voltage, rtol=0, atol=1e-6)


def test_a_ceramic_whose_polarization_falls_with_the_voltage_does_not_stop_it() -> None:
    falling = BoucWen(susceptibility=1e-8, height_soft=0.05, height_hard=0.05)
    voltage = run(limited(falling, 0.01)).voltage
    assert np.all(np.isfinite(voltage))


def test_a_slow_drive_does_not_feel_it_and_without_a_limit_nothing_does() -> None:
    ceramic = ceramic_of(PARAMETRIZED)
    for chain in (limited(ceramic, 1.001 * fastest(ceramic)), Chain("none", (AmplifierChargeLimit(), ceramic))):
        np.testing.assert_array_equal(run(chain).voltage, COMMAND)


def test_a_jump_charges_it_evenly() -> None:
    ceramic = ceramic_of(LATTICE)
    out = run(limited(ceramic, 0.5), np.concatenate((np.zeros(10), np.full(2000, 100.0))))
    climbing = np.flatnonzero(out.voltage[10:] < 100.0) + 10
    assert climbing.size > 100
    np.testing.assert_allclose(np.diff(out.polarization[climbing]), 0.5e-3, rtol=1e-5)
    assert out.voltage[-1] == 100.0


def test_what_is_reached_needs_itself_as_command() -> None:
    chain = limited(ceramic_of(PARAMETRIZED), 0.3 * fastest(ceramic_of(PARAMETRIZED)))
    reached = run(chain)
    _, asked = chain.links[0].invert(chain.links[0].init(Rest()), Signals(TIME, voltage=reached.voltage))
    np.testing.assert_array_equal(asked.voltage, reached.voltage)
    np.testing.assert_allclose(run(chain, asked.voltage).voltage, reached.voltage, rtol=0, atol=1e-3)


def test_its_shortcut_is_the_same_as_long_as_the_command_goes_one_way() -> None:
    """But for the rate that switching feels."""
    ceramic, ramp = ceramic_of(Preisach()), np.minimum(150.0 * TIME[:2000] / 0.05, 150.0)
    link = AmplifierChargeLimit(inverse_current_density=20.0)
    exact = run(Chain("exact", (link, ceramic)), ramp)
    near = run(Chain("near", (ceramic, link.shortcut)), ramp)
    free = run(Chain("free", (ceramic,)), ramp)
    assert np.max(np.abs(free.polarization - exact.polarization)) > 0.01
    np.testing.assert_allclose(near.polarization, exact.polarization, rtol=0, atol=1e-8)


def test_a_chain_puts_it_before_its_ceramic_and_the_ceramic_on_it() -> None:
    chain = Chain("stage", (ceramic_of(LATTICE), Electrostriction()))
    with_limit = with_effect(chain, AmplifierChargeLimit(inverse_current_density=1.0))
    limit, ceramic, _ = with_limit.links
    assert isinstance(limit, AmplifierChargeLimit)
    assert limit.load is ceramic


def test_misplaced_it_says_so() -> None:
    link = AmplifierChargeLimit(inverse_current_density=1.0)
    with pytest.raises(BenchError, match="no ceramic that it could charge"):
        Chain("none", (link,)).init(Rest())
    with pytest.raises(BenchError, match="stands behind the ceramic"):
        Chain("behind", (ceramic_of(PARAMETRIZED), link))
