"""The court's generator against laws, against SciPy and against the library it shares no code with."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, special

from pzt_benchmarks.residual_court import operators, relays
from pzt_benchmarks.residual_court.cases import KINDS, Spec, cases, make_case
from pzt_benchmarks.residual_court.drives import poled, wander
from pzt_benchmarks.residual_court.effects import INSIDE, OUTSIDE, OWN_PROTOCOL, effect_class
from pzt_benchmarks.residual_court.files import read_run, write_case
from pzt_benchmarks.residual_court.generator import NOISE, bench
from pzt_benchmarks.residual_court.scaling import Projection
from pzt_benchmarks.residual_court.specimens import RIGHT, WRONG, specimen
from pzt_ros.chains import load_chain
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import BOLTZMANN


@pytest.fixture(scope="module")
def projection():
    return Projection.of(bench(RIGHT, "short", 3))


def test_one_relay_follows_its_differential_equation():
    up, down, width, tau = 0.5, -0.3, 0.07, 2e-3
    grid = relays.Grid(np.array([down, up]), np.zeros((1, 3, 3)), np.zeros((3, 3)), np.zeros(1))
    grid.weights[0, 1, 1] = 1.0
    time = np.arange(0.0, 0.3, 1e-3)
    field = 0.62 * np.sin(2 * np.pi * 8.0 * time)

    def rate(t, x):
        e = np.interp(t, time, field)
        return ((1 - x) / special.erfcx((up - e) / width * -1) - x / special.erfcx((down - e) / width)) / tau

    exact = integrate.solve_ivp(rate, (0.0, time[-1]), [0.0], "Radau", time, rtol=1e-9, atol=1e-11, max_step=5e-4)
    share, _ = relays.respond(grid, time, field, width, tau)
    assert np.ptp(exact.y[0]) > 0.5
    np.testing.assert_allclose(share[0], exact.y[0], atol=2e-4)


def test_right_family_is_the_polycrystal_of_the_library():
    truth = specimen(RIGHT, np.random.default_rng(5))
    drive = wander(poled(1.5, 0.3), np.random.default_rng(1), 5.0, (40.0, 400.0)).drive()
    p = truth.parameters
    e1, width = 1e6 / p["susceptibility"], 1e6 * p["thermal_width"]
    library = Lattice(
        coercive_field=1e6 * p["coercive_field"],
        coercive_field_spread=2 * (1e6 * p["coercive_sigma"]) ** 2,
        interaction_field_spread=2 * (1e6 * p["interaction_sigma"]) ** 2,
        relaxation_time=p["relaxation_time"],
        domain_polarization=0.26,
        reciprocal_permittivity=e1,
        domain_volume=2 * e1 * BOLTZMANN * 293.0 / width**2,
        spacing=0.3,
    )
    _, out = library.step(library.init(Rest(time=0.0)), Signals(time=drive.time, voltage=drive.command))
    ours, _ = truth.polarization(drive.time, drive.command, 0.0, np.inf)
    difference = truth.displacement(ours) - truth.displacement(out.polarization)
    assert np.sqrt(np.mean(difference**2)) < 0.1 * NOISE


@pytest.mark.parametrize("family", [RIGHT, *WRONG])
def test_poling_takes_the_stroke_and_memory_is_kept(family):
    truth = specimen(family, np.random.default_rng(2))
    program = poled(2.0, 0.5).to(20.0, 0.5).hold(0.3)
    first = round(program.duration * program.rate)
    drive = program.to(80.0, 0.5).to(20.0, 0.5).hold(0.3).drive()
    p, _ = truth.polarization(drive.time, drive.command, 0.0, np.inf)
    y = truth.displacement(p)
    assert 8e-6 < y.max() - y[-1] + 4e-6 < 20e-6
    assert y[2000] - y[first] > 1e-6  # it moves down with the voltage
    assert abs(y[-1] - y[first]) < 0.5e-6  # the minor loop closes, but for what relaxes


def test_current_limit_slows_the_voltage_down():
    truth = specimen(RIGHT, np.random.default_rng(4))
    drive = poled(1.0, 0.2).to(0.0, 0.05).hold(0.2).drive()
    free, _ = truth.polarization(drive.time, drive.command, 0.0, np.inf)
    peak = 2e-3 * np.abs(np.diff(free)).max() / drive.step
    limit = 0.4 * peak
    p, applied = truth.polarization(drive.time, drive.command, 0.0, limit)
    current = 2e-3 * np.diff(p) / drive.step
    assert np.abs(applied - drive.command).max() > 5.0
    assert np.abs(current[np.abs(np.diff(drive.command)) > 0]).max() < 1.01 * limit


@pytest.mark.parametrize("name", [*INSIDE, *OUTSIDE])
def test_effect_of_no_size_is_no_effect(name):
    made = bench(RIGHT, "short", 3)
    effect = effect_class(name).drawn(np.random.default_rng(1))
    small = type(effect)(1e-12, effect.shape)
    one, other = made.motion(0, (small,)), made.motion(0, ())
    np.testing.assert_allclose(one.reading, other.reading, atol=2e-11)
    np.testing.assert_allclose(one.polarization, other.polarization, atol=1e-9)


@pytest.mark.parametrize("name", [name for name in (*INSIDE, *OUTSIDE) if name not in OWN_PROTOCOL])
def test_size_is_what_was_asked(projection, name):
    if name == "mechanical_resonance":
        pytest.skip("drives at 1 kHz hardly excite it")
    effect, size = projection.scaled(effect_class(name).drawn(np.random.default_rng(8)), 2.0)
    assert size == pytest.approx(2.0, rel=0.1)
    assert projection.size(effect) == pytest.approx(size)


def test_what_the_base_can_follow_has_no_size(projection):
    gain = INSIDE["load_stiffness"](0.02)
    loaded = [run.__class__(**{**vars(run), "loaded": True}) for run in projection.bench.runs]
    before, projection.bench.runs = projection.bench.runs, loaded
    try:
        assert projection.size(gain) < 0.02
    finally:
        projection.bench.runs = before


def test_operators_by_hand():
    drive = np.array([0.0, 1.0, 0.5, 0.0, 1.0])
    np.testing.assert_allclose(operators.play(drive, 0.2), [0.0, 0.8, 0.7, 0.2, 0.8])
    np.testing.assert_allclose(
        operators.play_sum(drive, np.array([0.0, 0.2]), np.array([1.0, 2.0])), [0.0, 2.6, 1.9, 0.4, 2.6]
    )
    long = np.linspace(0.0, 20.0, 500)
    assert operators.dahl(long, 2.0, 0.3)[-1] == pytest.approx(0.3)
    assert operators.bouc_wen(long, 1.0, 2.0, 0.5)[-1] == pytest.approx(1.0 / 2.5, rel=1e-6)


def test_wedge_is_a_sum_of_relays():
    drive = np.concatenate([np.linspace(a, b, 60) for a, b in ((0, 0.9), (0.9, 0.2), (0.2, 0.7), (0.7, 0.1), (0.1, 1))])
    edges = (np.arange(300) + 0.5) / 300
    up, down = np.meshgrid(edges, edges, indexing="ij")
    state, share = np.zeros_like(up), []
    for level in drive:
        state = np.where(level >= up, 1.0, np.where(level <= down, 0.0, state))
        share.append(state[up >= down].mean())
    np.testing.assert_allclose(operators.wedge_preisach(drive, 0.0, 1.0), share, atol=0.01)


def test_cases_repeat_and_seeds_of_tables_never_meet():
    one, same = (make_case(Spec("dev", RIGHT, ("mains_hum",), 3.0, "short", seed=9)) for _ in range(2))
    for part in ("train", "test", "score"):
        for a, b in zip(getattr(one, part), getattr(same, part), strict=True):
            for name in a:
                np.testing.assert_array_equal(a[name], b[name])
    tables = {kind: {spec.seed for spec in cases(kind, 2)} for kind in KINDS}
    kinds = list(tables)
    assert not any(tables[a] & tables[b] for a in kinds for b in kinds if a != b)
    names = [spec.name for kind in KINDS for spec in cases(kind, 2)]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("reading", ["white", "coloured", "quantised"])
def test_noise_has_the_rms_it_should(reading):
    made = bench(RIGHT, "short", 6)
    record = made.record(0, (), reading)
    noise = record["displacement_m"] - made.motion(0, ()).reading
    assert np.std(noise) == pytest.approx(NOISE, rel=0.08)


def test_files_are_what_the_library_reads(tmp_path):
    case = make_case(Spec("dev", RIGHT, protocol="short", reading="gaps", seed=4))
    files = write_case(case, tmp_path / "case")
    back = read_run(files.train[0])
    assert list(back) == ["time_s", "voltage_V", "displacement_m"]
    np.testing.assert_allclose(back["displacement_m"], case.train[0]["displacement_m"], rtol=1e-9, atol=1e-15)
    assert np.all(np.diff(back["time_s"]) > 0)
    assert np.max(np.diff(back["time_s"])) > 4e-3
    chain = load_chain(files.declared)
    truth = case.bench.truth.parameters
    off = chain.links[0].coercive_field / (1e6 * truth["coercive_field"])
    assert 0.1 <= max(off, 1 / off) - 1 <= 0.5
