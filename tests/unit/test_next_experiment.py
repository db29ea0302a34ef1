"""The drive of the next experiment: playable at a bench, one design for every pair, and what it is meant to separate.

What separates is computed by formulas of this file, not by the library's effects.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.data import split
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.next_experiment import (
    DESIGNS,
    FILE,
    HIGHEST,
    LONGEST,
    Bench,
    Design,
    NextExperiment,
    design_between,
    designed,
    for_amplitudes,
    for_unexplained,
    save,
)
from pzt_ros.diagnosis.outcome import Errors
from pzt_ros.diagnosis.programme import Programme
from pzt_ros.diagnosis.remains import Remains
from pzt_ros.diagnosis.report import Report
from pzt_ros.diagnosis.what_next import what_next
from pzt_ros.effects.confounded import CONFOUNDED
from pzt_ros.effects.sensor_lag import SensorLag
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.effects.thermal_drift import ThermalDrift
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record, read_csv

ALL = sorted({*DESIGNS.values(), for_amplitudes, for_unexplained}, key=lambda design: design.__name__)

BENCHES = {
    "unipolar": Bench(10.0, 120.0, 12.0, 2e4, {"sensor_lag": 3e-3}),
    "bipolar": Bench(-30.0, 140.0, 0.5, 2e4, {"slow_relaxation": 500.0, "thermal_drift": 1e6}),
    "slow": Bench(0.0, 50.0, 1e-3, 2e4, {"amplifier_bandwidth": 10.0}),
    "fast": Bench(-20.0, 20.0, 900.0, 1e5, {"mechanical_resonance": 1e-6}),
    "negative": Bench(-140.0, -20.0, 1.0, 2e4),
}


def made(design: Design, bench: Bench) -> NextExperiment:
    """A design that has to come out."""
    found = designed(design, bench, "why")
    assert found is not None
    return found


@pytest.mark.parametrize("bench", BENCHES.values(), ids=list(BENCHES))
@pytest.mark.parametrize("design", ALL, ids=[design.__name__ for design in ALL])
def test_a_bench_can_play_every_design(design: Design, bench: Bench) -> None:
    found = made(design, bench)
    assert found.voltage[0] == 0.0
    assert found.voltage[-1] == 0.0  # nothing was cut off for its length
    assert found.time[-1] <= LONGEST
    assert min(bench.low, 0.0) - 1e-9 <= found.voltage.min()
    assert found.voltage.max() <= max(bench.high, 0.0) + 1e-9
    assert np.ptp(found.voltage) > 0.9 * bench.span
    np.testing.assert_allclose(np.diff(found.time), 1.0 / found.rate, rtol=1e-6)
    steepest = np.max(np.abs(np.diff(found.voltage))) * found.rate
    assert steepest <= 1.01 * bench.slew
    assert found.time.size <= 60_000  # what a diagnosis counts of a run


def test_every_confounded_pair_has_a_design_and_a_sentence() -> None:
    assert set(DESIGNS) == set(CONFOUNDED)
    for pair, design in DESIGNS.items():
        assert design_between(sorted(pair)) == (CONFOUNDED[pair], design)


def test_a_group_is_decided_by_the_first_pair_that_is_known() -> None:
    why, design = design_between(("mains_hum", "leakage", "thermal_drift"))
    assert design is for_unexplained
    assert EFFECT_OF["mains_hum"].next_experiment in why
    group = ("thermal_drift", "mains_hum", "slow_relaxation")
    assert design_between(group) == design_between(("slow_relaxation", "thermal_drift"))


def sine_run(low: float, high: float, frequency: float, rate: float = 2000.0) -> Record:
    """Whole cycles between two voltages."""
    time = np.arange(0.0, 3.0, 1.0 / rate)
    voltage = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(2.0 * np.pi * frequency * time)
    return Record("sine", {"time_s": time, "voltage_V": voltage, "displacement_m": 1e-8 * voltage})


def test_the_bench_is_read_off_the_runs_and_the_suspects() -> None:
    links = (SensorLag(lag=2e-3), ThermalDrift(rate=1e-9, time_constant=7.0))
    bench = Bench.of((sine_run(20.0, 90.0, 5.0), sine_run(-400.0, 60.0, 1.0)), links)
    assert (bench.low, bench.high) == (-HIGHEST, pytest.approx(90.0))
    assert bench.frequency == pytest.approx(5.0, rel=1e-3)
    assert bench.times == {"sensor_lag": 2e-3, "thermal_drift": 7.0}
    assert bench.slew == 2e4
    stepped = sine_run(0.0, 100.0, 1.0)
    stepped.voltage[3000:] = 50.0
    stepped.voltage[:3000] = 0.0
    assert Bench.of((stepped,)).slew == 1e5


def test_runs_beyond_what_is_allowed_leave_no_drive() -> None:
    assert designed(for_unexplained, Bench.of((sine_run(200.0, 400.0, 1.0),)), "why") is None


def one_pole(values: Array, step: float, constant: float) -> Array:
    """First-order low-pass from rest at the first value, input held straight between samples."""
    b, a, _ = signal.cont2discrete(([1.0], [constant, 1.0]), step, method="foh")
    b, a = np.ravel(b), np.ravel(a)
    return np.asarray(signal.lfilter(b, a, values, zi=signal.lfilter_zi(b, a) * values[0])[0])


def hysteresis(voltage: Array, width: float) -> Array:
    """A play operator."""
    out = np.empty_like(voltage)
    state = 0.0
    for k, v in enumerate(voltage.tolist()):
        state = min(max(state, v - width), v + width)
        out[k] = state
    return out


def left_of(base: list[Array], rival: Array, target: Array) -> float:
    """Share that a rival leaves of what the best sum of base signals and a constant leaves of a signal."""

    def left(columns: list[Array]) -> float:
        basis = np.column_stack([*columns, np.ones_like(target)])
        return float(np.std(target - basis @ np.linalg.lstsq(basis, target, rcond=None)[0]))

    return left([*base, rival]) / left(base)


def late(voltage: Array, rate: float) -> tuple[Array, Array, Array]:
    """Hysteresis without a lag, with one before it and with one behind it."""
    bare = voltage + 2.0 * hysteresis(voltage, 15.0)
    before = one_pole(voltage, 1.0 / rate, 3e-3)
    return bare, before + 2.0 * hysteresis(before, 15.0), one_pole(bare, 1.0 / rate, 3e-3)


def test_fast_drive_tells_a_lag_before_the_ceramic_from_one_behind() -> None:
    bare, before, behind = late(sine_run(10.0, 120.0, 12.0).voltage, 2000.0)
    steady = slice(1000, None)
    tied = left_of([bare[steady]], (before - bare)[steady], (behind - bare)[steady])
    design = design_between(("sensor_lag", "amplifier_bandwidth"))[1]
    drive = made(design, BENCHES["unipolar"])
    bare, before, behind = late(drive.voltage, drive.rate)
    assert left_of([bare], before - bare, behind - bare) > 0.2
    assert tied < 0.1


def creep_and_drift(time: Array, voltage: Array, constant: float) -> tuple[Array, Array]:
    """What creep of the voltage adds, and a drift that dies out as fast."""
    return one_pole(voltage, time[1] - time[0], constant) - voltage, 1.0 - np.exp(-time / constant)


def test_holds_tell_creep_from_drift() -> None:
    time = np.arange(0.0, 20.0, 1e-2)
    step = np.minimum(time, 1.0) * 100.0
    held = time > 1.0
    creep, drift = creep_and_drift(time, step, 6.0)
    tied = left_of([step[held]], drift[held], creep[held])
    bench = Bench(10.0, 120.0, 12.0, 2e4, {"slow_relaxation": 5.0, "thermal_drift": 6.0})
    drive = made(design_between(("slow_relaxation", "thermal_drift"))[1], bench)
    creep, drift = creep_and_drift(drive.time, drive.voltage, 6.0)
    assert left_of([drive.voltage, drive.voltage**2], drift, creep) > 0.6
    assert tied < 0.01


def test_holds_last_and_come_from_both_sides() -> None:
    bench = BENCHES["bipolar"]
    drive = made(design_between(("thermal_drift", "slow_relaxation"))[1], bench)
    still = np.concatenate(([False], np.diff(drive.voltage) == 0.0))
    edges = np.flatnonzero(np.diff(still.astype(int)))
    starts, ends = edges[::2], edges[1::2]
    from_above, from_below = 0, 0
    for first, after in zip(starts, ends, strict=False):
        if (after - first) / drive.rate > 8.0 and drive.voltage[first] == pytest.approx(bench.at(0.5)):
            from_above += drive.voltage[first - 50] > bench.at(0.5)
            from_below += drive.voltage[first - 50] < bench.at(0.5)
    assert (from_above, from_below) == (2, 2)


def test_frequencies_lie_a_decade_apart() -> None:
    drive = made(DESIGNS[frozenset(("sensor_lag", "slow_relaxation"))], BENCHES["bipolar"])
    turns = np.flatnonzero(np.diff(np.sign(np.diff(drive.voltage))))
    legs = np.diff(drive.time[turns])
    for frequency in (0.05, 0.5, 5.0):
        assert np.any(np.isclose(legs, 0.5 / frequency, rtol=0.02))


def test_a_programme_stays_smooth_and_inside() -> None:
    made_up = Programme(1e4, 1e3, -10.0, 50.0)
    made_up.to(200.0).hold(0.1).loops(-90.0, 30.0, 3).pulse(0.0, 0.01, 0.02).chirp(80.0, 10.0, 300.0, 0.5)
    voltage = made_up.voltage
    assert (voltage.min(), voltage.max()) >= (-10.0, 50.0 - 1e-9)
    assert voltage.max() <= 50.0
    assert np.max(np.abs(np.diff(voltage))) * 1e4 <= 1e3 * 1.001
    assert made_up.time.shape == voltage.shape


def test_the_file_is_what_was_designed_and_goes_when_none_is_needed(tmp_path: Path) -> None:
    found = made(for_unexplained, BENCHES["bipolar"])
    save(found, tmp_path)
    back = read_csv(tmp_path / FILE, ("time_s", "voltage_V"))
    np.testing.assert_array_equal(back.time, found.time)
    np.testing.assert_array_equal(back.voltage, found.voltage)
    assert FILE in found.sentence
    save(None, tmp_path)
    assert not (tmp_path / FILE).exists()
    save(None, tmp_path)


def report(tied: tuple[tuple[str, ...], ...], present: bool, sparse: bool = False) -> Report:
    """What a diagnosis of one run says, made by hand up to what it proposes next."""
    run = split(with_floors([sine_run(10.0, 120.0, 5.0)]), [])
    errors = Errors(1e-8, 1e-8, 1e-8, 1e-8, 0.01, (0.0, 1.0), ())
    remains = Remains(1e-8, 1.2, 1.4, present, "something")
    why, design = what_next((), tied, remains, sparse, ())
    drive = designed(design, Bench.of([run[0].record]), why) if design else None
    chain = load_chain("thesis-p1")
    text = f"{why} {drive.sentence}" if drive else why
    return Report(
        (run[0],), (), 1e-8, {}, errors, errors, chain, chain, (), (), tied, remains, text, "verdict", next_drive=drive
    )


@pytest.mark.parametrize(
    ("found", "design"),
    [
        (
            report((("sensor_lag", "amplifier_bandwidth"),), True),
            DESIGNS[frozenset(("sensor_lag", "amplifier_bandwidth"))],
        ),
        (report((), False, sparse=True), for_amplitudes),
        (report((), True), for_unexplained),
    ],
    ids=["pair", "amplitudes", "unexplained"],
)
def test_a_report_hands_over_the_drive_and_names_its_file(found: Report, design: Design, tmp_path: Path) -> None:
    found.save_data(tmp_path)
    said = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["next_experiment"]
    assert FILE in said
    drive = read_csv(tmp_path / FILE, ("time_s", "voltage_V"))
    np.testing.assert_array_equal(drive.voltage, made(design, Bench.of([found.train[0].record])).voltage)
    assert f"{drive.voltage.max():.4g} V" in said
    dataclasses.replace(found, next_drive=None).save_data(tmp_path)
    assert not (tmp_path / FILE).exists()


def test_nothing_is_proposed_where_nothing_is_missing(tmp_path: Path) -> None:
    clean = report((), False)
    clean.save_data(tmp_path)
    assert clean.next_drive is None
    assert FILE not in clean.next_experiment
    assert {path.name for path in tmp_path.iterdir()} == {"report.json", "baseline.yaml", "model.yaml"}
