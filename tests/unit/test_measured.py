"""The page of the measured runs: its splits, its pieces against cases with a known answer; the runs where they are."""

from __future__ import annotations

import itertools
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from pzt_benchmarks.measured import __main__ as command
from pzt_benchmarks.measured import ceramic, ring
from pzt_benchmarks.measured.judged import row
from pzt_benchmarks.measured.sets import CERAMIC, HOLD, SETS, RunSet, averaged
from pzt_benchmarks.measured.ties import trials
from pzt_benchmarks.measured_runs import DATA
from pzt_ros.diagnosis.checks import check_runs
from pzt_ros.diagnosis.data import SCORE, SELECTION, RunData
from pzt_ros.records import Record


def test_train_and_test_share_no_sample() -> None:
    for which in SETS:
        for a, b in itertools.combinations((*which.train, which.test), 2):
            assert a.file != b.file or a.end <= b.start or b.end <= a.start, which.title


def test_means_of_samples() -> None:
    record = Record("made", {"time_s": np.arange(7.0), "voltage_V": np.arange(7.0) ** 2})
    found = averaged(record, 3)
    np.testing.assert_allclose(found.time, [1.0, 4.0])
    np.testing.assert_allclose(found.voltage, [5.0 / 3.0, 50.0 / 3.0])
    assert averaged(record, 1) is record


def test_error_of_a_row_is_of_its_part() -> None:
    time = np.arange(4.0)
    record = Record("made", {"time_s": time, "voltage_V": time, "displacement_m": 1e-6 * time})
    run = RunData(record, {SELECTION: np.array([0, 1]), SCORE: np.array([2, 3])}, 2e-9)
    found = row("model", run, 1e-9 * np.array([3.0, -3.0, 6.0, 6.0]))
    assert found.cells() == ("model", "3", "6", "0.200", "3.00")


def test_ring_of_a_known_frequency_is_found() -> None:
    time = np.arange(0.0, 0.2, 2e-4)
    on = time > 0.0999
    after = np.where(on, time - 0.1, 0.0)
    decay = np.exp(-after / 0.01) * np.cos(2.0 * math.pi * 871.0 * after)
    record = Record("made", {"time_s": time, "voltage_V": -87.0 * on, "displacement_m": 1e-6 * on * decay})
    assert ring.switch_on(record) == np.argmax(on)
    _, frequency, amplitude = ring.frequencies(record)
    np.testing.assert_allclose(frequency[:5], 871.0, atol=12.0)
    assert np.all(np.diff(amplitude[:5]) < 0.0)


def test_strain_law_finds_factors_and_zeros() -> None:
    """Two records with zeros of their own, made by the law itself."""
    random = np.random.default_rng(3)
    records, truth = [], (0.03, -0.06)
    for zero in truth:
        time = np.linspace(0.0, 1.0, 200)
        voltage = 1400.0 * np.sin(2.0 * math.pi * time)
        p = 0.2 * np.sin(2.0 * math.pi * time - 0.8)
        true_p, field = p + zero, voltage / ceramic.THICKNESS
        displacement = 3e-5 * true_p**2 + 1e-12 * field * true_p + random.normal(0.0, 1e-10) + 5e-8
        columns = {"time_s": time, "voltage_V": voltage, "displacement_m": displacement, "polarization_C_per_m2": p}
        records.append(Record("made", columns))
    factors, zeros = ceramic._law("P² + E·P", records, [np.ones(200, dtype=bool)] * 2)
    np.testing.assert_allclose(factors, [3e-5, 1e-12], rtol=1e-5)
    np.testing.assert_allclose(zeros, truth, atol=1e-6)


def test_every_trial_undoes_what_it_does() -> None:
    time = np.arange(0.0, 2.0, 0.005)
    voltage, displacement = 1.8 * (1.0 - np.cos(math.pi * time)), 2e-5 * np.sin(2.0 * math.pi * time)
    record = Record("made", {"time_s": time, "voltage_V": voltage, "displacement_m": displacement})
    for trial in trials(4e-5):
        seen_voltage, seen = trial.undone(record, 0.0)
        np.testing.assert_allclose(trial.done(record, seen), displacement, atol=1e-13, err_msg=trial.size)
        late = 200 - round(trial.delay / 0.005 * 2) / 2
        assert seen_voltage[200] == pytest.approx(np.interp(late, np.arange(time.size), voltage), abs=1e-9)


def test_the_command_says_that_it_skips(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(command, "DATA", tmp_path / "nowhere")
    monkeypatch.setattr(sys, "argv", ["measured", "--out", str(tmp_path / "docs")])
    command.main()
    assert capsys.readouterr().out.startswith("skipped: no measured runs in ")
    assert not (tmp_path / "docs").exists()


@pytest.mark.skipif(not DATA.is_dir(), reason="measured runs are not here")
@pytest.mark.parametrize("which", SETS, ids=lambda which: which.key)
def test_the_runs_can_be_diagnosed(which: RunSet) -> None:
    """Every cut is there, and neither too short nor of another actuator."""
    check_runs([cut.record(DATA) for cut in which.train], [which.test.record(DATA)])


@pytest.mark.skipif(not DATA.is_dir(), reason="measured runs are not here")
def test_ceramic_has_what_the_strain_law_needs() -> None:
    for cut in (*CERAMIC.train, CERAMIC.test, HOLD):
        assert cut.record(DATA).polarization is not None
