"""Runs that begin inside minor loops which nobody recorded: their past is found, and the rest of them is predicted."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pzt_benchmarks.residual_court.cases import RIGHT, Case, Spec, make_case
from pzt_benchmarks.residual_court.files import write_case
from pzt_ros.chains import load_chain, save_chain
from pzt_ros.diagnosis import histories
from pzt_ros.diagnosis.base import fit_declared
from pzt_ros.diagnosis.coordinates import coordinate
from pzt_ros.diagnosis.data import FIT, RunData, seen_through, split
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.histories import _most_alike, _not_clean, renewed, with_histories_of
from pzt_ros.diagnosis.hypothesis import fitted
from pzt_ros.diagnosis.outcome import model_of
from pzt_ros.diagnosis.staged import Staged
from pzt_ros.effects.amplifier_bandwidth import AmplifierBandwidth
from pzt_ros.effects.sensor_lag import SensorLag
from pzt_ros.effects.slow_relaxation import SlowRelaxation
from pzt_ros.effects.strain_polarization_hysteresis import StrainPolarizationHysteresis
from pzt_ros.effects.thermal_drift import ThermalDrift
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.surrogate import with_quick_surrogate
from pzt_ros.records import Record, read_csv
from pzt_ros.sysid import history_search
from pzt_ros.sysid import predict as predict_module
from pzt_ros.sysid.fit import Fit
from pzt_ros.sysid.history_search import (
    _corrected,
    _is_nested,
    _longer,
    _misfit_of,
    _Misfits,
    _refined,
    settle,
    telling_part,
)
from pzt_ros.sysid.history_shares import share_bounds, shares_of, voltage_bounds, with_shares
from pzt_ros.sysid.predict import predict
from pzt_ros.sysid.run import Span, Start, amplifier_gain, begins_driven, free_run, rms, typical_leg, usual_past
from pzt_ros.sysid.run_in import running_in
from pzt_ros.sysid.start import counted_part, misfit_at, with_offset
from pzt_ros.sysid.start_notes import start_as_data, start_from_data

NOISE = 12e-9
MODEL_LINK = Lattice(
    coercive_field=4.9e5,
    coercive_field_spread=4.0e11,
    interaction_field_spread=6.0e11,
    relaxation_time=6e-4,
    domain_volume=1.2e-22,
    layer_thickness=1e-4,
)
TRUE_LINK = dataclasses.replace(MODEL_LINK, spacing=0.25, accuracy=1e-6)
STRAIN = Electrostriction(coefficient=0.022, active_length=8e-3)
TRUTH, MODEL = Chain("truth", (TRUE_LINK, STRAIN)), Chain("model", (MODEL_LINK, STRAIN))
RATE = 500.0


def to(*turns: float) -> Array:
    """From 0 V through turning points at 150 V/s [V]."""
    pieces, last = [np.zeros(1)], 0.0
    for turn in turns:
        count = max(2, round(abs(turn - last) / 150.0 * RATE))
        pieces.append(last + (turn - last) * np.arange(1, count + 1) / count)
        last = turn
    return np.concatenate(pieces)


def begun_inside(chain: Chain, hidden: Sequence[float], shown: Sequence[float], seed: int) -> Record:
    """What is recorded of a chain after turns that nobody recorded."""
    voltage = to(*hidden, *shown)
    time = np.arange(voltage.size) / RATE
    _, out = chain.step(chain.init(Rest()), Signals(time=time, voltage=voltage))
    first = to(*hidden).size - 1
    noise = NOISE * np.random.default_rng(seed).standard_normal(voltage.size - first)
    measured = out.displacement[first:] + noise
    return Record(
        f"run {seed}",
        {"time_s": time[first:] - time[first], "voltage_V": voltage[first:], "displacement_m": measured},
    )


MINOR = (
    40.0,
    115.0,
    5.0,
    90.0,
    -15.0,
    125.0,
    20.0,
    70.0,
    30.0,
    110.0,
    -5.0,
    128.0,
    60.0,
    100.0,
    10.0,
    126.0,
    0.0,
    60.0,
)
INSIDE = begun_inside(TRUTH, (150.0, 20.0, 130.0, 80.0), MINOR, 1)


def run_from_rest() -> Record:
    return begun_inside(TRUTH, (), MINOR, 3)


def second_half(record: Record) -> Span:
    return Span(float(0.5 * record.time[-1]), None)


def test_the_second_half_is_predicted_to_the_noise() -> None:
    assert begins_driven(INSIDE)
    found = predict(MODEL, INSIDE)
    assert found.rms < 1.1 * NOISE
    assert found.start.prior_voltages[0] > 126.0, "a poling beyond what the run reaches"
    bare = Start(offset=found.start.offset)
    virgin, _ = _error(MODEL, INSIDE, bare)
    assert virgin > 10 * NOISE, "the past is no small matter here"


@pytest.mark.parametrize(("cycles", "told"), [(60, 20.5), (15, 15.0)])
def test_a_past_is_sought_where_the_drive_has_not_been_at_both_ends_many_times(cycles: int, told: float) -> None:
    time = np.arange(0.0, cycles, 0.02)
    voltage = 60.0 + 40.0 * np.sin(2.0 * np.pi * time)
    record = Record("sine", {"time_s": time, "voltage_V": voltage, "displacement_m": voltage})
    part = counted_part(record, Span(), 10_000)
    early = telling_part(part)
    assert early.end * 0.02 == pytest.approx(told, abs=0.5)
    assert early.picks[-1] == early.end - 1
    assert (early is part) == (told == cycles)


def test_the_drift_of_a_run_is_told_by_its_first_half_and_by_no_made_up_past() -> None:
    """A court case: a second of rest and rise; reversals made up for its drift, and the rest was 16 x the noise off."""
    rate, warming = 4e-8, ThermalDrift(time_constant=6.0)
    voltage = np.concatenate((np.zeros(round(0.6 * RATE)), to(110.0), np.full(round(18.0 * RATE), 110.0)))
    time = np.arange(voltage.size) / RATE
    drifting = Chain("drifting", (TRUE_LINK, STRAIN, dataclasses.replace(warming, rate=rate)))
    _, out = drifting.step(drifting.init(Rest()), Signals(time=time, voltage=voltage))
    noise = NOISE * np.random.default_rng(5).standard_normal(voltage.size)
    record = Record("drifting", {"time_s": time, "voltage_V": voltage, "displacement_m": out.displacement + noise})
    runs = [
        {"sha256": name, "prior_voltage_V": [], "leg_s": 1.0, "offset_m": 0.0, "values": {"thermal_drift.rate": value}}
        for name, value in (("one", 6e-8), ("other", -3e-8))
    ]
    notes = {"start": {"runs": runs, "other": {"per_run": ["thermal_drift.rate"]}}}
    found = predict(Chain("model", (TRUE_LINK, STRAIN, warming), notes), record)
    assert found.start.prior_voltages == ()
    assert found.told == len(record) // 2
    assert found.rms < 1.1 * NOISE
    assert dict(found.start.values)["thermal_drift.rate"] == pytest.approx(rate, rel=0.02)


def _error(chain: Chain, record: Record, start: Start) -> tuple[float, Array]:
    first, after = second_half(record).of(record)
    left = record.displacement[first:after] - free_run(chain, record, start, slice(first, after), after).displacement
    return float(np.std(left)), left


def test_a_history_found_with_a_surrogate_is_refined_with_the_chain_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """The surrogate here has a coercive field that is 2 % off, and alone would put the reversals elsewhere."""
    off = dataclasses.replace(MODEL_LINK, coercive_field=5.0e5)
    part = counted_part(INSIDE, Span(None, 5.0), 1000)
    monkeypatch.setattr(history_search, "with_quick_surrogate", lambda chain, voltage: Chain("off", (off, STRAIN)))
    misfits = _Misfits(MODEL, part)
    begin = Start((154.0, 24.0, 127.0), 1.0)
    alone = _refined(misfits.quickly, begin, INSIDE)
    assert rms(misfits.exactly(_corrected(misfits, begin, INSIDE))) < 0.5 * rms(misfits.exactly(alone))


def test_what_a_surrogate_is_off_by_is_taken_over_from_where_the_chain_was_asked() -> None:
    """It was 1.4 x the noise of a court case off, and hid two of four reversals."""
    part = counted_part(INSIDE, Span(), 1000)
    misfits = _Misfits(MODEL, part)
    there, near = Start((150.0, 20.0, 130.0), 1.0), Start((150.0, 21.0, 129.0), 1.0)
    off = rms(misfits.quickly(near) - misfits.exactly(near))
    np.testing.assert_array_equal(misfits.correct_at(there), misfits.exactly(there))
    np.testing.assert_allclose(misfits.quickly(there), misfits.exactly(there), atol=1e-3 * NOISE)
    assert rms(misfits.quickly(near) - misfits.exactly(near)) < 0.3 * off


@pytest.mark.parametrize("volts", [1.0, 1e3])
def test_a_quick_surrogate_is_its_own(volts: float) -> None:
    """It was copied once more where each sample took many steps, and then taken for a surrogate of another."""
    voltage = volts * np.arange(50.0)
    quick = with_quick_surrogate(MODEL, voltage)
    assert quick is not MODEL
    assert with_quick_surrogate(quick, voltage) is quick


WAITED = 3.0
"""At the voltage at which a run then begins [s]."""


def after_a_wait(seed: int) -> Record:
    """Begun inside minor loops at the top of one, where the drive had waited."""
    voltage = np.concatenate((to(150.0, 20.0, 80.0), np.full(round(WAITED * RATE), 80.0)))
    hidden = voltage.size - 1
    voltage = np.concatenate((voltage, 80.0 + to(*(turn - 80.0 for turn in MINOR))))
    time = np.arange(voltage.size) / RATE
    _, out = TRUTH.step(TRUTH.init(Rest()), Signals(time=time, voltage=voltage))
    noise = NOISE * np.random.default_rng(seed).standard_normal(voltage.size)
    columns = {"time_s": time - time[hidden], "voltage_V": voltage, "displacement_m": out.displacement + noise}
    return Record(f"waited {seed}", {name: values[hidden:] for name, values in columns.items()})


def test_a_wait_where_a_run_begins_is_found_and_no_reversals() -> None:
    """Half of the court's runs inside minor loops begin in a hold; two or three reversals were made up for each."""
    record = after_a_wait(11)
    part = counted_part(record, Span(), 2_000)
    found = settle(MODEL, part, noise=NOISE)
    assert found.approach is not None
    assert found.approach > 5.0 * found.leg
    assert found.prior_voltages == pytest.approx((150.0, 20.0), abs=3.0)
    misfit = _misfit_of(MODEL, part)
    assert rms(misfit(found)) < 1.05 * NOISE
    hasty = dataclasses.replace(found, approach=None)
    assert rms(misfit(hasty)) > 2.0 * NOISE, "the wait is no small matter here"
    assert predict(MODEL, record).rms < 1.1 * NOISE


def test_an_approach_is_written_down_and_read_again() -> None:
    start = Start((150.0, 20.0), 0.5, approach=12.5)
    assert start_from_data(start_as_data(start, "0", "run")) == start
    assert "12.5 s" in str(start)
    for value in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="no duration"):
            start_from_data({**start_as_data(start, "0", "run"), "approach_s": value})
    usual = Start((150.0, 20.0), 0.5)
    assert "approach_s" not in start_as_data(usual, "0", "run")
    assert start_from_data(start_as_data(usual, "0", "run")) == usual


@pytest.mark.parametrize("approach", [None, 0.02, 0.5, 400.0])
def test_a_history_is_its_shares(approach: float | None) -> None:
    start = Start((150.0, 20.0), 0.5, approach=approach)
    shares = shares_of(INSIDE, start)
    assert len(shares) == len(share_bounds(INSIDE, start)) == start.unknowns
    again = with_shares(start, INSIDE, shares)
    assert again.prior_voltages == pytest.approx(start.prior_voltages)
    assert again.approach == (None if approach is None else pytest.approx(approach))


def test_what_the_past_is_found_from_counts_in_no_figure() -> None:
    found = predict(MODEL, INSIDE)
    data = found.as_data()
    assert found.error.size == len(INSIDE)
    assert data["samples"] == found.error.size - found.told
    assert data["from_s"] == pytest.approx(0.5 * INSIDE.time[-1], abs=2 / RATE)
    assert data["rms_m"] == pytest.approx(np.sqrt(np.mean(found.error[found.told :] ** 2)))
    assert "begins driven" in data["rule"]
    spoiled = INSIDE.displacement.copy()
    spoiled[found.told :] += 1e-6
    other = predict(MODEL, Record("spoiled", {**INSIDE.columns, "displacement_m": spoiled}))
    assert other.start == found.start, "the half that is judged says nothing about the past"


@pytest.fixture(scope="module")
def case() -> Case:
    """Runs of the court's generator, which shares no code with the library."""
    return make_case(Spec("unknown_start", RIGHT, protocol="unknown_start", seed=71))


@pytest.mark.parametrize("until", [0.02, 0.05, 1.0])
def test_a_part_that_ends_early_has_its_past_from_its_own_first_half(until: float) -> None:
    found = predict(MODEL, INSIDE, Span(None, until))
    data = found.as_data()
    assert 0 < data["samples"] < found.error.size
    assert data["until_s"] <= until
    assert data["max_m"] >= data["rms_m"] > 0.0


def thinned(record: Record) -> Record:
    """Every third sample: enough, in half of the time."""
    return dataclasses.replace(record, columns={name: column[::3] for name, column in record.columns.items()})


def test_parameters_and_pasts_are_found_together(case: Case, tmp_path: Path) -> None:
    """All runs begin inside minor loops; what was fitted comes down to the noise, and so does half a run never seen."""
    files = write_case(case, tmp_path)
    train, test, score = ([thinned(read_csv(path)) for path in part] for part in (files.train, files.test, files.score))
    assert files.declared is not None
    runs = split(with_floors((*train, *test))[: len(train)], with_floors((*train, *test))[len(train) :])
    found = fit_declared(load_chain(files.declared), runs, lambda text: None)
    assert max(found.ratios) < 1.1
    model = model_of(found, "model", "")
    assert predict(model, score[0]).rms < 1.1 * NOISE


def test_a_poling_far_beyond_what_a_run_reaches_is_found_by_a_thorough_search() -> None:
    """Half the range beyond a sine ended below the poling, and parameters bent for it: 1.35 x the noise elsewhere."""
    shallow = (50.0, 15.0, 90.0, 30.0, 95.0, 20.0, 80.0, 12.0, 97.0, 40.0, 60.0, 14.0)
    poled = begun_inside(TRUTH, (150.0, 0.0, 56.0), shallow, 6)
    part = counted_part(poled, Span(), 10_000)
    found = settle(MODEL, part, noise=NOISE, thorough=True)
    reach = float(np.max(poled.voltage) + 0.5 * np.ptp(poled.voltage))
    assert found.prior_voltages[0] > reach
    assert float(np.std(_misfit_of(MODEL, part)(found))) < 1.05 * NOISE
    usual = settle(MODEL, part, noise=NOISE)
    assert max(usual.prior_voltages) <= reach
    assert float(np.std(_misfit_of(MODEL, part)(usual))) > 1.1 * NOISE


def test_a_run_whose_past_was_not_found_is_searched_more_thoroughly(monkeypatch: pytest.MonkeyPatch) -> None:
    """A court case: a reversal short of its past in the one run that was left, and a drift was named for it."""
    runs = split(with_floors((INSIDE,)), [])
    chain = dataclasses.replace(MODEL, notes={"free": ["electrostriction.coefficient"]})
    good = fit_declared(chain, runs, lambda text: None)
    assert isinstance(good.staged.ceramic, DeclaredHysteresis)
    short = good.staged.ceramic.with_starts([good.staged.ceramic.start_of(good.vector, 0)])
    staged = dataclasses.replace(good.staged, ceramic=short)
    lost = fitted(staged, staged.start + np.array([0.0, *[0.01] * (staged.start.size - 2), 0.0]), most_steps=0)
    assert 1.1 < lost.fit.ratio < 2.0

    def idle(*arguments: Any) -> Start:
        return settle(*arguments) if arguments[-1] else arguments[2][0]

    monkeypatch.setattr(histories, "settle", idle)
    monkeypatch.setattr(histories, "_STEPS", 0)
    found = renewed(lost)
    assert found.fit.ratio < 1.05


def test_a_run_that_comes_off_worse_by_the_histories_of_others_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A null of the court stayed at 1.7 x: its test run had found a past beside parameters that the others changed."""
    driven = SimpleNamespace(begins_driven=True)
    left: list[Any] = [
        SimpleNamespace(ratios=(1.7, 1.3), total=4.4, staged=SimpleNamespace(runs=[driven, driven])),
        SimpleNamespace(ratios=(1.1, 2.2), total=6.2),
        SimpleNamespace(ratios=(1.0, 1.0), total=2.0),
    ]
    fits, asked = iter(left[1:]), []

    def sought(found: Any, numbers: Sequence[int], *rest: Any) -> dict[int, Start]:
        asked.append((found, list(numbers)))
        return {}

    monkeypatch.setattr(histories, "_histories", sought)
    monkeypatch.setattr(histories, "_fitted_with", lambda found, known: next(fits))
    assert histories._with_other_histories(left[0], [0, 1], IN_THIS_PROCESS) is left[2]
    assert asked == [(left[0], [0, 1]), (left[1], [1])]


@pytest.mark.parametrize(
    ("past", "begin", "remembered"),
    [
        ((), 80.0, True),
        ((150.0,), 80.0, True),
        ((20.0, 150.0), 80.0, True),
        ((150.0, 20.0, 130.0), 80.0, True),
        ((150.0, 20.0, 160.0), 80.0, False),  # 160 V wiped out both
        ((150.0, 20.0), 160.0, False),
        ((150.0, 20.0, 130.0), 140.0, False),
        ((150.0, 20.0, 20.0), 80.0, False),
    ],
)
def test_reversals_that_others_wiped_out_are_not_tried(past: tuple[float, ...], begin: float, remembered: bool) -> None:
    """Return-point memory: of nine levels far fewer pasts are left than of five without it."""
    assert _is_nested(past, begin) is remembered


def test_a_past_that_is_no_memory_is_still_made_longer() -> None:
    wiped = Start((20.0, 130.0, 150.0), 1.0)
    assert not _is_nested(wiped.prior_voltages, float(INSIDE.voltage[0]))
    found = _longer(lambda start: np.ones(10), wiped, INSIDE, (0.0, 50.0, 100.0))
    assert {len(start.prior_voltages) for start in found if start.approach is None} == {4, 5}
    assert {start.prior_voltages for start in found if start.approach} == {wiped.prior_voltages}


@pytest.mark.parametrize(("record", "asked"), [(INSIDE, [0]), (run_from_rest(), [])])
def test_a_run_in_motion_is_asked_for_its_past_until_it_is_at_its_noise(record: Record, asked: list[int]) -> None:
    """Up to 1.1 x the noise was taken for done: a null of the court was "something is missing"."""
    (run,) = split(with_floors((record,)), [])
    left: Any = SimpleNamespace(ratios=(1.02,), staged=SimpleNamespace(runs=(run,)))
    assert _not_clean(left) == asked


def test_a_past_is_also_sought_from_that_of_another_run_in_motion() -> None:
    """The test run of a sine stayed at 1.36 x, a reversal short of the past that the train run had been given."""
    again = begun_inside(TRUTH, (150.0, 20.0, 130.0, 80.0), MINOR[::-1], 2)
    runs = tuple(split(with_floors((INSIDE, again, run_from_rest())), []))
    starts = [Start((150.0, 20.0, 130.0), 1.0), Start((), 1.0), Start((), 1.0)]
    ceramic = DeclaredHysteresis(MODEL_LINK, MODEL_LINK, [], [run.record for run in runs], starts)
    found: Any = SimpleNamespace(staged=SimpleNamespace(runs=runs, ceramic=ceramic), vector=ceramic.start)
    told = [_most_alike(found, number, MODEL, counted_part(runs[number].record, Span(), 2_000)) for number in range(3)]
    assert [len(starts) for starts in told] == [0, 1, 0]
    assert told[1][0].prior_voltages == pytest.approx((150.0, 20.0, 130.0))


RELAXING = SlowRelaxation(share=0.1, shortest_time=0.2, longest_time=8.0)


def relaxed(hidden: Sequence[float], shown: Sequence[float], seed: int) -> Record:
    return begun_inside(dataclasses.replace(TRUTH, links=(*TRUTH.links, RELAXING)), hidden, shown, seed)


def test_a_relaxation_that_began_before_the_record_is_found() -> None:
    """Its memory dies out over seconds: with the true past 2.9 x the noise in a run, and a drift was named for it."""
    records = [relaxed((150.0, 20.0, 130.0, 80.0), MINOR, 1), relaxed((150.0, -10.0), MINOR[::-1], 2)]
    free = [f"slow_relaxation.{name}" for name in ("share", "shortest_time", "longest_time")]
    begin = dataclasses.replace(RELAXING, share=0.06, shortest_time=0.4, longest_time=5.0)
    model = Chain("model", (*MODEL.links, begin), {"free": ["electrostriction.coefficient", *free]})
    runs = split(with_floors(tuple(records)), [])
    found = fit_declared(model, runs, lambda text: None)
    assert all(run.fades for run in found.staged.runs)
    assert max(found.ratios) < 1.03
    link = found.staged.chain_at(found.vector).links[-1]
    assert isinstance(link, SlowRelaxation)
    assert link.share == pytest.approx(RELAXING.share, rel=0.2)


AHEAD = dataclasses.replace(
    TRUTH, links=(TRUE_LINK, StrainPolarizationHysteresis(polarization_lead=3.5e-3, turn_width=0.04), STRAIN)
)


@pytest.mark.parametrize(
    ("hidden", "shown"),
    [((150.0, 20.0, 130.0, 80.0), MINOR), ((150.0, -10.0), MINOR[::-1]), ((150.0, 0.0, 140.0, 20.0, 100.0), MINOR)],
)
def test_what_follows_the_turns_of_the_polarization_has_its_past(
    hidden: Sequence[float], shown: Sequence[float]
) -> None:
    """It began as if the polarization had never turned: 1.2, 1.9 and 4.4 x the noise with the true reversals given."""
    record = begun_inside(AHEAD, hidden, shown, 1)
    part = counted_part(record, Span(), 10_000)
    start = with_offset(AHEAD, part, Start(hidden[:-1], typical_leg(record)))
    assert rms(misfit_at(AHEAD, part, start)) < 1.08 * NOISE
    found = predict(AHEAD, record)
    assert found.rms < 1.1 * found.noise


def test_a_diagnosis_begins_turns_as_a_prediction_does() -> None:
    """Outputs and slopes of both, from a history of two reversals."""
    start = Start((150.0, 20.0), 1.0)
    link = StrainPolarizationHysteresis(polarization_lead=3.5e-3, turn_width=0.04)
    chain = Chain("model", (MODEL_LINK, link, STRAIN))
    ceramic = DeclaredHysteresis(MODEL_LINK, MODEL_LINK, [coordinate(MODEL_LINK, "coercive_field")], [INSIDE], [start])
    run = RunData(INSIDE, {FIT: np.arange(len(INSIDE))}, NOISE)
    staged = Staged(chain, ceramic, [run], (coordinate(link, "polarization_lead"),))
    displacement, _ = staged.outputs(staged.start, [0])[0]
    there = free_run(chain, INSIDE, start, np.arange(len(INSIDE)), len(INSIDE)).displacement
    np.testing.assert_allclose(displacement, there, atol=1e-15)
    _, (jacobian,) = staged.linearise(staged.start)
    for place in range(staged.start.size):
        up, down = staged.start.copy(), staged.start.copy()
        up[place], down[place] = up[place] + 1e-3, down[place] - 1e-3
        slope = (staged.residuals(up)[0] - staged.residuals(down)[0]) / 2e-3
        assert rms(jacobian[:, place] - slope) < 0.05 * rms(slope)


RELAXED = dataclasses.replace(TRUTH, links=(*TRUTH.links, RELAXING))


@pytest.mark.parametrize(
    ("hidden", "shown"),
    [
        ((150.0, 20.0, 130.0, 80.0), MINOR),
        ((150.0, -10.0), MINOR[::-1]),
        ((150.0, 0.0, 140.0, 20.0, 100.0), MINOR),
        ((-20.0, 90.0, 30.0), MINOR),
    ],
)
def test_what_dies_out_is_predicted_from_the_first_half(hidden: Sequence[float], shown: Sequence[float]) -> None:
    """With an offset alone, and a past no better than its search, it was 3.7, 1.0, 3.3 and 1.2 x the noise."""
    found = predict(RELAXED, relaxed(hidden, shown, 1))
    assert found.told > 2000
    assert found.start.fading
    assert found.rms < 1.1 * found.noise


def test_a_fit_takes_out_what_dies_out(tmp_path: Path) -> None:
    """Where it did not, the share was 0.078 for 0.1, and what was left 1.9 x the noise."""
    record = relaxed((150.0, -10.0), MINOR[::-1], 2)
    begin = dataclasses.replace(RELAXING, share=0.09)
    notes = {"free": ["electrostriction.coefficient", "slow_relaxation.share"]}
    result = Fit(Chain("model", (*MODEL.links, begin), notes), most_samples=1000).fit([record])
    (run,), (_, share) = result.runs, result.estimates
    assert run.rms < 1.03 * run.noise.rms
    assert share.value == pytest.approx(RELAXING.share, rel=0.03)
    save_chain(result.model(), tmp_path / "model.yaml")
    again = predict(load_chain(tmp_path / "model.yaml"), record)
    assert again.start.fading == run.start.fading
    assert again.rms < 1.03 * again.noise


def test_only_what_begins_in_motion_fades() -> None:
    runs = split(with_floors((INSIDE, run_from_rest())), [])
    relaxing = dataclasses.replace(MODEL, links=(*MODEL.links, RELAXING))
    assert [run.fades for run in seen_through(relaxing, runs)] == [True, False]
    assert [run.fades for run in seen_through(MODEL, seen_through(relaxing, runs))] == [False, False]


def test_what_dies_out_is_no_misfit_and_no_offset() -> None:
    relaxing = dataclasses.replace(MODEL, links=(*MODEL.links, RELAXING))
    (run,) = seen_through(relaxing, split(with_floors((INSIDE,)), []))
    dying = 100e-9 * np.exp(-INSIDE.time / 1.3)
    model = INSIDE.displacement - dying - 40e-9
    assert rms(run.misfit(FIT, model, np.empty(0))) < 0.02
    assert rms(dataclasses.replace(run, fades=False).misfit(FIT, model, np.empty(0))) > 1.5
    part = counted_part(INSIDE, Span(), 10_000)
    start = Start((150.0, 20.0, 130.0))
    there = free_run(relaxing, INSIDE, start, part.picks, part.end).displacement
    measured = np.array(INSIDE.displacement)
    measured[part.picks] = there + dying[part.picks] + 40e-9
    seen = dataclasses.replace(
        part, record=dataclasses.replace(INSIDE, columns={**INSIDE.columns, "displacement_m": measured})
    )
    found = with_offset(relaxing, seen, start)
    assert found.offset == pytest.approx(40e-9, abs=1e-8)
    assert found.reading(INSIDE.time, INSIDE.time[0]) == pytest.approx(dying + 40e-9, abs=5e-9)


def test_what_a_thorough_search_took_beyond_may_stay_there() -> None:
    far = (float(voltage_bounds(INSIDE)[1]) + 10.0, 20.0)
    near, beyond = (
        DeclaredHysteresis(MODEL_LINK, MODEL_LINK, [], [INSIDE], [Start(past, 1.0)]) for past in ((140.0, 20.0), far)
    )
    assert near.upper.tolist() == [1.0, 1.0]
    assert np.all(beyond.upper > 1.0)
    assert np.all(beyond.lower < 0.0)


@pytest.mark.parametrize(
    ("first", "driven"),
    [
        ((0.6, 0.4, 0.1, -0.3), True),  # on its way through 0 V
        ((-0.6, -0.4, -0.1, 0.3), True),
        ((0.6, 0.9, 1.2, 1.5), False),  # a start that is recorded some samples late
        ((0.05, 0.02, -0.1, -0.3), False),  # the zero of a reading
        ((3.0, 3.0, 3.0, 3.0), True),
        ((0.0, 0.0, -0.5, -1.0), False),
        (1.9 - 0.07 * np.arange(10), True),  # of a court case: it comes to 0 V later
        (0.36 * np.cos(0.02 * np.arange(10)), True),  # of another: from a turn
        (0.05 - 0.002 * np.arange(10), False),
        (-1.6 - 0.01 * np.arange(10) ** 2, True),  # of a third: it stood at a turn, and was 5 x the noise off
        (1.6 + 0.3 * np.arange(10), False),  # late, too
        ((0.8, 0.8, 0.8, 0.8), False),  # the zero of a monitor
    ],
)
def test_a_run_on_its_way_through_zero_has_a_past(first: Sequence[float], driven: bool) -> None:
    """A court case: a run inside minor loops began at 0.6 V, was taken to be at rest, and a drift was named."""
    voltage = np.array([*np.repeat(first, 12 // min(len(first), 12))[:10], *(100.0 * np.sin(np.arange(50) / 8.0))])
    record = Record("run", {"time_s": 1e-3 * np.arange(voltage.size), "voltage_V": voltage, "displacement_m": voltage})
    assert begins_driven(record) == driven


@pytest.mark.parametrize("driven", [False, pytest.param(True, marks=pytest.mark.long)])
def test_what_was_before_a_run_in_motion_is_not_taken_for_the_past_of_one_from_rest(driven: bool) -> None:
    """A court case: 2.8 x the noise in the first 0.2 s of a run that the model describes."""
    rest, moving = begun_inside(TRUTH, (), (120.0, 10.0, 80.0), 7), INSIDE
    trains = (moving, *(() if driven else (rest,)))
    runs = split(with_floors(trains), [])
    chain = dataclasses.replace(MODEL, notes={"free": ["electrostriction.coefficient"]})
    model = model_of(fit_declared(chain, runs, lambda text: None), "model", "")
    known = Fit(chain).fit(trains).model()
    for each in (model, known):
        past = each.notes["start"]["other"]["prior_voltage_V"]
        assert bool(past) == driven
        assert predict(each, begun_inside(TRUTH, (), (100.0, 20.0, 110.0), 8)).rms < 1.1 * NOISE


def test_a_run_that_was_not_fitted_begins_as_the_last_fitted_one_from_rest() -> None:
    """An examiner's stage that was virgin before the first of its runs: 2.7 x of the run that scores, 1.35 x now."""
    virgin, poled, moving = Start(), Start((150.0,), 0.5, approach=4.0), Start((120.0, 10.0), 0.5)
    assert usual_past([virgin, poled, moving], [False, False, True]) == poled
    assert usual_past([moving], [True]).prior_voltages == moving.prior_voltages


def test_rivals_are_told_the_history_of_the_best() -> None:
    runs = split(with_floors((INSIDE,)), [])
    good = fit_declared(dataclasses.replace(MODEL, notes={"free": ["electrostriction.coefficient"]}), runs, print)
    assert isinstance(good.staged.ceramic, DeclaredHysteresis)
    lost = good.staged.ceramic.with_starts([Start((60.0,), 0.5)])
    staged = dataclasses.replace(good.staged, ceramic=lost)
    bad = fitted(staged, staged.start, most_steps=20)
    assert bad.fit.ratio > 2.0
    told = with_histories_of(bad, good)
    assert told.fit.ratio == pytest.approx(good.fit.ratio, rel=0.02)
    assert with_histories_of(good, bad) is good


def test_reversals_are_unknowns_of_their_run_alone() -> None:
    runs = [INSIDE, begun_inside(TRUTH, (150.0,), MINOR, 4)]
    starts = [Start((140.0, 30.0), 0.5), Start((145.0,), 0.5, approach=4.0)]
    ceramic = DeclaredHysteresis(MODEL_LINK, MODEL_LINK, [], runs, starts)
    assert ceramic.names == ["run 1 reversal 1", "run 1 reversal 2", "run 2 reversal 1", "run 2 approach"]
    assert [ceramic.places_of(number) for number in (0, 1)] == [[0, 1], [2, 3]]
    for number, start in enumerate(starts):
        np.testing.assert_allclose(ceramic.start_of(ceramic.start, number).prior_voltages, start.prior_voltages)
    voltages = [run.voltage for run in runs]
    here, (first, second) = ceramic.tangent(ceramic.start, voltages)
    assert not np.any(first[:, 2:])
    assert np.any(second[:, 3])
    assert not np.any(second[:, :2])
    step = 5e-4
    moved = ceramic.polarization(ceramic.start + np.array([0.0, step, 0.0, 0.0]), voltages)[0]
    np.testing.assert_allclose(first[:, 1], (moved - here[0]) / step, atol=0.05 * np.max(np.abs(first[:, 1])))


def sine(first: float, rate: float = 1e3) -> Record:
    """Three cycles about 60 V at 8 Hz from a phase [rad]."""
    time = np.arange(0.0, 3.0 / 8.0, 1.0 / rate)
    voltage = 60.0 + 60.0 * np.sin(2.0 * np.pi * 8.0 * time + first)
    return Record("sine", {"time_s": time, "voltage_V": voltage, "displacement_m": 1e-7 * voltage})


@pytest.mark.parametrize(("first", "samples"), [(0.0, 38), (-0.5 * np.pi, 0)])
def test_the_first_moments_of_a_run_in_motion_do_not_count(first: float, samples: int) -> None:
    """50 ms, or a tenth of a short run; from rest at 0 V a lag starts as it is modelled."""
    record = sine(first)
    early = running_in(record)
    assert np.count_nonzero(early) == samples
    assert not np.any(early[samples:])
    train, test = split([RunData(record, {}, NOISE)], [RunData(record, {}, NOISE)])
    assert train.picks["fit"][0] == test.picks["selection"][0] == samples
    assert counted_part(record, Span(), 10_000).picks[0] == samples


def test_a_run_that_rests_at_first_counts_from_there() -> None:
    voltage = np.concatenate((np.full(500, 80.0), sine(0.4).voltage[60:]))
    time = np.arange(voltage.size) * 1e-3
    assert not np.any(running_in(Record("held", {"time_s": time, "voltage_V": voltage, "displacement_m": voltage})))


@pytest.mark.parametrize(
    "amplifier",
    [Amplifier(), Amplifier(gain=25.0), Amplifier(gain=25.0, bandwidth=300.0), Amplifier(gain=25.0, slew_rate=4e3)],
)
@pytest.mark.parametrize("pasts", [(150.0, 20.0, 118.0), ()])
def test_a_free_run_begins_as_the_fit_began(amplifier: Amplifier, pasts: tuple[float, ...]) -> None:
    """Filters went through the reversals in a prediction only: 3 x the noise, all along; a gain did, too: 64 x."""
    record = sine(0.4)
    record = Record("input", {**record.columns, "voltage_V": record.voltage / amplifier.gain})
    start = Start(tuple(voltage / amplifier.gain for voltage in pasts), 0.06)
    chain = Chain(
        "late", (amplifier, AmplifierBandwidth(time_constant=2.5e-3), MODEL_LINK, STRAIN, SensorLag(lag=4e-3))
    )
    ceramic = DeclaredHysteresis(MODEL_LINK, MODEL_LINK, [], [record], [start], amplifier_gain(chain))
    (run,) = split([RunData(record, {}, NOISE)], [])
    staged = Staged(chain, ceramic, [run], (coordinate(STRAIN, "coefficient"),))
    ((fitted_displacement, _),) = staged.outputs(staged.start, [0])
    model = free_run(chain, record, start, slice(None), len(record)).displacement
    np.testing.assert_allclose(model, fitted_displacement, atol=1e-3 * NOISE)


def test_a_declared_fit_takes_pasts_through_the_gain() -> None:
    """A measured stack is recorded with the volts at the amplifier's input; such a fit ended at 87 x the noise."""
    columns = {**INSIDE.columns, "voltage_V": INSIDE.voltage / 25.0}
    notes = {"free": ["electrostriction.coefficient"]}
    amplified = Chain("amplified", (Amplifier(gain=25.0), MODEL_LINK, STRAIN), notes)
    runs = split(with_floors((Record("input", columns),)), [])
    found = fit_declared(amplified, runs, lambda text: None)
    assert found.fit.ratio < 1.1
    assert found.staged.ceramic.start_of(found.vector, 0).prior_voltages[0] > 126.0 / 25.0


def test_the_reversals_of_a_history_pass_the_gain() -> None:
    """A measured stack is driven with 0 to 3.6 V at the input: its past was once sought in these at the ceramic."""
    record, start = sine(0.4), Start((150.0, 20.0, 118.0), 0.06)
    columns = {**record.columns, "voltage_V": record.voltage / 25.0}
    at_input = Start(tuple(voltage / 25.0 for voltage in start.prior_voltages), 0.06)
    amplified = Chain("amplified", (Amplifier(gain=25.0), MODEL_LINK, STRAIN))
    expected = free_run(MODEL, record, start, slice(None), len(record)).displacement
    found = free_run(amplified, Record("input", columns), at_input, slice(None), len(record)).displacement
    np.testing.assert_allclose(found, expected, atol=1e-3 * NOISE)


def test_a_past_is_also_sought_from_those_of_the_fitted_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """From none and from how runs are poled the search of a sine ended 5 x the noise off, a reversal short."""
    asked: list[list[tuple[float, ...]]] = []

    def settled(chain: Chain, part: object, bases: Sequence[Start], tangent: Array, noise: float) -> Start:
        asked.append([base.prior_voltages for base in bases])
        return bases[-1]

    monkeypatch.setattr(predict_module, "settle", settled)
    runs = [
        {"sha256": str(number), "prior_voltage_V": list(past), "leg_s": 0.06, "offset_m": 0.0}
        for number, past in enumerate([(150.0, 20.0), (), (150.0, 20.0), (144.0, 8.0, 120.0), (1.0,)])
    ]
    predict(Chain("model", (MODEL_LINK, STRAIN), {"start": {"runs": runs}}), sine(0.4))
    assert asked == [[(), (147.0,), (150.0, 20.0), (144.0, 8.0, 120.0)]]
