"""A density with a formula that is off by a little, and one that is identified about it; court stages, simulated."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pzt_benchmarks.residual_court.cases import Case, Spec, make_case
from pzt_benchmarks.residual_court.files import declared_chain
from pzt_ros.chains import load_chain
from pzt_ros.diagnosis import density_alone as alone
from pzt_ros.diagnosis import formula
from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.data import RunData, split
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.density_alone import density_alone
from pzt_ros.diagnosis.flexible import fit_flexible
from pzt_ros.diagnosis.flexible_lattice import FlexibleHysteresis
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.formula import formula_again, is_formula_off
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact
from pzt_ros.diagnosis.outcome import model_of
from pzt_ros.diagnosis.reached import last_fit, reached_of
from pzt_ros.diagnosis.remarks import FORMULA, INSTEAD
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.shaped import shaped
from pzt_ros.diagnosis.time_limit import TimeLimit
from pzt_ros.errors import BenchError
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.identified_hats import gathered, hats_of, nodes_of, relay_thresholds
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.predict import predict
from pzt_ros.sysid.read_off import shares_of

NOISE, EVERY = 12e-9, 4
TWO_SHAPES = "coercive_field_skew", "interaction_field_tail"
"""Not those of heavy tails in both fields, which come near them only."""


def runs_of(case: Case, tmp_path: Any) -> tuple[list[RunData], Chain]:
    """Fewer samples of what a diagnosis sees, and what is declared."""
    train = [thinned(f"train {k}", columns) for k, columns in enumerate(case.train)]
    test = [thinned("test", columns) for columns in case.test]
    (tmp_path / "declared.yaml").write_text(declared_chain(case), encoding="utf-8")
    return split(with_floors(train), with_floors(test)), load_chain(tmp_path / "declared.yaml")


def made(family: str, *effects: str) -> Case:
    return make_case(Spec("effect_wrong", family, effects, 3.0 if effects else 0.0, protocol="slow", seed=4))


def thinned(name: str, columns: dict[str, Array]) -> Record:
    return Record(name, {key: values[::EVERY] for key, values in columns.items()})


def beside(case: Case, tmp_path: Any) -> tuple[Hypothesis, list[RunData]]:
    """Densities with free shapes, beside what is hidden."""
    runs, declared = runs_of(case, tmp_path)
    base = exact(shaped(begun(declared, runs), TWO_SHAPES))
    return (Search().with_effects(base, list(case.spec.effects)) if case.spec.effects else base), runs


def left(found: Hypothesis, case: Case) -> float:
    """Rms over noise of a run that no fit saw."""
    return float(predict(model_of(found, "model", ""), thinned("score", case.score[0])).rms / NOISE)


def test_the_model_has_an_identified_density_where_that_of_a_formula_is_off(tmp_path: Any) -> None:
    """Two shapes come near tails that are heavy, and name a drift, but are off where runs go that nobody saw."""
    case = made("heavy_tailed", "thermal_drift")
    found, runs = beside(case, tmp_path)
    assert is_formula_off(found, Thresholds())
    reached = reached_of(runs, branch_of(found, found), found, Thresholds(), "", IN_THIS_PROCESS, TimeLimit())
    last = reached.final
    assert isinstance(last.staged.ceramic, FlexibleHysteresis)
    assert last.effects == ("thermal_drift",)
    assert reached.remarks == (INSTEAD,)
    assert left(found, case) > 1.1
    assert left(last, case) < min(1.1, 1.0 + 0.7 * (left(found, case) - 1.0))


@pytest.fixture(scope="module")
def bent(tmp_path_factory: pytest.TempPathFactory) -> tuple[Case, list[RunData], Hypothesis, Hypothesis]:
    """Skewed densities with a drift, of which Gaussians leave 7 x; those, and a lattice beside the drift."""
    case = made("skewed", "thermal_drift")
    runs, declared = runs_of(case, tmp_path_factory.mktemp("bent"))
    base = begun(declared, runs)
    return case, runs, base, fit_flexible(Search().with_effects(base, ["thermal_drift"]), lambda text: None)


@pytest.mark.long
def test_a_formula_that_an_effect_had_bent_is_taken_again_beside_it(bent: Any) -> None:
    """The lattice leaves little, but where no run told."""
    case, runs, base, lattice = bent
    branch = Branch("identified", base, branch_of(base, lattice).steps)
    reached = reached_of(runs, branch, base, Thresholds(), "", IN_THIS_PROCESS, TimeLimit())
    assert isinstance(reached.final.staged.ceramic, DeclaredHysteresis)
    assert (reached.final.effects, reached.remarks) == (("thermal_drift",), (FORMULA,))
    assert left(lattice, case) > 1.2
    assert left(reached.final, case) < 1.0 + 0.2 * (left(lattice, case) - 1.0)


def test_a_formula_stays_aside_where_it_leaves_more_or_there_is_none(
    bent: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, _, base, lattice = bent
    assert formula_again(base, base, Thresholds()) is base  # it is one
    assert formula_again(lattice, lattice, Thresholds()) is lattice  # nothing with a formula is known
    monkeypatch.setattr(formula, "of_kinds", lambda *_: base)  # without the drift
    assert formula_again(lattice, base, Thresholds()) is lattice


def test_a_null_needs_no_effect_beside_the_density(tmp_path: Any) -> None:
    """A court case: a hysteresis of the strain that was not there took what the shapes were off by."""
    case = made("heavy_tailed")
    found, runs = beside(case, tmp_path)
    named = Search().with_effects(found, ["strain_polarization_hysteresis"])
    branch = branch_of(found, named)
    instead = density_alone(branch, Search(Thresholds().on_lattice()))
    assert (instead.density, instead.final.effects) == ("identified", ())
    before, after = left(found, case), left(last_fit(instead.final, runs, Thresholds()), case)
    assert after < 1.0 + 0.7 * (before - 1.0)


def branch_of(base: Any, final: Any) -> Branch:
    step: Any = SimpleNamespace(before=base, after=final, accepted=(), tied=())
    return Branch("shaped", base, (step,))


@pytest.mark.parametrize(
    ("base", "final", "is_asked"),
    [
        ((1.06, 0.2), (1.01, 0.9), True),
        ((2.5, 0.01), (1.04, 0.3), True),
        ((2.5, 0.01), (1.01, 0.9), False),  # nothing speaks against the density beside the effect
        ((3.5, 0.01), (1.04, 0.3), False),  # no density is off by so much
        ((1.06, 1.0), (1.01, 1.0), False),
    ],
)
def test_a_density_alone_is_asked_for_where_the_formula_is_off(
    monkeypatch: pytest.MonkeyPatch, base: tuple[float, float], final: tuple[float, float], is_asked: bool
) -> None:
    asked = []
    monkeypatch.setattr(alone, "is_formula_off", lambda each, _: is_off(each))
    monkeypatch.setattr(alone, "identified_about", lambda each: asked.append(each) or each)
    branch = branch_of(leaving(*base), leaving(*final, ("sensor_lag",)))
    assert density_alone(branch, Search()) is branch  # what comes of it is no better
    assert bool(asked) is is_asked


def leaving(ratio: float, tells: float, effects: tuple[str, ...] = ()) -> Any:
    """What is asked of a hypothesis that leaves so many times the noise, and of how many samples tell something."""
    part = SimpleNamespace(ratio=ratio, samples=1000, effective=1000 * tells, total=1000 * ratio**2)
    return SimpleNamespace(fit=part, selection=part, ratios=[ratio], effects=effects)


def is_off(found: Any) -> bool:
    return bool(found.fit.effective < 800 and max(found.ratios) <= 1.15)


@pytest.mark.parametrize(("fit", "selection", "is_taken"), [(0.9, 0.9, True), (0.9, 1.01, False), (1.01, 0.9, False)])
def test_an_identified_density_is_taken_where_both_parts_speak_for_it(
    monkeypatch: pytest.MonkeyPatch, fit: float, selection: float, is_taken: bool
) -> None:
    found = leaving(1.0, 0.5)
    other = SimpleNamespace(fit=leaving(fit, 1.0).fit, selection=leaving(selection, 1.0).selection)
    monkeypatch.setattr(formula, "fit_about", lambda each: other)
    assert (formula.identified_about(found) is other) is is_taken


def test_a_right_formula_stays(tmp_path: Any) -> None:
    found, runs = beside(made("gaussian", "mains_hum"), tmp_path)
    assert not is_formula_off(found, Thresholds())
    assert type(last_fit(found, runs, Thresholds()).staged.ceramic) is type(found.staged.ceramic)


def test_hats_gather_all_that_relays_hold() -> None:
    """They sum to 1 everywhere, and each holds what lies near its node."""
    lines, grid = np.linspace(-1.0, 1.5, 60), np.array([-1.2, -0.7, 0.1, 0.6, 1.7])
    up, down = relay_thresholds(lines)
    weight = np.random.default_rng(5).random(up.size)
    hats = hats_of(lines, grid)
    assert gathered(weight, hats).sum() == pytest.approx(weight.sum())
    near = (up > 0.6) & (down < -0.7)  # beyond all but the outermost lines
    held = gathered(np.where(near, weight, 0.0), hats)
    beyond = [number for number, (high, low) in enumerate(nodes_of(grid.size)) if high < 3 or low > 1]
    np.testing.assert_array_equal(held[beyond], 0.0)
    assert held.sum() > 0.0


def test_a_believed_density_costs_nothing() -> None:
    """Where no run tells, ridge, smoothness and rotation leave a lattice with what is believed of it."""
    times = [np.linspace(0.0, 1.0, 50)]
    lattice = FlexibleHysteresis(times, 1e-4, (-1e6, 1e6), unknown_start=[False], resolution=8)
    shares = np.random.default_rng(7).random(lattice.shared - 4)
    lattice.rotation_strength = 10.0
    lattice.believe(shares)
    rows, targets = lattice.regularisation()
    np.testing.assert_allclose(rows @ lattice.start, targets, atol=1e-8)
    believed = lattice.weights(lattice.start)
    np.testing.assert_allclose(believed / believed.sum(), shares / shares.sum())
    assert not np.allclose(rows @ (1.1 * lattice.start), targets, atol=1e-3)


def test_a_density_that_no_run_reaches_is_not_believed() -> None:
    lattice = FlexibleHysteresis([np.linspace(0.0, 1.0, 50)], 1e-4, (-1e6, 1e6), unknown_start=[False], resolution=8)
    with pytest.raises(BenchError, match="nothing of the density switches"):
        lattice.believe(np.zeros(lattice.shared - 4))


@pytest.mark.parametrize("shapes", [{}, {"coercive_field_skew": 1.5, "interaction_field_tail": 2.0}])
def test_hats_of_a_formula_are_its_density(shapes: dict[str, float]) -> None:
    """Each weighs as much more than another as the density is higher there, whatever its tails reach."""
    polycrystal = Lattice(
        coercive_field=4e5, coercive_field_spread=2e11, interaction_field_spread=3e11, reciprocal_permittivity=6e7,
        **shapes,
    )  # fmt: skip
    grid = np.linspace(-1.5e6, 1.5e6, 31)
    shares = shares_of(polycrystal, grid)
    places = {node: number for number, node in enumerate(nodes_of(grid.size))}
    pairs = (22, 10), (26, 8)

    def density(high: int, low: int) -> float:
        barrier, field = 0.5 * (grid[high] - grid[low]), -0.5 * (grid[high] + grid[low])
        at = polycrystal.coercive.at(np.array([barrier])) * polycrystal.interaction.at(np.array([field]))
        return float(at[0])

    one, other = (shares[places[pair]] for pair in pairs)
    assert density(*pairs[1]) > 0.0
    assert one / other == pytest.approx(density(*pairs[0]) / density(*pairs[1]), rel=0.05)
