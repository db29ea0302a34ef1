"""The numbers of a formula read off a lattice that has its density; simulated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pzt_ros.errors import BenchError
from pzt_ros.physics.identified_hats import hat_sums, hats_of, nodes_of
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.kinds import Kind
from pzt_ros.physics.lattice import Lattice
from pzt_ros.sysid.parameters import GROWTH, LOPSIDED, SECOND, SHAPES
from pzt_ros.sysid.read_off import kinetics_of, read_off

GRID = np.linspace(-1.7e6, 1.7e6, 18)
FINE = np.linspace(GRID[0], GRID[-1], 160)
DRIVEN = -0.4e6, 1.5e6
LIKE = Lattice(coercive_field=4e5, coercive_field_spread=5e11, interaction_field_spread=5e11)
GROWING = {"coercive_field": 5.2e5, "coercive_field_spread": 2.5e11, GROWTH: 0.4}
TWO = {
    "coercive_field": 5.5e5, "coercive_field_spread": 3e11, "interaction_field_spread": 4.5e11,
    "second_share": 0.3, "second_coercive_field": 1e6, "second_coercive_field_spread": 5e10,
    "second_interaction_field_spread": 1.6e11,
}  # fmt: skip


def lattice_of(polycrystal: Lattice, size: float = 0.2) -> IdentifiedLattice:
    """Hats with the density at their nodes, to some scale."""
    up, down = np.array(nodes_of(GRID.size)).T
    barrier, field = 0.5 * (GRID[up] - GRID[down]), -0.5 * (GRID[up] + GRID[down])
    density = np.sum([kind.at(barrier, field) for kind in polycrystal.kinds], axis=0)
    weights = density * hat_sums(hats_of(FINE, GRID))
    return IdentifiedLattice(
        grid=tuple(GRID), weights=tuple(size * weights / weights.sum()), relaxation_time=2e-3, thermal_field=6e4,
        susceptibility=1e-8,
    )  # fmt: skip


def harder_last(values: dict[str, float]) -> dict[str, float]:
    """Which of two kinds is called the second is nobody's matter."""
    if values["coercive_field"] < values["second_coercive_field"]:
        return values
    swapped = {name.removeprefix("second_") if name in SECOND else "second_" + name: values[name] for name in values}
    return {**swapped, "second_share": 1.0 - values["second_share"]}


def formula(**values: Any) -> Lattice:
    return Lattice(**{"interaction_field_spread": 3e11, **values})


@pytest.mark.parametrize(("truth", "fields"), [(GROWING, (GROWTH,)), (TWO, SECOND)], ids=["growing", "two kinds"])
def test_numbers_are_read_off(truth: dict[str, float], fields: tuple[str, ...]) -> None:
    values, off = read_off(lattice_of(formula(**truth)), DRIVEN, LIKE, fields)
    assert off < 1e-3
    values = values if fields == (GROWTH,) else harder_last(values)
    for name, value in truth.items():
        far = 0.5 if name.startswith("second") and name.endswith("spread") else 0.15  # as wide as the cells of the grid
        assert values[name] == pytest.approx(value, rel=far), name


@pytest.mark.parametrize("truth", [GROWING, TWO], ids=["growing", "two kinds"])
def test_the_right_formula_is_the_nearest(truth: dict[str, float]) -> None:
    lattice = lattice_of(formula(**truth))
    off = {fields: read_off(lattice, DRIVEN, LIKE, fields)[1] for fields in ((*SHAPES, LOPSIDED), (GROWTH,), SECOND)}
    right = (GROWTH,) if GROWTH in truth else SECOND
    assert min(off, key=lambda each: off[each]) == right
    assert off[right] < 0.3 * sorted(off.values())[1]


def test_kinetics_are_those_of_the_lattice_whatever_its_scale() -> None:
    polycrystal = formula(**GROWING)
    shares = {name: getattr(polycrystal, name) for name in ("interaction_field_spread", *GROWING)}
    for size in (0.1, 0.4):
        values = kinetics_of(lattice_of(polycrystal, size), DRIVEN, LIKE, shares)
        found = Lattice(**{**shares, **values})
        assert found.relaxation_time == 2e-3
        assert found.thermal_width == pytest.approx(6e4, rel=1e-9)
        reversible, switched = 1.0 / found.reciprocal_permittivity, found.domain_polarization
        inside = Kind(1.0, polycrystal.coercive, polycrystal.interaction, 0.4, 5.2e5).shares(
            np.linspace(1e4, 1.69e6, 169), np.linspace(-1.69e6, 1.69e6, 338), 1e4
        ).sum()  # fmt: skip
        assert reversible / switched == pytest.approx(1e-8 * inside / size, rel=0.1)


def test_a_drive_to_the_other_side_is_no_other_matter() -> None:
    mirrored = lattice_of(formula(**GROWING))
    values, off = read_off(mirrored, (-1.5e6, 0.4e6), LIKE, (GROWTH,))
    assert off < 1e-3
    assert values["coercive_field"] == pytest.approx(GROWING["coercive_field"], rel=0.15)


def test_a_lattice_that_tells_nothing_is_said_to() -> None:
    with pytest.raises(BenchError, match="nothing of the density switches"):
        read_off(lattice_of(formula(**GROWING)), (0.0, 1e5), LIKE, (GROWTH,))
