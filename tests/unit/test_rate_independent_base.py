"""What answers at any rate alike: diagnosed on the bases that know no rate, with runs of the court's operators."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pzt_benchmarks.residual_court.cases import Spec, make_case
from pzt_benchmarks.residual_court.files import write_case
from pzt_ros.chains import load_chain
from pzt_ros.diagnosis import reach_of_pasts
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.branches import _trusted
from pzt_ros.diagnosis.candidates import Step
from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.diagnosis.flexible_preisach import FlexiblePreisach
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.time_limit import TimeLimit
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.bouc_wen import BoucWen
from pzt_ros.physics.link import Link
from pzt_ros.physics.preisach import Preisach
from pzt_ros.records import read_csv

NULL = Spec("null_wrong", "play_sum", protocol="short", seed=5)
HUM = Spec("effect_wrong", "play_sum", ("mains_hum",), 5.0, "short", seed=6)


def ceramic() -> FlexiblePreisach:
    return FlexiblePreisach([np.arange(9.0)], 1e-4, (-0.5e6, 1.5e6), resolution=4, initial="virgin", total=0.26)


@pytest.mark.parametrize(("left", "named"), [(1.4, True), (1.6, False), (3.0, False), (5.0, False)])
def test_no_name_beside_much_that_is_left(left: float, named: bool) -> None:
    """A court case: what a Maxwell slip has beyond any Preisach model was named strain-polarization hysteresis."""
    base: Any = SimpleNamespace(staged=SimpleNamespace(ceramic=ceramic()))
    name = "strain_polarization_hysteresis"
    found: Any = SimpleNamespace(after=SimpleNamespace(fit=SimpleNamespace(ratio=left), choosing=[1], effects=(name,)))
    branch = Branch("identified", base, (Step(base, (found,), {}, (found,), (), "explains 97% of the excess"),))
    step = _trusted(branch, [branch], Thresholds(), TimeLimit()).steps[0]
    assert bool(step.accepted) is named
    assert ("no name is to be trusted" in step.verdict) is not named


def test_stronger_priors_leave_the_weaker_one_as_it_was() -> None:
    held = ceramic()
    held.rotation_strength = 10.0
    assert [each.rotation_strength for each in held.stiffer()] == [100.0]  # type: ignore[attr-defined]
    assert held.rotation_strength == 10.0
    stiffest = held.stiffer()[0]
    assert np.linalg.norm(stiffest.regularisation()[0]) > np.linalg.norm(held.regularisation()[0])
    assert stiffest.stiffer() == []


@pytest.mark.parametrize(
    ("spec", "names", "link", "density"),
    [
        pytest.param(NULL, [], Preisach, "identified", marks=pytest.mark.long),
        pytest.param(dataclasses.replace(NULL, declared=False), [], Preisach, "identified", marks=pytest.mark.long),
        pytest.param(
            dataclasses.replace(HUM, declared=False), ["mains_hum"], Preisach, "identified", marks=pytest.mark.long
        ),
        pytest.param(dataclasses.replace(NULL, family="bouc_wen"), [], BoucWen, "none", marks=pytest.mark.long),
        (dataclasses.replace(HUM, family="maxwell_slip"), ["mains_hum"], BoucWen, "none"),
        pytest.param(
            dataclasses.replace(HUM, family="maxwell_slip", declared=False),
            ["mains_hum"],
            BoucWen,
            "none",
            marks=pytest.mark.long,
        ),
    ],
    ids=[
        "plays",
        "plays, nothing declared",
        "plays and hum, nothing declared",
        "one that slips",
        "two and hum",
        "two, nothing declared",
    ],
)
def test_what_knows_no_rate_comes_down_to_the_noise(
    spec: Spec, names: list[str], link: type[Link], density: str, tmp_path: Path
) -> None:
    """Where nothing was declared, a hum of 3 x was named on relays that left 3.2 x of a score run, after 521 s."""
    files = write_case(make_case(spec), tmp_path)
    chain = load_chain(files.declared) if files.declared else None
    train, test = ([read_csv(path) for path in paths] for paths in (files.train, files.test))
    report = diagnose(train, test, chain, workers=IN_THIS_PROCESS)
    assert [effect.name for effect in report.effects] == names
    assert report.base == {"model": link.kind, "density": density}
    assert not report.remains.present
    assert report.after.score < 1.1 * report.noise
    report.save_data(tmp_path)
    assert link in [type(each) for each in load_chain(tmp_path / "model.yaml").links]


@pytest.mark.parametrize(
    ("left", "has_past", "since", "beyond", "is_taken"),
    [
        (10.0, False, 0, 1.05, True),
        (10.0, False, 0, 3.0, True),  # something is left there, too, but far less
        (10.0, False, 0, 4.2, False),  # most of it may be an effect
        (1.04, False, 0, 1.0, False),  # nothing to mend
        (10.0, True, 0, 1.0, False),  # pasts of runs that begin driven are sought elsewhere
        (10.0, False, 80, 1.0, False),  # it is counted so already
    ],
)
def test_a_first_way_up_that_no_fitted_run_shows_does_not_count(
    monkeypatch: pytest.MonkeyPatch, left: float, has_past: bool, since: int, beyond: float, is_taken: bool
) -> None:
    """An examiner's plays, nothing hidden: fitted runs were cycled before, others not, of which relays left 10 x."""
    runs = [SimpleNamespace(since=since), SimpleNamespace(since=0)]
    relays: Any = SimpleNamespace(
        ratios=[1.05, left], excess=left**2 - 1.0, staged=StagedLike(runs, has_past), vector=None, effects=()
    )
    there = SimpleNamespace(ratios=[1.0, beyond], excess=beyond**2 - 1.0, staged=StagedLike(runs, has_past))
    counted: list[Any] = []
    monkeypatch.setattr(reach_of_pasts, "counted_where_no_past_reaches", lambda run: counted.append(run) or run)
    monkeypatch.setattr(reach_of_pasts, "seen_through", lambda chain, runs: runs)
    monkeypatch.setattr(reach_of_pasts, "fitted", lambda staged, *_, most_steps: staged)
    monkeypatch.setattr(reach_of_pasts, "fit_rate_independent", lambda *_: there)
    found = reach_of_pasts.told_beyond_pasts(relays, Thresholds(), print, IN_THIS_PROCESS)
    assert found is (there if is_taken else relays)
    assert counted in ([], runs)


@dataclasses.dataclass
class StagedLike:
    runs: list[Any]
    has_past: bool
    chain: Any = None
    ceramic: Any = None
