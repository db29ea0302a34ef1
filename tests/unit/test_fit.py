"""Fitting a chain to runs: truth comes back with honest errors, unknown start included; doubtful input is refused."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from pzt_ros.chains import load_chain, save_chain
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.covariance import effective_samples, parameter_covariance
from pzt_ros.sysid.fit import Fit
from pzt_ros.sysid.history_search import settle
from pzt_ros.sysid.noise import noise_floor
from pzt_ros.sysid.parameters import fittable, free_parameters, without_noise
from pzt_ros.sysid.predict import predict
from pzt_ros.sysid.problem import Problem, distinguishable
from pzt_ros.sysid.result import FitResult
from pzt_ros.sysid.run import Span, Start, free_run
from pzt_ros.sysid.start import counted_part, with_offset

NOISE = 10e-9
FREE = [
    "shape_ascending",
    "barrier_ascending",
    "shape_descending",
    "barrier_descending",
    "relaxation_time",
    "domain_polarization",
    "reciprocal_permittivity",
]
WRONG = {
    "shape_ascending": 2.0,
    "barrier_ascending": 0.3e6,
    "shape_descending": 1.4,
    "barrier_descending": 0.8e6,
    "relaxation_time": 0.03,
    "domain_polarization": 0.23,
    "reciprocal_permittivity": 3.5e7,
}


def changed(chain: Chain, **changes: Any) -> Chain:
    links = tuple(dataclasses.replace(link, **changes) if link.kind == "parametrized" else link for link in chain.links)
    return dataclasses.replace(chain, links=links)


TRUTH = changed(load_chain("thesis-p2"), start="negative")  # its pre-history costs nothing, so the tests are quick
GUESS = dataclasses.replace(changed(TRUTH, **WRONG), notes={"free": [f"parametrized.{name}" for name in FREE]})


def drive(time: Array) -> Array:
    """Decaying and growing sweeps between about -40 and 150 V, at two rates."""
    return 55 + 95 * np.sin(2 * np.pi * 0.2 * time) * (1 - 0.05 * time) + 8 * np.sin(2 * np.pi * 1.7 * time)


def measured(
    name: str, start: Start, seed: int, duration: float = 12.0, noise: float = NOISE, chain: Chain = TRUTH
) -> Record:
    time = np.arange(0.0, duration, 0.008)
    record = Record(name, {"time_s": time, "voltage_V": drive(time), "displacement_m": time})
    y = free_run(chain, record, start, slice(None), time.size).displacement
    y = y + noise * np.random.default_rng(seed).standard_normal(time.size)
    return Record(name, {**record.columns, "displacement_m": y})


@pytest.fixture(scope="module")
def run() -> Record:
    return measured("run", Start((130.0, -20.0), 2.0, offset=-3e-6), seed=1)


@pytest.fixture(scope="module")
def fitted(run: Record) -> FitResult:
    return Fit(GUESS, Span(None, 8.0)).fit([run])


def true_value(name: str) -> float:
    return float(getattr(TRUTH.links[0], name.split(".")[1]))


def test_truth_comes_back_within_three_standard_errors(fitted: FitResult) -> None:
    assert [e.name for e in fitted.estimates] == [f"parametrized.{name}" for name in FREE]
    for estimate in fitted.estimates:
        assert 0 < estimate.std < 0.2 * estimate.value, estimate
        assert abs(estimate.value - true_value(estimate.name)) < 3 * estimate.std, estimate
    assert fitted.at_bounds == []


def test_misfit_is_the_noise_and_the_floor_says_so(fitted: FitResult) -> None:
    assert fitted.runs[0].rms == pytest.approx(NOISE, rel=0.05)
    assert fitted.runs[0].noise.rms == pytest.approx(NOISE, rel=0.15)
    assert fitted.runs[0].samples == 1001 - 7  # it begins in motion: the first 50 ms do not count


def test_held_out_part_is_predicted_to_the_noise(fitted: FitResult, run: Record) -> None:
    found = predict(fitted.model(), run, Span(8.001, None))
    assert found.rule == "as fitted to this run"
    assert found.signals.time[0] > 8.0
    assert found.rms < 1.1 * NOISE


def test_model_file_predicts_what_the_result_predicts(fitted: FitResult, run: Record, tmp_path: Path) -> None:
    save_chain(fitted.model("pzt fit run"), tmp_path / "model.yaml")
    loaded = load_chain(tmp_path / "model.yaml")
    assert loaded.notes["fit"]["runs"][0]["sha256"] == run.sha256
    np.testing.assert_array_equal(predict(loaded, run).error, predict(fitted.model(), run).error)


def test_lost_readings_change_neither_fit_nor_prediction(fitted: FitResult, run: Record) -> None:
    lost = [150, 500, 501, 900, 1300]
    shaken = run.displacement.copy()
    shaken[lost] = 1e-3
    spiky = Record("run", {**run.columns, "displacement_m": shaken})
    again = Fit(GUESS, Span(None, 8.0)).fit([spiky])
    assert again.runs[0].sha256 == spiky.sha256
    for before, after in zip(fitted.estimates, again.estimates, strict=True):
        assert after.value == pytest.approx(before.value, abs=0.3 * before.std)
    found = predict(again.model(), spiky, Span(8.001, None))
    assert found.rule == "as fitted to this run"
    assert found.rms < 1.1 * NOISE


def test_prediction_never_looks_at_the_predicted_measurement(fitted: FitResult, run: Record) -> None:
    spoilt = run.displacement.copy()
    spoilt[run.time >= 8.001] = 1.0
    other = Record("spoilt", {**run.columns, "displacement_m": spoilt})
    assert other.sha256 != run.sha256
    ours, theirs = (predict(fitted.model(), r, Span(8.001, None)) for r in (measured_again(run), other))
    np.testing.assert_array_equal(ours.signals.displacement, theirs.signals.displacement)
    assert ours.rms < 1.2 * NOISE
    assert "before 8.001 s" in ours.rule


def measured_again(run: Record) -> Record:
    """The same run under another fingerprint, so that no fitted start is known for it."""
    return Record("again", {**run.columns, "temperature_K": np.full(len(run), 293.0)})


def test_a_run_without_measurement_is_predicted_from_the_model_alone(fitted: FitResult, run: Record) -> None:
    bare = Record("bare", {"time_s": run.time, "voltage_V": run.voltage})
    found = predict(fitted.model(), bare)
    assert found.error.size == 0
    assert found.as_data()["rms_m"] is None
    assert np.ptp(found.signals.displacement) == pytest.approx(np.ptp(run.displacement), rel=0.02)


def test_a_run_at_rest_is_predicted(fitted: FitResult) -> None:
    time = np.arange(50.0)
    still = Record("still", {"time_s": time, "voltage_V": np.full(50, 20.0), "displacement_m": np.full(50, 7e-6)})
    found = predict(fitted.model(), still)
    assert found.signals.displacement[0] == pytest.approx(7e-6, abs=1e-6)
    assert found.as_data()["nrmse"] is None


def test_runs_of_different_start_are_fitted_together() -> None:
    runs = [
        measured("a", Start((150.0,), 2.0, offset=4e-6), seed=2, duration=6.0),
        measured("b", Start((140.0, -35.0), 2.0, offset=-9e-6), seed=3, duration=6.0),
    ]
    result = Fit(GUESS).fit(runs)
    for estimate in result.estimates:
        assert abs(estimate.value - true_value(estimate.name)) < 3 * estimate.std, estimate
    for found, rest in zip(result.runs, (4e-6, -9e-6), strict=True):
        assert found.rms == pytest.approx(NOISE, rel=0.1)
        assert found.start.offset == pytest.approx(rest, abs=0.3e-6)


def test_thinned_residuals_see_the_same_model(run: Record) -> None:
    whole = counted_part(run, Span(2.0, None), 10**6)
    thin = counted_part(run, Span(2.0, None), 100)
    assert thin.picks.size <= 100
    start = Start((130.0,), 2.0)
    fine = free_run(TRUTH, run, start, whole.picks, whole.end).displacement
    few = free_run(TRUTH, run, start, thin.picks, thin.end).displacement
    np.testing.assert_array_equal(few, fine[thin.picks - whole.picks[0]])


def test_no_more_history_is_taken_than_pays() -> None:
    plain = measured("plain", Start(leg=2.0), seed=4, duration=6.0)
    part = counted_part(plain, Span(), 1000)
    assert settle(TRUTH, part).prior_voltages == ()
    poled = measured("poled", Start((190.0, -30.0), 2.0), seed=5, duration=6.0)
    found = settle(TRUTH, counted_part(poled, Span(), 1000))
    assert len(found.prior_voltages) > 0
    model = free_run(TRUTH, poled, found, slice(None), len(poled)).displacement
    assert np.std(poled.displacement - model) == pytest.approx(NOISE, rel=0.1)


def test_offset_is_solved_exactly(run: Record) -> None:
    part = counted_part(run, Span(), 10**6)
    start = with_offset(TRUTH, part, Start((130.0, -20.0), 2.0))
    error = part.displacement - free_run(TRUTH, run, start, part.picks, part.end).displacement
    assert abs(error.mean()) < 1e-16
    assert start.offset == pytest.approx(-3e-6, abs=5 * NOISE / np.sqrt(len(run)))


def test_standard_errors_hold_for_residuals_that_remember() -> None:
    rng = np.random.default_rng(7)
    n, memory = 2000, 0.9
    time = np.arange(n) / n
    columns = np.stack([np.sin(9 * time), time, np.sin(31 * time)], axis=1)
    columns -= columns.mean(axis=0)
    errors, stds = [], []
    for _ in range(150):
        noise = np.zeros(n)
        kicks = rng.standard_normal(n)
        for k in range(1, n):
            noise[k] = memory * noise[k - 1] + kicks[k]
        noise -= noise.mean()
        estimate = np.linalg.lstsq(columns, noise, rcond=None)[0]
        covariance, undetermined = parameter_covariance([columns], [noise - columns @ estimate])
        assert not undetermined.any()
        errors.append(estimate)
        stds.append(np.sqrt(np.diag(covariance)))
    ratio = np.median(stds, axis=0) / np.std(errors, axis=0)
    assert np.all((ratio > 0.7) & (ratio < 1.4)), ratio
    assert effective_samples(noise) == pytest.approx(n * (1 - memory) / (1 + memory), rel=0.5)


def test_a_direction_without_data_is_not_determined() -> None:
    column = np.sin(np.arange(200.0))[:, None]
    _, undetermined = parameter_covariance(
        [np.hstack([column, column, np.cos(np.arange(200.0))[:, None]])], [np.cos(7.0 * np.arange(200.0))]
    )
    assert undetermined.tolist() == [True, True, False]


def test_noise_floor_of_white_slow_and_stepped_readings() -> None:
    rng = np.random.default_rng(3)
    motion = 1e-5 * np.sin(np.arange(5000) / 100)
    white = noise_floor(motion + 20e-9 * rng.standard_normal(5000))
    assert white.rms == pytest.approx(20e-9, rel=0.1)
    assert white.is_white
    slow = noise_floor(motion + 20e-9 * np.convolve(rng.standard_normal(5020), np.ones(21), "valid"))
    assert not slow.is_white
    assert "not white" in slow.caveat
    stepped = noise_floor(np.round(1e-6 * np.sin(np.arange(5000) / 800) / 1e-7) * 1e-7)
    assert stepped.rms == pytest.approx(1e-7 / np.sqrt(12))


def test_parameters_that_act_alike_are_held(run: Record) -> None:
    chain = dataclasses.replace(
        TRUTH, notes={"free": ["electrostriction.coefficient", "electrostriction.active_length"]}
    )
    part, start = counted_part(run, Span(), 300), Start((130.0, -20.0), 2.0)
    kept, held = distinguishable(Problem(TRUTH, free_parameters(chain), [part], [start]))
    assert [p.name for p in kept] == ["electrostriction.coefficient"]
    assert [p.name for p in held] == ["electrostriction.active_length"]


def test_without_a_list_the_properties_of_the_material_are_free() -> None:
    names = {p.name for p in free_parameters(dataclasses.replace(TRUTH, notes={}))}
    assert {f"parametrized.{name}" for name in FREE} <= names
    assert not names & {"parametrized.accuracy", "parametrized.layer_thickness", "electrostriction.active_length"}
    assert "parametrized.layer_thickness" in {p.name for p in fittable(TRUTH)}


def test_coordinates_come_back_to_the_same_value() -> None:
    for parameter in fittable(load_chain("thesis-p2")) + fittable(load_chain("thesis-q1")):
        low, high = parameter.scaled_bounds
        assert low < high
        assert parameter.to_si(parameter.to_scaled(parameter.value)) == pytest.approx(parameter.value, rel=1e-12)
        assert parameter.declared.lower <= parameter.to_si(low) < parameter.to_si(high) <= parameter.declared.upper


def test_bounds_and_correlated_pairs_are_named(run: Record) -> None:
    chain = dataclasses.replace(
        TRUTH, notes={"free": ["parametrized.domain_polarization", "electrostriction.coefficient"]}
    )
    scaled_up = Record("scaled", {**run.columns, "displacement_m": 1e9 * run.displacement})
    assert Fit(chain, Span(None, 4.0)).fit([scaled_up]).at_bounds
    three = ["domain_polarization", "reciprocal_permittivity"]
    free = [f"parametrized.{name}" for name in three] + ["electrostriction.coefficient"]
    # P scales with P_T and 1/E_1, y with zeta P^2: together they are known only as far as E_1 sets the thermal width
    bent = Fit(dataclasses.replace(chain, notes={"free": free}), Span(None, 4.0)).fit([run])
    named = {name for pair in bent.strongly_correlated for name in pair[:2]}
    assert named == set(free)
    text = io.StringIO()
    Console(file=text, width=200).print(bent)
    assert "only a combination is known" in text.getvalue()


def test_report_states_rms_span_and_noise(fitted: FitResult) -> None:
    text = io.StringIO()
    Console(file=text, width=200).print(fitted)
    for part in ("relaxation_time", "rms [nm]", "% of span", "noise floor [nm]", "prior reversals at"):
        assert part in text.getvalue()


def test_noise_of_the_sensor_is_no_part_of_the_model() -> None:
    quiet = without_noise(load_chain("bench-stage"))
    assert quiet.links[-1].noise_rms == 0.0  # type: ignore[attr-defined]
    assert quiet.links[-1].resolution == 0.0  # type: ignore[attr-defined]


def with_column(run: Record, **columns: Array) -> Record:
    return Record("bad.csv", {**run.columns, **columns})


def test_runs_that_cannot_be_fitted_are_refused(run: Record) -> None:
    n = len(run)
    cases = [
        ([], Span(), "no runs"),
        ([with_column(run, voltage_V=np.full(n, 3.0))], Span(), "voltage stays at 3 V"),
        ([with_column(run, displacement_m=np.full(n, 1e-6))], Span(), "displacement_m stays at 1e-06 m"),
        ([run], Span(None, 0.1), "at least 35 are needed"),
        ([run], Span(50.0, 60.0), "0 samples between"),
        ([run, run], Span(), "the same data"),
    ]
    for records, span, message in cases:
        with pytest.raises(BenchError, match=message) as caught:
            Fit(GUESS, span).fit(records)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("free", [["parametrized.colour"], ["parametrized.accuracy"], [], "all", [3]])
def test_an_impossible_free_list_is_refused(free: Any, run: Record) -> None:
    with pytest.raises(BenchError, match="free:") as caught:
        Fit(dataclasses.replace(TRUTH, notes={"free": free})).fit([run])
    assert "known are " in str(caught.value)
    assert "parametrized.shape_ascending" in str(caught.value)


@pytest.mark.parametrize("start", ["poled", {"runs": [{"sha256": 1}]}, {"runs": 3}, {"other": {"settle_s": "x"}}])
def test_a_malformed_start_is_refused(start: Any, run: Record) -> None:
    with pytest.raises(BenchError, match="start:"):
        predict(dataclasses.replace(TRUTH, notes={"start": start}), run)
