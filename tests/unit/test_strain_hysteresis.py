"""Strain over polarization as a loop: what it must be without size, and what the loop must look like with it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_hysteresis import StrainHysteresis

LEAD, WIDTH = 0.03, 0.08
LINK = StrainHysteresis(coefficient=0.02, active_length=8e-3, polarization_lead=LEAD, turn_width=WIDTH)
SCALE = 0.02 * 8e-3


def triangle(*turns: float, per_leg: int = 400) -> np.ndarray:
    """Straight lines through the turns."""
    legs = [np.linspace(a, b, per_leg, endpoint=False) for a, b in itertools.pairwise(turns)]
    return np.concatenate([*legs, [turns[-1]]])


def displacement(link: StrainHysteresis | Electrostriction, polarization: np.ndarray) -> np.ndarray:
    _, out = link.step(link.init(Rest()), signals(polarization))
    return out.displacement


def signals(polarization: np.ndarray) -> Signals:
    return Signals(np.arange(polarization.size) * 1e-3, polarization=polarization)


def test_without_size_it_is_electrostriction_to_the_bit() -> None:
    polarization = triangle(0.0, 0.3, -0.3, 0.1, -0.2, 0.3)
    plain = Electrostriction(coefficient=0.02, active_length=8e-3)
    bare = StrainHysteresis(coefficient=0.02, active_length=8e-3)
    np.testing.assert_array_equal(displacement(bare, polarization), displacement(plain, polarization))


def test_two_shifted_parabolas() -> None:
    """Beyond the turns the branches are zeta (P -+ delta)^2, and the strain is least where P = +-delta."""
    polarization = triangle(0.0, 0.3, -0.3, 0.3, per_leg=3000)
    strain = displacement(LINK, polarization) / SCALE
    down, up = slice(3000, 6000), slice(6000, 9000)
    past_turn = np.abs(polarization - 0.3) > WIDTH
    p = polarization[down][past_turn[down]]
    np.testing.assert_allclose(strain[down][past_turn[down]], (p - LEAD) ** 2, rtol=0, atol=1e-12)
    assert polarization[down][np.argmin(strain[down])] == pytest.approx(LEAD, abs=2e-4)
    assert polarization[up][np.argmin(strain[up])] == pytest.approx(-LEAD, abs=2e-4)


def test_butterfly_is_symmetric_and_closes() -> None:
    polarization = triangle(0.0, 0.3, -0.3, 0.3, -0.3, 0.3)
    strain = displacement(LINK, polarization)
    down, up, second = strain[400:801], strain[800:1201], strain[1200:1601]
    np.testing.assert_allclose(down, up, rtol=0, atol=1e-17)  # P -> -P takes one branch into the other
    np.testing.assert_allclose(second, down, rtol=0, atol=1e-17)


def test_loop_is_as_wide_as_its_closed_form() -> None:
    """Between the branches lies 4 zeta P delta, which the thesis' figure shows as two lobes crossing at P = 0."""
    polarization = triangle(0.0, 0.3, -0.3, 0.3, per_leg=600)
    strain = displacement(LINK, polarization) / SCALE
    p = np.linspace(-0.2, 0.2, 41)
    down = np.interp(-p, -polarization[600:1201], strain[600:1201])
    up = np.interp(p, polarization[1200:1801], strain[1200:1801])
    np.testing.assert_allclose(up - down, 4 * p * LEAD, rtol=0, atol=1e-6)


def test_rate_independent() -> None:
    """A denser drive with the same turns ends where a sparse one does."""
    turns = (0.0, 0.3, 0.05, 0.2, 0.1, 0.28, -0.1)
    assert displacement(LINK, triangle(*turns, per_leg=7))[-1] == pytest.approx(
        displacement(LINK, triangle(*turns, per_leg=1000))[-1], rel=1e-12
    )


def test_loop_area_never_negative_for_nested_turns() -> None:
    """A closed minor loop comes back to the strain it left (wiping out), whatever it did in between."""
    outer = triangle(0.0, 0.3, 0.1)
    with_loop = triangle(0.0, 0.3, 0.1, 0.15, 0.1)
    assert displacement(LINK, with_loop)[-1] == pytest.approx(displacement(LINK, outer)[-1], rel=1e-12)


@pytest.mark.parametrize("lead", [0.0, 1e-4, 0.03, 0.2])
def test_inverse_is_exact_on_the_positive_branch(lead: float) -> None:
    link = StrainHysteresis(polarization_lead=lead, turn_width=WIDTH)
    polarization = triangle(0.1, 0.3, 0.25, 0.28, 0.25 + lead / 2, 0.3)
    state, out = link.step(link.init(Rest()), signals(polarization))
    back, found = link.invert(link.init(Rest()), out)
    np.testing.assert_allclose(found.polarization, polarization, rtol=0, atol=1e-14)
    np.testing.assert_allclose(back, state, rtol=0, atol=1e-14)


def test_inverse_of_any_displacement_gives_it_back() -> None:
    """Also where no run of the link has been before: below the least strain of a branch and up again."""
    wanted = np.abs(5e-6 * np.sin(np.linspace(0, 9, 500))) + 1e-7
    state: State = LINK.init(Rest())
    _, found = LINK.invert(state, Signals(np.arange(500) * 1e-3, displacement=wanted))
    np.testing.assert_allclose(displacement(LINK, found.polarization), wanted, rtol=0, atol=1e-18)
