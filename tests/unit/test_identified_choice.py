"""What chooses between identified densities, and that a fit along a tangent never ends worse than it began."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from pzt_ros.diagnosis.hypothesis import exact, fitted
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.sysid.identified_fit import IdentifiedFit
from pzt_ros.sysid.identified_problem import MeasuredRun

THICKNESS = 1e-4
NOISE = 12e-9


def run_to(amplitude: float, seed: int) -> MeasuredRun:
    """Three triangles from 0 V."""
    time = np.arange(0.0, 1.2, 4e-3)
    voltage = amplitude * np.interp(time % 0.4, [0.0, 0.2, 0.4], [0.0, 1.0, 0.0])
    ceramic = Lattice(layer_thickness=THICKNESS)
    polarization = ceramic.step(ceramic.init(Rest()), Signals(time=time, voltage=voltage))[1].polarization
    noise = np.random.default_rng(seed).normal(0.0, NOISE, time.size)
    return MeasuredRun(time, voltage, 183.4e-6 * polarization**2 + noise, NOISE, np.ones(time.size, bool), False)


@pytest.fixture(scope="module")
def small_fit() -> IdentifiedFit:
    return IdentifiedFit(
        THICKNESS,
        resolutions=(5,),
        rotations=(0.0, 10.0),
        orders=(2, 3),
        fine_lines=(60, 60),
        voltage_range=(0.0, 150.0),
    )


def test_samples_that_neither_count_nor_choose_are_not_looked_at(small_fit: IdentifiedFit) -> None:
    run = run_to(150.0, 1)
    early = run.time < 0.8
    spoilt = replace(run, measured=np.where(early, run.measured, 1.0), counted=early)
    clean = small_fit.fit([replace(run, counted=early)])
    found = small_fit.fit([spoilt])
    np.testing.assert_array_equal(found.vector, clean.vector)
    assert found.choices == clean.choices


def test_another_run_chooses(small_fit: IdentifiedFit) -> None:
    """Its error stands in the choices, and what was chosen does about as well as any."""
    train, other = run_to(150.0, 1), run_to(90.0, 2)
    found = small_fit.fit([train], [other])
    assert {choice.order for choice in found.choices} == {2, 3}
    assert found.choices[0].both <= 1.02 * min(choice.both for choice in found.choices)
    assert found.choices[0].train == pytest.approx(1.0, abs=0.2)
    spoilt = small_fit.fit([train], [replace(other, measured=other.measured + 1e-6 * (other.time > 0.6))])
    assert min(choice.held_out for choice in spoilt.choices) > 10.0 * found.choices[0].held_out


def test_what_does_not_switch_is_bounded(small_fit: IdentifiedFit) -> None:
    """A stage without hysteresis asks for no domains; the law behind has any scale, and P ran to 1e48 C/m^2 once."""
    run = run_to(150.0, 1)
    noise = np.random.default_rng(0).normal(0.0, NOISE, run.time.size)
    found = small_fit.fit([replace(run, measured=8e-8 * run.voltage + noise)])
    base = found.problem.base
    (polarization,) = base.polarization(found.vector[: found.problem.law.start], [run.voltage])
    assert found.choices[0].train == pytest.approx(1.0, abs=0.1)
    assert np.max(np.abs(polarization)) < 400.0 * base.total


@dataclass(frozen=True)
class Ceramic:
    """Only what `hypothesis` asks for."""

    start: Array


@dataclass(frozen=True)
class Cliff:
    """One unknown x; the residual 1 - x jumps to 10 beyond x = 1/2, which a tangent does not know."""

    ceramic: Ceramic
    far: float = np.inf
    at: float | None = None
    runs: tuple[Any, ...] = ()
    bounds: tuple[Array, Array] = (np.array([-5.0]), np.array([5.0]))
    prior: tuple[Array, Array] = (np.zeros((0, 1)), np.zeros(0))

    def exact_at(self, vector: Array) -> Cliff:
        return replace(self, ceramic=Ceramic(vector), at=float(vector[0]))

    def for_one_search(self) -> Cliff:
        return self

    def residuals(self, vector: Array) -> list[Array]:
        x = float(vector[0])
        here = x if self.at is None else self.at
        return [np.array([10.0 if here > 0.5 else 1.0 - x])]

    def linearise(self, vector: Array) -> tuple[list[Array], list[Array]]:
        return self.residuals(vector), [np.array([[-1.0]])]


def test_a_step_that_makes_it_worse_is_taken_back() -> None:
    staged: Any = Cliff(Ceramic(np.zeros(1)))
    found = exact(fitted(staged, np.array([0.2]), most_steps=0))
    assert found.solution.vector[0] == pytest.approx(0.2)
    assert found.solution.cost == pytest.approx(0.64)
