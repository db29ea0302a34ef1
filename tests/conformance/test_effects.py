"""One battery for every effect: whoever stands in the table of effects is tested here, unasked.

What every link has to keep (state, blocks, YAML, units), the effects keep in test_links.py, at each of their starts.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from pzt_ros.chains import chain_as_data, load_chain, parse_chain, shipped_chains
from pzt_ros.effects.effect import PLACES, Effect, GoesOn
from pzt_ros.effects.insert import effects_in, with_effect, without_effect
from pzt_ros.effects.table import CONFOUNDED, EFFECT_OF, EFFECTS
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import ACTUATOR, AMPLIFIER, SENSOR, Link
from pzt_ros.physics.loaded import Loaded
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.quantities import check_bounds, parameters_of
from pzt_ros.records import KNOWN_COLUMNS
from pzt_ros.sysid.run import rms

CONTRACT = {
    "slow_relaxation", "strain_polarization_hysteresis", "thermal_drift", "mechanical_resonance", "sensor_lag",
    "sensor_nonlinearity", "amplifier_current_limit", "amplifier_bandwidth", "mains_hum", "polarization_fatigue",
    "bias_field", "leakage", "load_stiffness",
}  # fmt: skip
"""contract.md, "report.json"."""

SECTION_OF = dict(zip(PLACES, (AMPLIFIER, ACTUATOR, ACTUATOR, ACTUATOR, SENSOR), strict=True))
WRITTEN = ("voltage", "polarization", "strain_polarization", "displacement")
SHAPES = [(effect, start) for effect in EFFECTS for start in effect.starts]
SHAPE_NAMES = [f"{effect.name}-{number}" for effect in EFFECTS for number, _ in enumerate(effect.starts)]
ONE_CHAIN = load_chain("thesis-p1")

any_effect = pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
any_start = pytest.mark.parametrize(("effect", "start"), SHAPES, ids=SHAPE_NAMES)


def run(time: np.ndarray, duration: float) -> Signals:
    """A drive with turns and a fast part, its polarization and displacement, sampled at `time` [s]."""
    phase = time / duration
    drive = np.sin(2 * np.pi * 2 * phase) * (0.6 + 0.4 * phase) + 0.1 * np.sin(2 * np.pi * 11 * phase)
    polarization = 0.15 + 0.1 * np.tanh(2 * drive)
    signals = Signals(
        time, 60.0 + 60.0 * drive, polarization, 0.5 + 0.3 * drive, 1.8e-4 * polarization**2, 293.0 + 0.5 * phase
    )
    return signals.replace(neighbour=3e-6 * np.cos(2 * np.pi * 3 * phase))


def even(count: int = 400, duration: float = 0.4) -> Signals:
    return run(np.linspace(0.0, duration, count), duration)


def made(effect: Effect, **values: float) -> Link:
    """The effect's link, with a ceramic on it where it feels one."""
    link = effect.link(**values)
    return link.driving(Preisach()) if isinstance(link, Loaded) else link


def largest(values: np.ndarray) -> float:
    """Of their absolute values."""
    return float(np.max(np.abs(values)))


def stepped(link: Link, signals: Signals) -> Signals:
    return link.step(link.init(Rest()), signals)[1]


def output_of(link: Link, signals: Signals) -> dict[str, np.ndarray]:
    """What a step of the link replaces, by name."""
    out = stepped(link, signals)
    return {name: getattr(out, name) for name in WRITTEN if getattr(out, name) is not getattr(signals, name)}


def assert_untouched(link: Link, signals: Signals) -> None:
    """Identity to the bit, the polarization that strains being P where nothing else is said."""
    out = stepped(link, signals)
    for name in ("voltage", "polarization", "phase_fraction", "displacement", "temperature"):
        np.testing.assert_array_equal(getattr(out, name), getattr(signals, name), err_msg=name)
    np.testing.assert_array_equal(out.straining, signals.polarization)


def test_all_effects_of_the_contract_are_there() -> None:
    assert set(EFFECT_OF) >= CONTRACT
    assert len(EFFECT_OF) == len(EFFECTS)


@any_effect
def test_declaration_makes_sense(effect: Effect) -> None:
    declared = parameters_of(effect.link)
    assert effect.link.section == SECTION_OF[effect.place]
    assert effect.amplitude in effect.free
    assert set(effect.per_run) <= set(effect.free) <= set(declared)
    assert set(effect.needs) <= set(KNOWN_COLUMNS)
    assert (effect.goes_on in declared) == isinstance(effect.link(), GoesOn)
    assert effect.goes_on not in effect.free
    assert effect.absence
    assert effect.next_experiment
    assert len(effect.starts) <= 24
    assert len(effect.starts) >= 2 or set(effect.free) == set(effect.columns)  # what is linear has one shape
    assert effect.reported in EFFECT_OF
    assert getattr(effect.link(), effect.amplitude) == 0.0


@any_start
def test_start_is_within_bounds(effect: Effect, start: dict[str, float]) -> None:
    declared = parameters_of(effect.link)
    for name, value in start.items():
        check_bounds(value, declared[name], name)
    assert start[effect.amplitude] > 0.0


@any_effect
def test_default_is_the_identity_to_the_bit(effect: Effect) -> None:
    assert_untouched(made(effect), even())


@any_start
def test_without_amplitude_it_is_the_identity_to_the_bit(effect: Effect, start: dict[str, float]) -> None:
    assert_untouched(made(effect, **{**start, effect.amplitude: 0.0}), even())


@any_start
def test_start_is_not_the_identity(effect: Effect, start: dict[str, float]) -> None:
    """In a slow drive or in a fast one."""
    changes = []
    for signals in (even(duration=0.4), even(duration=4e-4)):
        for name, values in output_of(made(effect, **start), signals).items():
            given = signals.polarization if name == "strain_polarization" else getattr(signals, name)
            changes.append(np.max(np.abs(values - given)) / np.ptp(given))
    assert max(changes) > 1e-8


@any_effect
def test_works_with_what_the_nodes_of_the_graph_know(effect: Effect) -> None:
    """The sensor node has time and displacement, the amplifier node time and voltage; nobody has a temperature."""
    link, signals = made(effect, **effect.starts[0]), even().replace(temperature=np.zeros(0))
    known = {
        AMPLIFIER: {"voltage": signals.voltage},
        ACTUATOR: {name: getattr(signals, name) for name in ("voltage", "polarization", "displacement")},
        SENSOR: {"displacement": signals.displacement},
    }[link.section]
    for name, values in output_of(link, Signals(signals.time, **known)).items():
        np.testing.assert_array_equal(values, getattr(stepped(link, signals), name))


@any_start
def test_blocks_may_be_cut_at_random(effect: Effect, start: dict[str, float]) -> None:
    link, signals = made(effect, **start), even()
    whole, state = stepped(link, signals), link.init(Rest())
    cuts = np.sort(np.random.default_rng(5).integers(0, 400, 12))
    parts: dict[str, list[np.ndarray]] = {}
    for begin, end in zip([0, *cuts], [*cuts, 400], strict=True):
        names = ("time", "voltage", "polarization", "displacement", "temperature", "neighbour")
        kept = state.copy()
        after, out = link.step(state, Signals(**{name: getattr(signals, name)[begin:end] for name in names}))
        np.testing.assert_array_equal(state, kept)
        state = after
        for name in output_of(link, signals):
            parts.setdefault(name, []).append(getattr(out, name))
    assert parts
    for name, pieces in parts.items():
        np.testing.assert_array_equal(np.concatenate(pieces), getattr(whole, name), err_msg=name)


@any_start
def test_uneven_sampling_converges(effect: Effect, start: dict[str, float]) -> None:
    """A quarter of the step leaves less of the error (half of it where the law has a root of the number of cycles).

    Of its rms where a link runs the ceramic: by how much a sample misses the moment when a limit sets in is chance.
    """
    link, duration = made(effect, **start), 0.04
    finest = np.sort(np.random.default_rng(2).random(64 * 1024)) * duration
    finest[0] = 0.0
    reference = output_of(link, run(finest, duration))
    size, errors = rms if isinstance(link, Loaded) else largest, []
    for every in (256, 64, 16):
        found = output_of(link, run(finest[::every], duration))
        errors.append(max(size(found[q] - reference[q][::every]) / np.ptp(reference[q]) for q in found))
    exact = 1e-12
    assert errors[1] < max(0.6 * errors[0], exact)
    assert errors[2] < max(0.6 * errors[1], exact)


@any_start
def test_inverse_undoes_a_step(effect: Effect, start: dict[str, float]) -> None:
    """In a drive that is slow for every effect; what cannot be undone is the delay of a sensor."""
    link, signals = made(effect, **start), even(count=2000, duration=200.0)
    out = stepped(link, signals)
    _, back = link.invert(link.init(Rest()), out)
    late = getattr(link, "pure_delay", 0.0)
    for name in output_of(link, signals):
        name = "polarization" if name == "strain_polarization" else name
        given = getattr(signals, name)
        fastest = np.max(np.abs(np.diff(given) / np.diff(signals.time)))
        np.testing.assert_allclose(getattr(back, name), given, rtol=0, atol=1e-9 * np.ptp(given) + late * fastest)


@any_start
def test_inverse_of_the_chain_works_with_it(effect: Effect, start: dict[str, float]) -> None:
    """Inverse compensation: the voltage for a displacement wanted gives that displacement."""
    chain = with_effect(ONE_CHAIN, effect.link(**start))
    time = np.linspace(0.0, 20.0, 300)
    ramp = Signals(time[:40], voltage=np.linspace(0.0, 150.0, 40))
    state, _ = chain.step(chain.init(Rest()), ramp)
    wanted = 7e-6 + 1e-6 * np.sin(time[40:])
    _, drive = chain.invert(state, Signals(time[40:], displacement=wanted))
    _, got = chain.step(state, Signals(time[40:], voltage=drive.voltage))
    late = getattr(effect.link(**start), "pure_delay", 0.0)
    settled = slice(5, None)
    np.testing.assert_allclose(got.displacement[settled], wanted[settled], rtol=0, atol=1e-10 + 1.1e-6 * late)


@pytest.mark.parametrize("name", sorted(shipped_chains()))
def test_every_shipped_chain_can_have_every_effect(name: str) -> None:
    """In whatever order they come, they stand in the order of the table, and the file can be read again."""
    chain = load_chain(name)
    forwards, backwards = chain, chain
    for effect in EFFECTS:
        forwards = with_effect(forwards, effect.link(**effect.starts[0]))
    for effect in reversed(EFFECTS):
        backwards = with_effect(backwards, effect.link(**effect.starts[0]))
    assert forwards.links == backwards.links
    assert [link.kind for link in effects_in(forwards)] == [effect.name for effect in EFFECTS]
    assert parse_chain(chain_as_data(forwards), "all.yaml").links == forwards.links
    bare = forwards
    for effect in EFFECTS:
        bare = without_effect(bare, effect.name)
    assert bare.links == chain.links


@any_effect
def test_effect_stands_at_its_place(effect: Effect) -> None:
    links = with_effect(load_chain("p802"), effect.link()).links
    here = next(i for i, link in enumerate(links) if link.kind == effect.name)
    ceramic = next(i for i, link in enumerate(links) if isinstance(link, Ferroelectric))
    strain = next(i for i, link in enumerate(links) if link.kind == "strain_hysteresis")
    sections = [link.section for link in links]
    expected = {
        "amplifier": sections.index(ACTUATOR) - 1,
        "ferroelectric": ceramic - 1,
        "strain": ceramic + 1,
        "structure": strain + 1,
        "sensor": sections.index(SENSOR),
    }
    assert here == expected[effect.place]


@any_effect
def test_effect_is_replaced_not_doubled(effect: Effect) -> None:
    start = effect.starts[0]
    first, second = effect.link(**{**start, effect.amplitude: 0.5 * start[effect.amplitude]}), effect.link(**start)
    chain = with_effect(with_effect(ONE_CHAIN, first), second)
    assert effects_in(chain) == [second]
    assert chain.notes == ONE_CHAIN.notes


def test_what_is_no_effect_is_refused_in_one_line() -> None:
    with pytest.raises(BenchError, match="'electrostriction' is no effect; known are amplifier_bandwidth"):
        with_effect(ONE_CHAIN, Electrostriction())


@any_effect
def test_chain_with_the_default_does_what_it_did(effect: Effect) -> None:
    """To the bit, over the whole chain: the model with an effect that was fitted to nothing is the model."""
    time = np.linspace(0.0, 2.0, 500)
    drive = Signals(time, voltage=75.0 - 75.0 * np.cos(7 * time))
    with_it = with_effect(ONE_CHAIN, effect.link())
    for name in ("displacement", "polarization", "voltage"):
        one, other = (getattr(c.step(c.init(Rest()), drive)[1], name) for c in (with_it, ONE_CHAIN))
        np.testing.assert_array_equal(one, other)


def test_confounded_pairs_are_known_and_told_what_to_do() -> None:
    shapes_of_the_base: set[str] = {"strain_law", "hysteresis_density"}
    for pair, experiment in CONFOUNDED.items():
        assert len(pair) == 2
        assert pair <= set(EFFECT_OF) | shapes_of_the_base
        assert experiment.endswith(".")
        assert experiment[0].isupper()
        assert "\n" not in experiment
    expected: Any = [("sensor_lag", "amplifier_bandwidth"), ("slow_relaxation", "thermal_drift")]
    for pair in expected:
        assert frozenset(pair) in CONFOUNDED


def test_effects_are_data_that_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        EFFECTS[0].place = "sensor"  # type: ignore[misc]
    assert isinstance(with_effect(ONE_CHAIN, EFFECTS[0].link()), Chain)
