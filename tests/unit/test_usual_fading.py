"""What dies out in a run of a stage that is poled before each, by what died out in the runs that were fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pzt_ros.physics.chain import Chain
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Array
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.records import Record
from pzt_ros.sysid.fading import fading_curves
from pzt_ros.sysid.run import Start, free_run
from pzt_ros.sysid.start import CountedPart
from pzt_ros.sysid.usual_fading import with_usual_fading

CHAIN = Chain("stage", (Preisach(), Electrostriction()))
NOISE, OFFSET = 10e-9, 3e-6
SIZES = np.array([0.0, 10e-9, 50e-9, -300e-9, 250e-9])  # of 0.1 to 26 s
ALIKE = [Start(fading=tuple(SIZES * share)) for share in (0.9, 1.0, 1.15)]


def read_without(record: Record, start: Start) -> Array:
    """What the chain says of a run, its noise left out [m]."""
    return free_run(CHAIN, record, start, np.arange(len(record)), len(record)).displacement


@pytest.fixture(scope="module")
def part() -> CountedPart:
    """The first half of 20 s of a run, in which that dies out."""
    time = np.arange(0.0, 20.0, 0.005)
    record = Record("run", {"time_s": time, "voltage_V": 70.0 - 70.0 * np.cos(time), "displacement_m": time})
    read = read_without(record, Start()) + OFFSET + fading_curves(time) @ SIZES
    read = read + NOISE * np.random.default_rng(1).standard_normal(time.size)
    record = replace(record, columns={**record.columns, "displacement_m": read})
    return CountedPart(record, np.arange(time.size // 2), time.size // 2, poled=True)


def late(part: CountedPart, start: Start) -> float:
    """What is left of the half that was not looked at [m]."""
    error = part.record.displacement - read_without(part.record, start)
    return float(np.sqrt(np.mean(error[part.end :] ** 2)))


def test_the_half_that_was_not_looked_at_is_predicted(part: CountedPart) -> None:
    """With the fastest four curves alone, as far as half a run tells them, it is off by several times the noise."""
    curves = np.column_stack((np.ones(part.picks.size), fading_curves(part.record.time)[part.picks][:, :4]))
    left = (part.record.displacement - read_without(part.record, Start()))[part.picks]
    offset, *sizes = np.linalg.lstsq(curves, left, rcond=None)[0]
    told = Start(offset=float(offset), fading=tuple(float(size) for size in sizes))
    found = with_usual_fading(CHAIN, part, told, ALIKE, NOISE)
    assert late(part, told) > 1.5 * NOISE
    assert late(part, found) < 1.1 * NOISE
    assert found.offset == pytest.approx(OFFSET, abs=3e-8)


@pytest.mark.parametrize("fitted", [ALIKE[:1], [Start(), Start()], [], [*ALIKE, Start(fading=tuple(-SIZES))]])
def test_runs_that_say_nothing_leave_it_as_it_is(part: CountedPart, fitted: list[Start]) -> None:
    told = Start(offset=OFFSET, fading=(1e-9,))
    assert with_usual_fading(CHAIN, part, told, fitted, NOISE) is told


def test_nothing_dies_out_where_nothing_was_looked_for(part: CountedPart) -> None:
    told = Start(offset=OFFSET)
    assert with_usual_fading(CHAIN, part, told, ALIKE, NOISE) is told
