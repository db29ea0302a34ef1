"""One battery for every link: whoever stands in the table of links is tested here, unasked."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from pzt_ros.chains import LINKS, chain_as_data, load_chain, parse_chain, shipped_chains
from pzt_ros.effects.table import EFFECTS
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.change import Change, by_differences
from pzt_ros.physics.link import SECTIONS, Link
from pzt_ros.physics.loaded import Loaded
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import choices_of, parameters_of, to_si

QUANTITIES = ("voltage", "polarization", "phase_fraction", "displacement", "strain_polarization", "neighbour")
COUNT = 48
STEP = 1e-3
REST = Rest(seed=3)


def from_defaults() -> dict[str, Link]:
    """Every link of the table that needs no parameters."""
    return {
        kind: cls()
        for kind, cls in LINKS.items()
        if all(f.default is not dataclasses.MISSING for f in dataclasses.fields(cls))
    }


def from_shipped_chains() -> dict[str, Link]:
    """Every link of every shipped chain."""
    return {f"{name}-{link.kind}": link for name in shipped_chains() for link in load_chain(name).links}


def from_effects() -> dict[str, Link]:
    """Every effect at every start of a search: by default an effect is not there."""
    starts = {f"{e.name}-{number}": e.link(**start) for e in EFFECTS for number, start in enumerate(e.starts)}
    return {name: link.driving(Preisach()) if isinstance(link, Loaded) else link for name, link in starts.items()}


INSTANCES = {**from_defaults(), **from_shipped_chains(), **from_effects()}


@pytest.fixture(params=INSTANCES.values(), ids=INSTANCES.keys())
def link(request: pytest.FixtureRequest) -> Link:
    """One link after the other."""
    return request.param


def signals_of(count: int = COUNT) -> Signals:
    """A block in which every quantity is known: the drive goes up, down and up again."""
    time = np.arange(1, count + 1) * STEP
    part = 0.5 * (1.0 - np.cos(2 * np.pi * 1.5 * np.arange(1, count + 1) / count))
    polarization = 0.1 + 0.1 * part
    signals = Signals(time, 120.0 * part - 20.0, polarization, 0.5 + 0.3 * part, 2e-6 + 8e-6 * part)
    return signals.replace(
        strain_polarization=polarization + 0.02 * np.sin(9 * part), neighbour=3e-6 * np.cos(5 * part)
    )


def piece(signals: Signals, begin: int, end: int) -> Signals:
    """The samples `begin` to `end` of a block."""
    return signals.replace(time=signals.time[begin:end], **{q: getattr(signals, q)[begin:end] for q in QUANTITIES})


def assert_same(one: Signals, other: Signals) -> None:
    for quantity in ("time", *QUANTITIES):
        np.testing.assert_array_equal(getattr(one, quantity), getattr(other, quantity), err_msg=quantity)


def copied(signals: Signals) -> Signals:
    return signals.replace(**{q: getattr(signals, q).copy() for q in ("time", *QUANTITIES)})


def written_by(link: Link) -> list[str]:
    """The quantities a step of this link replaces."""
    before = signals_of(2)
    _, after = link.step(link.init(REST), before)
    return [q for q in QUANTITIES if getattr(after, q) is not getattr(before, q)]


def test_every_kind_of_link_is_here() -> None:
    assert {link.kind for link in INSTANCES.values()} == set(LINKS)


@pytest.mark.parametrize("kind", LINKS)
def test_registered_under_its_own_name(kind: str) -> None:
    cls = LINKS[kind]
    assert cls.kind == kind
    assert cls.section in SECTIONS
    assert cls.__doc__


@pytest.mark.parametrize("kind", LINKS)
def test_parameters_are_declared(kind: str) -> None:
    fields = {f.name: f for f in dataclasses.fields(LINKS[kind])}
    for name, declared in parameters_of(LINKS[kind]).items():
        assert to_si(1 if declared.unit == "1" else f"1 {declared.unit}", declared.unit, name) == 1.0
        assert len(declared.description) > 5, name
        assert math.isfinite(declared.lower), name
        assert math.isfinite(declared.upper), name
        assert declared.lower < declared.upper, name
        default = fields[name].default
        if default is not dataclasses.MISSING:
            assert declared.lower <= default <= declared.upper, name
    for name, offered in choices_of(LINKS[kind]).items():
        assert offered.description, name
        assert fields[name].default in offered.options, name


def test_yaml_gives_the_same_link_back(link: Link) -> None:
    assert parse_chain(chain_as_data(Chain("one", (link,))), "one.yaml").links == (link,)


def test_state_is_a_row_of_floats(link: Link) -> None:
    before = link.init(REST)
    after, _ = link.step(before, signals_of())
    for state in (before, after):
        assert isinstance(state, np.ndarray)
        assert state.dtype == np.float64
        assert state.ndim == 1
    assert before.shape == after.shape
    np.testing.assert_array_equal(link.init(REST), before)


@pytest.mark.parametrize("direction", ["step", "invert"])
def test_nothing_that_goes_in_is_changed(link: Link, direction: str) -> None:
    state, signals = link.init(REST), signals_of()
    kept_state, kept_signals = state.copy(), copied(signals)
    getattr(link, direction)(state, signals)
    np.testing.assert_array_equal(state, kept_state)
    assert_same(signals, kept_signals)


@pytest.mark.parametrize("direction", ["step", "invert"])
def test_what_comes_out_is_finite_and_of_full_length(link: Link, direction: str) -> None:
    state, out = getattr(link, direction)(link.init(REST), signals_of())
    for quantity in ("time", *QUANTITIES):
        values = getattr(out, quantity)
        assert values.shape == (COUNT,), quantity
        assert values.dtype == np.float64, quantity
        assert np.all(np.isfinite(values)), quantity
    np.testing.assert_array_equal(out.time, signals_of().time)
    _, again = getattr(link, direction)(link.init(REST), signals_of())
    assert_same(out, again)
    assert state.dtype == np.float64


CUTS = [0, 1, 2, 9, 30, COUNT]


def in_pieces(link: Link, direction: str) -> tuple[np.ndarray, Signals]:
    """The block cut into pieces; the state is stored as bytes and read back between them."""
    state, parts = link.init(REST), []
    for begin, end in itertools.pairwise(CUTS):
        stored = np.frombuffer(state.tobytes()).copy()
        state, out = getattr(link, direction)(stored, piece(signals_of(), begin, end))
        parts.append(out)
    joined = {q: np.concatenate([getattr(part, q) for part in parts]) for q in ("time", *QUANTITIES)}
    return state, signals_of().replace(**joined)


def test_blocks_may_be_cut_anywhere(link: Link) -> None:
    """To the bit; this is also the restart from a stored state, since nothing but the state is carried over."""
    end, whole = link.step(link.init(REST), signals_of())
    state, joined = in_pieces(link, "step")
    assert_same(joined, whole)
    np.testing.assert_array_equal(state, end)


def test_inverse_may_be_cut_anywhere(link: Link) -> None:
    """To the tolerance of the search: a link may begin it elsewhere in a new block."""
    _, whole = link.invert(link.init(REST), signals_of())
    _, joined = in_pieces(link, "invert")
    for quantity in QUANTITIES:
        one, other = getattr(joined, quantity), getattr(whole, quantity)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-7 * np.ptp(other), err_msg=quantity)


def lateness(link: Link) -> float:
    """By how much what a link was asked for comes late [s], as its docstring says."""
    if link.kind == "displacement_sensor":
        return STEP * link.delay  # type: ignore[attr-defined]
    return link.pure_delay if link.kind == "sensor_lag" else 0.0  # type: ignore[attr-defined]


def allowed(link: Link, asked: np.ndarray) -> float:
    """What an inverse may leave: the tolerance of searches; noise and least step; the differences of a fast lag."""
    left = 1e-6 * np.ptp(asked)
    if link.kind == "displacement_sensor":
        left += 6 * link.noise_rms + link.resolution  # type: ignore[attr-defined]
    if link.kind in ("amplifier_bandwidth", "sensor_lag") and link.time_constant > STEP:  # type: ignore[attr-defined]
        left += link.time_constant / STEP * np.max(np.abs(np.diff(asked, 2)))  # type: ignore[attr-defined]
    return float(left)


def test_step_undoes_invert(link: Link) -> None:
    """What the link was asked for comes out; noise, least step and delay of a sensor cannot be asked away."""
    end, wanted = link.step(link.init(REST), signals_of())
    moved, needed = link.invert(link.init(REST), wanted)
    _, got = link.step(link.init(REST), needed)
    for quantity in written_by(link):
        if quantity == "phase_fraction":  # internal: it follows where the polarization does
            continue
        asked = getattr(wanted, quantity)
        arrived = np.interp(wanted.time - lateness(link), wanted.time, asked)
        np.testing.assert_allclose(getattr(got, quantity), arrived, rtol=0, atol=allowed(link, asked), err_msg=quantity)
    assert moved.shape == end.shape


def test_a_step_writes_something(link: Link) -> None:
    assert written_by(link)


def moved_to_all_sides(signals: Signals) -> Change:
    """Three changes of what a link reads."""
    columns = np.column_stack([np.sin(rate * np.arange(len(signals.time)) + 0.3) for rate in (0.05, 0.3, 1.1)])
    return Change(0.01 * columns, 1e-6 * columns[::-1], 0.01 * columns + 0.004)


def test_a_change_is_carried_as_differences_would(link: Link) -> None:
    signals = signals_of()
    change = moved_to_all_sides(signals)
    found = link.carry(signals, change)
    wanted = by_differences(lambda block: link.step(link.init(REST), block)[1], signals, change)
    for quantity, columns in vars(found).items():
        reference = getattr(wanted, quantity)
        np.testing.assert_allclose(columns, reference, atol=1e-3 * np.max(np.abs(reference)), err_msg=quantity)


def test_changes_keep_their_precision(link: Link) -> None:
    change = Change(*(columns.astype(np.float32) for columns in vars(moved_to_all_sides(signals_of())).values()))
    assert {columns.dtype.name for columns in vars(link.carry(signals_of(), change)).values()} == {"float32"}
