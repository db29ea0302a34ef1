"""Identified densities of thresholds: lattice and front against the Gaussians, one another and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate

from pzt_ros.errors import BenchError
from pzt_ros.physics.density import Gaussian, Table, ThresholdDensity
from pzt_ros.physics.front import Front
from pzt_ros.physics.front_tables import LOWER, TRIANGLE, UPPER
from pzt_ros.physics.front_thresholds import everett_of
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.signals import Array, Rest, Signals

LEGS = [0, 2, -2, 2, -1, 1, -0.7, 0.7, -2, 0.4, -0.2, 0.8, 0.2, 1.2, 0.5, 2]
NARROW = {"coercive_field_spread": 1e11, "interaction_field_spread": 1e11}


def ramps(rate: float, samples: int = 600) -> Signals:
    turns = np.array(LEGS) * 1e6
    ends = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(turns)) / rate)))
    time = np.union1d(np.linspace(0, ends[-1], samples)[1:], ends[1:])
    return Signals(time=time, voltage=np.interp(time, ends, turns) * 1e-4)


def tabled(spacing: float) -> ThresholdDensity:
    """The Gaussians of NARROW over their thresholds."""
    up, down = np.arange(-1.2e6, 2.2e6, spacing), np.arange(-2.2e6, 1.2e6, spacing)
    coercive, interaction = (up[:, None] - down) / 2, -(up[:, None] + down) / 2
    bell = Gaussian(5e5, 1e11).at(coercive) * Gaussian(0.0, 1e11).at(interaction)
    return ThresholdDensity(tuple(up), tuple(down), tuple(map(tuple, bell)))


def lopsided() -> ThresholdDensity:
    """Coarse, with correlated fields, bias, domains without barrier and lines that fit no table."""
    up, down = np.linspace(-0.73e6, 1.91e6, 13), np.linspace(-1.61e6, 0.87e6, 11)
    weights = np.random.default_rng(7).uniform(0.0, 1.0, (13, 11)) * (up[:, None] > down - 2e5)
    return ThresholdDensity(tuple(up), tuple(down), tuple(map(tuple, weights)))


def fraction(model: Front | Lattice, signals: Signals) -> Array:
    return model.step(model.init(Rest()), signals)[1].phase_fraction


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_lattice_of_a_tabled_gaussian_is_that_of_the_gaussian() -> None:
    signals = ramps(1e7)
    identified = Lattice(threshold_density=tabled(5e4), accuracy=1e-5, spacing=0.4)
    expected = fraction(Lattice(**NARROW, accuracy=1e-5, spacing=0.4), signals)
    np.testing.assert_allclose(fraction(identified, signals), expected, atol=2e-3)
    assert np.ptp(expected) > 0.9


@pytest.mark.parametrize(("density", "limit"), [(tabled(1e5), 6e-4), (lopsided(), 1e-3)])
@pytest.mark.parametrize("rate", [1e5, 1e7])
def test_front_against_lattice(density: ThresholdDensity, rate: float, limit: float) -> None:
    signals = ramps(rate)
    front, lattice = Front(threshold_density=density), Lattice(threshold_density=density, spacing=0.25, accuracy=1e-5)
    found, expected = fraction(front, signals), fraction(lattice, signals)
    assert rms(found - expected) < limit
    assert np.ptp(expected) > 0.9
    polarization = [m.step(m.init(Rest()), signals)[1].polarization for m in (front, lattice)]
    assert rms(polarization[0] - polarization[1]) < 0.6 * limit


def test_everett_table_against_scipy() -> None:
    density = lopsided()
    table = everett_of(density)
    middle, step = table.values.shape[2] // 2, table.step

    def mass(u: float, l: float, far: bool = False) -> float:  # noqa: E741 - the Everett function's symbols
        """Of a < u, b > l, and where `far` a + b > u + l, by a million cells that end where the density bends."""
        lines = np.unique(np.clip([*np.linspace(l, u, 1000), *density.up_fields, *density.down_fields], l, u))
        at, width = (lines[1:] + lines[:-1]) / 2, np.diff(lines)
        share = (np.tri(at.size) + np.tri(at.size, k=-1)) / 2  # half of each cell on the diagonal
        if far:
            share *= np.clip(0.5 + (at[:, None] + at - u - l) / (width[:, None] + width), 0.0, 1.0)
        return float(np.sum(density.at(*np.meshgrid(at, at, indexing="ij")) * share * np.outer(width, width)))

    whole = mass(2e6, -2e6)
    for i, j in ((30, -5), (20, -28), (3, -1), (8, 2), (33, -30)):
        u, l = i * step, j * step  # noqa: E741
        found = table.values[0, :, middle + i, middle + j, 0]
        assert found[TRIANGLE] == pytest.approx(mass(u, l) / whole, abs=1e-4)
        assert found[LOWER] == pytest.approx(mass(u, l, far=True) / whole, abs=1e-4)
        assert found[UPPER] == pytest.approx(found[TRIANGLE] - found[LOWER], abs=1e-14)
        turned = table.values[1, :, middle - j, middle - i, 0]
        np.testing.assert_allclose(turned[[TRIANGLE, UPPER, LOWER]], found, atol=1e-15)
    assert table.values[0, TRIANGLE, -1, 0, 0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("share", [TRIANGLE, LOWER])
def test_slopes_of_the_everett_table_are_those_of_its_values(share: int) -> None:
    """The integral of a slope along a row or a column is the difference of values."""
    table = everett_of(tabled(1.5e5))
    values = table.values[0, share]
    n = values.shape[0]
    row, column = values[n // 2 :, n // 2], values[n // 2, : n // 2 + 1]
    assert integrate.simpson(row[:, 1]) == pytest.approx(row[-1, 0] - row[0, 0], abs=2e-4)
    assert integrate.simpson(column[:, 2]) == pytest.approx(column[-1, 0] - column[0, 0], abs=2e-4)
    across = values[n // 2 + 10, : n // 2 + 1]
    assert integrate.simpson(across[:, 3]) == pytest.approx(across[-1, 1] - across[0, 1], abs=2e-4)


@pytest.mark.parametrize(
    ("up", "down", "weights", "word"),
    [
        ((0.0,), (0.0, 1.0), ((1.0, 1.0),), "up fields"),
        ((0.0, 0.0), (0.0, 1.0), ((1.0, 1.0), (1.0, 1.0)), "increase"),
        ((0.0, 1.0), (0.0, np.nan), ((1.0, 1.0), (1.0, 1.0)), "down fields"),
        ((0.0, 1.0), (-1.0, 0.0), ((1.0, 1.0),), "rows"),
        ((0.0, 1.0), (-1.0, 0.0), ((1.0, 1.0), (1.0,)), "rows"),
        ((0.0, 1.0), (-1.0, 0.0), ((1.0, -1.0), (1.0, 1.0)), "below 0"),
        ((0.0, 1.0), (2.0, 3.0), ((1.0, 1.0), (1.0, 1.0)), "swap"),
    ],
)
def test_bad_densities_are_named(up, down, weights, word) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(BenchError, match=word):
        ThresholdDensity(up, down, weights)


def test_quadrature_and_two_densities_at_once_are_refused() -> None:
    with pytest.raises(BenchError, match="lattice or front"):
        Quadrature(threshold_density=lopsided())
    with pytest.raises(BenchError, match="drop"):
        Front(threshold_density=lopsided(), coercive_density=Table((0.0, 1e6), (1.0, 0.0)))
