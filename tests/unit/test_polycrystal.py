"""Quadrature and lattice against each other, against the laws of the model, and against a general ODE solver."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import integrate, special

from pzt_ros.errors import BenchError
from pzt_ros.physics import polycrystal_kernel as kernel
from pzt_ros.physics.density import Gaussian, Table, equal_probability, equally_spaced, gauss_legendre
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import build

COARSE = Lattice(spacing=1.5)
MODELS = [
    Quadrature(),
    Quadrature(rule="equal_probability", method="midpoint"),
    Quadrature(coercive_field_spread=0.0),
    COARSE,
    dataclasses.replace(COARSE, method="midpoint"),
    dataclasses.replace(COARSE, interaction_field_spread=0.0),
]
NAMES = ["quadrature", "equal", "one-barrier", "lattice", "lattice-midpoint", "no-interaction"]
every_model = pytest.mark.parametrize("model", MODELS, ids=NAMES)

TURNS = np.array([0, 2, -2, 2, -1, 1, -0.7, 0.7, -2, 0.4, -0.2, 0.8, 0.2, 1.2, 0.5, 2]) * 1e6


def drive(turns: np.ndarray = TURNS, rate: float = 1e7, samples: int = 150, hold: float = 0.0) -> Signals:
    """Ramps through `turns` [V/m] at `rate` [V/m/s], then a hold [s]; the voltage across a 0.1 mm layer."""
    time = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(turns)) / rate)))
    if hold:
        time, turns = np.append(time, time[-1] + hold), np.append(turns, turns[-1])
    at = np.union1d(np.linspace(0, time[-1], samples), time)
    return Signals(time=at, voltage=np.interp(at, time, turns) * 1e-4)


def fraction(model: Polycrystal, signals: Signals) -> np.ndarray:
    return model.step(model.init(Rest()), signals)[1].phase_fraction


class FineLegendre(Quadrature):
    """Gauss-Legendre nodes as the thesis places them, but far more of them and to 5 sigma."""

    def nodes(self):
        coercive = gauss_legendre(self.coercive, 60, 80, cut=5.0)
        interaction = gauss_legendre(self.interaction, 80, 80, cut=5.0)
        return self._normalized(coercive, True), self._normalized(interaction, False)


def test_two_independent_fine_grids_agree():
    signals = drive(samples=80)
    difference = fraction(Lattice(spacing=0.25), signals) - fraction(FineLegendre(), signals)
    assert np.max(np.abs(difference)) < 1e-5


@pytest.mark.parametrize("method", ["midpoint", "collocation"])
@pytest.mark.parametrize("rate", [1e5, 1e7, 1e9])
def test_a_lattice_steps_the_fronts_only_and_misses_nothing(method, rate):
    """The same domains as one row in no order, which is stepped whole; some barriers are too low to hold."""
    lattice = Lattice(spacing=0.7, method=method, accuracy=1e-5, temperature=400.0)
    rows, columns = (nodes[0].size for nodes in lattice.nodes())
    elements = lattice.elements
    i, j = np.arange(rows)[:, None], np.arange(columns)
    assert rows > 20 < columns
    unordered = np.random.default_rng(3).permutation(rows * columns)
    whole = elements._replace(
        forward=elements.forward[rows - 1 - i + j].ravel()[unordered],
        backward=elements.backward[i + j].ravel()[unordered],
        row_weight=np.ones(1),
        column_weight=np.outer(elements.row_weight, elements.column_weight).ravel()[unordered],
    )
    signals = drive(rate=rate, hold=1.0)
    state = lattice.init(Rest())
    after, out = lattice.step(state, signals)
    expected = np.concatenate((state[: kernel.HEAD], state[kernel.HEAD :][unordered]))
    polarization, fraction = np.empty(signals.time.size), np.empty(signals.time.size)
    assert kernel.run(expected, whole, signals.time, signals.voltage, polarization, fraction) == -1
    np.testing.assert_allclose(out.phase_fraction, fraction, rtol=0, atol=1e-9)
    np.testing.assert_allclose(after[kernel.HEAD :][unordered], expected[kernel.HEAD :], rtol=0, atol=1e-8)
    assert np.diff(after[kernel.HEAD :].reshape(rows, columns), axis=1).min() > -1e-11, "what the fronts rest on"


def test_a_table_of_the_gaussian_is_the_gaussian():
    signals = drive(samples=60)
    fields = np.linspace(0, 3e6, 3001)
    table = Table(tuple(fields), tuple(Gaussian(0.5e6, 5e11).at(fields)))
    gaussian = Lattice(spacing=0.5)
    tabled = dataclasses.replace(gaussian, coercive_density=table, coercive_field=9e6, coercive_field_spread=1e9)
    assert np.max(np.abs(fraction(tabled, signals) - fraction(gaussian, signals))) < 1e-5


def test_biased_table_shifts_the_loop():
    """All domains see E + E_b: the loop is that of the unbiased model at a field higher by E_b (3.13)."""
    bias = 1e5
    fields = np.linspace(-2.4e6, 2.4e6, 961)
    weight = tuple(Gaussian(0.0, 5e11).at(fields))
    centred = dataclasses.replace(COARSE, interaction_density=Table(tuple(fields), weight))
    shifted = dataclasses.replace(COARSE, interaction_density=Table(tuple(fields + bias), weight))
    signals = drive(np.array([0, 3e6, -3e6, 3e6, -3e6]), samples=100)
    later = Signals(time=signals.time, voltage=signals.voltage + bias * 1e-4)
    tail = signals.time > 1.0  # the start differs: virgin domains know the sign of E_e
    _, expected = centred.step(centred.init(Rest()), later)
    _, got = shifted.step(shifted.init(Rest()), signals)
    assert np.max(np.abs(got.phase_fraction - expected.phase_fraction)[tail]) < 1e-5
    assert np.max(np.abs(got.polarization - expected.polarization)[tail]) < 1e-5


def observed_order(method: str, steps: list[int]) -> list[float]:
    """Order between successive halvings of the step, from one ramp against a far finer one; a sample is one step."""

    def final(count: int, method: str) -> float:
        ramp = np.arange(1, count + 1) / count
        model = Quadrature(method=method, accuracy=1e-2)  # so loose that no sample is divided
        return float(fraction(model, Signals(time=0.3 * ramp, voltage=150.0 * ramp))[-1])

    exact = final(4096, "collocation")
    errors = np.array([abs(final(count, method) - exact) for count in steps])
    return list(np.log2(errors[:-1] / errors[1:]))


@pytest.mark.parametrize(("method", "order"), [("midpoint", 2), ("collocation", 4)])
def test_order_of_convergence(method, order):
    for measured in observed_order(method, [128, 256, 512]):
        assert measured == pytest.approx(order, abs=0.35)


@pytest.mark.parametrize("rate", [1e3, 1e5, 1e7, 1e9])
@pytest.mark.parametrize("accuracy", [1e-4, 1e-6])
def test_collocation_keeps_its_accuracy_at_any_rate(rate, accuracy):
    signals = drive(np.array([0, 2, -1, 0.5]) * 1e6, rate=rate, samples=25)
    loose = fraction(Quadrature(accuracy=accuracy), signals)
    tight = fraction(Quadrature(accuracy=1e-10), signals)
    assert np.max(np.abs(loose - tight)) < 2 * accuracy


def test_midpoint_reaches_its_accuracy_with_small_steps():
    signals = drive(np.array([0, 2, -1, 0.5]) * 1e6, rate=1e7, samples=25)
    difference = fraction(Quadrature(method="midpoint"), signals) - fraction(Quadrature(accuracy=1e-10), signals)
    assert np.max(np.abs(difference)) < 2e-6


def test_agrees_with_a_general_solver():
    model = Quadrature(nodes_coercive_above=2.0, nodes_coercive_below=2.0, nodes_interaction_side=2.0, accuracy=1e-8)
    (coercive, wc), (interaction, wi) = model.nodes()
    c, e = (grid.ravel() for grid in np.meshgrid(coercive, interaction, indexing="ij"))

    def slope(t, x, start, rate):
        field = start + rate * t + e
        up, down = (1 / special.erfcx((s * field - c) / model.thermal_width) for s in (1, -1))
        return (up * (1 - x) - down * x) / model.relaxation_time

    x, got, state = np.where(e < 0, 0.0, 1.0), [], model.init(Rest())
    for k, (start, end, duration) in enumerate([(0, 1.2e6, 0.1), (1.2e6, -0.3e6, 0.2), (-0.3e6, -0.3e6, 0.5)]):
        rate = (end - start) / duration
        x = integrate.solve_ivp(slope, (0, duration), x, "Radau", args=(start, rate), rtol=1e-9, atol=1e-12).y[:, -1]
        expected = wc @ x.reshape(4, 4) @ wi
        time = np.array([[0.1, 0.3, 0.8][k]])
        state, out = model.step(state, Signals(time=time, voltage=np.array([end * 1e-4])))
        got.append(out.phase_fraction[0] - expected)
    assert np.max(np.abs(got)) < 1e-7


@every_model
def test_fractions_stay_between_0_and_1(model):
    jumps = np.random.default_rng(1).uniform(-900, 900, 200)  # up to 9 MV/m, in steps of 1 us to 1 s
    signals = Signals(time=np.cumsum(10 ** np.random.default_rng(2).uniform(-6, 0, 200)), voltage=jumps)
    state, out = model.step(model.init(Rest()), signals)
    assert state[3:].min() >= 0
    assert state[3:].max() <= 1
    assert out.phase_fraction.min() >= 0
    assert out.phase_fraction.max() <= 1 + 1e-12
    assert np.ptp(out.phase_fraction) > 0.5


@every_model
@pytest.mark.parametrize("loop", [(2.0, -2.0), (1.0, -0.4), (0.5, 0.1)])
def test_closed_loops_dissipate(model, loop):
    """The third round of a cycle: the integral of E dP is heat."""
    high, low = np.array(loop) * 1e6
    signals = drive(np.array([0, high, low, high, low, high]), samples=1500)
    _, out = model.step(model.init(Rest()), signals)
    time = signals.time - (signals.time[-1] - 2 * (high - low) / 1e7)
    last = time >= -1e-12
    field = signals.voltage[last] / model.layer_thickness
    work = np.sum((field[1:] + field[:-1]) / 2 * np.diff(out.polarization[last]))
    assert work >= -1e-3
    if loop == (2.0, -2.0):
        assert work > 1e5


@every_model
def test_cutting_into_blocks_changes_no_bit(model):
    signals = drive(samples=60, hold=0.5)
    wanted = model.step(model.init(Rest()), signals)[1].polarization
    for inverse in (False, True):
        call = model.invert if inverse else model.step
        whole = Signals(time=signals.time, voltage=signals.voltage, polarization=wanted)
        after, out = call(model.init(Rest()), whole)
        state, pieces, k = model.init(Rest()), [], 0
        for size in [1, 2, 1, 5, 11, 3, 1000]:
            part = slice(k, k + size)
            piece = Signals(time=whole.time[part], voltage=whole.voltage[part].copy(), polarization=wanted[part].copy())
            before = state.copy()
            new, block = call(state, piece)
            np.testing.assert_array_equal(state, before)
            state, k = new, k + size
            pieces.append(block)
        np.testing.assert_array_equal(np.concatenate([p.voltage for p in pieces]), out.voltage)
        np.testing.assert_array_equal(np.concatenate([p.phase_fraction for p in pieces]), out.phase_fraction)
        np.testing.assert_array_equal(np.concatenate([p.polarization for p in pieces]), out.polarization)
        np.testing.assert_array_equal(state, after)


@every_model
def test_step_undoes_invert(model):
    signals = drive(samples=60, hold=0.5)
    _, out = model.step(model.init(Rest()), signals)
    start = model.init(Rest())
    after, inverse = model.invert(start, Signals(time=signals.time, polarization=out.polarization))
    again, forward = model.step(start, Signals(time=signals.time, voltage=inverse.voltage))
    np.testing.assert_allclose(forward.polarization, out.polarization, rtol=0, atol=2e-10)
    np.testing.assert_allclose(inverse.voltage, signals.voltage, rtol=0, atol=1e-4)
    np.testing.assert_array_equal(inverse.phase_fraction, forward.phase_fraction)
    np.testing.assert_array_equal(np.delete(again, 2), np.delete(after, 2))  # all but the inverse's own slope


@every_model
def test_inverse_of_nonsense_is_finite(model):
    wanted = np.array([0.1, np.nan, 9.0, -9.0, np.inf, 0.0])
    state, out = model.invert(model.init(Rest()), Signals(time=np.arange(6) * 1e-4, polarization=wanted))
    assert np.all(np.isfinite(state))
    assert np.all(np.abs(out.voltage) <= 1000)
    assert out.voltage[1] == out.voltage[0]
    np.testing.assert_allclose(out.voltage[2:4], [1000, -1000])
    _, back = model.step(model.init(Rest()), Signals(time=np.arange(6) * 1e-4, voltage=out.voltage))
    np.testing.assert_allclose(back.polarization[[0, 5]], [0.1, 0.0], rtol=0, atol=2e-10)


def test_hold_is_one_exact_exponential():
    model = Quadrature(method="midpoint")
    start, _ = model.step(model.init(Rest()), Signals(time=np.array([0.1]), voltage=np.array([40.0])))
    once, _ = model.step(start, Signals(time=np.array([5.1]), voltage=np.array([40.0])))
    often, _ = model.step(start, Signals(time=np.linspace(0.101, 5.1, 5000), voltage=np.full(5000, 40.0)))
    np.testing.assert_allclose(once[3:], often[3:], rtol=0, atol=1e-12)
    assert np.max(np.abs(once[3:] - start[3:])) > 0.1


@every_model
def test_virgin_and_rest(model):
    assert np.all(np.isin(model.init(Rest())[3:], [0.0, 1.0]))
    state = model.init(Rest(time=7.0, voltage=100.0))
    assert tuple(state[:2]) == (7.0, 100.0)
    # the same as the slow ramp, and a first sample at the time of rest moves nothing
    ramp = Signals(time=np.array([10.0]), voltage=np.array([100.0]))
    slow, _ = model.step(model.init(Rest()), ramp)
    np.testing.assert_allclose(state[3:], slow[3:], rtol=0, atol=1e-12)
    same, _ = model.step(state, Signals(time=np.array([7.0]), voltage=np.array([100.0])))
    np.testing.assert_array_equal(same, state)


def test_virgin_start_without_interaction_field_is_up():
    """As the oracle's Q4_Ec_only has it: x = 1 where E_e is not below 0."""
    model = Quadrature(interaction_field_spread=0.0)
    assert np.all(model.init(Rest())[3:] == 1)


@pytest.mark.parametrize("density", [Gaussian(0.5e6, 5e11, lower=0.0), Gaussian(0.0, 1e11)])
def test_rules_reproduce_moments(density):
    low, high = density.support(12.0)
    scale = density.sigma
    for moment in (0, 1, 2):
        exact = integrate.quad(
            lambda e, m=moment: (e / scale) ** m * float(density.at(np.array([e]))[0]),
            low, high, points=[density.peak], epsabs=1e-12, limit=200,
        )[0]  # fmt: skip
        for fields, weights, tolerance in [
            (*gauss_legendre(density, 30, 30, cut=6.0), 1e-6),
            (*equally_spaced(density, scale / 5, cut=6.0), 1e-3),
            (*equal_probability(density, 1000), 1e-2),
        ]:
            assert np.sum(weights * (fields / scale) ** moment) == pytest.approx(exact, abs=tolerance)


def test_quantiles_of_a_table_are_those_of_its_area():
    table = Table((0.0, 1.0, 3.0), (0.0, 2.0, 0.0))  # a triangle of area 3
    np.testing.assert_allclose(table.quantile(np.array([0.0, 1 / 12, 1 / 3, 1.0])), [0, 0.5, 1, 3], atol=1e-12)


@pytest.mark.parametrize(
    ("fields", "weights"),
    [((0.0,), (1.0,)), ((1.0, 0.0), (1.0, 1.0)), ((0.0, 1.0), (0.0, 0.0)), ((0.0, 1.0), (1.0, -1.0))],
)
def test_a_bad_table_is_refused(fields, weights):
    with pytest.raises(BenchError, match="density table"):
        Table(fields, weights)


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        (Signals(time=np.array([1.0, 0.5]), voltage=np.zeros(2)), "sample 1"),
        (Signals(time=np.array([1.0, 2.0]), voltage=np.array([0.0, np.nan])), "sample 1"),
        (Signals(time=np.array([1.0]), voltage=np.array([1e300])), "beyond 1 GV/m"),
        (Signals(time=np.array([1.0])), "0 values of voltage"),
    ],
)
@every_model
def test_a_bad_block_is_one_line(model, signals, message):
    with pytest.raises(BenchError, match=message) as error:
        model.step(model.init(Rest()), signals)
    assert "\n" not in str(error.value)


def test_wrong_use_is_one_line():
    with pytest.raises(BenchError, match="start from init"):
        Quadrature().step(COARSE.init(Rest()), drive())
    with pytest.raises(BenchError, match="0 values of polarization"):
        Quadrature().invert(Quadrature().init(Rest()), drive())
    with pytest.raises(BenchError, match="whole number"):
        Quadrature(nodes_coercive_above=2.5).init(Rest())
    with pytest.raises(BenchError, match="raise the spacing"):
        Lattice(interaction_field_spread=1.0).init(Rest())
    with pytest.raises(BenchError, match="barriers start at 0"):
        Lattice(coercive_density=Table((-1.0, 1.0), (1.0, 1.0)))


def test_reads_from_text_with_units():
    given = {"coercive_field": "0.5 MV/m", "coercive_field_spread": "0.5 MV^2/m^2", "domain_volume": "100 nm^3"}
    with pytest.raises(BenchError, match="outside"):
        build(Lattice, {**given, "layer_thickness": "1 m"}, "stage.yaml: lattice")
    model = build(
        Quadrature, {**given, "nodes_coercive_above": 12, "rule": "equal_probability"}, "stage.yaml: quadrature"
    )
    assert model.coercive_field_spread == pytest.approx(5e11)
    assert model.init(Rest()).size == 3 + 18 * 16
