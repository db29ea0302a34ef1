"""Instruments that play a record: the same numbers in the same time, its end, and records that do not fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bag_making import block_values, check_one_line, write_run
from driver_benches import RATE, SIZE, record

from pzt_ros.chains import load_chain
from pzt_ros.errors import BenchError
from pzt_ros.hardware.driver import Bench
from pzt_ros.hardware.guard import DISABLED, ENABLED, RAMPING, GuardedAmplifier, Limits
from pzt_ros.hardware.replay import ReplayAmplifier, ReplayAmplifierSettings, ReplaySensor, ReplaySensorSettings
from pzt_ros.physics.signals import Rest
from pzt_ros.records import Record, read_csv, write_csv
from pzt_ros.reference import block_times


def opened(path: Path, rate: float = RATE) -> tuple[ReplayAmplifier, ReplaySensor]:
    bench = Bench(load_chain("thesis-p2"), Rest(), rate, SIZE)
    amplifier = ReplayAmplifierSettings(record=str(path)).build(bench)
    sensor = ReplaySensorSettings(record=str(path)).build(bench)
    amplifier.open()
    sensor.open()
    return amplifier, sensor


def play(amplifier: ReplayAmplifier, sensor: ReplaySensor, blocks: int, rate: float = RATE) -> dict[str, np.ndarray]:
    """What both say over a run of so many blocks, whatever is asked of them."""
    columns: dict[str, list[np.ndarray]] = {"voltage": [], "current": [], "charge": [], "displacement": []}
    for block in range(blocks):
        time = block_times(block, SIZE, rate)
        applied = amplifier.apply(time, np.full(SIZE, 99.0))
        for name in ("voltage", "current", "charge"):
            columns[name].append(getattr(applied, name))
        columns["displacement"].append(sensor.read(time, np.full(SIZE, 1.0)))
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def test_a_csv_run_is_played_sample_by_sample(tmp_path: Path) -> None:
    path = record(tmp_path)
    run = read_csv(path)
    amplifier, sensor = opened(path)
    assert amplifier.voltage == run.voltage[0]
    played = play(amplifier, sensor, len(run) // SIZE)
    np.testing.assert_array_equal(played["voltage"], run.voltage)
    np.testing.assert_array_equal(played["current"], run.current)
    np.testing.assert_array_equal(played["displacement"], run.displacement)
    np.testing.assert_allclose(np.diff(played["charge"]), run.current[1:] / RATE, rtol=1e-9, atol=1e-18)
    assert amplifier.remark == sensor.remark == ""


def test_at_the_end_the_last_sample_is_held_and_it_is_said(tmp_path: Path) -> None:
    path = record(tmp_path, count=25)
    run = read_csv(path)
    played = play(*(pair := opened(path)), 5)
    np.testing.assert_array_equal(played["voltage"][:25], run.voltage)
    assert set(played["voltage"][25:]) == {run.voltage[-1]}
    assert set(played["displacement"][25:]) == {run.displacement[-1]}
    for driver in pair:
        assert driver.remark == f"{path} is over after 0.024 s: holding its last sample"


def test_a_bag_is_played_as_it_was_recorded(tmp_path: Path) -> None:
    write_run(tmp_path / "bag", blocks=6)
    played = play(*opened(tmp_path / "bag", rate=3.0), 6, rate=3.0)
    applied = np.concatenate([block_values("/stage/applied", number) for number in range(6)])
    measured = np.concatenate([block_values("/stage/measurement", number) for number in range(6)])
    np.testing.assert_array_equal(played["voltage"], applied[:, 1])
    np.testing.assert_array_equal(played["current"], applied[:, 2])
    np.testing.assert_array_equal(played["displacement"], measured[:, 1])


def test_a_record_without_current_reads_as_no_current(tmp_path: Path) -> None:
    run = read_csv(record(tmp_path))
    write_csv(Record("run", {k: run[k] for k in ("time_s", "voltage_V", "displacement_m")}), tmp_path / "bare.csv")
    played = play(*opened(tmp_path / "bare.csv"), 3)
    assert not played["current"].any()
    assert not played["charge"].any()


@pytest.mark.parametrize("rate", [500.0, 999.0, 1001.0, 20e3])
def test_another_sample_rate_is_refused_in_one_line(tmp_path: Path, rate: float) -> None:
    with pytest.raises(BenchError) as caught:
        opened(record(tmp_path), rate)
    check_one_line(caught.value, "sampled at 1000 Hz", f"{rate:.6g} Hz throughout", "set sample_rate, or resample")


def test_uneven_sampling_is_refused_and_the_sample_named(tmp_path: Path) -> None:
    run = read_csv(record(tmp_path))
    columns = {name: np.delete(values, 17) for name, values in run.columns.items()}
    write_csv(Record("run", columns), tmp_path / "uneven.csv")
    with pytest.raises(BenchError) as caught:
        opened(tmp_path / "uneven.csv")
    check_one_line(caught.value, "uneven.csv", "sample 18 at 3.018 s")


def test_a_record_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(BenchError) as caught:
        opened(tmp_path / "none.csv")
    check_one_line(caught.value, "none.csv", "no such file")


def test_that_no_record_is_named_is_said() -> None:
    bench = Bench(load_chain("thesis-p2"), Rest(), RATE, SIZE)
    for settings in (ReplayAmplifierSettings(), ReplaySensorSettings()):
        with pytest.raises(BenchError) as caught:
            settings.build(bench).open()
        check_one_line(caught.value, "set the parameter replay.record")


def test_behind_the_guard_it_starts_at_the_recorded_voltage(tmp_path: Path) -> None:
    amplifier, _ = opened(record(tmp_path, voltage=60.0))
    guard = GuardedAmplifier(amplifier, Limits(slew_rate=2e4), RATE, SIZE)
    assert guard.enable() == ""
    assert guard.command_voltage == pytest.approx(60.0)
    for _ in range(100):
        assert guard.apply(guard.next_block * SIZE / RATE, np.zeros(SIZE)) is not None
    assert guard.state == ENABLED
    assert "is over" in amplifier.remark
    guard.disable()
    while guard.state == RAMPING:
        guard.ramp()
    assert guard.state == DISABLED
