"""Diagnosis: Jacobians against differences, the right effect by name, nothing where nothing is, claims predicted.

All runs are simulated. The plant's parameters are off the declared ones; its effect is added behind the chain by
formulas of this file's own, not by the library's links.
"""

from __future__ import annotations

import copy
import dataclasses
import importlib
import itertools
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy import interpolate, optimize, signal

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis import Report, diagnose, elimination, final_fit
from pzt_ros.diagnosis import search as search_of_effects
from pzt_ros.diagnosis.base import begun, fit_declared
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.branches import _trusted, chosen_of
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.coordinates import coordinate, of_effect
from pzt_ros.diagnosis.data import FIT, SCORE, SELECTION, RunData, slow_curves, split
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.elimination import (
    bias_in_question,
    groups_in_question,
    hysteresis_in_question,
    is_law_as_good,
    law_in_question,
    needed_only,
)
from pzt_ros.diagnosis.final_fit import fitted_to_all, identified_beside_effects
from pzt_ros.diagnosis.flexible_lattice import FlexibleHysteresis
from pzt_ros.diagnosis.floor import displacement_floors, with_floors
from pzt_ros.diagnosis.found import found_effects, tried_candidates
from pzt_ros.diagnosis.hypothesis import Hypothesis, Misfit, fitted
from pzt_ros.diagnosis.identifiability import Alike, stood_in_for
from pzt_ros.diagnosis.identified_densities import _on_all_seen
from pzt_ros.diagnosis.informed import informed
from pzt_ros.diagnosis.judge import Judge
from pzt_ros.diagnosis.less_effects import less_effects
from pzt_ros.diagnosis.page import write_page
from pzt_ros.diagnosis.parts import parts_of
from pzt_ros.diagnosis.reached import reached_of
from pzt_ros.diagnosis.refinement import detailed, off_bounds, refits
from pzt_ros.diagnosis.remains import remains_of
from pzt_ros.diagnosis.screen import Prospect, Screen, _at_bound, _bounded
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.staged import Staged
from pzt_ros.diagnosis.strain_laws import with_free_law
from pzt_ros.diagnosis.time_limit import TimeLimit
from pzt_ros.diagnosis.wandering import _spacing
from pzt_ros.diagnosis.wandering import wandering as wandering_of
from pzt_ros.effects.bias_field import BiasField
from pzt_ros.effects.insert import effects_in, with_effect
from pzt_ros.effects.sensor_lag import SensorLag
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.effects.slow_relaxation import SlowRelaxation
from pzt_ros.effects.table import EFFECT_OF, EFFECTS
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.records import Record
from pzt_ros.sysid.predict import predict

NOISE = 8e-9
RATE = 500.0
ERRORS = {"coercive": 1.0, "shape_ascending": 1.05, "barrier_ascending": 0.96, "relaxation_time": 1.2}


def declared() -> Chain:
    """Thesis set P2 and electrostriction, some parameters free."""
    chain = load_chain("thesis-p2")
    free = ["shape_ascending", "barrier_ascending", "barrier_descending", "relaxation_time"]
    names = [f"parametrized.{name}" for name in free] + ["electrostriction.coefficient"]
    return dataclasses.replace(chain, notes={"free": names})


def plant() -> Chain:
    """What is really there."""

    def changed(link):  # type: ignore[no-untyped-def]
        values = {name: factor * getattr(link, name) for name, factor in ERRORS.items() if hasattr(link, name)}
        return dataclasses.replace(link, **values)

    return declared().with_links(changed)


def drive(seed: int) -> tuple[Array, Array]:
    """Poling, then reversals at random with holds, then sines at 2 and 9 Hz [s, V]."""
    rng = np.random.default_rng(seed)
    points = [(0.0, 0.0), (0.5, 140.0), (0.8, 140.0), (1.3, 10.0)]
    for _ in range(4):
        at = points[-1][0]
        points += [(at + 0.35, rng.uniform(70, 140)), (at + 0.6, points[-1][1])]
        points[-1] = (points[-1][0], points[-2][1])
        points += [(at + 0.95, rng.uniform(-10, 40))]
        points += [(at + 1.2, points[-1][1])]
    times, volts = np.array(points).T
    legs = np.arange(0.0, times[-1], 1.0 / RATE)
    parts = [np.interp(legs, times, volts)]
    for frequency in (2.0, 9.0):
        phase = 2.0 * np.pi * frequency * np.arange(0.0, 1.0, 1.0 / RATE)
        parts.append(parts[-1][-1] + rng.uniform(30, 45) * (1.0 - np.cos(phase)))
    voltage = np.concatenate(parts)
    return np.arange(voltage.size) / RATE, voltage


def run(seed: int, effect: str = "none", noise: float = NOISE) -> Record:
    """A simulated run of the plant with an effect, its sensor's zero anywhere."""
    rng = np.random.default_rng(100 + seed)
    time, voltage = drive(seed)
    chain = plant()
    _, out = chain.step(chain.init(Rest(time=0.0)), Signals(time=time, voltage=voltage))
    y = reading(effect, time, out.displacement, seed)
    y = y + noise * rng.standard_normal(time.size) + rng.uniform(-1e-6, 1e-6)
    return Record(f"run-{seed}", {"time_s": time, "voltage_V": voltage, "displacement_m": y})


def one_loop(seed: int, effect: str = "none") -> Record:
    """As `run`, but cycles of one sine all along."""
    time = np.arange(0.0, 6.0, 1.0 / RATE)
    voltage = 50.0 * (1.0 - np.cos(2.0 * np.pi * 2.0 * time))
    chain = plant()
    _, out = chain.step(chain.init(Rest()), Signals(time=time, voltage=voltage))
    noise = NOISE * np.random.default_rng(100 + seed).standard_normal(time.size)
    y = reading(effect, time, out.displacement, seed) + noise
    return Record(f"loop-{seed}", {"time_s": time, "voltage_V": voltage, "displacement_m": y})


def reading(effect: str, time: Array, y: Array, seed: int) -> Array:
    """The effects, one or `one+another`, by other means than the library's."""
    if "+" in effect:
        first, second = effect.split("+")
        return reading(second, time, reading(first, time, y, seed), seed)
    if effect == "slow_relaxation":  # Kelvin and Voigt: a spring and a damper in series, by Euler's method, finely
        element = np.zeros_like(y)
        for k in range(1, y.size):
            element[k] = element[k - 1] + (time[k] - time[k - 1]) / 0.4 * (y[k - 1] - y[0] - element[k - 1])
        return y + 0.03 * element
    if effect == "two_elements":
        lags = [signal.lsim(([1.0], [tau, 1.0]), y - y[0], time)[1] for tau in (0.08, 1.6)]
        return y + 0.05 * (lags[0] + lags[1])
    if effect == "sensor_lag":
        return np.interp(time - 3e-3, time, y)
    if effect == "mains_hum":
        return y + 25e-9 * np.sin(2.0 * np.pi * 50.0 * time + seed)
    if effect == "cubic_strain_law":  # y goes with P^2, and P stays positive once poled
        return y + 0.03 * np.sign(y) * np.abs(y) ** 1.5 / np.sqrt(np.max(y))
    if effect == "charge_limit":  # y goes with P^2; P follows at 5 times its highest value in a second at most
        limited = np.sqrt(y - y.min())
        most = 5.0 * float(np.max(limited)) / RATE
        for k in range(1, limited.size):
            limited[k] = limited[k - 1] + min(max(limited[k] - limited[k - 1], -most), most)
        return np.square(limited) + y.min()
    if effect == "waving_sensor":
        return y + 60e-9 * np.sin(2.0 * np.pi * y / np.max(y))
    if effect == "wandering":  # of the room: another course in every run
        course = interpolate.CubicSpline(np.arange(0.0, 20.0, 5.0), np.random.default_rng(seed).normal(size=4))
        return y + 80e-9 * (course(time) - course(0.0))
    if effect == "slow_wave":  # not in the library, and too fast for a drift
        return y + 40e-9 * np.sin(2.0 * np.pi * time / 1.7 + seed)
    if effect == "backlash":  # not in the library
        return np.array(_backlash(y, 120e-9))
    return y


def _backlash(y: Array, width: float) -> list[float]:
    state, out = float(y[0]), []
    for value in y:
        state = max(value - width, min(value + width, state))
        out.append(state)
    return out


@pytest.fixture(scope="module")
def null() -> Report:
    return diagnose([run(1), run(2)], [run(3)], declared())


def test_silence_of_runs_that_show_one_loop_names_what_it_may_hide(null: Report) -> None:
    """Twice in the court: a lag and a bandwidth of 1.5 x, which the hysteresis had taken up, and nothing was said."""
    report = diagnose([one_loop(1)], [one_loop(2)], declared())
    assert (report.effects, report.remains.present) == ((), False)
    (group,) = report.not_identifiable
    assert group[0] == "hysteresis_density"
    assert {"sensor_lag", "amplifier_bandwidth", "slow_relaxation"} <= set(group)
    assert report.verdict.startswith("Nothing is missing that these runs show")
    assert "Not identifiable from this data, which could hide there: hysteresis density or" in report.verdict
    assert report.next_drive is not None
    assert not report.repaired
    assert "could hide" not in null.verdict


@pytest.fixture(scope="module")
def creeping() -> Report:
    train = [run(1, "slow_relaxation"), run(2, "slow_relaxation")]
    return diagnose(train, [run(3, "slow_relaxation")], declared(), profile=True)


def test_intervals_are_those_of_the_last_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """They were those of the fit before: that may have parameters which the model does not have any more."""
    reached = importlib.import_module("pzt_ros.diagnosis.reached")
    module = importlib.import_module("pzt_ros.diagnosis.diagnose")
    last_fit = reached.last_fit
    fits: list[Hypothesis] = []
    asked: list[Hypothesis] = []

    def fitted_for_the_last_time(*given: Any) -> Hypothesis:
        fits.append(dataclasses.replace(last_fit(*given)))
        return fits[-1]

    monkeypatch.setattr(reached, "last_fit", fitted_for_the_last_time)
    monkeypatch.setattr(module, "note_intervals", lambda report, final: asked.append(final))
    diagnose([run(1, "mains_hum")], [run(3, "mains_hum")], declared(), workers=IN_THIS_PROCESS, profile=True)
    assert len(asked) == 1
    assert asked[0] is fits[1]  # the first is without the effect
    assert asked[0].effects == ("mains_hum",)


def test_says_that_nothing_is_missing_where_nothing_is(null: Report) -> None:
    assert null.effects == ()
    assert null.not_identifiable == ()
    assert not null.remains.present
    assert null.verdict.startswith("Nothing is missing")
    assert null.after.test == pytest.approx(NOISE, rel=0.05)


def test_base_recovers_the_plants_parameters(null: Report) -> None:
    true = plant().links[0]
    found = null.model.notes["fit"]["parameters"]
    for name in ("shape_ascending", "barrier_ascending"):
        entry = found[f"parametrized.{name}"]
        assert entry["value"] == pytest.approx(getattr(true, name), abs=5.0 * entry["std"] + 1e-3 * abs(entry["value"]))


def test_names_creep_and_comes_down_to_the_noise(creeping: Report) -> None:
    assert [effect.name for effect in creeping.effects] == ["slow_relaxation"]
    assert creeping.before.score > 1.5 * NOISE
    assert creeping.after.score < 1.10 * NOISE
    (effect,) = creeping.effects
    assert effect.parameters["share"]["value"] == pytest.approx(0.03, rel=0.2)
    assert 0.5 < effect.probability <= 1.0


def test_intervals_asked_for_are_in_the_report_and_in_the_model(creeping: Report) -> None:
    (effect,) = creeping.effects
    share = effect.parameters["share"]
    lower, upper = share["interval_95"]
    assert lower < 0.03 < upper
    assert lower < share["value"] < upper
    assert upper - lower == pytest.approx(4.0 * share["std"], rel=0.5)
    assert creeping.model.notes["fit"]["parameters"]["slow_relaxation.share"]["interval_95"] == [lower, upper]
    assert "interval_95" not in creeping.model.notes["fit"]["parameters"]["parametrized.shape_ascending"]


def test_lag_is_answered_by_a_name_of_its_group() -> None:
    report = diagnose([run(1, "sensor_lag"), run(2, "sensor_lag")], [run(3, "sensor_lag")], declared())
    named = {effect.name for effect in report.effects} | {name for group in report.not_identifiable for name in group}
    assert "sensor_lag" in named
    assert named <= {"sensor_lag", "amplifier_bandwidth", "mechanical_resonance"}
    assert report.after.score < 1.15 * NOISE


def test_names_that_make_the_prediction_of_what_scores_worse_are_taken_back() -> None:
    """What was there in the fitted run and in the half that chooses is gone in the half that scores."""
    hums, quiet = run(3, "mains_hum"), run(3)
    half = len(hums) // 2
    changed = np.concatenate((hums.displacement[:half], quiet.displacement[half:]))
    report = diagnose(
        [run(1, "mains_hum")],
        [dataclasses.replace(hums, columns={**hums.columns, "displacement_m": changed})],
        declared(),
    )
    assert (report.effects, report.not_identifiable) == ((), ())
    assert report.after is report.before
    assert report.after.score < 1.1 * NOISE < report.before.train
    assert "makes its prediction of the rest worse" in report.remarks[0]
    assert report.model.links == report.baseline.links
    (hum,) = [each for each in report.tried if each.name == "mains_hum" and each.step == 1]
    assert not hum.accepted
    assert "but it makes the prediction of what scores worse" in hum.why
    assert report.remains.present


@pytest.fixture(scope="module")
def wandering() -> Report:
    return diagnose([run(seed, "wandering") for seed in (1, 2)], [run(3, "wandering")], declared())


@pytest.mark.long
def test_readings_that_wander_by_chance_are_a_drift(wandering: Report) -> None:
    assert [effect.name for effect in wandering.effects] == ["thermal_drift"]
    assert wandering.not_identifiable == ()
    assert not wandering.remains.present
    assert wandering.remains.times_noise == pytest.approx(1.0, abs=0.03)
    assert "goes by chance" in wandering.verdict
    assert wandering.after.score > 2.0 * NOISE  # no model foretells it
    assert wandering.model.notes["fit"]["parameters"].keys() == wandering.baseline.notes["fit"]["parameters"].keys()


@pytest.mark.long
def test_readings_that_wander_do_not_bend_the_model(wandering: Report, null: Report) -> None:
    quiet = run(9)
    bent, kept, best = (predict(chain, quiet).rms for chain in (wandering.baseline, wandering.model, null.model))
    assert kept < 1.02 * best
    assert bent > 1.04 * best


def test_a_straight_drift_in_the_end_may_wander() -> None:
    base = hypothesis("wandering")
    search = Search(effects=[EFFECT_OF["thermal_drift"]])
    (straight,), _ = search._candidates(base, base)
    assert max(straight.after.ratios) > 1.5
    (step,) = search.with_last_drift_wandering([Step(base, (straight,), {}, (straight,), (), "")], base)
    assert max(step.after.ratios) < 1.05
    assert step.after.effects == ("thermal_drift",)


def test_a_slow_wave_is_no_drift() -> None:
    asked = Thresholds()
    drift, wave = (wandering_of(hypothesis(effect), asked, asked.polishable) for effect in ("wandering", "slow_wave"))
    assert drift is not None
    assert max(drift.ratios) < 1.05
    assert wave is None


def test_what_wanders_is_taken_out_of_misfit_and_jacobian_alike() -> None:
    """Any cubic is as good as nothing; so is what a model's change has of one."""
    (plain,) = split([RunData(run(1), {}, NOISE)], [])
    wanders = dataclasses.replace(plain, wander=4.0)
    time, measured = plain.record.time, plain.record.displacement
    cubic, still = 1e-7 * (time - 2.0) ** 3, np.zeros_like(time)
    np.testing.assert_allclose(wanders.misfit(FIT, measured + cubic, still), 0.0, atol=1e-6)
    np.testing.assert_allclose(wanders.wandered(cubic), cubic, atol=1e-12)
    fast = 1e-6 * np.sin(20.0 * time)
    assert np.linalg.norm(wanders.misfit(FIT, measured + fast, still)) == pytest.approx(
        np.linalg.norm(plain.misfit(FIT, measured + fast, still)), rel=0.01
    )
    changes = wanders.change(FIT, np.column_stack((cubic, fast)).astype(np.float32), np.zeros((time.size, 2)))
    np.testing.assert_allclose(changes[:, 0], 0.0, atol=1e-2)
    np.testing.assert_allclose(changes[:, 1], wanders.misfit(FIT, measured + fast, still), atol=1e-3)


def test_a_reading_bends_no_sooner_than_its_drive() -> None:
    """What a slow drive leaves of its loops would be taken for a drift; of a short run a straight line may be one."""
    time = np.linspace(0.0, 600.0, 601)

    def course(period: float) -> Array:
        volts = 50.0 - 50.0 * np.cos(2.0 * np.pi * time / period)
        return np.column_stack((slow_curves(time, _spacing(RunData(driven(volts), {}, NOISE))), np.ones(time.size)))

    def driven(volts: Array) -> Record:
        return Record("slow", {"time_s": time, "voltage_V": volts, "displacement_m": 1e-7 * volts})

    assert course(120.0).shape[1] == 600 / 60 + 3
    assert course(400.0).shape[1] == 2  # three ways up and down
    loop = np.sin(4.0 * np.pi * time / 120.0)
    left = loop - course(120.0) @ np.linalg.lstsq(course(120.0), loop, rcond=None)[0]
    assert np.std(left) > 0.5 * np.std(loop)
    assert slow_curves(time, 1.0).shape[1] == 40 + 2


def with_lost_readings(record: Record) -> Record:
    """The run with five readings of an interface that had nothing to say."""
    shaken = record.displacement.copy()
    shaken[np.random.default_rng(len(record)).integers(100, len(record) - 100, 5)] = -20e-6
    return dataclasses.replace(record, columns={**record.columns, "displacement_m": shaken})


def test_hum_keeps_its_phase_to_each_run_and_is_found_beside_lost_readings(tmp_path: Path) -> None:
    runs = [with_lost_readings(run(seed, "mains_hum")) for seed in (1, 2, 3)]
    report = diagnose(runs[:2], runs[2:], declared())
    assert [effect.name for effect in report.effects] == ["mains_hum"]
    assert "Something unexplained remains: 15 readings stand alone and do not count" in report.verdict
    assert report.remains.times_noise == pytest.approx(1.0, abs=0.05)
    assert len(report.remarks) == 3
    assert [entry["sha256"] for entry in report.as_data()["runs"]] == [each.sha256 for each in runs]
    report.save(tmp_path)
    unseen = with_lost_readings(run(9, "mains_hum"))
    before, after = (predict(load_chain(tmp_path / f"{name}.yaml"), unseen).rms for name in ("baseline", "model"))
    assert before > 1.8 * NOISE
    assert after < 1.15 * NOISE


@pytest.mark.long
def test_an_effect_outside_the_library_is_not_named() -> None:
    report = diagnose([run(1, "backlash")], [run(3, "backlash")], declared())
    assert report.before.test > 2.0 * NOISE
    assert report.remains.present or report.after.test < 1.2 * NOISE
    assert "sensor_lag" not in {effect.name for effect in report.effects}


def test_predict_reproduces_what_the_report_claims(creeping: Report, tmp_path: Path) -> None:
    creeping.save(tmp_path)
    claimed = json.loads((tmp_path / "report.json").read_text())
    record = run(3, "slow_relaxation")
    for key, name in (("before", "baseline"), ("after", "model")):
        found = predict(load_chain(tmp_path / f"{name}.yaml"), record).rms
        assert found == pytest.approx(claimed[key]["test_rms_m"], rel=1e-9)
    assert set(claimed) >= {
        "schema", "train", "test", "noise_rms_m", "base", "before", "after", "effects", "candidates",
        "not_identifiable", "unexplained", "next_experiment",
    }  # fmt: skip
    assert (tmp_path / "report.html").stat().st_size > 50_000


def hypothesis(effect: str = "none") -> Hypothesis:
    """The declared model fitted to one run."""
    runs = split([RunData(run(1, effect), {}, NOISE)], [RunData(run(3, effect), {}, NOISE)])
    return fit_declared(declared(), runs, lambda text: None)


def test_parts_are_disjoint_and_cover_the_runs() -> None:
    runs = hypothesis().staged.runs
    assert list(runs[0].picks) == [FIT]
    chosen, scored = runs[1].picks[SELECTION], runs[1].picks[SCORE]
    assert not set(chosen) & set(scored)
    assert chosen.size + scored.size == len(runs[1].record)


@pytest.mark.parametrize("name", ["slow_relaxation", "amplifier_bandwidth", "strain_polarization_hysteresis"])
def test_jacobian_is_what_differences_of_the_residuals_are(name: str) -> None:
    base = hypothesis()
    effect = EFFECT_OF[name]
    link = effect.link(**{**effect.starts[1], effect.amplitude: 20.0 * effect.starts[1][effect.amplitude]})
    added = of_effect(effect, link, range(2))
    chain = with_effect(base.staged.chain, link)
    staged = dataclasses.replace(base.staged, chain=chain, coordinates=(*base.staged.coordinates, *added))
    vector = staged.start
    _, (jacobian,) = staged.linearise(vector)
    for k in range(vector.size):
        step = np.zeros(vector.size)
        step[k] = 2e-4
        (above,), (below,) = staged.residuals(vector + step), staged.residuals(vector - step)
        there = (above - below) / 4e-4
        assert np.linalg.norm(jacobian[:, k] - there) <= 0.02 * np.linalg.norm(there) + 1e-6


def test_a_search_ends_where_another_base_leaves_far_less() -> None:
    clean, bent = hypothesis(), hypothesis("backlash")
    search = Search()

    def ended(after: Hypothesis) -> list[Step]:
        return [Step(after, (), {}, (), (), "")]

    assert bent.fit.ratio > 1.5
    assert search.is_outdone(ended(bent), clean)
    assert not search.is_outdone(ended(bent), bent)
    assert not search.is_outdone(ended(clean), bent)


def test_a_name_that_the_drive_cannot_tell_from_another_is_a_tie() -> None:
    wandering = hypothesis()
    time = wandering.staged.runs[0].record.time
    up = Record("up", {"time_s": time, "voltage_V": np.minimum(50.0 * time, 100.0), "displacement_m": 0.0 * time})
    one_way = dataclasses.replace(wandering.staged, runs=[RunData(up, {}, NOISE)])
    for staged, tied in ((wandering.staged, ()), (one_way, ("thermal_drift", "bias_field", "slow_relaxation"))):
        before = dataclasses.replace(wandering, staged=staged)
        assert Search()._tied(Candidate("thermal_drift", before, before), []) == tied


@pytest.mark.parametrize(
    ("effect", "tied"), [("cubic_strain_law", ("sensor_nonlinearity", "strain_law")), ("waving_sensor", ())]
)
def test_a_curve_that_a_strain_law_explains_as_well_is_a_tie(effect: str, tied: tuple[str, ...]) -> None:
    """A court case: another strain law was named a curve of the sensor."""
    step = Search(effects=(EFFECT_OF["sensor_nonlinearity"],)).step(hypothesis(effect))
    assert [each.name for each in step.accepted] == ["sensor_nonlinearity"]
    assert step.tied == tied


@pytest.mark.parametrize(
    ("name", "fit_gain", "selection_gain", "selection_share", "is_significant"),
    [
        ("amplifier_charge_limit", 88.0, 5492.0, 0.84, True),  # the court case that this is for
        ("amplifier_charge_limit", 3.0, 5492.0, 0.84, False),  # the fitted runs say nothing of it
        ("amplifier_charge_limit", 88.0, 40.0, 0.84, False),  # the others say little
        ("amplifier_charge_limit", 88.0, 5492.0, 0.7, False),  # something else is there, too
        ("thermal_drift", 88.0, 5492.0, 0.84, False),  # its rates were found where they explain
    ],
)
def test_what_the_fitted_runs_hardly_show_may_be_told_by_what_it_explains_elsewhere(
    name: str, fit_gain: float, selection_gain: float, selection_share: float, is_significant: bool
) -> None:
    shown = SimpleNamespace(
        name=name, fit_gain=fit_gain, fit_size=0.08, selection_gain=selection_gain, selection_size=1.3,
        selection_share=selection_share,
    )  # fmt: skip
    assert Search().is_significant(cast(Candidate, shown)) == is_significant


def test_a_curve_that_takes_little_from_a_free_law_is_as_likely_one_of_its_powers() -> None:
    """A case of our own: a density alone left 1.3 x the noise, and a curve of six powers 1.03."""
    curved = hypothesis("waving_sensor")
    freed = with_free_law(curved)
    assert freed is not None
    assert with_free_law(freed) is None
    few, many = freed.total - 0.5, freed.total - 5.0
    near, far = (cast(Hypothesis, SimpleNamespace(total=total)) for total in (few, many))
    asked = Thresholds()
    assert not is_law_as_good(freed, near, asked)
    assert is_law_as_good(freed, near, asked.on_flexible())
    assert not is_law_as_good(freed, far, asked.on_flexible())


@pytest.mark.parametrize(("law_leaves", "is_as_good"), [(2.2, True), (3.0, False)])
def test_a_law_that_does_what_a_curve_does_may_end_a_power_below_the_true_one(
    monkeypatch: pytest.MonkeyPatch, law_leaves: float, is_as_good: bool
) -> None:
    """A court null of a law with a fourth power: of 14 x up to the third left 0.25 more, and a curve was named."""
    bare, law, curved = (cast(Hypothesis, SimpleNamespace(total=total)) for total in (14.0, law_leaves, 2.0))
    monkeypatch.setattr(elimination, "with_free_law", lambda found: law)
    monkeypatch.setattr(elimination, "taken_on", lambda found, asked: found)
    assert is_law_as_good(bare, curved, Thresholds()) is is_as_good


def test_a_curve_bends_about_the_middle_of_where_the_model_goes() -> None:
    """A court case: a density moved from -17 to -4 um, where the powers of it were too much alike to be told."""
    screen = Screen(hypothesis("waving_sensor"))
    prospect = screen.best(EFFECT_OF["sensor_nonlinearity"])
    assert prospect is not None
    reached = np.concatenate([displacement for displacement, _ in screen.outputs])
    link = cast(SensorNonlinearity, prospect.link)
    assert link.centre - link.range == pytest.approx(reached.min())
    assert link.centre + link.range == pytest.approx(reached.max())


def test_where_the_screen_ran_into_a_bound_a_refit_begins_from_before_it_too() -> None:
    """A court case: relaxation up to 300 s promised most and was stuck there, and a drift was named beside it."""
    screen, effect = Screen(hypothesis("slow_relaxation")), EFFECT_OF["slow_relaxation"]
    coarse = screen.best(effect)
    assert coarse is not None
    assert screen.refined(coarse).coarse is None
    added = of_effect(effect, coarse.link, range(2))
    longest = math.exp(next(each for each in added if each.field == "longest_time").bounds[1])
    assert _at_bound(added, dataclasses.replace(coarse.link, longest_time=longest))  # type: ignore[call-arg]
    assert not _at_bound(added, coarse.link)
    hum = screen.best(EFFECT_OF["mains_hum"])
    assert hum is not None
    places = [hum, coarse, dataclasses.replace(hum, coarse=coarse)]
    alone, best, both = refits(places, (), IN_THIS_PROCESS)
    assert alone is not None
    assert best is not None
    assert both is not None
    assert both.total == best.total < alone.total


def test_amounts_within_bounds_make_up_for_one_another() -> None:
    """Two columns nearly alike: the first at its bound leaves the second to do the rest."""
    rng = np.random.default_rng(1)
    first = rng.standard_normal(500)
    columns = np.column_stack((first, first + 1e-3 * rng.standard_normal(500)))
    wanted = columns @ np.array([5.0, -2.0])
    low, high = np.array([-1.0, -np.inf]), np.array([1.0, np.inf])
    amounts = _bounded(columns, wanted, low, high)
    least = optimize.lsq_linear(columns, wanted, (low, high), tol=1e-12)
    np.testing.assert_allclose(amounts, least.x, rtol=1e-4)
    assert np.sum((columns @ amounts - wanted) ** 2) < 1e-3 * np.sum(wanted**2)


def test_a_base_that_was_fitted_to_what_chooses_too_shows_an_effect_and_nothing_where_nothing_is() -> None:
    asked = Thresholds()
    hums, silent = (
        _on_all_seen(hypothesis(effect), asked, Search(workers=IN_THIS_PROCESS)) for effect in ("mains_hum", "none")
    )
    assert hums.is_all_seen
    assert hums.final.effects == ("mains_hum",)
    assert not hums.base.choosing
    assert hums.explains(asked)
    hum = next(each for each in tried_candidates([hums]) if each.accepted)
    assert hum.fit_share > 0.95
    assert "of the excess where it was fitted; explains" in hum.why
    assert silent.steps == ()
    assert silent.explains(asked)


def test_bases_compare_by_what_is_left_of_what_was_seen() -> None:
    """Of a base that was fitted to all there is one kind of parts, of others two."""
    base = hypothesis("backlash")
    seen = fitted_to_all(base)
    assert seen.total < 0.7 * base.total
    assert seen.over_noise == pytest.approx(base.over_noise, rel=0.2)


def test_readings_less_effects_are_those_of_the_stage_without_them() -> None:
    """What stands before the ceramic is in the voltage that a density is identified with, and adds nothing."""
    found = found_in_turn(hypothesis("slow_relaxation"), "slow_relaxation")[0].accepted[0].after
    for run, less in zip(found.staged.runs, less_effects(found), strict=True):
        bare, creeping = (plant_reading(run.record, effect) for effect in ("none", "slow_relaxation"))
        added = run.record.displacement - less.record.displacement
        np.testing.assert_allclose(added - added.mean(), creeping - bare - (creeping - bare).mean(), rtol=0, atol=NOISE)
        assert np.std(added) > 3.0 * NOISE
        assert less.picks == run.picks
    late = found_in_turn(hypothesis("sensor_lag"), "amplifier_bandwidth")[0].accepted[0].after
    for run, less in zip(late.staged.runs, less_effects(late), strict=True):
        np.testing.assert_array_equal(less.record.displacement, run.record.displacement)
    # what the creep remembers of a past that nobody recorded is still in them
    fading = [dataclasses.replace(run, fades=True) for run in found.staged.runs]
    poled = dataclasses.replace(found, staged=dataclasses.replace(found.staged, runs=fading))
    assert all(run.fades for run in less_effects(poled))


def plant_reading(record: Record, effect: str) -> Array:
    """What the sensor would read without noise [m]."""
    chain = plant()
    _, out = chain.step(chain.init(Rest(time=0.0)), Signals(time=record.time, voltage=record.voltage))
    return reading(effect, record.time, out.displacement, 0)


@pytest.mark.parametrize(("left", "is_taken"), [(0.9, True), (1.1, False)])
def test_density_identified_beside_effects_is_taken_where_it_says_more(
    monkeypatch: pytest.MonkeyPatch, left: float, is_taken: bool
) -> None:
    """It is judged on the parts that chose, also where they were fitted since."""
    base = hypothesis("slow_relaxation")
    found = found_in_turn(base, "slow_relaxation")[0].accepted[0].after
    seen, runs = fitted_to_all(found), found.staged.runs
    assert identified_beside_effects(seen, runs, Thresholds()) is seen  # a declared density is as it was declared
    former: list[Hypothesis] = []

    def anew(asked: Hypothesis, progress: object) -> Any:
        former.append(asked)
        return SimpleNamespace(total=left * asked.total)

    monkeypatch.setitem(final_fit._IDENTIFIED_BY, type(found.staged.ceramic), anew)
    taken = identified_beside_effects(seen, runs, Thresholds())
    assert (taken is not seen) == is_taken
    assert former[0].choosing == found.choosing
    assert former[0].effects == ("slow_relaxation",)
    assert identified_beside_effects(base, runs, Thresholds()) is base  # it has no effects
    assert len(former) == 1


def found_in_turn(base: Hypothesis, *names: str) -> list[Step]:
    """Steps in which effects were added whatever else would have been better."""
    steps: list[Step] = []
    for name in names:
        before = steps[-1].after if steps else base
        found = Search(effects=(EFFECT_OF[name],)).step(before).candidates[0]
        steps.append(Step(before, (found,), {}, (found,), (), ""))
    return steps


def test_the_second_of_two_effects_stands_alone_where_the_first_is_no_longer_needed() -> None:
    """A court case: a drift, which makes up for much, was named before the bias field that explained all."""
    base = hypothesis("sensor_lag")
    steps = found_in_turn(base, "mechanical_resonance", "sensor_lag")
    (step,) = needed_only(steps, Judge().shows_beside)
    assert [each.name for each in step.accepted] == ["sensor_lag"]
    assert step.after.effects == ("sensor_lag",)
    assert step.after.total < 1.05 * steps[-1].after.total
    both = hypothesis("cubic_strain_law+mains_hum")
    needed = found_in_turn(both, "sensor_nonlinearity", "mains_hum")
    assert needed_only(needed, Judge().shows_beside) == needed


def test_an_effect_before_a_curve_that_ties_with_a_law_is_dropped_where_it_is_not_needed() -> None:
    """A court case: elements had bent for the curve, and a hysteresis of the strain stood for that."""
    steps = found_in_turn(hypothesis("cubic_strain_law"), "slow_relaxation", "sensor_nonlinearity")
    tied = ("sensor_nonlinearity", "strain_law")
    asked: list[Hypothesis] = []

    def anew(found: Hypothesis) -> Hypothesis:
        asked.append(found)
        return found

    open_ones = [steps[0], dataclasses.replace(steps[1], tied=tied)]
    (step,) = needed_only(open_ones, Judge().shows_beside, anew)
    assert step.after.effects == ("sensor_nonlinearity",)
    assert step.tied == tied
    assert [each.effects for each in asked] == [("sensor_nonlinearity",)]
    rivals = [steps[0], dataclasses.replace(steps[1], tied=("sensor_nonlinearity", "bias_field"))]
    assert needed_only(rivals, Judge().shows_beside, anew) == rivals
    assert needed_only(open_ones, lambda candidate: True, anew) == open_ones


def test_an_effect_that_two_others_make_needless_is_dropped() -> None:
    """A court case: a drift came first, and was kept beside the creep and the hysteresis that it had stood for."""
    steps = found_in_turn(hypothesis("sensor_lag+mains_hum"), "mechanical_resonance", "sensor_lag", "mains_hum")
    assert needed_only(steps, lambda candidate: True) == steps
    (step,) = needed_only(steps, Judge().shows_beside)
    assert [each.name for each in step.accepted] == list(step.after.effects) == ["sensor_lag", "mains_hum"]
    first, second = step.accepted
    assert first.before is steps[0].before
    assert second.before is first.after
    assert step.after.total < 1.01 * steps[-1].after.total
    assert needed_only([step], Judge().shows_beside) == [step]


def leaving(share: float, *effects: str) -> Hypothesis:
    """A hypothesis that leaves a share of an excess of eight times the noise's square, on both kinds of parts."""
    left = Misfit(1000.0 * (1.0 + 8.0 * share), 1000, 1000.0)
    total, excess = 2.0 * (1.0 + 8.0 * share), 16.0 * share
    found = SimpleNamespace(fit=left, selection=left, total=total, excess=excess, total_at=lambda ratio: 2.0 * ratio**2)
    found.ratios, found.effects, found.over_noise = [left.ratio, left.ratio], effects, total / 2.0
    found.staged = SimpleNamespace(has_past=False)
    return cast(Hypothesis, found)


@pytest.mark.parametrize(("declared_leaves", "is_chosen"), [(0.01, True), (0.02, False), (0.06, False)])
def test_few_unknowns_are_preferred_near_the_noise(declared_leaves: float, is_chosen: bool) -> None:
    """A court case: a lag was found, 2 % of the noise was left, and a density of 270 weights without it left less."""
    branches = [
        Branch("gaussian", leaving(declared_leaves, "sensor_lag"), ()),
        Branch("identified", leaving(0.008), ()),
    ]
    asked = dataclasses.replace(Thresholds(), floor=1.0)  # so that neither explains all
    assert (chosen_of(branches, asked) is branches[0]) is is_chosen


@pytest.mark.parametrize(("another_leaves", "is_chosen"), [(0.98, True), (0.7, False), (0.002, False)])
def test_where_none_explains_all_another_has_to_leave_clearly_less(another_leaves: float, is_chosen: bool) -> None:
    """A court case: a lattice left 3 % less than the declared density, and predicted a run to 30 x the noise."""
    branches = [Branch("gaussian", leaving(1.0), ()), Branch("identified", leaving(another_leaves), ())]
    assert (chosen_of(branches, Thresholds()) is branches[0]) is is_chosen


@pytest.mark.parametrize(("named", "is_chosen"), [(True, True), (False, False)])
def test_an_effect_near_the_noise_is_preferred_to_a_density_that_explains_all(named: bool, is_chosen: bool) -> None:
    """A court case: 270 weights took in a strain hysteresis where they were fitted, and score runs were 1.5 x off."""
    base, found = leaving(0.1), leaving(0.015, "strain_polarization_hysteresis")
    step = Step(base, (), {}, (Candidate("strain_polarization_hysteresis", base, found),), (), "")
    declared = Branch("gaussian", base, (step,)) if named else Branch("gaussian", found, ())
    flexible = Branch("identified", leaving(0.009), ())
    assert flexible.explains(Thresholds())
    assert not declared.explains(Thresholds())
    assert (chosen_of([declared, flexible], Thresholds()) is declared) is is_chosen


@pytest.mark.parametrize(("left_by_both", "is_pair"), [(0.11, False), (0.05, True)])
def test_two_at_once_need_one_another(left_by_both: float, is_pair: bool) -> None:
    """A court case: beside a current limit that left a fifth, a drift that took up half of that was named, too."""
    base, both = leaving(1.0), leaving(left_by_both)
    first = Candidate("amplifier_charge_limit", base, leaving(0.2))
    second = Candidate("thermal_drift", first.after, both)

    alone: list[float] = []

    class Offering(Search):
        def _candidates(self, *given: Any) -> tuple[tuple[Candidate, ...], dict[str, str]]:
            alone.append(given[-1])
            return (second,), {}

        def is_significant(self, candidate: Candidate) -> bool:
            return True

    assert Offering()._pair(base, [first]) == ((first, second) if is_pair else ())
    base.staged.has_past = True  # type: ignore[misc]
    Offering()._pair(base, [first])
    assert alone == [pytest.approx(base.total - 0.4 * base.excess), 0.0]  # beside unknown pasts a refit takes a minute


@pytest.mark.parametrize(("floor", "wanders"), [(1.0, True), (1.2, False)])
def test_a_straight_drift_that_leaves_something_is_asked_whether_it_wanders(floor: float, wanders: bool) -> None:
    """A court case: beside a current limit it all but explained the first halves, and foretold no second one."""
    limit, drift = "amplifier_charge_limit", "thermal_drift"
    base = leaving(1.0)
    first = Candidate(limit, base, leaving(0.2, limit))
    straight = Candidate(drift, first.after, leaving(0.02, limit, drift))
    steps = [Step(each.before, (each,), {}, (each,), (), "") for each in (first, straight)]
    chance = Candidate(drift, first.after, leaving(0.0, limit, drift))
    beside: list[Hypothesis] = []

    class Wandering(Search):
        def explains(self, steps: Sequence[Step], base: Hypothesis) -> bool:
            return True

        def at_floor(self, hypothesis: Hypothesis) -> bool:
            return max(hypothesis.ratios) <= floor

        def _wandering_step(self, before: Hypothesis, *_: object) -> Step:
            beside.append(before)
            return Step(before, (chance,), {}, (chance,), (), "wanders by chance")

    found = Wandering().with_wandering(steps, base)
    assert beside == ([first.after] if wanders else [])
    assert [step.accepted[-1] for step in found] == [first, chance if wanders else straight]


@pytest.mark.parametrize(("share", "left", "is_found"), [(0.4, 0.0, True), (0.4, 0.3, False), (0.1, 0.0, False)])
def test_an_effect_is_sought_beside_readings_that_wander_where_a_drift_is_half(
    monkeypatch: pytest.MonkeyPatch, share: float, left: float, is_found: bool
) -> None:
    """A court case: beside a straight drift a bandwidth did not explain all, and without one it was not enough."""
    base, slow = leaving(1.0), leaving(0.5, "thermal_drift")
    drift = Candidate("thermal_drift", base, leaving(1.0 - share))
    bandwidth = Candidate("amplifier_bandwidth", base, leaving(0.5))
    both = Candidate("amplifier_bandwidth", slow, leaving(left, "thermal_drift", "amplifier_bandwidth"))
    asked: list[float] = []

    def wanders(place: Hypothesis, thresholds: Thresholds, most: float) -> Hypothesis | None:
        asked.append(most)
        return slow

    class Searching(Search):
        def _wandering_step(self, *_: object) -> None:
            """Alone they do not explain all."""

        def is_significant(self, candidate: Candidate) -> bool:
            return True

        def step(self, before: Hypothesis) -> Step:
            return Step(before, (both,), {}, (both,), (), "")

    monkeypatch.setattr(search_of_effects, "wandering", wanders)
    monkeypatch.setattr(search_of_effects, "replace", lambda found, **_: found)
    steps = [Step(base, (drift, bandwidth), {}, (), (), "")]
    found = Searching(dataclasses.replace(Thresholds(), pair_share=0.8)).with_wandering(steps, base)
    assert [step.accepted[-1].name for step in found if step.accepted] == (
        ["thermal_drift", "amplifier_bandwidth"] if is_found else []
    )
    assert asked == ([Thresholds().nameable] if share == 0.4 else [])


@pytest.mark.parametrize(("left_where_fitted", "ties"), [(0.005, True), (0.03, False)])
def test_what_explains_more_where_it_was_fitted_ties_with_readings_that_wander(
    left_where_fitted: float, ties: bool
) -> None:
    """A court case: a bias field that grew inside minor loops was a drift by chance, for that chose for itself."""
    base = leaving(1.0)
    wanders = Candidate("thermal_drift", base, leaving(0.01, "thermal_drift"))
    after = leaving(left_where_fitted, "bias_field")
    after.selection, after.total = leaving(1.1).selection, leaving(1.1).total  # type: ignore[misc]
    bias = Candidate("bias_field", base, after)

    class Refusing(Search):
        def is_significant(self, candidate: Candidate) -> bool:
            return False  # where it was not fitted

    assert Refusing()._beside_chance(wanders, [wanders, bias]) == ([bias] if ties else [])


@pytest.mark.parametrize("left", [0.2, 0.0])
def test_an_effect_that_had_to_bend_for_another_is_found_anew_beside_it(left: float) -> None:
    """A court case: a hysteresis stood for a mode, too, until that was found, and no refit of both led it back."""
    both = ("strain_polarization_hysteresis", "mechanical_resonance")
    base = leaving(1.0)
    bent = Candidate(both[0], base, leaving(0.4, both[0]))
    beside = Candidate(both[1], bent.after, leaving(left, *both))
    steps = [Step(each.before, (each,), {}, (each,), (), "") for each in (bent, beside)]
    asked: list[str] = []

    class Renewing(Search):
        def _anew(self, found: Hypothesis, name: str) -> list[Hypothesis]:
            asked.append(name)
            return [leaving(0.5 * left, *both), leaving(0.9)]

    renewed = Renewing()._renewed(steps, base)
    assert set(asked) == ({both[0]} if left else set())
    assert renewed[0] is steps[0]
    assert renewed[1].after.total == leaving(0.5 * left).total
    assert [each.name for each in renewed[1].accepted] == [both[1]]


class Unable(Search):
    """Cannot refit a relaxation."""

    def _refitted(self, before: Hypothesis, prospects: Sequence[Prospect]) -> list[Candidate]:
        return super()._refitted(before, [each for each in prospects if each.effect.name != "slow_relaxation"])


@pytest.mark.parametrize(
    ("kind", "rival", "ties"),
    [(Search, "sensor_nonlinearity", False), (Search, "slow_relaxation", True), (Unable, "slow_relaxation", True)],
)
def test_a_tie_is_decided_once_what_was_left_beside_it_is_explained(kind: type[Search], rival: str, ties: bool) -> None:
    """A court case: a bias tied with a drift as long as a mode was missing, and the search ended there."""
    base = hypothesis("slow_relaxation+mains_hum")
    (first,) = found_in_turn(base, "slow_relaxation")
    open_yet = dataclasses.replace(first, tied=("slow_relaxation", rival))
    steps = kind(effects=(EFFECT_OF["mains_hum"],))._decided([open_yet], base)
    assert [each.name for step in steps for each in step.accepted] == ["slow_relaxation", "mains_hum"]
    assert steps[0].tied == (open_yet.tied if ties else ())
    nothing_further = Search(effects=(EFFECT_OF["thermal_drift"],))
    assert nothing_further._decided([open_yet], base) == [open_yet]


def test_two_refits_of_one_effect_are_two_candidates() -> None:
    """They were compared by what they hold, arrays, once an effect had been refitted again without another."""
    base = hypothesis()
    first, second = (Candidate("bias_field", base, dataclasses.replace(base)) for _ in range(2))
    assert first in (second, first)
    assert first not in (second,)


def test_a_curve_is_left_open_that_a_law_explains_beside_what_was_found_later() -> None:
    """A court case: while a drift was missing neither explained enough to be a tie, and the curve was named."""
    steps = found_in_turn(hypothesis("cubic_strain_law+mains_hum"), "sensor_nonlinearity", "mains_hum")
    first, second = law_in_question(steps, Thresholds())
    assert first.tied == ("sensor_nonlinearity", "strain_law")
    assert second.tied == ()
    waving = found_in_turn(hypothesis("waving_sensor+mains_hum"), "sensor_nonlinearity", "mains_hum")
    assert law_in_question(waving, Thresholds()) == waving


@pytest.mark.parametrize(
    ("left", "knows_no_rate", "is_open"), [(1.2, True, True), (1.04, True, False), (1.2, False, False)]
)
def test_a_hysteresis_that_elements_may_lack_themselves_is_left_open(
    left: float, knows_no_rate: bool, is_open: bool
) -> None:
    """A court case: a drift of elements that slip, and a hysteresis of the strain for the shape of these."""
    after = SimpleNamespace(
        ratios=[1.0, left], staged=SimpleNamespace(ceramic=SimpleNamespace(knows_no_rate=knows_no_rate))
    )
    steps = [
        Step(after, (), {}, (cast(Any, SimpleNamespace(name=name, after=after)),), (), "")
        for name in ("thermal_drift", "strain_polarization_hysteresis")
    ]
    drift, hysteresis = hysteresis_in_question(steps, Thresholds())
    assert drift is steps[0]
    assert hysteresis.tied == (("strain_polarization_hysteresis", "hysteresis_density") if is_open else ())
    at_once = Step(after, (), {}, (steps[0].accepted[0], steps[1].accepted[0]), (), "")
    tied = [step.tied for step in hysteresis_in_question([at_once], Thresholds())]
    assert tied == ([(), ("strain_polarization_hysteresis", "hysteresis_density")] if is_open else [()])


@pytest.mark.parametrize(
    ("drift_share", "time_constant", "is_declared", "is_open"),
    [
        (0.0, 1e-3, False, True),
        (0.5, 1e-3, False, True),  # all there at the first sample but one
        (0.5, 10.0, False, False),
        (0.0, 1e-3, True, False),
    ],
)
def test_a_bias_field_that_never_changes_is_left_open_on_an_identified_density(
    drift_share: float, time_constant: float, is_declared: bool, is_open: bool
) -> None:
    """A court case: nothing hidden beside correlated thresholds, and 12.5 V from the first sample on."""
    bias = BiasField(bias_voltage=12.5, drift_share=drift_share, time_constant=time_constant)
    ceramic = object.__new__(DeclaredHysteresis) if is_declared else SimpleNamespace()
    run = SimpleNamespace(record=SimpleNamespace(time=np.linspace(0.0, 40.0, 4001)))
    staged = SimpleNamespace(ceramic=ceramic, runs=[run], chain_at=lambda vector: SimpleNamespace(links=(bias,)))
    after: Any = SimpleNamespace(staged=staged, vector=np.zeros(1), effects=("bias_field",))
    step = Step(after, (), {}, (cast(Any, SimpleNamespace(name="bias_field", after=after)),), (), "")
    (found,) = bias_in_question([step])
    assert found.tied == (("bias_field", "hysteresis_density") if is_open else ())
    assert bias_in_question([]) == []


@pytest.mark.parametrize(
    ("later", "tied"),
    [
        (["amplifier_charge_limit", "imprint"], [(), ("sensor_nonlinearity", "imprint", "strain_law")]),
        (["bias_field"], [("sensor_nonlinearity", "imprint", "strain_law")]),  # a variant is no other answer
        (["amplifier_charge_limit"], [()]),
    ],
)
def test_what_is_found_beside_a_group_that_it_belongs_to_is_left_open(later: list[str], tied: list[Any]) -> None:
    """A court case: tilted thresholds looked like a curve or a bias field, and a bias field was named beside those."""
    group = ("sensor_nonlinearity", "imprint", "strain_law")

    def added(names: list[str], tied: tuple[str, ...]) -> Step:
        candidates: Any = tuple(SimpleNamespace(name=name, after=SimpleNamespace(effects=())) for name in names)
        return Step(cast(Any, None), candidates, {}, candidates, tied, "")

    first, *others = groups_in_question([added([group[0]], group), added(later, ())])
    assert first.tied == group
    assert [step.tied for step in others] == tied
    assert [each.name for step in others for each in step.accepted] == later


def misfitting(fit: float, selection: float) -> Any:
    """What a candidate asks of a hypothesis, with so many times the noise left."""
    parts = [Misfit(1000.0 * ratio**2, 1000, 1000.0) for ratio in (fit, selection)]
    total = fit**2 + selection**2
    return SimpleNamespace(
        fit=parts[0],
        selection=parts[1],
        ratios=[fit, selection],
        total=total,
        over_noise=total / 2.0,
        excess=max(total - 2.0, 1e-4),
        choosing=[1],
        effects=(),
    )


@pytest.mark.parametrize(
    ("reached", "left", "tied"),
    [(1.03, 1.05, True), (1.03, 1.3, False), (1.0, 1.01, True), (1.0, 1.05, False)],
)
def test_a_drift_is_not_put_first_by_values_of_its_own_where_nothing_was_fitted(
    reached: float, left: float, tied: bool
) -> None:
    """A court case: a relaxation that described the fitted runs as well lost to a drift with a rate for every run.

    Another: a drift came down to the noise, no relaxation did, and both were the answer.
    """
    before = misfitting(2.0, 2.0)
    drift = Candidate("thermal_drift", before, misfitting(reached, 1.0))
    relaxation = Candidate("slow_relaxation", before, misfitting(left, 1.01 if left < 1.02 else 3.0))
    search = Search()
    assert search.is_outvoted(drift, relaxation)
    assert not search.is_outvoted(relaxation, drift)
    assert search.is_as_good(drift, relaxation) is tied


@pytest.mark.parametrize(("left", "of_one_run", "tied"), [(1.03, 1.03, False), (1.01, 1.03, True), (1.03, 1.06, True)])
def test_one_run_a_little_above_the_noise_does_not_make_a_drift_tie(left: float, of_one_run: float, tied: bool) -> None:
    """A court case: a drift left 1.00 x in all and 1.02 in a short run, relaxation 1.03 x, and both were the answer."""
    before = misfitting(2.0, 2.0)
    drift, relaxation = (
        Candidate(name, before, misfitting(*ratios))
        for name, ratios in (("thermal_drift", (1.0, 1.0)), ("slow_relaxation", (left, 1.04)))
    )
    drift.after.ratios.append(of_one_run)
    assert Search().is_as_good(drift, relaxation) is tied


@pytest.mark.parametrize("driven", [False, True])
def test_beside_an_unknown_past_no_likelihood_decides(driven: bool) -> None:
    """A court case: a mode that left 0.4 % less than the lag that was there was named."""
    before = misfitting(2.0, 2.0)
    mode = Candidate("mechanical_resonance", before, misfitting(1.02, 1.0))
    lag = Candidate("sensor_lag", before, misfitting(1.04, 1.03))
    mode.after.staged = SimpleNamespace(has_past=driven)  # type: ignore[misc, assignment]
    assert Search().is_as_good(mode, lag) is driven
    worse = Candidate("slow_relaxation", before, misfitting(1.5, 1.5))
    assert not Search().is_as_good(mode, worse)


@pytest.mark.parametrize(
    ("has_past", "winner", "rival", "tied"),
    [
        (False, (1.0, 1.0), (1.005, 1.002), True),
        (False, (1.0, 1.0), (1.03, 1.03), False),
        (False, (1.0, 1.0), (1.2, 1.001), False),
        (False, (1.0, 1.0), (1.2, 0.999), True),
        (False, (1.04, 1.0), (1.25, 1.001), True),
        (True, (1.0, 1.0), (1.15, 1.001), False),
        (True, (1.0, 1.0), (1.15, 0.999), True),
        (True, (1.0, 1.0), (1.1, 1.1), True),
        (True, (1.0, 1.03), (1.15, 1.04), True),
    ],
)
def test_what_was_fitted_decides_alone_where_it_is_beyond_doubt(
    has_past: bool, winner: tuple[float, float], rival: tuple[float, float], tied: bool
) -> None:
    """Court cases: a bandwidth was 700 likelihoods ahead of a lag where fitted, 9 where not, and the two tied.

    Not where what chooses speaks against it, nor where the winner leaves more than the noise itself; of runs whose past
    nobody recorded, in any of them.
    """
    before = misfitting(4.0, 4.0)
    bandwidth, lag = (
        Candidate(name, before, misfitting(*ratios))
        for name, ratios in (("amplifier_bandwidth", winner), ("sensor_lag", rival))
    )
    bandwidth.after.staged = SimpleNamespace(has_past=has_past)  # type: ignore[misc, assignment]
    assert Search().is_as_good(bandwidth, lag) is tied


@pytest.mark.parametrize(("driven", "left", "is_base"), [(True, 1.02, True), (True, 1.9, False), (False, 1.02, False)])
def test_beside_an_unknown_past_an_effect_has_to_beat_the_base_from_where_it_stands(
    monkeypatch: pytest.MonkeyPatch, driven: bool, left: float, is_base: bool
) -> None:
    """A court case: a refit with hum found better histories than the base had, and hum was named."""
    winner = Candidate("mains_hum", misfitting(2.0, 2.0), misfitting(1.01, 1.01))
    winner.after.staged = SimpleNamespace(has_past=driven)  # type: ignore[misc, assignment]
    bare = misfitting(left, left)
    bare.effects = ()
    monkeypatch.setattr(search_of_effects, "without", lambda found, name: bare)
    monkeypatch.setattr(Search, "is_significant", lambda self, candidate: True)
    assert (Search()._base_instead_of(winner) is not None) is is_base


def test_a_freed_strain_law_keeps_what_else_is_sought() -> None:
    base = hypothesis()
    law = StrainLaw()
    staged = dataclasses.replace(
        base.staged,
        chain=base.staged.chain.with_links(lambda link: law if isinstance(link, Electrostriction) else link),
        coordinates=(coordinate(law, "quadratic"), coordinate(law, "field", typical=1e-7)),
    )
    freed = with_free_law(fitted(staged, staged.start, most_steps=3))
    assert freed is not None
    fields = [each.field for each in freed.staged.coordinates]
    assert fields == ["linear", "quadratic", "cubic", "field"]
    assert freed.fit.ratio < 1.1
    assert with_free_law(freed) is None


def test_what_a_density_may_stand_in_for_is_said_where_the_design_hides_it() -> None:
    clean, bent = hypothesis(), hypothesis("backlash")
    design = Alike(lambda records: True, frozenset({"slow_relaxation", "sensor_lag"}), "")
    asked = Thresholds()
    assert stood_in_for(bent, clean, [design], asked) == (("hysteresis_density", "sensor_lag", "slow_relaxation"),)
    assert stood_in_for(bent, clean, [], asked) == ()
    assert stood_in_for(bent, bent, [design], asked) == ()  # it does not explain it either
    assert stood_in_for(clean, clean, [design], asked) == ()


def test_page_tells_what_a_density_may_stand_in_for(null: Report, tmp_path: Path) -> None:
    group = ("hysteresis_density", "sensor_lag", "slow_relaxation")
    report = dataclasses.replace(null, not_identifiable=(group,))
    assert not report.repaired
    write_page(report, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Not identifiable from these runs: hysteresis density or sensor lag or slow relaxation." in page
    assert "each of the others looks like it" in page


@pytest.mark.parametrize("past", [[False, False], [True, False]])
def test_starts_are_free_only_where_a_run_has_a_past(past: list[bool]) -> None:
    """Court cases: free starts hid what was missing, and runs from rest were predicted 0.2 to 8 um off."""
    runs = hypothesis().staged.runs
    parts = parts_of(runs, [each.record.voltage for each in runs], past)
    seen = [run.unknown_start for part in parts for run in part]
    expected = [past[n] for part in (FIT, SELECTION) for n, run in enumerate(runs) if part in run.picks]
    assert seen == expected


def test_flexible_ceramic_goes_along_its_tangent() -> None:
    base = hypothesis()
    times = [each.record.time for each in base.staged.runs]
    voltages = [each.record.voltage for each in base.staged.runs]
    field = (min(v.min() for v in voltages) / 1e-4, max(v.max() for v in voltages) / 1e-4)
    ceramic = FlexibleHysteresis(times, 1e-4, field, unknown_start=[False, False], resolution=6)
    along = ceramic.exact_at(ceramic.start, voltages)
    moved = ceramic.start.copy()
    moved[3:] *= 1.0 + 0.3 * np.sin(np.arange(moved.size - 3))
    exact, near = ceramic.polarization(moved, voltages), along.polarization(moved, voltages)
    for one, other in zip(exact, near, strict=True):  # linear in the weights, so the same
        np.testing.assert_allclose(other, one, atol=2e-6)


@pytest.mark.parametrize("other", [lambda t, v: np.interp(t - 5e-3, t, v), lambda t, v: np.minimum(v, 80.0) - 0.1 * t])
def test_flexible_ceramic_knows_what_another_voltage_changes_from_few_samples(
    monkeypatch: pytest.MonkeyPatch, other: Callable[[Array, Array], Array]
) -> None:
    time = np.arange(0.0, 20.0, 1e-3)
    voltage = 60.0 - 60.0 * np.cos(0.5 * time) + 20.0 * np.sin(3.0 * time)
    ceramic = FlexibleHysteresis([time, time], 1e-4, (-3e5, 1.5e6), unknown_start=[False, False], resolution=6)
    along = ceramic.exact_at(ceramic.start, [voltage, 0.5 * voltage])
    there = other(time, voltage)
    (exact,), (before,) = (ceramic.polarization(ceramic.start, [each, time[:0]]) for each in (there, voltage))
    seen: list[int] = []
    run = FlexibleHysteresis._run

    def counted(*given: Any) -> Array:
        seen.append(given[-1].size)
        return run(*given)

    monkeypatch.setattr(FlexibleHysteresis, "_run", counted)
    (found,) = along.polarization(ceramic.start, [there, time[:0]])
    assert np.std(found - exact) < 0.01 * np.std(exact - before)
    along.polarization(ceramic.start, [voltage + 1.001 * (there - voltage), time[:0]])
    assert len(seen) == 3  # how it was before is known where the same samples are kept
    assert max(seen) < 0.3 * time.size


@pytest.mark.parametrize("name", ["slow_relaxation", "sensor_lag", "mains_hum"])
def test_screen_puts_the_effect_that_is_there_among_the_first(name: str) -> None:
    screen = Screen(hypothesis(name))
    found = {effect.name: screen.best(effect) for effect in EFFECTS if not effect.needs}
    totals = {key: prospect.total for key, prospect in found.items() if prospect is not None}
    assert name in sorted(totals, key=lambda key: totals[key])[:3]


def test_a_limit_is_sought_between_the_points_of_its_grid() -> None:
    """A court case: at one point of the grid it did nothing yet, at the next one far too much."""
    base, effect = hypothesis("charge_limit"), EFFECT_OF["amplifier_charge_limit"]
    screen = Screen(base)
    coarse = screen.best(effect)
    assert coarse is not None
    assert base.total - screen.refined(coarse).total > 2.0 * (base.total - coarse.total)
    (found,) = Search(effects=(effect,)).step(base).accepted
    assert found.after.fit.ratio < 0.5 * base.fit.ratio


def test_limits_are_sought_whatever_their_grid_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    sought: list[str] = []

    def refined(_screen: Screen, prospect: Prospect) -> Prospect:
        sought.append(prospect.effect.name)
        return prospect

    monkeypatch.setattr(Screen, "refined", refined)
    monkeypatch.setattr(Search, "_refitted", lambda *_: [])
    Search(Thresholds(refits=0, promise=math.inf)).step(hypothesis())
    assert sorted(sought) == ["amplifier_charge_limit", "amplifier_current_limit"]


def test_where_no_second_promises_enough_the_best_is_tried_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """An examiner's creep and current limit: far from the noise a screen promised 9 x of what came to 2 x."""
    tried: list[str] = []
    monkeypatch.setattr(
        Search, "_refitted", lambda self, before, given: tried.extend(p.effect.name for p in given) or []
    )
    base, effects = hypothesis("slow_relaxation"), [EFFECT_OF[name] for name in ("mains_hum", "slow_relaxation")]
    search = Search(effects=effects)
    search._candidates(base, base, most=0.0)
    assert tried == []
    search._candidates(base, base, most=0.0, most_alone=base.total)
    assert tried == ["slow_relaxation"]


def test_what_no_run_tells_leaves_the_base_its_directions_in_the_screen() -> None:
    """Known from the prior alone, it had a length of 0, and everything else was nothing beside it."""
    rng = np.random.default_rng(0)
    told = rng.standard_normal((50, 3))
    silent = np.hstack((told, np.zeros((50, 1))))
    rows = np.array([[0.0, 0.0, 0.0, 1.0]])
    runs = [None]
    staged = SimpleNamespace(
        fitted=[0], runs=runs, prior=(rows, np.zeros(1)), outputs=lambda *_: [], start=np.zeros(4), ceramic=None
    )
    residual = told @ np.ones(3)
    solution = SimpleNamespace(residuals=[residual])
    base: Any = SimpleNamespace(
        staged=staged, choosing=[], solution=solution, jacobians=[silent], vector=np.zeros(4), selection_residuals=[]
    )
    assert np.linalg.norm(Screen(base)._rest) < 1e-9 * np.linalg.norm(residual)


def test_an_effect_is_weighed_on_a_density_that_was_fitted_to_what_chose(monkeypatch: pytest.MonkeyPatch) -> None:
    """A court case: a lag that explained most where it was fitted, beside a density that predicted badly elsewhere."""
    before, wandering = misfitting(2.0, 3.0), misfitting(1.1, 2.9)
    before.staged = SimpleNamespace(runs=[])
    before.effects, before.beside = (), ""
    wandering.effects = ()
    lag, mode = (Candidate(name, before, wandering) for name in ("sensor_lag", "mechanical_resonance"))
    left = {"sensor_lag": 1.1, "mechanical_resonance": 1.2}

    def weighed(candidates: Sequence[Candidate], _workers: object) -> list[Candidate]:
        bare, *afters = (misfitting(ratio, 0.0) for ratio in (2.0, *(left[each.name] for each in candidates)))
        for each in (bare, *afters):
            each.selection, each.ratios = Misfit(0.0, 0, 0.0), each.ratios[:1]
        bare.staged, bare.effects = before.staged, ()
        pairs = zip(candidates, afters, strict=True)
        return [dataclasses.replace(each, before=bare, after=after) for each, after in pairs]

    monkeypatch.setattr("pzt_ros.diagnosis.search.informed", weighed)
    monkeypatch.setattr("pzt_ros.diagnosis.judge.alike_by_design", lambda _records: [])
    search = Search(Thresholds().on_lattice())
    both = [lag, mode]
    found = search._informed(both, both)
    assert found is not None
    assert found[0] is lag
    assert found[1] == ("sensor_lag", "mechanical_resonance")
    left["mechanical_resonance"] = 1.6
    assert search._informed(both, both)[1] == ()  # type: ignore[index]
    assert search._informed(both, [mode]) is None  # what chose found nothing in the best
    asked = Thresholds()
    for thresholds in (asked, asked.on_flexible(), asked.on_elements()):  # no density there, or one that knows no rate
        assert Search(thresholds)._informed(both, both) is None
    left["sensor_lag"] = 1.5
    assert search._informed(both, both) is None


def test_candidates_weighed_again_are_fitted_to_all_and_held_alike() -> None:
    base = hypothesis("sensor_lag")
    found = found_in_turn(base, "sensor_lag")[0].accepted[0]
    firm, loose = copy.copy(base.staged.ceramic), cast(Any, base.staged.ceramic)
    cast(Any, firm).rotation_strength, loose.rotation_strength = 100.0, 1.0
    after = dataclasses.replace(found.after, staged=dataclasses.replace(found.after.staged, ceramic=firm))
    lag, same = informed([found, dataclasses.replace(found, after=after)], IN_THIS_PROCESS)
    assert not lag.before.choosing
    assert lag.before.fit.samples == base.fit.samples + base.selection.samples
    assert lag.share > 0.9
    assert lag.after.total == same.after.total
    assert cast(Any, same.after.staged.ceramic).rotation_strength == 1.0


def test_a_shape_at_its_bound_is_tried_from_the_middle() -> None:
    """The reading is delayed; a search that began with bandwidth alone may stay there."""
    base = hypothesis("sensor_lag")
    screen, effect = Screen(base), EFFECT_OF["sensor_lag"]
    prospect = screen._prospect(effect, SensorLag(lag=3e-3, delay_share=0.0))
    held = fitted(prospect.staged, prospect.best_start(), ("sensor_lag",), 0)
    (found,) = off_bounds(held)
    assert found.total < held.total
    share = next(link for link in found.staged.chain_at(found.vector).links if isinstance(link, SensorLag)).delay_share
    assert share > 0.5
    inside = held.vector.copy()
    inside[-1] = 0.4
    assert off_bounds(fitted(prospect.staged, inside, ("sensor_lag",), 0)) == []


def test_details_are_moved_where_the_runs_show_them() -> None:
    """Two elements are no even band; of one the band may shrink to a point, and nothing is left to show."""
    after, details = {}, {}
    for effect in ("two_elements", "slow_relaxation"):
        base = hypothesis(effect)
        link = SlowRelaxation(share=0.05, shortest_time=0.3, longest_time=0.5)
        prospect = Screen(base)._prospect(EFFECT_OF["slow_relaxation"], link)
        after[effect] = fitted(prospect.staged, prospect.best_start(), ("slow_relaxation",), 20)
        details[effect] = detailed(after[effect], Thresholds())
    assert details["slow_relaxation"] is after["slow_relaxation"]
    found = details["two_elements"]
    assert found.excess < 0.3 * after["two_elements"].excess
    chain = found.staged.chain_at(found.vector)
    (creep,) = [each for each in chain.links if isinstance(each, SlowRelaxation)]
    assert creep.ends > 0.5
    assert detailed(found, Thresholds()) is found  # they are moved already
    lag = found_in_turn(hypothesis("sensor_lag"), "sensor_lag")[0].accepted[0]
    assert detailed(lag.after, Thresholds()) is lag.after  # it has none


def test_coordinates_come_back_to_their_values() -> None:
    law = StrainLaw()
    linear, quadratic = coordinate(law, "linear", typical=1e-5), coordinate(law, "quadratic")
    assert linear.si(linear.scaled(-3e-6)) == pytest.approx(-3e-6)
    assert quadratic.si(quadratic.scaled(2e-4)) == pytest.approx(2e-4)
    ceramic = next(link for link in declared().links if isinstance(link, Ferroelectric))
    scale = coordinate(ceramic, "relaxation_time")
    assert scale.is_log
    assert scale.si(scale.scaled(0.02)) == pytest.approx(0.02)


def test_floor_sees_coloured_noise_in_holds() -> None:
    rng = np.random.default_rng(4)
    time = np.arange(4000) / RATE
    voltage = np.where((time % 2.0) < 1.0, 20.0, 80.0)
    white = rng.standard_normal(time.size)
    coloured = np.convolve(white, np.ones(8) / np.sqrt(8.0), mode="same")
    for noise in (white, coloured):
        y = 1e-7 * voltage + NOISE * noise
        record = Record("hold", {"time_s": time, "voltage_V": voltage, "displacement_m": y})
        assert displacement_floors([record])[0] == pytest.approx(NOISE, rel=0.15)


def test_remains_name_time_and_line() -> None:
    rng = np.random.default_rng(5)
    time = np.arange(8000) / RATE
    tone = 20e-9 * np.sin(2.0 * np.pi * 37.0 * time) * (time > 12.0)
    record = Record("r", {"time_s": time, "voltage_V": np.sin(time), "displacement_m": np.sin(time) * 1e-6})
    data = RunData(record, {FIT: np.arange(time.size)}, NOISE)
    found = remains_of([data], [NOISE * rng.standard_normal(time.size) + tone], 1.05, 2.0)
    assert found.present
    assert "37" in found.what_is_seen
    assert "strongest from 14" in found.what_is_seen  # the tone is there from 12 s on
    quiet = remains_of([data], [NOISE * rng.standard_normal(time.size)], 1.05, 2.0)
    assert not quiet.present


def test_staged_needs_no_lattice_for_effects_behind_it() -> None:
    base = hypothesis()
    staged: Staged = base.staged
    before = staged.outputs(base.vector, [0])[0][0]
    link = EFFECT_OF["slow_relaxation"].link()
    same = dataclasses.replace(staged, chain=with_effect(staged.chain, link)).outputs(base.vector, [0])[0][0]
    np.testing.assert_array_equal(before, same)


def beside(seed: int, coupling: float) -> Record:
    """A run whose record has the displacement of another axis, of which a share comes through [m/m]."""
    alone = run(seed)
    neighbour = 2e-6 + 4e-6 * np.sin(2.0 * np.pi * (1.3 * alone.time + 0.1 * seed))
    moved_on = alone.displacement + coupling * neighbour
    return Record(alone.name, {**alone.columns, "displacement_m": moved_on, "neighbour_displacement_m": neighbour})


@pytest.mark.parametrize(("coupling", "names"), [(0.01, ["cross_coupling"]), (0.0, [])])
def test_another_axis_is_named_where_it_comes_through_and_only_there(coupling: float, names: list[str]) -> None:
    report = diagnose([beside(1, coupling), beside(2, coupling)], [beside(3, coupling)], declared())
    assert [effect.name for effect in report.effects] == names
    assert report.after.test < 1.1 * NOISE
    for effect in report.effects:
        assert effect.parameters["coupling"]["value"] == pytest.approx(coupling, rel=0.1)


def warmed(seed: int, expansion: float, rate: float) -> Record:
    """A run in which the reading goes with a recorded temperature, and drifts beside that [m/K, m/s]."""
    alone = run(seed)
    temperature = 293.0 + 0.3 * np.sin(1.1 * alone.time + seed)
    away = expansion * (temperature - temperature[0]) + rate * (-1) ** seed * alone.time
    return Record(
        alone.name,
        {**alone.columns, "displacement_m": alone.displacement + away, "temperature_K": temperature},
    )


@pytest.mark.parametrize(("rate", "link"), [(0.0, "thermal_expansion"), (2e-8, "thermal_drift")])
def test_a_drift_has_values_of_its_own_in_each_run_only_where_the_temperature_does_not_say_all(
    rate: float, link: str
) -> None:
    """A court case: rates that no temperature asked for predicted a run that was not fitted 36 nm off."""
    report = diagnose([warmed(1, 1e-7, rate), warmed(2, 1e-7, rate)], [warmed(3, 1e-7, rate)], declared())
    (effect,) = report.effects
    assert effect.name == "thermal_drift"
    assert effect.parameters["expansion"]["value"] == pytest.approx(1e-7, rel=0.05)
    assert [each.kind for each in effects_in(report.model)] == [link]
    assert [each.name for each in report.tried if each.accepted] == [link]
    outdone = [each.why for each in report.tried if each.name == "thermal_drift" and not each.accepted]
    assert all("thermal_expansion explains as much with fewer unknowns" in why for why in outdone)
    assert len(outdone) == (link == "thermal_expansion")


def warmed_late(seed: int) -> Record:
    """A run in which the reading goes with a body that follows the recorded air by 2 s and began off by 0.2 K."""
    alone = run(seed)
    air = 293.0 + 0.3 * np.sin(1.1 * alone.time + seed)
    lag = signal.lti([1.0], [2.0, 1.0])
    _, body, _ = signal.lsim(lag, air - air[0], alone.time - alone.time[0])
    away = 1e-7 * (body - 0.2 * (-1) ** seed * np.exp(-(alone.time - alone.time[0]) / 2.0))
    return Record(alone.name, {**alone.columns, "displacement_m": alone.displacement + away, "temperature_K": air})


def test_a_body_that_comes_after_the_air_is_a_thermal_drift() -> None:
    """An examiner's case: a drift of 480 nm/K came 6 s after the air, and drifts without a lag predicted it badly."""
    report = diagnose([warmed_late(1), warmed_late(2)], [warmed_late(3)], declared())
    (effect,) = report.effects
    assert effect.name == "thermal_drift"
    assert [each.kind for each in effects_in(report.model)] == ["thermal_lag"]
    assert effect.parameters["expansion"]["value"] == pytest.approx(1e-7, rel=0.1)
    assert effect.parameters["time_constant"]["value"] == pytest.approx(2.0, rel=0.1)
    assert report.after.score < 1.1 * NOISE


def misled(seed: int, turns: bool) -> Record:
    """A run with creep whose reading goes with a recorded temperature, which may turn its sign half the way."""
    alone = run(seed, "slow_relaxation")
    time, late = alone.time, alone.time > np.mean(alone.time)
    temperature = 293.0 + 0.3 * np.sin(1.1 * time + seed)
    shown = np.where(turns & late, 2.0 * temperature[late][0] - temperature, temperature)
    return Record(
        alone.name,
        {
            **alone.columns,
            "displacement_m": alone.displacement + 1e-7 * (temperature - temperature[0]),
            "temperature_K": shown,
        },
    )


@pytest.mark.parametrize("turns", [False, True])
def test_the_last_name_goes_that_makes_the_prediction_of_what_scores_worse_and_those_before_stay(turns: bool) -> None:
    """An examiner's case had three names, and each made it worse than the one before, 45, 50 and 67 nm."""
    runs = split(with_floors([misled(1, False), misled(2, False)]), with_floors([misled(3, turns)]))
    places = [begun(declared(), runs)]
    for name in ("slow_relaxation", "thermal_expansion"):
        places.append(Search().with_effects(places[-1], [name]))
    added = [Candidate(after.effects[-1], before, after) for before, after in itertools.pairwise(places)]
    steps = tuple(Step(each.before, (each,), {}, (each,), (), "is the best") for each in added)
    branch = Branch("gaussian", places[0], steps)
    reached = reached_of(runs, branch, places[0], Thresholds(), "", IN_THIS_PROCESS, TimeLimit())
    names = [effect.name for effect in found_effects(reached)]
    assert names == (["slow_relaxation"] if turns else ["slow_relaxation", "thermal_drift"])
    assert len(reached.errors) == 1 + len(names)
    assert (reached.after.score < 1.1 * NOISE) is not turns
    assert ("Beside what is named, thermal expansion would" in " ".join(reached.remarks)) is turns
    (drift,) = [each for each in tried_candidates([reached.branch]) if each.name == "thermal_expansion"]
    assert ("but it makes the prediction of what scores worse" in drift.why) is turns


def test_two_slow_effects_that_hide_one_another_are_both_named() -> None:
    """Neither shows itself alone; every other base was tried for 300 s, and nothing was named."""
    runs = split(with_floors([misled(1, False), misled(2, False)]), with_floors([misled(3, False)]))
    search = Search()
    (step,) = search.run(begun(declared(), runs))
    assert step.after.effects == ("slow_relaxation", "thermal_expansion")
    assert search.at_floor(step.after)
    assert not any(search.is_significant(each) for each in step.candidates)
    assert min(step.before.ratios) > 3.0


@pytest.mark.parametrize(("left", "tied", "named"), [(1.1, (), True), (1.29, (), False), (1.29, ("a", "b"), True)])
def test_without_a_test_run_no_name_stands_beside_what_is_left(left: float, tied: tuple[str, ...], named: bool) -> None:
    """A measured run: a bender that rings after switch-on, as no single mode does, was a mode with 1.29 x left."""
    base, after = misfitting(1.9, 1.9), misfitting(left, left)
    base.staged = SimpleNamespace(ceramic=SimpleNamespace(knows_no_rate=False))
    found = Candidate("mechanical_resonance", base, after)
    branch = Branch("gaussian", base, (Step(base, (found,), {}, (found,), tied, ""),))
    for tested, trusted in ((True, True), (False, named)):
        after.choosing = [1] if tested else []
        step = _trusted(branch, [branch], Thresholds(), TimeLimit()).steps[0]
        assert bool(step.accepted) is trusted
        assert ("without a test run" in step.verdict) is not trusted


@pytest.mark.parametrize(("left", "tied", "named"), [(1.4, (), True), (2.0, (), False), (2.0, ("a", "b"), True)])
def test_no_name_that_explains_half_beside_much_that_is_left(left: float, tied: tuple[str, ...], named: bool) -> None:
    """A court case: a gain that drifts was named thermal drift, which explained 53 % and left 2.5 times the noise."""
    for before, trusted in ((1.2 * left, named), (9.0, True)):
        base = misfitting(before, before)
        base.staged = SimpleNamespace(ceramic=SimpleNamespace(knows_no_rate=False))
        found = Candidate("thermal_drift", base, misfitting(left, left))
        branch = Branch("gaussian", base, (Step(base, (found,), {}, (found,), tied, ""),))
        assert bool(_trusted(branch, [branch], Thresholds(), TimeLimit()).steps[0].accepted) is trusted


@pytest.mark.parametrize(("name", "trusted"), [("mains_hum", True), ("bias_field", False)])
@pytest.mark.parametrize("is_over", [False, True])
def test_what_a_base_is_off_by_says_nothing_against_a_tone(name: str, trusted: bool, is_over: bool) -> None:
    """An examiner's hum beside a Duhem model: 87 % of what relays left, taken back for 2.2 x that are the model's."""
    base, after = misfitting(6.0, 6.0), misfitting(5.0, 5.0)
    base.staged = SimpleNamespace(ceramic=SimpleNamespace(knows_no_rate=True))
    after.effects = (name,)
    found = Candidate(name, base, after)
    branch = Branch("identified", base, (Step(base, (found,), {}, (found,), (), ""),))
    limit = TimeLimit()
    limit.has_cut = is_over
    assert bool(_trusted(branch, [branch], Thresholds(), limit).steps[0].accepted) is trusted


@pytest.mark.parametrize(("another", "is_over", "named"), [(1.4, True, False), (1.8, True, True), (1.4, False, True)])
def test_where_the_time_is_up_no_name_stands_beside_a_base_that_leaves_less(
    another: float, is_over: bool, named: bool
) -> None:
    """A court case: a curve stood for heavy tails beside a hysteresis; a lattice told it alone, but not nearly all."""
    base, after = misfitting(9.0, 9.0), misfitting(1.75, 1.75)
    base.staged = SimpleNamespace(ceramic=SimpleNamespace(knows_no_rate=False))
    after.effects = ("strain_polarization_hysteresis", "sensor_nonlinearity")
    found = Candidate("sensor_nonlinearity", base, after)
    branch = Branch("gaussian", base, (Step(base, (found,), {}, (found,), (), ""),))
    limit = TimeLimit()
    limit.has_cut = is_over
    searched = [branch, Branch("identified", misfitting(another, another), ())]
    assert bool(_trusted(branch, searched, Thresholds(), limit).steps[0].accepted) is named
