"""Error statistics against numbers worked out by hand; the demo's gains against the search that found them."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from pzt_ros.experiments.experiment import Experiment
from pzt_ros.experiments.phases import Move, Scan, VoltageRamp
from pzt_ros.report.tracking import Stretch, stretches, track, tracking_error
from pzt_ros.scenario import load_scenario

ROOT = Path(__file__).parents[2]
RATE = 1000.0


def scan_of(cycles: float, controller: str = "") -> Scan:
    return Scan(low=1e-6, peak_to_peak=10e-6, frequency=1.0, cycles=cycles, controller=controller)


def test_statistics_of_three_samples() -> None:
    error = tracking_error(np.array([3.0, 0.0, 0.0]), np.array([0.0, 4.0, 0.0]), stroke=50.0)
    assert error is not None
    assert error.rms == pytest.approx(5.0 / math.sqrt(3.0))
    assert error.maximum == 4.0
    assert error.mean == pytest.approx(-1.0 / 3.0)  # below the reference counts positive
    assert error.rms_percent == pytest.approx(10.0 / math.sqrt(3.0))
    assert error.maximum_percent == pytest.approx(8.0)


def test_sine_of_amplitude_a_has_rms_a_over_root_two() -> None:
    time = np.arange(2000) / RATE
    error = tracking_error(2e-9 * np.sin(2 * np.pi * time), np.zeros(2000), stroke=1e-6)
    assert error is not None
    assert error.rms == pytest.approx(2e-9 / math.sqrt(2.0))


def test_gaps_do_not_count() -> None:
    error = tracking_error(np.array([1.0, np.nan, 1.0, 5.0]), np.array([0.0, 0.0, np.nan, 4.0]), stroke=1.0)
    assert error is not None
    assert (error.rms, error.maximum, error.samples) == (1.0, 1.0, 2)
    assert tracking_error(np.array([np.nan]), np.array([1.0]), 1.0) is None


def test_no_stroke_gives_no_percentage() -> None:
    error = tracking_error(np.array([1.0]), np.array([0.0]), stroke=0.0)
    assert error is not None
    assert math.isnan(error.rms_percent)
    assert math.isnan(error.maximum_percent)


def test_controllers_and_settling_of_phases() -> None:
    phases = (
        VoltageRamp(to=150.0, duration=1.0),
        Move(to=1e-6, duration=0.5),
        Move(to=2e-6, duration=0.5, controller="pi"),
        scan_of(3.0),
        scan_of(1.0, "inverse"),
    )
    found = stretches(Experiment(phases, RATE, 100).spans())
    assert [s.controller for s in found] == ["", "open_loop", "pi", "pi", "inverse"]
    assert [s.number for s in found] == [1, 2, 3, 4, 5]
    assert found[0].begin == pytest.approx(0.1)  # the first block is the hold at the start
    assert found[3].settled - found[3].begin == pytest.approx(1.0)
    assert found[4].settled == found[4].begin  # a single cycle has nothing to leave out


def stretch(cycles: float, begin: float = 0.0) -> Stretch:
    return Stretch(4, scan_of(cycles), "pi", begin, begin + cycles, begin + 1.0)


def test_first_cycle_is_left_out_and_reported_apart() -> None:
    time = np.arange(4000) / RATE
    displacement = np.where(time < 1.0, -8e-9, -2e-9)
    found = track(stretch(4.0), time, np.zeros(4000), {"truth": displacement, "measurement": displacement - 1e-9})
    assert found is not None
    assert found.settled["truth"].rms == pytest.approx(2e-9)
    assert found.settled["truth"].samples == 3000
    assert found.settled["measurement"].rms == pytest.approx(3e-9)
    assert found.whole["truth"].rms == pytest.approx(1e-9 * math.sqrt((64 + 3 * 4) / 4))
    assert found.judged is found.settled["truth"]
    assert found.judged.rms_percent == pytest.approx(0.02)  # 2 nm of the scan's 10 um, whatever the reference did
    assert found.done == pytest.approx(1.0)


def test_phase_takes_its_own_samples_only() -> None:
    time = np.arange(6000) / 20e3 + 1.0  # sums of 50 us, rounded
    displacement = np.where((time > 1.09999) & (time < 1.19999), 0.0, 1.0)
    own = Stretch(1, Move(to=1e-6, duration=0.1), "pi", 1.1, 1.2, 1.1)
    found = track(own, time, np.zeros(6000), {"measurement": displacement})
    assert found is not None
    assert found.judged.samples == 2000
    assert found.judged.maximum == 0.0


def test_phase_cut_short() -> None:
    time = np.arange(600) / RATE
    found = track(stretch(4.0), time, np.zeros(600), {"truth": np.full(600, 1e-9)})
    assert found is not None
    assert found.done == pytest.approx(0.15)
    assert found.settled == {}
    assert found.judged.rms == pytest.approx(1e-9)  # of what there is
    assert track(stretch(4.0, begin=2.0), time, np.zeros(600), {"truth": np.zeros(600)}) is None


def test_the_demo_has_the_best_gains_of_the_search() -> None:
    with (ROOT / "benchmarks/results/pi_tuning.csv").open(encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row["rms_error_nm"]]
    controllers = load_scenario("demo").controllers
    for name in ("pi", "inverse_pi"):
        tried = [row for row in rows if row["controller"] == name]
        best = min(tried, key=lambda row: float(row["rms_error_nm"]))
        assert len(tried) >= 8
        for gain in ("proportional_gain", "integral_gain"):
            assert getattr(controllers[name], gain) == pytest.approx(float(best[gain]))
