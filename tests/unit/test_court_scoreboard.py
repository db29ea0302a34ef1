"""The court's counting: what a report is worth beside the truth, and the tables made of it."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from pzt_benchmarks.residual_court import outcome as said
from pzt_benchmarks.residual_court.cases import KINDS, Spec
from pzt_benchmarks.residual_court.court import chosen, read_results
from pzt_benchmarks.residual_court.outcome import Covered, Outcome, verdict
from pzt_benchmarks.residual_court.scoreboard import Share, markdown, targets
from pzt_benchmarks.residual_court.trial import NEXT_DRIVE, Trial, proposed
from pzt_ros.chains import load_chain, save_chain
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain

LAG, CREEP, DRIFT = "sensor_lag", "slow_relaxation", "thermal_drift"


@pytest.mark.parametrize(
    ("hidden", "named", "groups", "unexplained", "expected"),
    [
        ((), (), (), False, said.SILENT),
        ((), (LAG,), (), False, said.WRONG),
        ((), (), ((LAG, CREEP),), False, said.OTHER_PAIR),
        ((LAG,), (LAG,), (), False, said.RIGHT),
        ((LAG,), (LAG,), (), True, said.RIGHT),
        ((LAG,), (LAG, CREEP), (), False, said.WRONG),
        ((LAG,), (), ((LAG, CREEP),), False, said.PAIR),
        ((LAG,), (LAG,), ((DRIFT, CREEP),), False, said.OTHER_PAIR),
        ((LAG,), (), (), True, said.UNEXPLAINED),
        ((LAG, CREEP), (LAG,), (), True, said.PARTLY),
        ((LAG, CREEP), (CREEP, LAG), (), False, said.RIGHT),
        (("tone",), (), (), True, said.UNEXPLAINED),
        (("tone",), ("mains_hum",), (), True, said.WRONG),
    ],
)
def test_verdict(hidden, named, groups, unexplained, expected):
    assert verdict(hidden, named, groups, unexplained) == expected


def test_interval_of_a_share_is_the_one_in_the_books():
    low, high = Share(0, 96).interval  # Wilson: z^2/(n + z^2)
    assert low == 0.0
    assert high == pytest.approx(1.96**2 / (96 + 1.96**2), rel=1e-3)


def _outcome(kind, number, **values):
    effects = values.pop("effects", ())
    return Outcome(f"{kind}-{number}", kind, "gaussian", "standard", effects, values.pop("size", 0.0), **values)


def test_targets_count_what_they_say():
    outcomes = [_outcome("null_right", k, after=(1.0,)) for k in range(99)]
    outcomes.append(_outcome("null_right", 99, named=(LAG,)))
    good = Covered(LAG, "lag", 1e-3, 1.1e-3, 1e-4)
    bad = Covered(LAG, "lag", 1e-3, 1.5e-3, 1e-4)
    lag = {"effects": (LAG,), "size": 3.0, "reached": (3.0,)}
    outcomes.append(_outcome("effect_right", 0, named=(LAG,), after=(1.05,), parameters=(good,), **lag))
    outcomes.append(_outcome("effect_right", 1, named=(LAG,), after=(1.2,), parameters=(bad,), **lag))
    outcomes.append(_outcome("effect_right", 2, groups=((LAG, CREEP),), **lag))
    outcomes.append(_outcome("effect_right", 3, **{**lag, "reached": (0.4,)}))
    found = {target.what: target for target in targets(outcomes)}
    assert (found["false alarms, structure right"].found, found["false alarms, structure right"].met) == (
        Share(1, 100),
        "yes",
    )
    assert found["the same, 3x"].found == Share(2, 3)
    assert found["the same, 3x"].met == "**no**"
    assert found["score error <= 1.10 x noise where identified"].found == Share(1, 2)
    assert found["95 % intervals that hold the true parameter"].found == Share(1, 2)
    assert found["right effect alone, structure right, 1x"].met == "-"
    page = markdown(outcomes, "# The page")
    assert "1/100 = 1.0 % (0.2 to 5.4)" in page
    assert "1 of 104 cases left out" in page


def test_outcomes_come_back_from_json(tmp_path):
    one = _outcome("pair", 1, effects=(LAG, CREEP), groups=((LAG, CREEP),), parameters=(Covered(LAG, "lag", 1, 2, 3),))
    path = tmp_path / "results.jsonl"
    path.write_text(json.dumps(one.as_data()) + "\n" + '{"name": "cut o', encoding="utf-8")
    assert read_results(path) == [one]


def test_sample_draws_that_many_of_each_table():
    found = chosen(list(KINDS), 3, 4)
    assert {kind: sum(spec.kind == kind for spec in found) for kind in KINDS} == dict.fromkeys(KINDS, 4)
    assert found == chosen(list(KINDS), 3, 4)


def names_hum(files, out):
    """A diagnosis that always says the same and predicts with the declared chain."""
    out.mkdir()
    parameters = {"frequency": {"value": 50.0, "std": 10.0, "unit": "Hz"}}
    report = {
        "effects": [{"name": "mains_hum", "parameters": parameters}],
        "not_identifiable": [],
        "unexplained": {"present": False},
    }
    (out / "report.json").write_text(json.dumps(report), encoding="utf-8")
    lattice, strain = load_chain(files.declared).links
    coarse = dataclasses.replace(lattice, spacing=2.0, accuracy=1e-2)  # predicting is not what is tested
    for name in ("baseline.yaml", "model.yaml"):
        save_chain(Chain("declared", (coarse, strain)), out / name)


def names_nothing_twice(files, out):
    """A pair at first; with one more run the name."""
    names_hum(files, out)
    if len(files.train) == 1:
        report = json.loads((out / "report.json").read_text(encoding="utf-8"))
        report |= {"effects": [], "not_identifiable": [["mains_hum", LAG]]}
        (out / "report.json").write_text(json.dumps(report), encoding="utf-8")
        (out / NEXT_DRIVE).write_text("time_s,voltage_V\n0,0\n1,100\n2,20\n", encoding="utf-8")


def gives_up(files, out):
    """No report at all."""
    raise BenchError("nothing to see")


HUM = Spec("effect_right", "gaussian", ("mains_hum",), 3.0, "short", seed=12)


def test_trial_holds_the_report_against_the_truth(tmp_path):
    found = Trial(tmp_path, names_hum)(HUM)
    assert found.verdict == said.RIGHT
    assert found.reached == (pytest.approx(3.0, rel=0.05),)
    assert found.before == found.after
    assert found.after[0] > 5  # the declared chain is 10 to 50 % off
    assert found.seconds >= 0.0
    assert not list(tmp_path.rglob("*.csv"))
    assert Trial(tmp_path, names_hum)(dataclasses.replace(HUM, effects=(LAG,))).verdict == said.WRONG


def test_trial_makes_the_proposed_experiment(tmp_path):
    found = Trial(tmp_path, names_nothing_twice)(dataclasses.replace(HUM, kind="confounded"))
    assert (found.verdict, found.separated) == (said.PAIR, True)


def test_trial_without_a_report_is_an_outcome(tmp_path):
    found = Trial(tmp_path, gives_up)(HUM)
    assert (found.verdict, found.failure) == (said.FAILED, "BenchError: nothing to see")


def test_proposed_drive_beyond_the_bench_is_refused(tmp_path):
    path = tmp_path / NEXT_DRIVE
    path.write_text("time_s,voltage_V\n0,0\n1,400\n", encoding="utf-8")
    with pytest.raises(BenchError, match="150 V"):
        proposed(path)
    path.write_text("time_s,voltage_V\n0,0\n1,100\n", encoding="utf-8")
    drive = proposed(path)
    assert drive.step == pytest.approx(1e-3)
    np.testing.assert_allclose(drive.command, 100 * drive.time)
