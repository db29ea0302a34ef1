"""Densities that are skewed or have tails: against SciPy's, between the models, and at a Gaussian."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy import stats

from pzt_ros.chains import load_chain
from pzt_ros.physics.density import Bent, Gaussian
from pzt_ros.physics.front import Front
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.sysid.parameters import LOPSIDED, SHAPES, free_parameters

TIME = np.linspace(0.0, 6.0, 6001)
VOLTAGE = 100.0 * np.sin(2 * np.pi * TIME / 3) * np.clip(TIME / 3, 0.0, 1.0)
_stats: Any = stats  # SciPy carries no types


def lognormal(skew: float, sigma: float, mode: float) -> Any:
    """SciPy's, shifted so that it is densest at a field [V/m]."""
    scale = sigma / skew
    return _stats.lognorm(s=skew, loc=mode - scale * np.exp(-(skew**2)), scale=scale)


def johnson(tail: float, sigma: float) -> Any:
    """SciPy's S_U about 0 [V/m]."""
    root = np.sqrt(tail)
    return _stats.johnsonsu(a=0.0, b=1.0 / root, scale=sigma / root)


@pytest.mark.parametrize(
    ("density", "theirs"),
    [
        (Bent(1e6, 5e11, skew=0.6, lower=0.0), lognormal(0.6, 5e5, 1e6)),
        (Bent(1e6, 5e11, skew=0.3), lognormal(0.3, 5e5, 1e6)),
        (Bent(0.0, 5e11, tail=0.3), johnson(0.3, 5e5)),
        (Bent(0.0, 5e11, tail=1.5), johnson(1.5, 5e5)),
    ],
)
def test_it_is_the_density_of_the_text_books(density: Bent, theirs: Any) -> None:
    low, high = density.support(50.0)
    fields = np.linspace(low, high, 1001)
    share = theirs.cdf(high) - theirs.cdf(low)
    assert share > 0.97
    assert np.allclose(density.at(fields), theirs.pdf(fields) / share, rtol=1e-9, atol=1e-18)
    assert np.allclose(density.below(fields), (theirs.cdf(fields) - theirs.cdf(low)) / share, atol=1e-12)
    assert fields[np.argmax(density.at(fields))] == pytest.approx(density.peak, abs=0.002 * (high - low))


@pytest.mark.parametrize(
    "density",
    [
        Bent(1e6, 5e11, skew=-0.5, lower=0.0),
        Bent(0.0, 5e11, tail=-0.8),
        Bent(2e5, 5e11, skew=1.2, lower=0.0),
        Bent(0.0, 5e11, lopsided=-0.6),
        Bent(0.0, 5e11, tail=0.5, lopsided=0.3),
    ],
)
def test_shares_and_quantiles_are_the_integral_and_its_inverse(density: Bent) -> None:
    low, high = density.support(50.0)
    fields = np.linspace(low, high, 200_001)
    steps = 0.5 * (density.at(fields[1:]) + density.at(fields[:-1])) * np.diff(fields)
    assert np.max(np.abs(np.cumsum(steps) - density.below(fields[1:]))) < 1e-5
    shares = np.array([1e-3, 0.2, 0.5, 0.9, 0.999])
    assert np.allclose(density.below(density.quantile(shares)), shares, atol=1e-12)


@pytest.mark.parametrize("lopsided", [0.3, -0.7])
def test_a_lopsided_one_is_two_halves_of_which_each_has_its_share_of_the_width(lopsided: float) -> None:
    """SciPy's normals, each as heavy as it is wide (Fernandez and Steel 1998), so that they meet at the centre."""
    density, sigma = Bent(0.0, 5e11, lopsided=lopsided), 5e5
    fields = np.linspace(*density.support(50.0), 1001)
    width = np.where(fields > 0, 1 + lopsided, 1 - lopsided)
    theirs = _stats.norm(scale=width * sigma)
    assert np.allclose(density.at(fields), theirs.pdf(fields) * width, rtol=1e-8, atol=1e-18)
    below = np.where(fields > 0, 1 - width * theirs.sf(fields), width * theirs.cdf(fields))
    assert np.allclose(density.below(fields), below, atol=1e-8)
    assert density.below(np.zeros(1))[0] == pytest.approx((1 - lopsided) / 2, abs=1e-9)


def test_without_skew_and_tails_it_goes_over_into_a_gaussian() -> None:
    fields = np.linspace(0.0, 2.5e6, 101)
    gaussian = Gaussian(1e6, 5e11, lower=0.0)
    for bent in (
        Bent(1e6, 5e11, skew=1e-6, lower=0.0),
        Bent(1e6, 5e11, tail=-1e-6, lower=0.0),
        Bent(1e6, 5e11, lopsided=1e-7, lower=0.0),
    ):
        assert np.allclose(bent.at(fields), gaussian.at(fields), rtol=2e-5)


def polarization(link: Front | Lattice) -> Array:
    return link.step(link.init(Rest()), Signals(time=TIME, voltage=VOLTAGE))[1].polarization


@pytest.mark.parametrize(
    "shape",
    [
        (0.6, 0.0, 0.0, 0.0),
        (0.0, 0.0, 0.7, 0.0),
        (0.4, 0.0, -0.5, 0.0),
        (-0.4, 0.0, 0.3, 0.0),
        (0.0, 0.0, 0.0, -0.3),
        (0.3, 0.0, 0.4, 0.5),
        (0.0, 0.7, 0.0, 0.0),
        (-0.3, -0.6, 0.3, 0.2),
    ],
)
def test_front_and_lattice_agree_on_it(shape: tuple[float, float, float, float]) -> None:
    """As near as on Gaussians."""
    shapes: Any = dict(zip((*SHAPES, LOPSIDED), shape, strict=True))
    fields: Any = {"coercive_field": 4e5, "coercive_field_spread": 8e10, "interaction_field_spread": 5e10}
    front, lattice = (polarization(model(**fields, **shapes)) for model in (Front, Lattice))
    gaussian = polarization(Lattice(**fields))
    assert np.std(front - lattice) < 6e-4 * np.ptp(lattice)
    assert np.std(gaussian - lattice) > 5e-3 * np.ptp(lattice)


def test_a_fit_leaves_shapes_alone_unless_they_are_named() -> None:
    chain = load_chain("thesis-q1")
    assert not {each.field for each in free_parameters(chain)} & {*SHAPES, LOPSIDED}
    named = dataclasses.replace(chain, notes={"free": ["quadrature.coercive_field_skew"]})
    assert [each.field for each in free_parameters(named)] == ["coercive_field_skew"]
