"""A lattice identified from runs that begin in motion, where a run from rest chooses: that asks for a wider grid."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.data import RunData, split
from pzt_ros.diagnosis.flexible import _lattice
from pzt_ros.diagnosis.flexible_lattice import FlexibleHysteresis
from pzt_ros.diagnosis.hypothesis import fitted
from pzt_ros.diagnosis.undeclared import default_chain
from pzt_ros.parallel import one_blas_thread
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.identified_hats import nodes_of
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.records import Record
from pzt_ros.sysid.identified import WEIGHTS, IdentifiedHysteresis

NOISE, RATE, CUT = 8e-9, 500.0, 0.7


def declared() -> Chain:
    """Thesis set P2, its density and its law known."""
    return dataclasses.replace(load_chain("thesis-p2"), notes={"free": ["electrostriction.coefficient"]})


def run(seed: int, begins_driven: bool) -> RunData:
    """Reversals at random, far to one side and a little to the other; its beginning kept or not."""
    rng = np.random.default_rng(seed)
    volts = [0.0, 140.0, -20.0, *(v for _ in range(8) for v in (rng.uniform(70, 140), rng.uniform(-20, 60)))]
    time = np.arange(0.0, 0.5 * (len(volts) - 1), 1.0 / RATE)
    voltage = np.interp(time, 0.5 * np.arange(len(volts)), volts)
    chain = declared()
    _, out = chain.step(chain.init(Rest(time=0.0)), Signals(time=time, voltage=voltage))
    kept = time >= (CUT if begins_driven else 0.0)
    y = out.displacement[kept] + NOISE * rng.standard_normal(int(kept.sum()))
    columns = {"time_s": time[kept] - time[kept][0], "voltage_V": voltage[kept], "displacement_m": y}
    return RunData(Record(f"run-{seed}", columns), {}, NOISE)


def test_its_weights_are_taken_over_where_they_lie() -> None:
    """Measured runs of an actuator ended in a traceback, and before that in weights that lay elsewhere."""
    runs = split([run(1, True), run(2, True)], [run(3, False)])
    model = begun(default_chain(runs), runs)
    train, _, test = runs
    assert (train.begins_driven, test.begins_driven) == (True, False)
    with one_blas_thread():
        begun_there = _lattice(model, model)
        found = fitted(begun_there.staged, begun_there.vector, (), 40)
    lattice = found.staged.ceramic
    assert isinstance(lattice, FlexibleHysteresis)
    assert lattice.grid[0] == -lattice.grid[-1]  # so far a virgin run asks for
    assert max(found.ratios[:2]) < 1.15


def test_no_weight_moves_to_another_threshold() -> None:
    times, reach = [np.linspace(0.0, 1.0, 50)] * 2, (-2e5, 1.4e6)
    driven, wide = (
        IdentifiedHysteresis(times, 1e-4, reach, unknown_start=[True, rested], resolution=6) for rested in (True, False)
    )
    assert wide.grid.size == driven.grid.size + 1
    vector = driven.start.copy()
    vector[WEIGHTS : driven.shared] *= np.random.default_rng(1).uniform(0.5, 2.0, driven.shared - WEIGHTS)
    there = wide.carried(driven, vector)
    lies = [dict(zip(lines_of(each), each.weights(v), strict=True)) for each, v in ((driven, vector), (wide, there))]
    assert all(lies[1][lines] == weight for lines, weight in lies[0].items())
    assert sum(lies[1].values()) == pytest.approx(sum(lies[0].values()))


def lines_of(lattice: IdentifiedHysteresis) -> list[tuple[float, float]]:
    """Thresholds of every weight [V/m]."""
    return [(lattice.grid[up], lattice.grid[down]) for up, down in nodes_of(lattice.grid.size)]
