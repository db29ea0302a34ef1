"""The conductor: every sample once, whole blocks, the shapes of the phases, and who is told what when."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from pzt_ros.experiments.experiment import Experiment
from pzt_ros.experiments.phases import PHASES, Move, Phase, Scan, VoltageRamp
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference, block_times

RATE, SIZE = 1000.0, 10
HERE, VOLTS = 7e-6, 0.0
"""Where the stage is, as the tests tell the conductor [m, V]."""


def run(phases: Sequence[Phase], rate: float = RATE, size: int = SIZE) -> list[Reference]:
    """Every reference of a scenario whose first block is number 1, as in the graph."""
    experiment = Experiment(phases, rate, size)
    references: list[Reference] = []
    while (reference := experiment.step(len(references) + 1, HERE, VOLTS)) is not None:
        references.append(reference)
    assert experiment.phase is None
    assert experiment.step(len(references) + 1, HERE, VOLTS) is None, "the end stays the end"
    return references


def values_of(phases: Sequence[Phase], rate: float = RATE, size: int = SIZE) -> np.ndarray:
    return np.concatenate([reference.values for reference in run(phases, rate, size)])


def test_block_times_are_exact() -> None:
    for rate, size in ((20e3, 100), (1000.0, 10), (3.0, 7)):
        joined = np.concatenate([block_times(block, size, rate) for block in range(50)])
        np.testing.assert_array_equal(joined, np.arange(50 * size) / rate)
    assert block_times(10**9, 100, 20e3)[0] == 5e6, "no drift in the long run"


@pytest.mark.parametrize("size", [2, 10, 64])
def test_stamps_follow_one_another(size: int) -> None:
    references = run([VoltageRamp(to=10.0, duration=0.13), Move(to=1e-6, duration=0.07)], size=size)
    joined = np.concatenate([reference.time for reference in references])
    np.testing.assert_array_equal(joined, np.arange(size, size + joined.size) / RATE)
    assert all(reference.time.shape == reference.values.shape == (size,) for reference in references)


def test_ramp_is_linear_and_phases_join() -> None:
    """Up and down in 20 samples each: every step is half a volt, none is missing and none comes twice."""
    values = values_of(
        [VoltageRamp(to=10.0, duration=0.02, shape="linear"), VoltageRamp(to=0.0, duration=0.02, shape="linear")]
    )
    expected = np.concatenate((np.arange(1, 21), np.arange(19, -1, -1))) * 0.5
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12)


def test_half_sine() -> None:
    """Thesis, appendix B: from one voltage to the next along half a period of a sine."""
    values = values_of([VoltageRamp(to=150.0, duration=0.1), VoltageRamp(to=-40.0, duration=0.2)])
    t = np.arange(1, 301) / RATE
    up = 75.0 + 75.0 * np.sin(np.pi * (t[:100] - 0.05) / 0.1)
    down = 55.0 - 95.0 * np.sin(np.pi * (t[100:] - 0.2) / 0.2)
    np.testing.assert_allclose(values, np.concatenate((up, down)), rtol=0, atol=1e-10)
    assert values[99] == 150.0
    assert values[-1] == -40.0


def test_a_ramp_to_where_it_is_holds() -> None:
    values = values_of([VoltageRamp(to=5.0, duration=0.01), VoltageRamp(to=5.0, duration=0.03)])
    np.testing.assert_array_equal(values[10:], np.full(30, 5.0))


def test_move_starts_where_the_stage_is() -> None:
    t = np.arange(1, 51) / RATE
    wave = 0.5 + 0.5 * np.sin(np.pi * (t - 0.025) / 0.05)
    values = values_of([VoltageRamp(to=1.0, duration=0.01), Move(to=2e-6, duration=0.05)])
    np.testing.assert_allclose(values[10:], HERE + (2e-6 - HERE) * wave, rtol=0, atol=1e-18)
    again = values_of([Move(to=1e-6, duration=0.05), Move(to=2e-6, duration=0.05)])
    np.testing.assert_allclose(again[50:], 1e-6 + 1e-6 * wave, rtol=0, atol=1e-18)


def test_triangle() -> None:
    values = values_of([Scan(low=2e-6, peak_to_peak=10e-6, frequency=5.0, cycles=2.0)])
    samples = np.arange(1, 401)
    expected = np.interp(samples, [0, 100, 200, 300, 400], [2e-6, 12e-6, 2e-6, 12e-6, 2e-6])
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-17)
    assert values[-1] == 2e-6


def test_sine_scan() -> None:
    values = values_of([Scan(low=2e-6, peak_to_peak=10e-6, frequency=5.0, cycles=2.0, shape="sine")])
    t = np.arange(1, 401) / RATE
    np.testing.assert_allclose(values, 7e-6 - 5e-6 * np.cos(2 * np.pi * 5.0 * t), rtol=0, atol=1e-17)


@pytest.mark.parametrize("kind", PHASES)
def test_every_phase_is_a_row_of_the_table(kind: str) -> None:
    assert PHASES[kind].kind == kind
    assert PHASES[kind].quantity in (VOLTAGE, DISPLACEMENT)


@pytest.mark.parametrize(("duration", "blocks"), [(0.001, 1), (0.01, 1), (0.0101, 2), (0.025, 3), (0.03, 3)])
def test_phases_take_whole_blocks(duration: float, blocks: int) -> None:
    """Rounded up, with the last value held; a duration of whole blocks is not rounded up by its rounding error."""
    references = run([VoltageRamp(to=3.0, duration=duration, shape="linear"), VoltageRamp(to=0.0, duration=0.01)])
    assert len(references) == blocks + 1
    values = np.concatenate([reference.values for reference in references[:blocks]])
    moving = int(np.floor(duration * RATE + 1e-9))  # samples before the end of the ramp, or at it
    np.testing.assert_allclose(values[:moving], 3.0 * np.arange(1, moving + 1) / (duration * RATE), rtol=1e-9)
    np.testing.assert_array_equal(values[moving + 1 :], 3.0)
    assert values[-1] == 3.0


@pytest.mark.parametrize("blocks", range(1, 400, 7))
def test_no_duration_of_whole_blocks_is_rounded_up(blocks: int) -> None:
    ramp = VoltageRamp(to=1.0, duration=blocks * 100 / 20e3)
    assert Experiment([ramp], 20e3, 100).length == pytest.approx(blocks * 100 / 20e3, rel=1e-12)


PHASES_OF_ALL_KINDS = (
    VoltageRamp(to=10.0, duration=0.023),
    Move(to=1e-6, duration=0.04, controller="pi"),
    Scan(low=1e-6, peak_to_peak=2e-6, frequency=50.0, cycles=1.5, controller="inverse"),
    Scan(low=1e-6, peak_to_peak=2e-6, frequency=50.0, cycles=0.0),
    VoltageRamp(to=0.0, duration=0.01),
)


def test_spans_say_what_step_does() -> None:
    experiment = Experiment(PHASES_OF_ALL_KINDS, RATE, SIZE)
    spans = experiment.spans(first_block=4)
    assert [phase for phase, _, _ in spans] == list(PHASES_OF_ALL_KINDS)
    block = 4
    for phase, begin, end in spans:
        assert begin == block_times(block, SIZE, RATE)[0]
        while experiment.phase is phase:
            reference = experiment.step(block, HERE, VOLTS)
            assert reference is not None
            assert reference.quantity == phase.quantity
            assert begin <= reference.time[0] < reference.time[-1] < end
            block += 1
        assert end == block_times(block, SIZE, RATE)[0]
    assert experiment.length == pytest.approx(spans[-1][2] - spans[0][1], rel=1e-12)


def test_a_controller_is_named_once() -> None:
    references = run(PHASES_OF_ALL_KINDS)
    assert [r.controller for r in references] == ["", "", "", "pi", "", "", "", "inverse", "", "", "", ""]
    assert [r.quantity for r in references] == [VOLTAGE] * 3 + [DISPLACEMENT] * 8 + [VOLTAGE]


def test_no_phase_is_the_end() -> None:
    assert run([]) == []
    assert Experiment([], RATE, SIZE).length == 0.0


def test_a_voltage_ramp_after_a_displacement_begins_at_the_voltage_found() -> None:
    phases = [Move(to=2e-6, duration=1e-3), VoltageRamp(to=0.0, duration=1e-3, shape="linear")]
    experiment = Experiment(phases, 20e3, 10)
    blocks = [experiment.step(number, HERE, 33.0) for number in (1, 2, 3, 4)]
    ramp = np.concatenate([block.values for block in blocks[2:] if block is not None])
    np.testing.assert_allclose(ramp, 33.0 * (1 - np.arange(1, 21) / 20), atol=1e-12)
