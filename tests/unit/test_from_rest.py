"""Runs that begin at rest on a stage that had been poled and left, as most benches record them."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.bouc_wen_base import fit_bouc_wen
from pzt_ros.diagnosis.data import seen_through, split
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.from_rest import as_poled
from pzt_ros.diagnosis.histories import _sought_beside, refitted_from
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.outcome import model_of
from pzt_ros.diagnosis.reach_of_pasts import counted_where_no_past_reaches
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.undeclared import default_chain
from pzt_ros.diagnosis.whole_runs import whole_beside
from pzt_ros.effects.slow_relaxation import SlowRelaxation
from pzt_ros.physics.bouc_wen import BoucWen
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.records import Record
from pzt_ros.sysid.predict import predict
from pzt_ros.sysid.run import Start
from pzt_ros.sysid.start_notes import past_as_data, past_from_data

NOISE, RATE = 12e-9, 500.0
STAGE = Chain(
    "stage",
    (
        Lattice(
            coercive_field=7e5,
            coercive_field_spread=2e11,
            interaction_field_spread=2.5e11,
            relaxation_time=1.5e-2,
            domain_polarization=0.21,
            reciprocal_permittivity=1.5e7,
        ),
        Electrostriction(coefficient=0.04, active_length=8e-3),
    ),
)
POLED, WAIT = 150.0, 4.0


CREEPS = Chain("creeps", (*STAGE.links, SlowRelaxation(share=0.1, shortest_time=0.1, longest_time=10.0)))
SLIPS = Chain("slips", (BoucWen(), StrainLaw(linear=5e-5)))


def record(seed: int, poled: bool, stage: Chain = STAGE, wait: float = WAIT, rests: float = 0.0) -> Record:
    """Ramps between corners and back to 0 V, from rest at 0 V, where the stage had been poled or never been driven."""
    rng = np.random.default_rng(seed)
    before = [(0.0, 0.0), (1.0, POLED), (2.0, 0.0), (2.0 + wait, 0.0)] if poled else [(0.0, 0.0)]
    corners = [*before, *([(before[-1][0] + rests, 0.0)] if rests else [])]
    for volts in [0.0, 140.0, *rng.uniform(10.0, 140.0, 7), 0.0]:
        corners.append((corners[-1][0] + rng.uniform(0.3, 0.9), float(volts)))
    time = np.arange(0.0, corners[-1][0], 1.0 / RATE)
    voltage = np.interp(time, *np.array(corners).T)
    out = stage.step(stage.init(Rest()), Signals(time=time, voltage=voltage))[1]
    shown = time >= before[-1][0]
    read = out.displacement[shown] + NOISE * rng.standard_normal(int(shown.sum())) + rng.uniform(-1e-6, 1e-6)
    columns = {"time_s": time[shown] - before[-1][0], "voltage_V": voltage[shown], "displacement_m": read}
    return Record(f"run-{seed}", columns)


@cache
def fitted_to(poled: bool) -> Hypothesis:
    runs = with_floors([record(seed, poled) for seed in (1, 2, 3)])
    return as_poled(begun(default_chain(runs), split(runs[:2], runs[2:])))


def starts_of(found: Hypothesis) -> list[Start]:
    return [found.staged.ceramic.start_of(found.vector, number) for number in range(len(found.staged.runs))]


def test_a_stage_that_had_been_poled_is_fitted_as_one() -> None:
    found = fitted_to(poled=True)
    assert max(found.ratios) < 1.1
    assert all(start.prior_voltages[0] == pytest.approx(POLED, rel=0.15) for start in starts_of(found))


def test_a_stage_that_was_never_driven_stays_one() -> None:
    found = fitted_to(poled=False)
    assert max(found.ratios) < 1.1
    assert {start.prior_voltages for start in starts_of(found)} == {()}


@pytest.mark.parametrize("number", [1, 2])
def test_a_past_that_was_taken_for_none_is_sought_where_all_else_describes_the_other_runs(number: int) -> None:
    """Beside a current limit an examiner's run was at 11 x the noise, its past sought before the limit was there."""
    found = fitted_to(poled=True)
    taken = refitted_from(found, {number: Start()}, 0)
    again = _sought_beside(taken)
    assert taken.ratios[number] > 100.0
    assert again is not None
    assert max(again.ratios) < 1.05
    assert starts_of(again)[number].prior_voltages[0] == pytest.approx(POLED, rel=0.15)


def test_no_past_is_sought_where_no_run_is_described_or_none_had_one() -> None:
    found = fitted_to(poled=True)
    assert _sought_beside(found) is None
    assert _sought_beside(refitted_from(found, dict.fromkeys(range(3), Start()), 0)) is None
    far_off = fitted(found.staged, found.vector + 0.05, most_steps=0)
    assert min(far_off.ratios) > 1.2
    assert _sought_beside(far_off) is None


def cut(found: Hypothesis, effects: tuple[str, ...]) -> Hypothesis:
    """The same where no past reaches, as one that an effect was found on."""
    runs = [counted_where_no_past_reaches(run) for run in found.staged.runs]
    assert all(run.since for run in runs)
    beyond = dataclasses.replace(found.staged, runs=seen_through(found.staged.chain, runs))
    return fitted(beyond, found.vector, effects, most_steps=0)


@pytest.mark.parametrize("poled", [False, True])
def test_an_effect_that_was_taken_for_pasts_is_asked_of_whole_runs(poled: bool) -> None:
    """A court case: a curve was told from samples that no past reaches, and left 2 x of a run that was not fitted."""
    found = whole_beside(cut(fitted_to(poled=poled), ("sensor_nonlinearity",)))
    assert found is not None
    assert not any(run.since or run.poled for run in found.staged.runs)
    assert {start.prior_voltages for start in starts_of(found)} == {()}
    assert (max(found.ratios) < Thresholds().near_floor) is not poled


def test_whole_runs_are_asked_where_samples_were_left_out_beside_an_effect() -> None:
    found = fitted_to(poled=False)
    assert whole_beside(dataclasses.replace(found, effects=("sensor_nonlinearity",))) is None
    assert whole_beside(cut(found, ())) is None


def test_a_run_that_no_fit_saw_begins_as_the_fitted_ones() -> None:
    """As a virgin ceramic would it leaves many times the noise."""
    model = model_of(fitted_to(poled=True), "model", "")
    assert model.notes["start"]["other"]["approach_s"] > 0.0
    prediction = predict(model, record(4, poled=True))
    assert prediction.rms < 1.15 * NOISE
    assert prediction.start.prior_voltages


def test_a_run_that_waited_otherwise_tells_so_by_its_first_half() -> None:
    """Its first second is a rest, in which stages creep alike however long ago they were left: an offset from there
    alone was wrong all along the run, 3.6 x the noise of an examiner's null.
    """
    past = {"prior_voltage_V": [POLED], "leg_s": 1.0, "approach_s": 1.0 + WAIT}
    known = dataclasses.replace(STAGE, notes={"start": {"other": past}})
    prediction = predict(known, record(5, True, wait=0.1 * WAIT, rests=1.5))
    assert prediction.told > 0
    assert prediction.rms < 1.05 * NOISE
    assert prediction.start.approach == pytest.approx(1.0 + 0.1 * WAIT, rel=0.1)


def test_elements_that_slip_begin_where_a_poled_stage_left_them() -> None:
    """From rest they left 1.24 x the noise, and a constant bias field that does nothing but displace them was named."""
    runs = with_floors([record(seed, True, SLIPS) for seed in (1, 2, 3)])
    polycrystal = begun(default_chain(runs), split(runs[:2], runs[2:]))
    found = fit_bouc_wen(polycrystal, lambda text: None)
    assert max(found.ratios) < 1.05
    assert all(start.prior_voltages and start.approach is None for start in starts_of(found))


def test_what_relaxes_is_told_by_the_first_half_of_a_run_on_a_poled_stage() -> None:
    """A structure that was driven before still creeps back: an offset alone leaves tens of times the noise."""
    past = {"prior_voltage_V": [POLED], "leg_s": 1.0, "approach_s": 1.0 + WAIT}
    known = dataclasses.replace(CREEPS, notes={"start": {"other": past}})
    found = predict(known, record(4, True, CREEPS))
    assert "driven before" in found.rule
    assert found.told > 0
    assert found.rms < 1.1 * NOISE
    never = predict(CREEPS, record(4, False, CREEPS))
    assert never.told == 0
    assert never.rms < 1.1 * NOISE


@pytest.mark.parametrize("past", [Start(), Start((150.0,)), Start((150.0, -20.0), 0.8, approach=12.5)])
def test_a_past_is_written_down_and_read_again(past: Start) -> None:
    assert past_from_data(past_as_data(past), 1.0) == past


def test_a_past_without_a_duration_is_refused() -> None:
    with pytest.raises(ValueError, match="no duration"):
        past_from_data({"prior_voltage_V": [150.0], "leg_s": 1.0, "approach_s": -1.0}, 1.0)
