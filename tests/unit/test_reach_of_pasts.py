"""Runs of a stage that was left within minor loops: what no past reaches tells the model, and short pasts the rest."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pzt_ros.diagnosis import reach_of_pasts
from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.data import SCORE, SELECTION, split
from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.from_rest import as_poled
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact
from pzt_ros.diagnosis.reach_of_pasts import counted_where_no_past_reaches, where_no_past_reaches, with_short_pasts
from pzt_ros.diagnosis.undeclared import default_chain
from pzt_ros.effects.slow_relaxation import SlowRelaxation
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.records import Record

NOISE, RATE, REVERSALS = 12e-9, 500.0, 6
STAGE = Chain(
    "stage",
    (
        Lattice(
            coercive_field=3.6e5,
            coercive_field_spread=3.4e10,
            interaction_field_spread=3.2e11,
            relaxation_time=8e-3,
            domain_polarization=0.25,
            reciprocal_permittivity=6e7,
        ),
        Electrostriction(coefficient=0.023, active_length=8e-3),
    ),
)
CREEPS = Chain("creeps", (*STAGE.links, SlowRelaxation(share=0.05, shortest_time=0.1, longest_time=1.0)))


def record(seed: int, stage: Chain = STAGE, reversals: int = REVERSALS) -> Record:
    """Ramps between corners and back to 0 V, both ends reached at a third, after reversals that are not recorded."""
    rng = np.random.default_rng(seed)
    nested = rng.uniform(0.7, 1.0, reversals) * np.geomspace(110.0, 10.0, REVERSALS)[:reversals]
    before = [0.0, *nested * np.where(np.arange(reversals) % 2, -0.3, 1.0), 0.0, 0.0]
    corners = [*before, 50.0, 10.0, 120.0, -20.0, *rng.uniform(-15.0, 115.0, 12), 0.0]
    times = np.concatenate(([0.0], np.cumsum(rng.uniform(0.3, 0.9, len(corners) - 1))))
    time = np.arange(0.0, times[-1], 1.0 / RATE)
    voltage = np.interp(time, times, corners)
    out = stage.step(stage.init(Rest()), Signals(time=time, voltage=voltage))[1]
    begin = times[len(before) - 1]
    shown = time >= begin
    read = out.displacement[shown] + NOISE * rng.standard_normal(int(shown.sum()))
    return Record(f"run-{seed}", {"time_s": time[shown] - begin, "voltage_V": voltage[shown], "displacement_m": read})


def runs_of(stage: Chain, reversals: int = REVERSALS) -> tuple[Record, ...]:
    return tuple(record(seed, stage, reversals) for seed in (1, 2, 3))


def fitted_to(runs: tuple[Record, ...]) -> tuple[Hypothesis, Hypothesis]:
    """As poled or virgin, and where no past reaches if that is better."""
    divided = with_floors(runs)
    virgin = begun(default_chain(divided), split(divided[:2], divided[2:]))
    found = as_poled(virgin, is_declared=False)
    return found, where_no_past_reaches(virgin, found, IN_THIS_PROCESS)


def test_samples_that_no_past_reaches_are_described_to_the_noise() -> None:
    found, other = fitted_to(runs_of(STAGE))
    assert max(found.ratios) > 1.5  # 1.65 or more than 3, by machine: two wrong pasts are nearly as good
    assert all(0 < run.since < 0.6 * len(run.record) for run in other.staged.runs)
    assert max(exact(other).ratios) < 1.05


def test_short_pasts_of_the_other_samples_count_for_nothing() -> None:
    _, other = fitted_to(runs_of(STAGE))
    beside = with_short_pasts(other)
    starts = [beside.staged.ceramic.start_of(beside.vector, number) for number in range(3)]
    assert all(start.prior_voltages for start in starts)
    assert [run.since for run in beside.staged.runs] == [run.since for run in other.staged.runs]
    assert beside.total == pytest.approx(other.total, rel=0.02)


def test_a_stage_that_was_never_driven_counts_from_the_first_sample() -> None:
    found, other = fitted_to(runs_of(STAGE, reversals=0))
    assert other is found
    assert max(found.ratios) < 1.1


def test_what_no_past_does_at_the_beginning_of_runs_counts() -> None:
    """A reading that tips over there would be explained away by leaving it out."""
    runs = []
    for each in runs_of(STAGE, reversals=0):
        tipped = each.displacement + 3e-7 * np.sin(40.0 * each.time) * (each.time < 1.0)
        runs.append(Record(each.name, {**each.columns, "displacement_m": tipped}))
    found, other = fitted_to(tuple(runs))
    assert other is found
    assert max(found.ratios) > 2.0


def test_a_run_is_cut_only_where_enough_is_left() -> None:
    late = record(1)
    rising = {**late.columns, "voltage_V": np.linspace(0.0, 100.0, len(late))}
    early, whole = split(with_floors((late, Record("rises", rising))), [])
    assert 0 < counted_where_no_past_reaches(early).since < 0.6 * len(late)
    assert counted_where_no_past_reaches(whole) is whole


def test_an_uncut_run_has_all_its_samples_again() -> None:
    divided = with_floors((record(1), record(2)))
    for run in split(divided[:1], divided[1:]):
        cut = run.counted_from(400)
        again = cut.uncut
        assert not np.any(cut.clear[:400])
        assert {part: list(picks) for part, picks in again.picks.items()} == {
            part: list(picks) for part, picks in run.picks.items()
        }
        assert (SCORE in run.picks) == (SELECTION in run.picks)


@pytest.mark.long
def test_an_effect_is_named_beside_a_past_of_many_reversals() -> None:
    """Of such stages with a creep, a lag or a curve three of five were "something is missing", after minutes."""
    runs = runs_of(CREEPS)
    report = diagnose(runs[:2], runs[2:], workers=IN_THIS_PROCESS)
    assert [effect.name for effect in report.effects] == ["slow_relaxation"]
    assert not report.remains.present
    assert report.after.train < 1.1 * NOISE
    assert report.after.score < 1.3 * NOISE
    assert report.before.score > 1.5 * report.after.score
    assert any("how the stage was driven before" in remark for remark in report.remarks)


def test_no_short_past_stays_that_spoils_what_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """An examiner's plays: relays that were up before lost a run from 1.2 to 24 x the noise by one."""
    runs = [SimpleNamespace(since=80, uncut=None), SimpleNamespace(since=80, uncut=None)]

    @dataclasses.dataclass
    class StagedLike:
        runs: list[Any]
        ceramic: Any = None

    ceramic = SimpleNamespace(start_of=lambda vector, number: f"none of {number}")
    found: Any = SimpleNamespace(staged=StagedLike(runs, ceramic), vector=None, effects=(), ratios=[1.2, 1.0])
    spoilt: Any = SimpleNamespace(staged=StagedLike(runs, ceramic), vector=None, effects=(), ratios=[24.0, 1.0])
    monkeypatch.setattr(reach_of_pasts, "fitted", lambda *_, most_steps: spoilt)
    monkeypatch.setattr(reach_of_pasts, "with_other_pasts", lambda whole, workers: whole)
    monkeypatch.setattr(reach_of_pasts, "refitted_from", lambda back, pasts, steps: (back, pasts, steps))
    assert with_short_pasts(found) == (spoilt, {0: "none of 0"}, 0)
    spoilt.ratios[0] = 1.2
    assert with_short_pasts(found) is spoilt
