"""Profile intervals against theory: +-1.96 standard errors for a linear model, closed forms and coverage for others."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Callable

import numpy as np
import pytest
from rich.console import Console

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.base import fit_declared
from pzt_ros.diagnosis.data import split
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.intervals import intervals
from pzt_ros.diagnosis.search import Search
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.covariance import parameter_covariance
from pzt_ros.sysid.fit import Fit
from pzt_ros.sysid.profile import BetterFitError, Interval, Profile
from pzt_ros.sysid.result import Estimate, FitResult
from pzt_ros.sysid.run import Start, free_run

Z = 1.959963984540054
WIDE = 1e9


@dataclasses.dataclass
class Toy:
    """Runs y = model(vector) + noise, with a Jacobian by differences."""

    measured: list[Array]
    model: Callable[[Array], list[Array]]

    def residuals(self, vector: Array) -> list[Array]:
        return [y - m for y, m in zip(self.measured, self.model(vector), strict=True)]

    def linearise(self, vector: Array) -> tuple[list[Array], list[Array]]:
        here = self.residuals(vector)
        columns = []
        for k in range(vector.size):
            step = np.zeros(vector.size)
            step[k] = 1e-5 * (abs(vector[k]) + 1.0)
            pairs = zip(self.residuals(vector + step), self.residuals(vector - step), strict=True)
            columns.append([(up - down) / (2.0 * step[k]) for up, down in pairs])
        return here, [np.column_stack(parts) for parts in zip(*columns, strict=True)]


def unbounded(count: int) -> tuple[Array, Array]:
    return np.full(count, -WIDE), np.full(count, WIDE)


def red(rng: np.random.Generator, count: int, memory: float) -> Array:
    """Noise that remembers itself."""
    noise = rng.standard_normal(count)
    for k in range(1, count):
        noise[k] += memory * noise[k - 1]
    return noise


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_a_linear_model_has_1_96_standard_errors_on_both_sides(memory: float) -> None:
    rng = np.random.default_rng(1)
    shapes = [np.column_stack([np.sin(np.arange(n) / 30.0), np.arange(n) / n, np.ones(n)]) for n in (900, 500)]
    truth = np.array([2.0, -3.0, 1.0])
    toy = Toy([s @ truth + red(rng, len(s), memory) for s in shapes], lambda vector: [s @ vector for s in shapes])
    start = np.linalg.lstsq(np.vstack(shapes), np.concatenate(toy.measured), rcond=None)[0]
    profile = Profile(toy, start, unbounded(3))
    residuals, jacobians = toy.linearise(start)
    stds = np.sqrt(np.diag(parameter_covariance(jacobians, residuals)[0]))
    for place in range(3):
        found = profile.interval(place)
        assert profile.std(place) == pytest.approx(stds[place], rel=1e-6)
        assert found.lower == pytest.approx(start[place] - Z * stds[place], abs=1e-3 * stds[place])
        assert found.upper == pytest.approx(start[place] + Z * stds[place], abs=1e-3 * stds[place])


def test_a_curved_model_of_one_parameter_has_its_closed_form() -> None:
    """y = e^u + noise: the squares rise by n (e^u - mean)^2, so the ends are ln(mean -+ 1.96 s), and not symmetric."""
    values = 1.0 + np.random.default_rng(2).standard_normal(40)
    toy = Toy([values], lambda vector: [np.full(40, np.exp(vector[0]))])
    profile = Profile(toy, np.array([0.1]), unbounded(1))
    mean, s = values.mean(), profile.std(0) * values.mean()  # d(e^u) = e^u du
    found = profile.interval(0)
    assert found.lower == pytest.approx(np.log(mean - Z * s), abs=0.01 * s)
    assert found.upper == pytest.approx(np.log(mean + Z * s), abs=0.01 * s)
    u = np.log(mean)
    assert found.lower is not None
    assert found.upper is not None
    assert u - found.lower > 1.2 * (found.upper - u)


def test_a_change_of_coordinates_changes_no_interval() -> None:
    """What a standard error cannot do: the interval of b in a e^(-b t) and in a e^(-t / c) are the same one."""
    t = np.linspace(0.0, 2.0, 60)
    y = 1.5 * np.exp(-0.8 * t) + 0.3 * np.random.default_rng(3).standard_normal(60)
    rate = Profile(Toy([y], lambda v: [v[0] * np.exp(-v[1] * t)]), np.array([1.5, 0.8]), unbounded(2))
    time = Profile(
        Toy([y], lambda v: [v[0] * np.exp(-t / v[1])]), np.array([1.5, 1.2]), (np.array([-9.0, 0.01]), np.full(2, 99.0))
    )
    of_rate, of_time = rate.interval(1), time.interval(1)
    assert of_rate.lower is not None
    assert of_rate.upper is not None
    assert of_time.upper == pytest.approx(1.0 / of_rate.lower, rel=0.01)
    assert of_time.lower == pytest.approx(1.0 / of_rate.upper, rel=0.01)
    wald = 1.0 / (rate.best.vector[1] - Z * rate.std(1))
    assert abs(time.best.vector[1] + Z * time.std(1) - wald) > 0.04 * wald


def test_coverage_of_a_curved_model_is_right_where_that_of_standard_errors_is_not() -> None:
    """300 simulated fits of e^(-t / c) to noise of half of it: 95 % within 3 binomial standard errors."""
    t = np.linspace(0.0, 1.0, 40)
    truth, runs = 2.0, 300
    rng = np.random.default_rng(4)
    low, high = np.array([0.01]), np.array([1e4])
    covered, above, below = 0, 0, 0
    for _ in range(runs):
        y = np.exp(-t / truth) + 0.5 * rng.standard_normal(t.size)
        profile = Profile(Toy([y], lambda v: [np.exp(-t / v[0])]), np.array([truth]), (low, high))
        found = profile.interval(0)
        covered += (found.lower or 0.0) <= truth <= (found.upper or np.inf)
        value, error = profile.best.vector[0], Z * profile.std(0)
        above, below = above + (truth > value + error), below + (truth < value - error)
    assert abs(covered / runs - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / runs)
    assert above / runs > 0.05  # each would have to be 0.025
    assert below == 0


def test_coverage_holds_for_residuals_that_remember() -> None:
    t = np.arange(400) / 400.0
    truth, runs = 1.0, 200
    rng = np.random.default_rng(5)
    covered = 0
    for _ in range(runs):
        y = np.exp(truth * t) + 0.1 * red(rng, t.size, 0.8)
        profile = Profile(Toy([y], lambda v: [np.exp(v[0] * t)]), np.array([truth]), unbounded(1))
        found = profile.interval(0)
        assert found.lower is not None
        assert found.upper is not None
        covered += found.lower <= truth <= found.upper
    assert covered / runs > 0.88  # ten samples that count as one, and their memory estimated from the run itself


def test_one_sided_where_a_bound_is_reached() -> None:
    """A share near 0: the data allow 0, which is its bound, and say how large it may be at most."""
    t = np.linspace(0.0, 1.0, 100)
    y = 0.02 * t + 0.2 * np.random.default_rng(6).standard_normal(100)
    toy = Toy([y], lambda v: [v[0] * t])
    free = Profile(toy, np.array([0.0]), unbounded(1)).interval(0)
    assert free.lower is not None
    assert free.lower < 0.0
    found = Profile(toy, np.array([0.01]), (np.zeros(1), np.ones(1))).interval(0)
    assert found.lower is None
    assert found.upper is not None
    assert found.upper < 1.0


def test_another_parameter_that_meets_its_bound_shortens_the_interval() -> None:
    """y = (a + b) t + b t^2 / 10, b <= its estimate: a cannot fall, for b would have to rise."""
    t = np.linspace(0.0, 1.0, 300)
    y = 2.0 * t + 0.1 * t**2 + 0.1 * np.random.default_rng(7).standard_normal(300)
    toy = Toy([y], lambda v: [(v[0] + v[1]) * t + 0.1 * v[1] * t**2])
    free = Profile(toy, np.ones(2), unbounded(2))
    a, b = free.best.vector
    wide = free.interval(0)
    bounded = Profile(toy, np.array([a, b]), (np.full(2, -WIDE), np.array([WIDE, b]))).interval(0)
    assert wide.lower is not None
    assert bounded.lower is not None
    assert bounded.upper is not None
    assert a - bounded.lower < 0.2 * (a - wide.lower)
    assert bounded.upper == pytest.approx(wide.upper, abs=0.02 * (a - wide.lower))


def test_what_changes_nothing_has_no_interval() -> None:
    y = 1.0 + 0.1 * np.random.default_rng(8).standard_normal(50)
    profile = Profile(Toy([y], lambda v: [np.full(50, v[0])]), np.array([1.0, 0.5]), (np.zeros(2), np.full(2, 5.0)))
    assert profile.interval(1) == Interval(None, None)


def test_a_direction_that_is_not_determined_goes_to_both_bounds() -> None:
    y = 1.0 + 0.1 * np.random.default_rng(9).standard_normal(50)
    toy = Toy([y], lambda v: [np.full(50, v[0] + v[1])])
    profile = Profile(toy, np.array([0.5, 0.5]), (np.full(2, -2.0), np.full(2, 3.0)))
    assert profile.interval(0) == Interval(None, None)


def test_an_interval_ends_where_a_link_refuses() -> None:
    y = 1.0 + 0.5 * np.random.default_rng(10).standard_normal(30)
    limit = y.mean() + 0.03

    def model(vector: Array) -> list[Array]:
        if vector[0] > limit:
            raise BenchError("too much")
        return [np.full(30, vector[0])]

    toy = Toy([y], model)
    profile = Profile(toy, np.array([y.mean() - 0.01]), unbounded(1))
    assert profile.interval(0).upper == pytest.approx(limit, abs=2e-3)


def test_a_better_fit_on_the_way_is_said() -> None:
    """Two valleys, the start in the shallow one."""
    toy = Toy(
        [np.zeros(60)], lambda v: [np.full(60, (v[0] ** 2 - 1.0) ** 2 + 0.3 * v[0] + 0.5) + np.linspace(-1, 1, 60)]
    )
    with pytest.raises(BetterFitError) as said:
        Profile(toy, np.array([0.9]), unbounded(1)).interval(0)
    assert said.value.args[0][0] < 0.0


def test_a_prior_narrows_as_data_would() -> None:
    """y = a with 25 samples of noise 1 and a prior as strong as 75 more at the mean: half of the interval."""
    y = np.random.default_rng(11).standard_normal(25)
    toy = Toy([y], lambda v: [np.full(25, v[0])])
    prior = (np.array([[np.sqrt(75.0)]]), np.array([np.sqrt(75.0) * y.mean()]))
    alone = Profile(toy, np.zeros(1), unbounded(1)).interval(0)
    held = Profile(toy, np.zeros(1), unbounded(1), prior).interval(0)
    assert alone.upper is not None
    assert alone.lower is not None
    assert held.upper is not None
    assert held.lower is not None
    assert held.upper - held.lower == pytest.approx(0.5 * (alone.upper - alone.lower), rel=0.01)


def stage(**changes: object) -> Chain:
    """Thesis set P2 from a start that costs nothing."""
    chain = load_chain("thesis-p2")
    links = [
        dataclasses.replace(link, start="negative", **changes) if link.kind == "parametrized" else link  # type: ignore[call-arg]
        for link in chain.links
    ]
    return dataclasses.replace(chain, links=tuple(links), notes={"free": FREE})


FREE = ["parametrized.shape_ascending", "parametrized.barrier_ascending", "parametrized.relaxation_time"]
NOISE = 30e-9


def measured(scale: float = 1.0, delay: float = 0.0, fast: float = 0.0, seed: int = 12) -> Record:
    """A simulated run of the stage, read late [s], with so much of a fast drive on top [V]."""
    time = np.arange(0.0, 6.0, 0.01)
    voltage = 55.0 + 95.0 * np.sin(2.0 * np.pi * 0.4 * time) * (1.0 - 0.05 * time)
    voltage += fast * np.sin(2.0 * np.pi * 6.0 * time)
    blank = Record("run", {"time_s": time, "voltage_V": voltage, "displacement_m": time})
    y = free_run(stage(), blank, Start(leg=1.0), slice(None), time.size).displacement
    y = np.interp(time - delay, time, y) + NOISE * np.random.default_rng(seed).standard_normal(time.size)
    y = scale * y
    return Record(f"run-{seed}", {**blank.columns, "displacement_m": y})


@pytest.fixture(scope="module")
def fitted() -> FitResult:
    return Fit(stage(relaxation_time=0.2), profile=True).fit([measured()])


def test_intervals_of_a_chain_hold_the_truth(fitted: FitResult) -> None:
    truth = stage().links[0]
    for estimate in fitted.estimates:
        found = estimate.interval
        assert found is not None
        assert found.lower is not None
        assert found.upper is not None
        assert found.lower < getattr(truth, estimate.name.split(".")[1]) < found.upper
        assert found.upper - found.lower == pytest.approx(2.0 * Z * estimate.std, rel=0.15)


def test_a_fit_with_the_parameter_held_at_its_end_is_worse_by_3_84(fitted: FitResult) -> None:
    """The same end by another way: `Fit` with that value given and the others free, in units of the white noise."""
    time = fitted.estimates[2]
    assert time.interval is not None
    for end in (time.interval.lower, time.interval.upper):
        held = stage(relaxation_time=end)
        others = Fit(dataclasses.replace(held, notes={"free": FREE[:2]})).fit([measured()])
        risen = others.runs[0].samples * (others.runs[0].rms ** 2 - fitted.runs[0].rms ** 2) / NOISE**2
        assert risen == pytest.approx(Z**2, rel=0.35)  # 600 samples tell their own autocovariance no better


def test_report_and_model_file_carry_the_intervals(fitted: FitResult) -> None:
    text = io.StringIO()
    Console(file=text, width=200).print(fitted)
    assert "95 %" in text.getvalue()
    for estimate in fitted.estimates:
        assert estimate.interval_in_words in text.getvalue()
        noted = fitted.model().notes["fit"]["parameters"][estimate.name]
        assert estimate.interval is not None
        assert noted["interval_95"] == [estimate.interval.lower, estimate.interval.upper]
    without = dataclasses.replace(
        fitted, estimates=tuple(dataclasses.replace(e, interval=None) for e in fitted.estimates)
    )
    assert "interval_95" not in without.model().notes["fit"]["parameters"][FREE[0]]


def test_a_parameter_at_its_bound_has_one_end() -> None:
    """So much motion that the strain coefficient ends at the bound of its declaration, 3 % below what it would take."""
    chain = dataclasses.replace(stage(), notes={"free": ["electrostriction.coefficient"]})
    result = Fit(chain, profile=True).fit([measured(4.5e4)])
    (estimate,) = result.estimates
    assert estimate.at_bound
    assert estimate.interval is not None
    assert estimate.interval.upper is None
    assert estimate.interval_in_words.startswith("at least ")


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        (None, "-"),
        (Interval(0.012345, 2.0), "0.01235 to 2"),
        (Interval(None, 2.0), "at most 2"),
        (Interval(0.0, None), "at least 0"),
        (Interval(None, None), "anything"),
    ],
)
def test_an_interval_is_said_in_words(interval: Interval | None, words: str) -> None:
    assert Estimate("a.b", 1.0, 0.1, "1", False, interval).interval_in_words == words


def test_a_diagnosis_says_what_the_runs_allow_of_an_effect() -> None:
    """A sensor that is 8 ms late, all of it delay: a standard error of a share at its bound means nothing."""
    runs = [measured(delay=8e-3, fast=12.0, seed=seed) for seed in (1, 2)]
    base = fit_declared(stage(), split(with_floors(runs[:1]), with_floors(runs[1:])), lambda text: None)
    (candidate,) = Search(effects=[EFFECT_OF["sensor_lag"]]).step(base).candidates
    found = intervals(candidate.after, ["sensor_lag"])
    assert set(found) == {"sensor_lag.lag", "sensor_lag.delay_share"}
    lag, share = found["sensor_lag.lag"], found["sensor_lag.delay_share"]
    assert lag.lower is not None
    assert lag.upper is not None
    assert lag.lower < 8e-3 < lag.upper
    assert lag.upper - lag.lower < 1e-3
    assert share.lower is not None
    assert share.lower > 0.5
    assert share.upper is None
