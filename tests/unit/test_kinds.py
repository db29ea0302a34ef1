"""Domains of two kinds, and interaction fields that depend on the coercive field: three models of one specimen."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy import integrate

from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.density import Bent, Gaussian, Table
from pzt_ros.physics.front import Front
from pzt_ros.physics.front_tables import LOWER, TRIANGLE, everett
from pzt_ros.physics.kinds import Kind
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.sysid.parameters import free_parameters

GROWING = {"interaction_field_growth": 0.6}
SECOND = {
    "second_share": 0.35,
    "second_coercive_field": 1.1e6,
    "second_coercive_field_spread": 1e11,
    "second_interaction_field_spread": 2e11,
}
ALL = {**SECOND, "interaction_field_growth": -0.5, "interaction_field_skew": 0.3, "coercive_field_skew": 0.4}
SPECIMENS = pytest.mark.parametrize("specimen", [GROWING, SECOND, ALL], ids=["growing", "second", "all"])


def drive(*ends: float) -> Signals:
    """Legs between fields [MV/m] at 10 MV/m/s."""
    legs = [np.linspace(a, b, max(2, int(abs(b - a) * 1e3)), endpoint=False) for a, b in pairwise(ends)]
    voltage = 100.0 * np.concatenate(legs)
    return Signals(time=1e-4 * np.arange(voltage.size), voltage=voltage)


SIGNALS = drive(0, 1.5, -0.5, 1.2, 0.2, 1.0, -1.5, 1.5, -0.2, 0.8)


def polarization(link: Any) -> Array:
    return link.step(link.init(Rest()), SIGNALS)[1].polarization


def distance(link: Any, other: Any) -> float:
    """Rms over the span of P."""
    there = polarization(other)
    return float(np.sqrt(np.mean((polarization(link) - there) ** 2)) / np.ptp(there))


@SPECIMENS
def test_fronts_lattice_and_quadrature_are_one_specimen(specimen: dict[str, float]) -> None:
    lattice = Lattice(spacing=0.25, accuracy=1e-5, **specimen)
    nodes = dict.fromkeys(("nodes_coercive_above", "nodes_coercive_below", "nodes_interaction_side"), 40.0)
    assert distance(Front(**specimen), lattice) < 6e-4
    assert distance(Quadrature(rule="equal_probability", **nodes, **specimen), lattice) < 8e-4
    assert distance(lattice, Lattice(spacing=0.25, accuracy=1e-5)) > 0.02  # and another than without


def test_two_kinds_are_the_sum_of_both() -> None:
    """Domains do not know of one another."""
    first = Lattice(spacing=0.25, accuracy=1e-5)
    second = Lattice(
        spacing=0.25, accuracy=1e-5, coercive_field=SECOND["second_coercive_field"],
        coercive_field_spread=SECOND["second_coercive_field_spread"],
        interaction_field_spread=SECOND["second_interaction_field_spread"],
    )  # fmt: skip
    both, share = polarization(Lattice(spacing=0.25, accuracy=1e-5, **SECOND)), SECOND["second_share"]
    expected = (1 - share) * polarization(first) + share * polarization(second)
    assert np.sqrt(np.mean((both - expected) ** 2)) / np.ptp(expected) < 2e-4


@pytest.mark.parametrize(
    ("specimen", "plain"), [({"second_share": 1e-9}, {}), ({"interaction_field_growth": 1e-9}, {})]
)
def test_where_there_is_next_to_nothing_of_it_a_model_is_as_without(
    specimen: dict[str, float], plain: dict[str, float]
) -> None:
    assert distance(Front(**specimen), Front(**plain)) < 1e-5
    assert distance(Lattice(spacing=0.25, **specimen), Lattice(spacing=0.25, **plain)) < 1e-4


def test_everett_function_of_fields_that_depend_on_one_another() -> None:
    """Against integrals of the density by adaptive quadrature."""
    kind = Kind(0.7, Gaussian(5e5, 3e11, 0.0), Bent(0.0, 2e11, tail=0.2, lopsided=0.2), growth=0.5, reference=5e5)
    table = everett((kind,))
    middle = table.values.shape[2] // 2
    for i, j in ((3, -3), (6, 1), (8, -11)):
        u, low = i * table.step, j * table.step
        c, m = (u - low) / 2, -(u + low) / 2

        def share(upper: Any, c: float = c, u: float = u) -> float:
            def strip(x: float) -> float:
                width = float(kind.widening(np.array([x]))[0])
                below = kind.interaction.below(np.array([upper(x), x - u]) / width)
                return 0.7 * float(kind.coercive.at(np.array([x]))[0]) * float(below[0] - below[1])

            return integrate.quad(strip, 0.0, c, points=[min(5e5, c)], epsabs=1e-10)[0]

        got = table.values[0, :, middle + i, middle + j, 0]
        assert got[TRIANGLE] == pytest.approx(share(lambda x, low=low: -low - x), abs=5e-6)
        assert got[LOWER] == pytest.approx(share(lambda x, m=m: m), abs=5e-6)


def test_a_table_may_be_wider_for_harder_domains_too() -> None:
    fields = np.linspace(-2e6, 2e6, 401)
    table = Table(tuple(fields), tuple(Gaussian(0.0, 5e11).at(fields)))
    tabled = Front(interaction_density=table, **GROWING)
    assert distance(tabled, Front(**GROWING)) < 1e-3
    assert (tabled.has_formula, Front(**GROWING).has_formula) == (False, True)


@pytest.mark.parametrize("field", [1e3, 3e4, 5e4])
def test_fields_that_outgrow_every_table_are_refused_and_not_tabulated(field: float) -> None:
    """A fit of a court's case came by there, and asked for a table of 1 TiB."""
    grown = Front(
        coercive_field=field, coercive_field_spread=2e11, interaction_field_spread=4e11, interaction_field_growth=1.0
    )
    with pytest.raises(BenchError, match=r"too far for a table .* lower interaction_field_growth"):
        everett(grown.kinds)


@pytest.mark.parametrize("shape", [(0.5, 0.3), (-0.6, -0.5), (1.2, 1.5), (0.3, -0.9), (-0.9, 2.0)])
def test_a_bell_that_is_skewed_and_has_tails_is_a_density(shape: tuple[float, float]) -> None:
    skew, tail = shape
    bell = Bent(5e5, 2e11, lower=0.0, skew=skew, tail=tail)
    share = np.linspace(0.001, 0.999, 201)
    np.testing.assert_allclose(bell.below(bell.quantile(share)), share, atol=1e-9)
    fields = np.linspace(*bell.support(6.0), 200_001)
    density = bell.at(fields)
    assert np.trapezoid(density, fields) == pytest.approx(1.0, abs=1e-6)
    assert fields[np.argmax(density)] == pytest.approx(5e5, rel=1e-3)


def test_what_most_runs_do_not_tell_is_not_free() -> None:
    names = [each.field for each in free_parameters(Chain("plain", (Lattice(**ALL),), {}))]
    assert not set(ALL) & set(names)
