"""Densities in chain files: what is written is what is read, and every mistake is a line of text."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pzt_ros.chains import chain_as_data, load_chain, parse_chain, save_chain
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.density import Table, ThresholdDensity
from pzt_ros.physics.front import Front
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.quantities import parameters_of

TABLE = {"unit": "MV/m", "field": [0.1, 0.5, 2.0], "density": [0, 1.5, 0]}
GRID = {"unit": "kV/mm", "up": [0, 1, 2], "down": [-2, -1, 0], "density": [[0, 1, 0], [2, 3, 0], [1, 0, 0]]}


def data(kind: str, **densities: Any) -> dict[str, Any]:
    return {"chain": "tabled", "links": [{"link": kind, **copy.deepcopy(densities)}]}


@pytest.mark.parametrize("kind", ["quadrature", "lattice", "front"])
def test_tables_are_read_in_their_unit(kind: str) -> None:
    link = parse_chain(data(kind, coercive_density=TABLE, interaction_density=TABLE), "t").links[0]
    assert link.coercive_density == Table((1e5, 5e5, 2e6), (0.0, 1.5, 0.0))  # type: ignore[attr-defined]
    assert link.interaction_density == link.coercive_density  # type: ignore[attr-defined]


@pytest.mark.parametrize("kind", ["lattice", "front"])
def test_identified_densities_are_read_in_their_unit(kind: str) -> None:
    link = parse_chain(data(kind, threshold_density=GRID), "t").links[0]
    assert link.threshold_density == ThresholdDensity(  # type: ignore[attr-defined]
        (0.0, 1e6, 2e6), (-2e6, -1e6, 0.0), ((0.0, 1.0, 0.0), (2.0, 3.0, 0.0), (1.0, 0.0, 0.0))
    )


def test_saved_and_read_back_to_the_same_numbers(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    fields = tuple(np.sort(rng.uniform(0, 3e6, 9)))
    table, other = Table(fields, tuple(rng.uniform(0, 1, 9))), Table(fields, tuple(1e-7 * rng.uniform(0, 1, 9)))
    grid = ThresholdDensity(fields, tuple(np.sort(rng.normal(0, 1e6, 4))), tuple(map(tuple, rng.uniform(0, 1, (9, 4)))))
    for link in (
        Front(coercive_density=table),
        Quadrature(coercive_density=table, interaction_density=other),
        Lattice(threshold_density=grid),
        Front(threshold_density=grid),
        Front(),
    ):
        save_chain(Chain("saved", (link,)), tmp_path / "saved.yaml")
        assert load_chain(tmp_path / "saved.yaml").links == (link,)
    assert "density" not in yaml.safe_dump(chain_as_data(Chain("saved", (Front(),))))


def test_a_fit_sees_numbers_only() -> None:
    """Whoever lists parameters gets floats with a unit; densities are none."""
    assert not any("density" in name for name in parameters_of(Front))
    link = parse_chain(data("front", threshold_density=GRID), "t").links[0]
    assert all(isinstance(getattr(link, name), float) for name in parameters_of(link))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"field": [0.5, 0.1, 2.0]}, "increase"),
        ({"field": [0.1, 0.5]}, "2 fields with 3 weights"),
        ({"field": [0.1, 0.5, "2 MV/m"]}, "field, value 3"),
        ({"field": [0.1, 0.5, float("nan")]}, "finite"),
        ({"field": [-0.1, 0.5, 2.0]}, "barriers start at 0"),
        ({"field": 0.1}, "list of numbers"),
        ({"density": [0, -1, 0]}, "density, value 2"),
        ({"density": [0, 0, 0]}, "not all 0"),
        ({"density": [0, float("inf"), 0]}, "density, value 2"),
        ({"density": None}, "list of numbers"),
        ({"unit": "V"}, "field, value 1"),
        ({"unit": 3}, "field, value 1"),
        ({"unit": None}, "field, value 1"),
        ({"values": []}, "write just these"),
    ],
)
def test_mistakes_in_a_table_are_named(change: dict[str, Any], word: str) -> None:
    with pytest.raises(BenchError, match=word) as caught:
        parse_chain(data("front", coercive_density={**TABLE, **change}), "t.yaml")
    assert "\n" not in str(caught.value)
    if word != "barriers start at 0":
        assert "t.yaml: link 1 (front).coercive_density" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"up": [0, 2, 1]}, "up fields do not increase"),
        ({"density": [[0, 1, 0], [2, 3], [1, 0, 0]]}, "3 rows of 3"),
        ({"density": [[0, 1, 0], [2, 3, 0]]}, "3 rows of 3"),
        ({"density": [[0, 1, 0], 2, [1, 0, 0]]}, "row 2"),
        ({"density": [[0, 1, 0], [2, -3, 0], [1, 0, 0]]}, "row 2, value 2"),
        ({"density": 1}, "list of rows"),
        ({"down": [3, 4, 5]}, "swap"),
        ({"down": ["a", 4, 5]}, "down, value 1"),
    ],
)
def test_mistakes_in_a_grid_are_named(change: dict[str, Any], word: str) -> None:
    with pytest.raises(BenchError, match=word) as caught:
        parse_chain(data("lattice", threshold_density={**GRID, **change}), "t.yaml")
    assert "t.yaml: link 1 (lattice).threshold_density" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("wrong", [None, 3, "identified", [1, 2], {}])
def test_another_form_is_named(wrong: Any) -> None:
    with pytest.raises(BenchError, match="a density has unit"):
        parse_chain(data("front", threshold_density=wrong), "t.yaml")
