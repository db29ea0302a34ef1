"""The tracking benchmark: its stage, its loop, its verdicts and its page; the figures are not judged here."""

from __future__ import annotations

import numpy as np
import pytest

from pzt_benchmarks import full_plant, tracking
from pzt_benchmarks.__main__ import ALL, BENCHMARKS
from pzt_benchmarks.report import Provenance
from pzt_benchmarks.table import MET, NOT_MET
from pzt_benchmarks.tracking_rig import FRONT, LOW, PLANT, QUIET, RATE, STROKE, WRONG_FRONT, Rig, Tracked, triangle
from pzt_benchmarks.unknown_histories import history, scan
from pzt_ros.controllers.inverse import Inverse
from pzt_ros.controllers.open_loop import OpenLoop
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import Link


def test_it_is_found_by_name_only() -> None:
    assert BENCHMARKS["tracking"] == "tracking"
    assert BENCHMARKS["observer"] == "unknown_histories"
    assert not {"tracking", "observer"} & set(ALL)


def test_the_stage_is_that_of_methods_md() -> None:
    """About 42 x 68 domains (where they are cut differs a little), a triangle from 0.8 to 10.8 um."""
    lattice: Link = PLANT.links[0]
    assert isinstance(lattice, Lattice)
    coercive, interaction = lattice.nodes()
    assert abs(coercive[0].size - 42) <= 4
    assert abs(interaction[0].size - 68) <= 4
    reference = triangle(10.0, 2.0)
    assert (reference.min(), reference.max()) == pytest.approx((0.8e-6, 10.8e-6))
    assert reference.size == 4000
    assert np.allclose(np.abs(np.diff(reference)), 2 * STROKE * 10.0 / RATE)
    assert reference[-1] == pytest.approx(LOW)


def test_a_model_that_is_the_stage_is_followed_exactly() -> None:
    run = Rig(Inverse(), FRONT, plant=FRONT, sensor=QUIET).run(100.0, 2.0)
    assert run.settled(0)[1] < 0.02
    wrong = Rig(Inverse(), WRONG_FRONT, plant=FRONT, sensor=QUIET).run(100.0, 1.0)
    assert wrong.settled(0)[0] > 1.0


def test_a_straight_line_knows_nothing_of_the_loop() -> None:
    line = OpenLoop(gain=6e-8, voltage_at_zero=-20.0)
    assert Rig(line, FRONT, plant=FRONT, sensor=QUIET).run(100.0, 2.0).settled(200)[0] > 5.0


def test_error_is_in_percent_of_the_stroke() -> None:
    run = Tracked(np.full(4, 5e-6), np.array([5e-6, 4.9e-6, 5.1e-6, 4.9e-6]), np.zeros(4), 0.0)
    np.testing.assert_allclose(run.error, [0.0, 1.0, -1.0, 1.0], atol=1e-9)
    assert run.settled(1) == pytest.approx((1.0, 1.0))


def test_verdicts_and_page() -> None:
    kept = tracking.Row("observer-based, front", {10.0: (0.04, 0.2)}, {10.0: 0.05}, seconds=1e-4)
    quiet = tracking.Row(tracking.QUIET_FRONT, {10.0: (0.03, 0.2)})
    missed = tracking.Row("observer-based, lattice", {10.0: (0.06, 0.2)}, {10.0: 0.05})
    assert (kept.verdict, missed.verdict) == (MET, NOT_MET)
    assert kept.cells()[:3] == ("observer-based, front", "0.040 (≤ 0.05) / 0.20", MET)
    pi = tracking.Row("best PI of each frequency", {10.0: (0.24, 1.0)})
    wrong = tracking.Row("observer-based, front, wrong", {10.0: (0.14, 0.4)}, {10.0: 0.15})
    line = tracking.Row("linear open loop", {10.0: (15.0, 30.0)})
    rows = [line, pi, kept, quiet, missed, wrong]
    learned = [np.geomspace(2.0, 0.02, 11)]
    tables = [tracking._tracking_table(rows, [10.0]), tracking._learning_table(learned, rows)]
    full = [full_plant.Followed("observer-based", {5.0: 0.06, 150.0: 0.167}, {})]
    page = tracking.page(Provenance("command", "m", "v", "c", "d"), tracking.Outcome(rows, {}, learned, full, tables))
    assert "Limits not met: observer-based, lattice." in page
    assert "10.0 at 5 Hz, 10.0 at 150 Hz" in page
    assert "| error down, mean of the seeds | 100 times | ≥ 50 times | met |" in page


def test_histories_end_where_the_scan_begins() -> None:
    random = np.random.default_rng(3)
    time, voltage = scan(random)
    past, levels = history(random, float(voltage[0]))
    assert past.size == levels.size
    assert np.all(np.diff(past) > 0.0)
    assert past[-1] < time[0]
    assert levels[-1] == voltage[0]
    assert levels.min() >= -40.0
    assert levels.max() <= 150.0


def test_a_rounded_triangle_is_smooth_and_has_its_stroke() -> None:
    for frequency in (5.0, 150.0):
        path = full_plant.rounded_triangle(frequency, 3.0)
        assert np.min(path) == pytest.approx(full_plant.LOW, abs=1e-11)
        assert np.ptp(path) == pytest.approx(full_plant.STROKE, rel=2e-3)
        speed = np.diff(path) * RATE
        turn = 2.0 * np.max(np.abs(speed)) / (2.0 * full_plant.TURN / frequency)  # mean acceleration
        assert np.max(np.abs(np.diff(speed) * RATE)) < 2.05 * turn
        flank = np.abs(speed) > 0.999 * np.max(np.abs(speed))
        assert np.mean(flank) == pytest.approx(1.0 - 4.0 * full_plant.TURN, abs=0.05)


def test_measured_runs_carry_what_the_amplifier_takes() -> None:
    record = full_plant.measured("steps", ((100.0, 5e-3), (100.0, 0.02), (0.0, 5e-3)), RATE, 3)
    held = (record.time > 0.01) & (record.time < 0.024)
    assert np.all(record.voltage[held] < 99.9), "the capacitor takes its share"
    assert np.all(record.voltage[held] > 95.0)
    assert 0.5e-6 < np.mean(record["displacement_m"][held]) < 10e-6
    assert np.all(np.isin(np.round(record["displacement_m"] / 1e-7, 6) % 1.0, 0.0)), "steps of the sensor"


def test_the_identified_model_is_driven_through_its_amplifier() -> None:
    model = full_plant.to_control_with(full_plant.GUESS)
    assert [link.kind for link in model.links][:2] == ["amplifier", "lattice"]
    assert "thermal_drift" not in {link.kind for link in model.links}
    assert {link.noise_rms for link in model.links if link.kind == "displacement_sensor"} == {0.0}
