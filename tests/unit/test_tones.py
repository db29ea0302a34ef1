"""A hum stands out of whatever else is left, and the lines of a drive that repeats itself are none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.data import FIT, SELECTION, RunData
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.tones import with_hum
from pzt_ros.effects.mains_hum import MainsHum
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.bouc_wen import BoucWen
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.records import Record

NOISE, HUM, RATE, SECONDS = 3e-9, 4e-9, 500.0, 12.0
WRONG = Chain("stage", (BoucWen(), StrainLaw(linear=1e-4)))


def _run(drive: Array, hum: float, part: str, seed: int) -> RunData:
    """A stage whose hysteresis is none of the model's, 30 x the noise away from it, with a hum or without."""
    rng = np.random.default_rng(seed)
    time = np.arange(drive.size) / RATE
    late = 4e-9 * np.convolve(drive, np.ones(40) / 40.0, "same")
    bent = 6e-8 * np.abs(np.sin(drive / 9.0)) * np.sign(np.gradient(drive))
    reading = late + bent + hum * np.sin(2 * np.pi * 50.02 * time + seed) + NOISE * rng.standard_normal(time.size)
    columns = {"time_s": time, "voltage_V": drive, "displacement_m": reading}
    return RunData(Record(f"run {seed}", columns), {part: np.arange(time.size)}, NOISE)


def _random(seed: int) -> Array:
    rng = np.random.default_rng(100 + seed)
    knots = np.arange(0.0, SECONDS + 0.2, 0.2)
    return np.interp(np.arange(0.0, SECONDS, 1.0 / RATE), knots, rng.uniform(0.0, 100.0, knots.size))


def _triangle(seed: int) -> Array:
    """At 5 Hz, so that what is left has its tenth harmonic at 50 Hz."""
    phase = np.arange(0.0, SECONDS, 1.0 / RATE) * 5.0 % 1.0
    return (80.0 + seed) * (1.0 - np.abs(2.0 * phase - 1.0))


@pytest.mark.parametrize(
    ("drive", "hum", "is_named"), [(_random, HUM, True), (_random, 0.0, False), (_triangle, HUM, False)]
)
def test_a_hum_is_named_beside_far_more_that_is_left_unless_the_drive_has_lines(
    drive: Callable[[int], Array], hum: float, is_named: bool
) -> None:
    runs = [_run(drive(k), hum, part, k) for k, part in enumerate((FIT, FIT, SELECTION))]
    base = begun(WRONG, runs)
    assert min(base.ratios) > 3.0  # a hum is a small part of that
    found = with_hum(Branch("none", base, ()), Thresholds(), IN_THIS_PROCESS)
    assert found.final.effects == (("mains_hum",) if is_named else ())
    if is_named:
        links = found.final.staged.chain_at(found.final.vector).links
        (detuning,) = [link.detuning for link in links if isinstance(link, MainsHum)]
        assert detuning == pytest.approx(0.02, abs=0.005)
        assert found.steps[-1].verdict.startswith("a line at 50.02 Hz")
