"""Densities identified with the polarization that was recorded beside the displacement."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from pzt_ros.sysid.identified_fit import IdentifiedFit
from pzt_ros.sysid.identified_problem import IdentifiedProblem, MeasuredRun, rms_of
from pzt_ros.sysid.rate_independent import RateIndependentHysteresis

THICKNESS, NOISE, COARSE = 1e-4, 10e-9, 3e-4
LINEAR, QUADRATIC = 1e-4, 9e-5  # m/(C/m^2), m/(C/m^2)^2
LEAKAGE = 2e-5  # C/(m^2 V s)


def run(seed: int) -> MeasuredRun:
    """Plays with a strain that bends, and their polarization behind a leak and a zero of its own."""
    dice = np.random.default_rng(seed)
    corners = np.concatenate(([0.0, 100.0, 0.0], dice.uniform(0.0, 100.0, 20)))
    voltage = np.concatenate([np.linspace(a, b, 60, endpoint=False) for a, b in itertools.pairwise(corners)])
    time = 0.005 * np.arange(float(voltage.size))
    radii = np.arange(1, 20) * 2.5
    plays, polarization = np.zeros(radii.size), np.empty(voltage.size)
    for k, v in enumerate(voltage):
        plays = np.clip(plays, v - radii, v + radii)
        polarization[k] = 4e-4 * v + 2e-4 * float(np.exp(-radii / 15.0) @ plays)
    displacement = LINEAR * polarization + QUADRATIC * polarization**2
    recorded = polarization - 0.03 + LEAKAGE * np.cumsum(0.005 * voltage)
    return MeasuredRun(
        time,
        voltage,
        displacement + dice.normal(0.0, NOISE, time.size),
        NOISE,
        np.arange(time.size) > 3,
        False,
        polarization=recorded + dice.normal(0.0, COARSE, time.size),
        polarization_noise=COARSE,
    )


def relays(runs: list[MeasuredRun]) -> IdentifiedProblem:
    base = RateIndependentHysteresis([each.time for each in runs], THICKNESS, (0.0, 1e6), unknown_start=[False, False])
    return IdentifiedProblem(base, runs, order=2, lag=False, drift=True)


def test_jacobian_of_both_readings() -> None:
    problem = relays([run(1), dataclasses.replace(run(2), polarization=np.empty(0))])
    vector = problem.with_law_guess(problem.start)
    residuals, jacobians = problem.linearise(vector)
    assert [each.size for each in residuals] == [2 * (run(1).time.size - 4), run(2).time.size - 4]
    assert problem.polarization_scale is not None
    columns: list[int] = [
        0,
        5,
        40,
        problem.law.start,
        problem.law.start + 1,
        problem.polarization_scale,
        problem.offsets,
        vector.size - 1,
    ]
    for column in columns:
        step = 1e-4 * max(abs(vector[column]), 1e-9)
        moved = [vector + way * step * (np.arange(vector.size) == column) for way in (1.0, -1.0)]
        above, below = (np.concatenate(problem.residuals(each)) for each in moved)
        expected = (above - below) / (2.0 * step)
        found = np.concatenate([jacobian[:, column] for jacobian in jacobians])
        size = max(float(np.max(np.abs(expected))), 1e-9)
        np.testing.assert_allclose(found, expected, rtol=0, atol=0.01 * size, err_msg=problem.names[column])


def test_the_law_is_that_of_the_recorded_polarization() -> None:
    """Between a law that bends and a density that does a displacement hardly decides; its scale it does not know."""
    fit = IdentifiedFit(THICKNESS, (18,), (1.0,), (2,), base=RateIndependentHysteresis)
    found = fit.fit([run(1), run(2)])
    assert rms_of(found.residuals) < 1.1
    assert found.problem.polarization_scale is not None
    scale = float(found.vector[found.problem.polarization_scale])
    polarization = np.concatenate(
        found.problem.base.polarization(found.vector, [each.voltage for each in found.problem.runs])
    )
    low, high = np.percentile(scale * polarization, [1.0, 99.0])
    true = np.concatenate(
        [each.polarization - LEAKAGE * np.cumsum(0.005 * each.voltage) for each in found.problem.runs]
    )
    assert high - low == pytest.approx(np.ptp(np.percentile(true, [1.0, 99.0])), rel=0.02)
    _, linear, quadratic = found.law
    bend = quadratic / scale**2 / QUADRATIC
    assert bend == pytest.approx(1.0, abs=0.1)
    assert linear > 0.0
