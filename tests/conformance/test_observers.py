"""One battery for every observer: whoever stands in the table of observers is tested here, unasked."""

from __future__ import annotations

import copy
import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.errors import BenchError
from pzt_ros.observers.disturbance import DisturbanceObserver
from pzt_ros.observers.hysteresis import HysteresisObserver
from pzt_ros.observers.observer import Estimate, Observer
from pzt_ros.observers.table import OBSERVERS, find_observer
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameters_of, to_si

COUNT = 60
TIME = np.arange(COUNT) / 20e3
VOLTAGE = 50.0 * (1.0 - np.cos(2 * np.pi * 1.3 * np.arange(COUNT) / COUNT))
SERIES = ("time", "displacement", "polarization", "phase_fraction", "innovation", "disturbance")


@pytest.fixture(params=OBSERVERS.values(), ids=OBSERVERS.keys())
def observer(request: pytest.FixtureRequest) -> Observer:
    """One observer after the other, with its default gains."""
    return request.param()


@pytest.fixture(scope="module")
def model() -> Chain:
    return load_chain("thesis-p2")


def measured(model: Chain, noise: float = 0.0) -> np.ndarray:
    """What the model itself would read [m], with an offset, a drift and noise."""
    _, out = model.step(model.init(Rest()), Signals(TIME, VOLTAGE))
    return out.displacement + 3e-6 + 1e-5 * TIME + noise * np.random.default_rng(1).normal(size=COUNT)


def pieces(observer: Observer, model: Chain, measurement: np.ndarray, cuts: list[int]) -> tuple[Any, list[Estimate]]:
    state, estimates = observer.init(model, Rest()), []
    for begin, end in itertools.pairwise(cuts):
        state, estimate = observer.update(model, state, TIME[begin:end], VOLTAGE[begin:end], measurement[begin:end])
        estimates.append(estimate)
    return state, estimates


@pytest.mark.parametrize("kind", OBSERVERS)
def test_gains_are_declared(kind: str) -> None:
    cls = OBSERVERS[kind]
    assert find_observer(kind) is cls
    assert cls.kind == kind
    assert cls.__doc__
    declared = parameters_of(cls)
    assert set(declared) == {f.name for f in dataclasses.fields(cls)}
    for name, parameter in declared.items():
        assert to_si(1 if parameter.unit == "1" else f"1 {parameter.unit}", parameter.unit, name) == 1.0
        assert len(parameter.description) > 5
        assert math.isfinite(parameter.lower)
        assert math.isfinite(parameter.upper)
        assert parameter.lower <= getattr(cls(), name) <= parameter.upper


def test_estimate_is_a_block_of_finite_numbers(observer: Observer, model: Chain) -> None:
    _, (estimate,) = pieces(observer, model, measured(model, 2e-8), [0, COUNT])
    for name in SERIES:
        values = getattr(estimate, name)
        assert values.shape == (COUNT,), name
        assert values.dtype == np.float64, name
        assert np.all(np.isfinite(values)), name
    np.testing.assert_array_equal(estimate.time, TIME)


def test_update_changes_nothing_it_was_given(observer: Observer, model: Chain) -> None:
    state, _ = pieces(observer, model, measured(model), [0, 20])
    arguments = (state, TIME[20:].copy(), VOLTAGE[20:].copy(), measured(model)[20:])
    kept = copy.deepcopy(arguments)
    _, first = observer.update(model, *arguments)
    for before, now in zip(kept[1:], arguments[1:], strict=True):
        np.testing.assert_array_equal(before, now)
    _, second = observer.update(model, *kept)  # from the copy of the state
    _, third = observer.update(model, *arguments)  # from the state that was used already
    for name in SERIES:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), err_msg=name)
        np.testing.assert_array_equal(getattr(first, name), getattr(third, name), err_msg=name)


def test_blocks_may_be_cut(observer: Observer, model: Chain) -> None:
    """Anywhere but into single samples, which do not say how long a sample is; the rest is rounding of that length."""
    _, (whole,) = pieces(observer, model, measured(model, 2e-8), [0, COUNT])
    _, parts = pieces(observer, model, measured(model, 2e-8), [0, 2, 9, 30, COUNT])
    for name in SERIES:
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_allclose(joined, getattr(whole, name), rtol=1e-12, atol=1e-18, err_msg=name)


@pytest.mark.parametrize(
    ("knowing", "tolerance"), [(DisturbanceObserver(), 1e-18), (HysteresisObserver(members=1.0), 1e-11)]
)
def test_true_model_leaves_no_innovation(knowing: Observer, tolerance: float, model: Chain) -> None:
    """The measurement is the model plus a constant: after the first sample there is nothing new in it.

    Of the observers that take the stage to be at rest at first, that is; one of them weighs the first sample against
    what it thought of the offset, which leaves 1e-7 of it.
    """
    _, out = model.step(model.init(Rest()), Signals(TIME, VOLTAGE))
    measurement = out.displacement + 3e-6
    _, (estimate,) = pieces(knowing, model, measurement, [0, COUNT])
    assert np.max(np.abs(estimate.innovation[1:])) < tolerance
    np.testing.assert_allclose(estimate.displacement, measurement, rtol=0, atol=tolerance)
    np.testing.assert_array_equal(estimate.polarization, out.polarization)


@pytest.mark.parametrize("first", [0, 20])
def test_missing_samples_leave_no_trace(observer: Observer, model: Chain, first: int) -> None:
    """A reading that is no number tells nothing, wherever it comes: everything stays finite, and goes on."""
    whole = measured(model, 2e-8)
    holes = whole.copy()
    holes[first : first + 10], holes[40], holes[50] = np.nan, np.inf, -np.inf
    _, parts = pieces(observer, model, holes, [0, 10, 30, COUNT])
    for part in parts:
        for name in SERIES:
            assert np.all(np.isfinite(getattr(part, name))), name
    assert np.all(np.concatenate([part.innovation for part in parts])[first : first + 10] == 0.0)
    np.testing.assert_allclose(parts[-1].displacement[-5:], whole[-5:], rtol=0, atol=1.5e-7)


def test_single_samples_are_blocks_too(observer: Observer, model: Chain) -> None:
    """A disturbance that grows is followed as in longer blocks."""
    growing = measured(model) + 2e-3 * TIME
    _, (whole,) = pieces(observer, model, growing, [0, COUNT])
    _, parts = pieces(observer, model, growing, [0, *range(2, COUNT + 1)])
    joined = np.concatenate([part.disturbance for part in parts])
    np.testing.assert_allclose(joined, whole.disturbance, rtol=1e-9, atol=1e-15)
    assert abs(joined[-1] - joined[0]) > 1e-8


def test_innovation_is_measurement_minus_prediction(observer: Observer, model: Chain) -> None:
    """Whatever is measured in a sample, its innovation differs by just that; earlier ones do not know of it."""
    one, other = measured(model), measured(model)
    other[30] += 1e-7
    _, (a,) = pieces(observer, model, one, [0, COUNT])
    _, (b,) = pieces(observer, model, other, [0, COUNT])
    np.testing.assert_array_equal(a.innovation[:30], b.innovation[:30])
    assert b.innovation[30] - a.innovation[30] == pytest.approx(1e-7, rel=1e-9)


def test_unknown_observer_is_named() -> None:
    with pytest.raises(BenchError, match="unknown observer 'kalman'; known are disturbance, hysteresis"):
        find_observer("kalman")
