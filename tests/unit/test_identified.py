"""The identified hysteresis: tangent, recovery of what another lattice was made with, unknown starts."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from pzt_ros.errors import BenchError
from pzt_ros.physics.identified_hats import nodes_of
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.sysid.identified import LOG_SETTLING, LOG_TIME, LOG_WIDTH, SUSCEPTIBILITY, WEIGHTS, IdentifiedHysteresis
from pzt_ros.sysid.identified_fit import IdentifiedFit, IdentifiedResult
from pzt_ros.sysid.identified_problem import IdentifiedProblem, MeasuredRun, rms_of
from pzt_ros.sysid.thinning import kept_samples

THICKNESS = 1e-4
NOISE = 12e-9
GAIN = 183.4e-6  # [m^5/C^2]


def minor_loops(seed: int, duration: float, rate: float) -> tuple[Array, Array]:
    """Ramps between random voltages, some holds [s, V]."""
    random = np.random.default_rng(seed)
    times, voltages = [0.0], [0.0]
    while times[-1] < duration:
        if random.uniform() < 0.2:
            times.append(times[-1] + random.uniform(0.05, 0.4))
            voltages.append(voltages[-1])
        voltages.append(random.uniform(-40.0, 140.0))
        times.append(times[-1] + abs(voltages[-1] - voltages[-2]) / 10 ** random.uniform(1.8, 3.3))
    time = np.arange(0.0, duration, 1.0 / rate)
    return time, np.interp(time, times, voltages)


def hysteresis(unknown: bool = True) -> tuple[IdentifiedHysteresis, list[Array], Array]:
    """Two runs, one of them with a known start, their voltages, and a vector away from the first guess."""
    random = np.random.default_rng(1)
    (time, voltage), (late, other) = minor_loops(1, 1.0, 500.0), minor_loops(2, 0.6, 700.0)
    late = late + np.cumsum(random.uniform(0.0, 1e-3, late.size))
    base = IdentifiedHysteresis(
        [time, late], THICKNESS, (-0.5e6, 1.5e6), unknown_start=[False, unknown], resolution=4, fine_lines=65
    )
    vector = base.start.copy()
    vector[SUSCEPTIBILITY:] *= random.uniform(0.4, 1.6, vector.size - SUSCEPTIBILITY)
    return base, [voltage, other], vector


def test_columns_are_the_derivatives() -> None:
    """Central differences of the polarization, one coordinate after the other."""
    base, voltages, vector = hysteresis()
    here, jacobians = base.tangent(vector, voltages)
    for one, other in zip(here, base.polarization(vector, voltages), strict=True):
        np.testing.assert_array_equal(one, other)
    for column, name in enumerate(base.names):
        step = 1e-3 * (1.0 if column < SUSCEPTIBILITY else abs(vector[column]))
        up, down = vector.copy(), vector.copy()
        up[column] += step
        down[column] -= step
        pairs = zip(base.polarization(up, voltages), base.polarization(down, voltages), jacobians, strict=True)
        for above, below, jacobian in pairs:
            expected = (above - below) / (2.0 * step)
            size = max(np.max(np.abs(expected)), 1e-6)
            np.testing.assert_allclose(jacobian[:, column], expected, rtol=0, atol=2e-3 * size, err_msg=name)


def test_columns_of_the_kinetics_take_few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a densely sampled run with slow legs, steps and holds; against differences at all samples."""
    time = np.arange(0.0, 8.0, 1e-3)
    voltage = 60.0 - 60.0 * np.cos(1.5 * time) + np.where(time > 5.0, 30.0 * np.sin(7.0 * (time - 5.0)), 0.0)
    voltage[6500:7200], voltage[7200:] = 50.0, 90.0
    base = IdentifiedHysteresis([time], THICKNESS, (0.0, 1.5e6), unknown_start=[False], resolution=6)
    vector = base.start.copy()
    vector[LOG_TIME] = math.log(0.02)  # felt in the holds
    asked: list[int] = []
    run = IdentifiedHysteresis._run

    def counted(self: IdentifiedHysteresis, *given: Any) -> Array:
        asked.append(given[-1].size)
        return run(self, *given)

    with monkeypatch.context() as patch:
        patch.setattr(IdentifiedHysteresis, "_run", counted)
        _, (jacobian,) = base.tangent(vector, [voltage])
    assert max(asked) < 0.4 * time.size
    for column in (LOG_TIME, LOG_WIDTH):
        up, down = vector.copy(), vector.copy()
        up[column] += 1e-3
        down[column] -= 1e-3
        expected = (base.polarization(up, [voltage])[0] - base.polarization(down, [voltage])[0]) / 2e-3
        assert np.max(np.abs(jacobian[:, column] - expected)) < 0.02 * np.max(np.abs(expected))
        assert np.std(jacobian[:, column] - expected) < 0.003 * np.std(expected)


def test_link_says_what_was_fitted() -> None:
    """Fit and prediction are the same numbers, also where the start is unknown."""
    base, voltages, vector = hysteresis()
    link = base.link(vector)
    for run, (voltage, polarization) in enumerate(zip(voltages, base.polarization(vector, voltages), strict=True)):
        time = base.times[run]
        state = link.init(Rest(float(time[0]), float(voltage[0]), occupancy=base.occupancy(vector, run)))
        _, out = link.step(state, Signals(time, voltage))
        np.testing.assert_array_equal(out.polarization, polarization)
    assert base.occupancy(vector, 0).size == 0
    assert base.occupancy(vector, 1).size == sum("run 1 occupancy" in name for name in base.names)
    assert link.relaxation_time == math.exp(vector[LOG_TIME])
    assert link.thermal_field == math.exp(vector[LOG_WIDTH])
    assert link.settling_time == math.exp(vector[LOG_SETTLING])


def test_coordinates_fit_together() -> None:
    base, _, _ = hysteresis()
    assert len(set(base.names)) == len(base.names)
    for array in (base.start, base.lower, base.upper):
        assert array.shape == (len(base.names),)
    assert np.all(base.lower <= base.start)
    assert np.all(base.start <= base.upper)
    assert base.names[WEIGHTS] == "weight 0 0"
    base.rotation_strength = 1.0
    rows, targets = base.regularisation()
    assert rows.shape == (targets.size, len(base.names))
    assert np.linalg.matrix_rank(rows) == len(base.names) - 1  # the susceptibility alone is left free
    even = base.start.copy()
    even[WEIGHTS] *= 2.0
    assert np.sum((rows @ even - targets) ** 2) > np.sum((rows @ base.start - targets) ** 2)


def test_what_stays_as_it_is_does_not_count_in_the_sum() -> None:
    """Else what switches shrank in its favour, by 14 in the court, and every prior on it with it."""
    base, _, _ = hysteresis()
    base.weight_strength = base.smoothness_strength = 0.0
    rows, targets = base.regularisation()

    def cost(vector: Array) -> float:
        return float(np.sum((rows @ vector - targets) ** 2))

    nodes = nodes_of(base.grid.size)
    low, high = base.field_range
    switched = [base.grid[down] >= low and base.grid[up] <= high for up, down in nodes]
    assert 0 < sum(switched) < len(switched)
    for place, counts in enumerate(switched):
        vector = base.start.copy()
        vector[WEIGHTS + place] *= 3.0
        assert (cost(vector) > cost(base.start) + 1.0) == counts


def test_a_grid_that_reaches_farther_has_more_lines_and_none_that_are_wider_apart() -> None:
    time = np.arange(10.0)
    spacings = [
        np.diff(each.link(each.start).lines)[0]
        for each in (
            IdentifiedHysteresis([time], THICKNESS, (-0.2e6, 1.5e6), unknown_start=[unknown], fine_lines=80)
            for unknown in (True, False)  # the start of one that is not known may be any, that of the other is virgin
        )
    ]
    assert spacings[1] == pytest.approx(spacings[0], rel=0.02)
    assert spacings[0] == pytest.approx(1.3 * 1.7e6 / 80)


def test_no_range_no_lattice() -> None:
    time = np.arange(10.0)
    with pytest.raises(BenchError, match="is empty"):
        IdentifiedHysteresis([time], THICKNESS, (1.0, 1.0), unknown_start=[True])
    with pytest.raises(BenchError, match="a word on its start"):
        IdentifiedHysteresis([time], THICKNESS, (0.0, 1.0), unknown_start=[])
    base, voltages, vector = hysteresis()
    voltages[0][7] = np.nan
    with pytest.raises(BenchError, match="run 0, sample 7"):
        base.polarization(vector, voltages)


def test_problem_derivatives() -> None:
    """With law, lag and drift on top; the centring moves with the vector, too."""
    base, voltages, vector = hysteresis()
    runs = [
        MeasuredRun(time, voltage, np.zeros(time.size), 1e-8, np.arange(time.size) > 20)
        for time, voltage in zip(base.times, voltages, strict=True)
    ]
    problem = IdentifiedProblem(base, runs, order=3, lag=True, drift=True)
    law = [3e-6, 1e-6, -2e-7, 1.3e-3, 1e-6, 2e-7, -1e-6, 1e-7]
    point = np.concatenate((vector, law))
    assert point.size == len(problem.names)
    _, jacobians = problem.linearise(point)
    for column in (LOG_TIME, LOG_WIDTH, SUSCEPTIBILITY, WEIGHTS + 7, WEIGHTS + 20, *range(point.size - 8, point.size)):
        step = 1e-3 * (1.0 if column < SUSCEPTIBILITY else abs(point[column]))
        up, down = point.copy(), point.copy()
        up[column] += step
        down[column] -= step
        pairs = zip(problem.residuals(up), problem.residuals(down), jacobians, strict=True)
        for above, below, jacobian in pairs:
            expected = (above - below) / (2.0 * step)
            size = max(np.max(np.abs(expected)), 1e-3)
            name = problem.names[column]
            np.testing.assert_allclose(jacobian[:, column], expected, rtol=0, atol=0.02 * size, err_msg=name)


def plain_lattice() -> Lattice:
    return Lattice(coercive_field=0.5e6, coercive_field_spread=2e11, interaction_field_spread=1e11, accuracy=1e-5)


def measured(seed: int, duration: float, history: list[float]) -> tuple[MeasuredRun, Array]:
    """A run of the plain lattice after some reversals [V] that nobody knows of, and its true displacement."""
    truth = plain_lattice()
    time, voltage = minor_loops(seed, duration, 500.0)
    before = np.arange(1.0, len(history) + 1.0) - len(history) - 1.0
    state = truth.init(Rest(time=before[0] - 1.0))
    state, _ = truth.step(state, Signals(before, np.array(history)))
    _, out = truth.step(state, Signals(time, voltage))
    displacement = GAIN * out.polarization**2
    noise = NOISE * np.random.default_rng(seed).normal(size=time.size)
    return MeasuredRun(time, voltage, displacement + noise + 3e-6, NOISE, np.ones(time.size, dtype=bool)), displacement


@pytest.fixture(scope="module")
def found() -> IdentifiedResult:
    """A fit to one run that begins inside unknown minor loops."""
    run, _ = measured(5, 12.0, [150.0, -30.0, 110.0, 10.0, 80.0, 0.0])
    return IdentifiedFit(THICKNESS, resolutions=(12,), rotations=(0.0,)).fit([run])


def test_unknown_start_is_fitted_to_the_noise(found: IdentifiedResult) -> None:
    assert rms_of(found.residuals) < 1.05


def test_relaxation_time_and_thermal_field_are_found(found: IdentifiedResult) -> None:
    """From a first guess that is twice and half of the truth; the two trade against each other."""
    truth = plain_lattice()
    assert found.link.thermal_field == pytest.approx(truth.thermal_width, rel=0.1)
    assert math.log(found.link.relaxation_time / truth.relaxation_time) == pytest.approx(0.0, abs=0.7)


def test_another_run_is_predicted(found: IdentifiedResult) -> None:
    """Settled on its first third only, the rest comes out to a few times the noise, of 8 um of motion."""
    run, displacement = measured(6, 9.0, [150.0, -20.0, 0.0])
    early = np.arange(run.time.size) < run.time.size // 3
    prediction = found.predict(run.part(early))
    error = (prediction - displacement)[~early]
    assert np.std(error) < 4.0 * NOISE
    assert np.ptp(displacement) > 400.0 * NOISE


def test_law_in_polarization(found: IdentifiedResult) -> None:
    """The coefficients over the link's polarization give what the centred law gives."""
    problem = found.problem
    run = problem.runs[0]
    state = found.link.init(Rest(run.time[0], run.voltage[0], occupancy=problem.base.occupancy(found.vector, 0)))
    _, out = found.link.step(state, Signals(run.time, run.voltage))
    displacement = np.polynomial.Polynomial(found.law)(out.polarization) + found.vector[problem.offsets]
    np.testing.assert_allclose(displacement, problem.predict(found.vector)[0], rtol=0, atol=1e-12)


def test_choice_is_reported(found: IdentifiedResult) -> None:
    assert found.choices[0].resolution == 12
    assert found.choices[0].train == pytest.approx(1.0, abs=0.05)
    still = dataclasses.replace(found.problem.runs[0], voltage=np.zeros(found.problem.runs[0].time.size))
    with pytest.raises(BenchError, match="voltage that moves"):
        IdentifiedFit(THICKNESS).fit([still])


def test_thinned_run_keeps_the_drive() -> None:
    time, voltage = minor_loops(3, 5.0, 2000.0)
    kept = kept_samples(time, voltage, 5.0, 0.5, 0.05)
    assert kept.size < time.size / 5
    assert kept[0] == 0
    assert kept[-1] == time.size - 1
    assert np.max(np.abs(np.interp(time, time[kept], voltage[kept]) - voltage)) <= 0.05 * (1 + 1e-9)
    assert np.max(np.diff(time[kept])) <= 0.5 + 1e-3
