"""The quadrature model against converged solutions of the thesis' equations (data: see reference/README.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.signals import Rest, Signals

DATA = Path(__file__).parent / "data"

FIGURE_3_6 = {
    "coercive_field": 0.5e6,
    "relaxation_time": 1e-3,
    "domain_polarization": 0.26,
    "reciprocal_permittivity": 6e7,
    "temperature": 293.0,
    "domain_volume": 1e-22,
}
ACTUATOR = {**FIGURE_3_6, "relaxation_time": 8e-2, "domain_polarization": 0.21, "reciprocal_permittivity": 2.5e7}

# file: (parameters, b1, b2, nodes above and below the coercive field and per side of the other, sum of weights)
CASES = {
    "Q1_fig3.6_16x16_10MVms": (FIGURE_3_6, 5e11, 5e11, (10, 6, 8), 0.9973002027863114),
    "Q2_fig3.7_b1_1e10_b2_1e10": (FIGURE_3_6, 1e10, 1e10, (10, 6, 8), 0.9959519749290223),
    "Q2_fig3.7_b1_1e11_b2_1e11": (FIGURE_3_6, 1e11, 1e11, (10, 6, 8), 0.9973002145073236),
    "Q2_fig3.7_b1_1e12_b2_1e12": (FIGURE_3_6, 1e12, 1e12, (10, 6, 8), 0.9973002027860886),
    "Q3_relax_direct_-20V_0.1kVmms": (ACTUATOR, 5e11, 5e11, (10, 6, 8), 0.9973002027863114),
    "Q4_Ec_only_32": (FIGURE_3_6, 1e11, 0.0, (20, 12, 1), 1.0),
    "Q4_Ee_only_32": (FIGURE_3_6, 0.0, 1e11, (1, 1, 16), 0.9973002039367398),
}


def link(name: str, method: str) -> Quadrature:
    physics, b1, b2, (above, below, side), _ = CASES[name]
    return Quadrature(
        **physics,
        coercive_field_spread=b1,
        interaction_field_spread=b2,
        nodes_coercive_above=float(above),
        nodes_coercive_below=float(below),
        nodes_interaction_side=float(side),
        normalization="thesis",
        accuracy=1e-8,
        method=method,
    )


def test_every_oracle_file_has_a_case():
    assert {path.stem for path in DATA.glob("Q*.csv")} == set(CASES)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("method", ["collocation", "midpoint"])
def test_agrees_with_the_oracle_at_every_row(name, method):
    time, field, phase_fraction, polarization, _ = np.loadtxt(DATA / f"{name}.csv", delimiter=",", skiprows=1).T
    model = link(name, method)
    drive = Signals(time=time, voltage=field * model.layer_thickness)

    _, out = model.step(model.init(Rest()), drive)

    assert np.max(np.abs(out.polarization - polarization)) <= 1e-7
    assert np.max(np.abs(out.phase_fraction - phase_fraction)) <= 1e-7


@pytest.mark.parametrize("name", CASES)
def test_weights_sum_to_what_the_program_makes_of_them(name):
    (_, coercive), (_, interaction) = link(name, "collocation").nodes()
    assert coercive.sum() * interaction.sum() == pytest.approx(CASES[name][-1], rel=1e-12)


@pytest.mark.parametrize(
    ("b1", "b2", "nodes", "expected"), [(5e11, 1e6, (10, 6, 1), 0.777), (1e6, 5e11, (1, 1, 8), 0.776)]
)
def test_one_node_per_side_of_a_narrow_density_loses_a_fifth_of_the_weight(b1, b2, nodes, expected):
    above, below, side = (float(n) for n in nodes)
    model = Quadrature(
        coercive_field_spread=b1,
        interaction_field_spread=b2,
        nodes_coercive_above=above,
        nodes_coercive_below=below,
        nodes_interaction_side=side,
        normalization="thesis",
    )
    (_, coercive), (_, interaction) = model.nodes()
    assert coercive.sum() * interaction.sum() == pytest.approx(expected, abs=6e-4)


def test_sparse_rows_do_not_cost_accuracy():
    """Only the segment ends are fed: 2 MV/m per row and more."""
    rows = np.loadtxt(DATA / "Q1_fig3.6_16x16_10MVms.csv", delimiter=",", skiprows=1)
    change = np.diff(rows[:, 1])
    turns = 1 + np.flatnonzero(change[1:] * change[:-1] < 0)
    keep = rows[np.concatenate(([0], turns, [len(rows) - 1]))]
    model = link("Q1_fig3.6_16x16_10MVms", "collocation")

    _, out = model.step(model.init(Rest()), Signals(time=keep[:, 0].copy(), voltage=keep[:, 1] * 1e-4))

    assert len(keep) == 30
    assert np.max(np.abs(out.phase_fraction - keep[:, 2])) <= 1e-7
