"""Readings that stand alone are found, nothing else is taken for one, and no figure goes by them."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from pzt_ros.diagnosis.data import FIT, split
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.remains import Remains, remains_of
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.spikes import spikes_of, told, without_spikes

NOISE = 10e-9
TIME = 1e-3 * np.arange(20_000)


def noise(seed: int = 1) -> Array:
    return NOISE * np.random.default_rng(seed).standard_normal(TIME.size)


def triangle() -> Array:
    """0 to 100 V in half a second, and back."""
    return 50.0 * (1.0 - signal.sawtooth(2.0 * math.pi * TIME, 0.5))


def staircase() -> Array:
    return 20.0 * ((TIME // 0.5) % 5)


def ringing(voltage: Array) -> Array:
    """A stage with a mode of 180 Hz, hardly damped [m]."""
    omega = 2.0 * math.pi * 180.0
    _, out, _ = signal.lsim(([omega**2], [1.0, 0.02 * omega, omega**2]), 1e-7 * voltage, TIME, interp=False)
    return np.asarray(out)


def record(displacement: Array, voltage: Array | None = None) -> Record:
    drive = triangle() if voltage is None else voltage
    return Record("run", {"time_s": TIME, "voltage_V": drive, "displacement_m": displacement})


PLANTED = {
    "a lost reading": {4000: -1.0},
    "two together": {4000: -1.0, 4001: -0.5},
    "three together": {4000: 1.0, 4001: 2.0, 4002: 1.0},
    "one up and one down": {4000: 1.0, 4001: -1.0},
    "several": {300: 0.2, 4000: -1.0, 7000: 3.0, 19_000: 0.2},
    "at a tip of the triangle": {10_000: 0.3},
}


@pytest.mark.parametrize("planted", PLANTED.values(), ids=PLANTED)
def test_readings_that_stand_alone_are_found_and_replaced(planted: dict[int, float]) -> None:
    clean = 1e-7 * triangle() + noise()
    shaken = clean.copy()
    shaken[list(planted)] += 1e-6 * np.array(list(planted.values()))
    mended, found = without_spikes(record(shaken))
    spikes = found["displacement_m"]
    assert spikes.places.tolist() == sorted(planted)
    assert spikes.heights == pytest.approx(1e-6 * np.array([planted[k] for k in sorted(planted)]), abs=120e-9)
    assert mended.displacement == pytest.approx(clean, abs=120e-9)


@pytest.mark.parametrize(
    "motion",
    [
        lambda: 1e-7 * triangle(),
        lambda: 1e-7 * staircase(),
        lambda: ringing(staircase()),
        lambda: 5e-6 * np.sin(2.0 * math.pi * 210.0 * TIME),
        lambda: 1e-6 * np.random.default_rng(5).standard_normal(TIME.size),
    ],
    ids=["triangle", "steps", "steps that ring", "fast sine", "much noise"],
)
@pytest.mark.parametrize("scale", [0.0, 1.0], ids=["clean", "noisy"])
def test_no_motion_is_taken_for_readings_that_stand_alone(motion, scale: float) -> None:  # type: ignore[no-untyped-def]
    for seed in range(5):
        found = spikes_of(motion() + scale * noise(seed), triangle())
        assert found.places.size == 0


def test_what_the_drive_does_for_one_sample_is_no_spike() -> None:
    voltage = triangle()
    voltage[5000] += 30.0
    assert spikes_of(1e-7 * voltage + noise(), voltage).places.size == 0
    assert spikes_of(1e-7 * voltage + noise(), triangle()).places.tolist() == [5000]


def test_the_last_digits_of_a_simulated_reading_are_no_spikes() -> None:
    rough = 1e-7 * triangle()
    rough[[3000, 7001]] += 5e-10
    assert spikes_of(rough, triangle()).places.size == 0
    rough[5100] += 5e-9
    assert spikes_of(rough, triangle()).places.tolist() == [5100]


def test_a_row_that_was_lost_as_a_whole_is_mended_as_a_whole() -> None:
    clean, voltage = 1e-7 * triangle() + 3e-6 + noise(), triangle()
    shaken = clean.copy()
    for place in (4300, 7150, 7151):
        shaken[place] = voltage[place] = 0.0
    mended, found = without_spikes(record(shaken, voltage))
    assert found["displacement_m"].places.tolist() == [4300, 7150, 7151]
    assert mended.voltage == pytest.approx(triangle(), abs=1e-9)
    assert mended.displacement == pytest.approx(clean, abs=120e-9)


def test_what_is_zero_for_longer_was_so() -> None:
    voltage = np.where((TIME > 5.0) & (TIME < 5.01), 0.0, triangle() + 20.0)
    run = record(1e-7 * voltage, voltage)
    assert without_spikes(run) == (run, {})


def test_what_comes_too_often_is_noise() -> None:
    shaken = 1e-7 * triangle() + noise()
    shaken[10:-10:20] += 1e-6
    assert spikes_of(shaken, triangle()).places.size == 0


def test_a_run_keeps_its_fingerprint_and_is_mended_once() -> None:
    shaken = 1e-7 * triangle() + noise()
    shaken[4000] = 0.0
    run = record(shaken)
    mended, found = without_spikes(run)
    assert mended.sha256 == run.sha256
    assert without_spikes(mended) == (mended, {})
    assert told(run, found) == [
        "run: 1 reading stands alone and does not count in displacement_m, farthest off is "
        f"{abs(found['displacement_m'].heights[0]) * 1e9:.3g} nm at 4 s"
    ]
    calm = record(1e-7 * triangle() + noise())
    assert without_spikes(calm) == (calm, {})


def remains(heights: dict[int, float], wave: float = 0.0) -> Remains:
    """Of a run that a straight line describes but for these readings and a wave of so many times the noise."""
    shaken = 1e-7 * triangle() + noise() + math.sqrt(2.0) * wave * NOISE * np.sin(2.0 * math.pi * 3.0 * TIME)
    for place, height in heights.items():
        shaken[place] += height
    (run,) = split(with_floors([record(shaken)]), [])
    assert not np.intersect1d(run.picks[FIT], list(heights)).size
    return remains_of([run], [run.record.displacement - 1e-7 * run.record.voltage], 1.05, 2.0)


def test_a_few_are_a_remark_many_are_something_that_remains() -> None:
    few = remains({4000: 200e-9})
    assert (few.present, few.what_is_seen) == (False, "")
    many = remains({place: 1e-6 for place in range(500, 19_500, 200)})
    assert many.present
    assert many.only_spikes
    assert many.times_noise == pytest.approx(1.0, abs=0.02)
    assert many.what_is_seen.startswith("95 readings stand alone and do not count, the farthest")
    assert many.what_is_seen.endswith("1.00 x the noise floor is left")
    both = remains({4000: 5e-6}, wave=2.0)
    assert both.present
    assert not both.only_spikes
    assert "between 2.19 and 6.5 Hz" in both.what_is_seen
    assert "1 reading stands alone and does not count" in both.what_is_seen


def test_measured_strain_gauge_has_them() -> None:
    """Seen in a picture: single readings of 0.2 to 0.4 um against the way of the motion, on a noise of 20 nm."""
    path = Path(__file__).parents[3] / "shared/data/afm-x-stage-strain-gauge/triangle6_sine10_0_150V.csv"
    if not path.exists():
        pytest.skip("no measured data")
    from pzt_ros.records import read_csv

    run = read_csv(path)
    _, found = without_spikes(run)
    spikes = found["displacement_m"]
    assert {2458, 2593, 2606, 3048, 3427, 4158, 4169} <= set(spikes.places.tolist())
    assert spikes.places.size < 0.01 * len(run)
    against = np.sign(spikes.heights) != np.sign(np.gradient(run.voltage)[spikes.places])
    assert np.mean(against) > 0.9


def test_a_record_with_a_part_cut_out_is_another() -> None:
    shaken = 1e-7 * triangle() + noise()
    shaken[4000] = 0.0
    mended, _ = without_spikes(record(shaken))
    assert dataclasses.replace(mended, fingerprint="").sha256 != mended.sha256
    assert mended.between(5.0, 10.0).sha256 == record(shaken).between(5.0, 10.0).sha256
