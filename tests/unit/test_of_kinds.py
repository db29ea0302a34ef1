"""Formulas that begin where a lattice tells their numbers; court stages, simulated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pzt_benchmarks.residual_court.cases import Case, Spec, make_case
from pzt_benchmarks.residual_court.files import declared_chain
from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.data import split
from pzt_ros.diagnosis.flexible import fit_flexible
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.formula import formula_again
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.of_kinds import of_kinds
from pzt_ros.diagnosis.outcome import model_of
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.shaped import is_shaped
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.lattice import Lattice
from pzt_ros.records import Record
from pzt_ros.sysid.predict import predict

NOISE = 12e-9


def bases(family: str, seed: int, tmp_path: Any) -> tuple[Case, Hypothesis, Hypothesis]:
    """Of a null: the declared Gaussians as fitted, and a lattice in their place."""
    case = make_case(Spec("null_wrong", family, (), 0.0, protocol="standard", seed=seed))
    (tmp_path / "declared.yaml").write_text(declared_chain(case), encoding="utf-8")
    train = [Record(f"train {number}", dict(columns)) for number, columns in enumerate(case.train)]
    test = [Record(f"test {number}", dict(columns)) for number, columns in enumerate(case.test)]
    base = begun(load_chain(tmp_path / "declared.yaml"), split(with_floors(train), with_floors(test)))
    return case, base, fit_flexible(base, lambda text: None)


def left(found: Hypothesis, case: Case) -> float:
    """Rms over noise of the worst run that no fit saw."""
    model = model_of(found, "model", "")
    return max(float(predict(model, Record("score", dict(each))).rms / NOISE) for each in case.score)


@pytest.mark.parametrize(
    ("family", "seed", "field", "truth"),
    [
        ("two_component", 52, "second_share", "hard_share"),
        pytest.param("correlated", 42, "interaction_field_growth", "correlation", marks=pytest.mark.long),
    ],
)
def test_a_formula_is_found_that_begins_far_off(family: str, seed: int, field: str, truth: str, tmp_path: Any) -> None:
    case, base, lattice = bases(family, seed, tmp_path)
    assert max(base.ratios) > 5.0
    found = formula_again(lattice, base, Thresholds())
    link = found.staged.ceramic.link(found.vector)
    assert isinstance(link, Lattice)
    assert is_shaped(found)
    share = getattr(link, field)
    if field == "second_share" and link.second_coercive_field < link.coercive_field:
        share = 1.0 - share
    assert share == pytest.approx(case.bench.truth.parameters[truth], abs=0.1)
    assert max(found.ratios) < 1.1
    assert left(found, case) < 1.0 + 0.5 * (left(lattice, case) - 1.0)


@pytest.mark.long
def test_where_no_formula_comes_near_the_lattice_stays(tmp_path: Any) -> None:
    """Interaction fields that lean with the coercive field: the search ends, and is not believed."""
    _, base, lattice = bases("leaning", 52, tmp_path)
    assert isinstance(lattice.staged.ceramic.link(lattice.vector), IdentifiedLattice)
    near = of_kinds(lattice, base.staged.ceramic)  # type: ignore[arg-type]
    assert np.isfinite(near.total)
    assert near.total < base.total
    assert formula_again(lattice, base, Thresholds()) is lattice
