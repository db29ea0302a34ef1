"""One domain: averages, rates and loops against direct integration of Boltzmann's densities (thesis 3.1)."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import integrate, special

from pzt_ros.errors import BenchError
from pzt_ros.physics.kinetics import exponential, switching_rate
from pzt_ros.physics.single_crystal import SingleCrystal
from pzt_ros.quantities import BOLTZMANN

COLD = SingleCrystal(averages="exact", prefactor="exact")
HOT = dataclasses.replace(COLD, domain_volume=1e-24, coercive_field=2e6)  # kT/V_D a hundred times larger
FIELDS = [-1.5e6, -0.6e6, -0.1e6, 0.0, 0.3e6, 0.5e6, 1.2e6]


def boltzmann_integral(crystal: SingleCrystal, field: float, power: int, reference: float) -> float:
    """Integral of P^power exp(-(G - reference) V_D/kT) over the upper well."""
    beta = crystal.domain_volume / (BOLTZMANN * crystal.temperature)
    start, deviation = crystal.barrier_polarization, np.sqrt(1 / (beta * crystal.reciprocal_permittivity))
    centre = crystal.domain_polarization + field / crystal.reciprocal_permittivity
    end = max(start, centre) + 40 * deviation

    def density(p: float) -> float:
        return p**power * np.exp(-beta * (float(crystal.gibbs_energy(p, field)) - reference))

    points = sorted({float(np.clip(centre + k * deviation, start, end)) for k in (-8, -3, 0, 3, 8)})
    value, _ = integrate.quad(density, start, end, points=points, limit=500, epsabs=0, epsrel=1e-12)
    return value


def top_of_upper_well(crystal: SingleCrystal, field: float) -> float:
    """The lowest Gibbs energy of the upper well, so that the Boltzmann factors below are of order 1."""
    centre = crystal.domain_polarization + field / crystal.reciprocal_permittivity
    return float(crystal.gibbs_energy(max(centre, crystal.barrier_polarization), field))


@pytest.mark.parametrize("crystal", [COLD, HOT], ids=["cold", "hot"])
@pytest.mark.parametrize("field", FIELDS)
def test_domain_averages_are_boltzmann_means(crystal, field):
    low = top_of_upper_well(crystal, field)
    mean = boltzmann_integral(crystal, field, 1, low) / boltzmann_integral(crystal, field, 0, low)
    assert crystal.mean_polarization_up(field) == pytest.approx(mean, rel=1e-9)
    assert crystal.mean_polarization_down(-field) == pytest.approx(-mean, rel=1e-9)


@pytest.mark.parametrize("crystal", [COLD, HOT], ids=["cold", "hot"])
@pytest.mark.parametrize("field", FIELDS)
def test_rates_are_boltzmann_ratios(crystal, field):
    low = top_of_upper_well(crystal, field)
    beta = crystal.domain_volume / (BOLTZMANN * crystal.temperature)
    at_barrier = np.exp(-beta * (float(crystal.gibbs_energy(crystal.barrier_polarization, field)) - low))
    expected = at_barrier / boltzmann_integral(crystal, field, 0, low) / crystal.relaxation_time
    assert crystal.rate_down(field) == pytest.approx(expected, rel=1e-9, abs=1e-280)
    assert crystal.rate_up(-field) == pytest.approx(expected, rel=1e-9, abs=1e-280)


@pytest.mark.parametrize("field", [-0.2e6, 0.05e6, 0.3e6])
def test_rates_are_in_detailed_balance(field):
    """Equilibrium is Boltzmann's: each flux is the well's population times the chance to be at its own barrier."""
    beta = HOT.domain_volume / (BOLTZMANN * HOT.temperature)
    up_well = boltzmann_integral(HOT, field, 0, 0.0)
    down_well = boltzmann_integral(HOT, -field, 0, 0.0)
    barrier = HOT.barrier_polarization
    barriers = np.exp(-beta * float(HOT.gibbs_energy(-barrier, field) - HOT.gibbs_energy(barrier, field)))
    assert HOT.rate_up(field) / HOT.rate_down(field) == pytest.approx(barriers * up_well / down_well, rel=1e-9)


def test_prefactor_has_the_published_sizes():
    """1.06 for chapter 4 and 0.66 for the fits of 3.3.5 (model-notes.md; in units of 1000 m^2/C)."""
    chapter_4 = SingleCrystal(temperature=273.0, reciprocal_permittivity=6.67e7, relaxation_time=1.0, prefactor="exact")
    fits = SingleCrystal(temperature=293.0, reciprocal_permittivity=2.8e7, relaxation_time=1.0, prefactor="exact")
    assert chapter_4.rate_factor == pytest.approx(1060.0, rel=5e-3)
    assert fits.rate_factor == pytest.approx(660.0, rel=1e-2)


def test_the_programs_polarization_is_the_cold_limit():
    exact, minimum = COLD, dataclasses.replace(COLD, averages="minimum")
    assert exact.mean_polarization_up(0.0) == pytest.approx(float(minimum.mean_polarization_up(0.0)), abs=1e-9)
    hot_minimum = dataclasses.replace(HOT, averages="minimum", coercive_field=0.5e6)
    hot_exact = dataclasses.replace(hot_minimum, averages="exact")
    assert hot_exact.mean_polarization_up(0.0) - hot_minimum.mean_polarization_up(0.0) > 1e-3


def test_helmholtz_energy_is_smooth_where_the_pieces_meet():
    p_i, h = COLD.barrier_polarization, 1e-6
    below, at, above = COLD.helmholtz_energy(np.array([p_i - h, p_i, p_i + h]))
    assert above - at == pytest.approx(at - below, rel=1e-3)
    assert COLD.helmholtz_energy(COLD.domain_polarization) == 0


def test_a_coercive_field_beyond_the_wells_is_refused():
    with pytest.raises(BenchError, match="leaves no barrier"):
        SingleCrystal(coercive_field=2e7).helmholtz_energy(0.1)


@pytest.mark.parametrize("prefactor", ["unity", "exact"])
@pytest.mark.parametrize("rate", [1e5, 1e7, 1e9])
def test_loop_agrees_with_a_stiff_solver(prefactor, rate):
    crystal = SingleCrystal(coercive_field=1.5e5, prefactor=prefactor)
    field = np.array([0.0, 6e5, -6e5, 3e5])
    time = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(field)) / rate)))
    samples = np.union1d(np.linspace(0, time[-1], 97), time)

    _, fraction = crystal.simulate(samples, np.interp(samples, time, field), phase_fraction=0.2)

    x = 0.2
    for k in range(3):
        inside = samples[(samples >= time[k]) & (samples <= time[k + 1])]

        def slope(t: float, y: np.ndarray) -> np.ndarray:
            e = np.interp(t, time, field)
            return crystal.rate_up(e) * (1 - y) - crystal.rate_down(e) * y

        solution = integrate.solve_ivp(
            slope, (time[k], time[k + 1]), [x], "Radau", inside, rtol=1e-9, atol=1e-11, max_step=np.ptp(inside) / 20
        )
        assert np.max(np.abs(fraction[np.isin(samples, inside)] - solution.y[0])) < 3e-7
        x = solution.y[0, -1]


def test_polarization_mixes_both_orientations():
    fraction = np.array([0.0, 0.25, 1.0])
    field = np.array([0.0, 1e5, -1e5])
    up, down = 0.26 + field / 6e7, -0.26 + field / 6e7
    expected = fraction * up + (1 - fraction) * down
    np.testing.assert_allclose(SingleCrystal().polarization(field, fraction), expected, rtol=1e-14)


@pytest.mark.parametrize("time", [[0.0, 1.0, 0.5], [0.0, np.nan, 2.0]])
def test_bad_time_is_one_line(time):
    with pytest.raises(BenchError, match="sample"):
        SingleCrystal().simulate(np.array(time), np.zeros(3))


def test_compiled_special_functions():
    z = np.linspace(-26.3, 60, 4001)
    rates = np.array([switching_rate(v) for v in z])
    np.testing.assert_allclose(rates, 1 / special.erfcx(z), rtol=1e-14)
    assert switching_rate(-27.0) == 0.0
    x = np.linspace(-690, 690, 4001)
    np.testing.assert_allclose([exponential(v) for v in x], np.exp(x), rtol=1e-15)
    assert exponential(-1e9) == 0.0
