"""A tone whose phase wanders is there all the same; one that is gone is not."""

from __future__ import annotations

import numpy as np
import pytest

from pzt_ros.diagnosis.data import SCORE, SELECTION, RunData
from pzt_ros.diagnosis.unsteady import is_unsteady
from pzt_ros.effects.mains_hum import MainsHum
from pzt_ros.physics.chain import Chain
from pzt_ros.records import Record

NOISE, TONE, RATE = 1e-8, 4e-8, 1000.0


@pytest.mark.parametrize(("size", "is_there"), [(1.0, True), (0.0, False)])
@pytest.mark.parametrize("frequency", [50.0, 57.3])
def test_a_tone_that_wanders_is_there_and_one_that_is_gone_is_not(
    size: float, frequency: float, is_there: bool
) -> None:
    """An examiner's hum turned half round from the half of a run that told it to the other, which it foretold worse."""
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    late = time >= 10.0
    phase = np.where(late, np.pi * np.minimum((time - 10.0) / 2.0, 1.0), 0.0)
    left = np.where(late, size, 1.0) * TONE * np.sin(2 * np.pi * frequency * time + phase)
    left += NOISE * rng.standard_normal(time.size)
    base = 3.0 * TONE * np.sin(2 * np.pi * 0.4 * time)  # beside a hum another density is fitted
    told = left - base - TONE * np.sin(2 * np.pi * frequency * time)
    picks = {SELECTION: np.flatnonzero(~late), SCORE: np.flatnonzero(late)}
    run = RunData(Record("run", {"time_s": time, "voltage_V": time, "displacement_m": left}), picks, NOISE)
    assert np.std(told[late]) > np.std(left[late])  # so it would be taken back
    model = Chain("stage", (MainsHum(frequency=frequency, sine=TONE),))
    assert is_unsteady(model, [run], [left], [told]) is is_there


def test_without_what_scores_there_is_nothing_to_be_heard_in() -> None:
    time = np.arange(0.0, 1.0, 1.0 / RATE)
    run = RunData(Record("run", {"time_s": time, "voltage_V": time, "displacement_m": time}), {}, NOISE)
    assert not is_unsteady(Chain("stage", (MainsHum(),)), [run], [time], [time])
