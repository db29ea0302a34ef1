"""An identified lattice whose runs from rest follow a session that nobody recorded, simulated by a polycrystal."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pzt_ros.diagnosis import flexible
from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.data import RunData, split
from pzt_ros.diagnosis.flexible import fit_flexible
from pzt_ros.diagnosis.flexible_lattice import FlexibleHysteresis
from pzt_ros.diagnosis.histories import refitted_from, renewed
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.lattice_pasts import not_described, with_pasts_sought
from pzt_ros.diagnosis.outcome import model_of
from pzt_ros.diagnosis.undeclared import default_chain
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.records import Record
from pzt_ros.sysid.history_shares import voltage_bounds
from pzt_ros.sysid.predict import predict
from pzt_ros.sysid.run import Start
from pzt_ros.sysid.start import CountedPart, displacement_of, thinned_part

RATE, NOISE, SWEEP = 200.0, 10e-9, 60.0
PLANT = Lattice(
    coercive_field=5e5,
    coercive_field_spread=5e10,
    interaction_field_spread=1e11,
    relaxation_time=2e-3,
    reciprocal_permittivity=6e7,
    domain_volume=2e-22,
)

TURNS = (
    (0.0, 140.0, -30.0, 110.0, 10.0, 90.0, 30.0, 140.0, -30.0, 60.0, 0.0),
    (0.0, 70.0, 20.0, 120.0, -20.0, 140.0, 40.0, 100.0, -30.0, 130.0, 0.0),
    (0.0, 90.0, -10.0, 135.0, 15.0, 80.0, 50.0, 120.0, -25.0, 100.0, 0.0),
)
BETWEEN = 150.0, -35.0
"""Volts that the stage went to between two runs, unrecorded."""


def path(points: tuple[float, ...]) -> Array:
    """Straight from one voltage to the next [V]."""
    legs = [np.linspace(a, b, int(abs(b - a) / SWEEP * RATE))[:-1] for a, b in pairwise(points)]
    return np.concatenate([*legs, [points[-1]]])


@pytest.fixture(scope="module")
def records() -> list[Record]:
    """Three runs of one session; before the first the stage was never driven."""
    rng, drives = np.random.default_rng(4), [path(turns) for turns in TURNS]
    hidden = path((0.0, *BETWEEN, 0.0))
    session = np.concatenate([drives[0], hidden, drives[1], hidden, drives[2]])
    time = np.arange(session.size) / RATE
    _, out = PLANT.step(PLANT.init(Rest()), Signals(time=time, voltage=session))
    motion = 150e-6 * out.polarization**2
    first, found = 0, []
    for number, drive in enumerate(drives):
        reading = motion[first : first + drive.size] + NOISE * rng.standard_normal(drive.size)
        columns = {"time_s": np.arange(drive.size) / RATE, "voltage_V": drive, "displacement_m": reading}
        found.append(Record(f"run-{number}", columns))
        first += drive.size + hidden.size
    return found


@pytest.fixture(scope="module")
def model(records: list[Record]) -> Hypothesis:
    """What stands for a stage of which nothing was declared, fitted as if every run were its first."""
    data = [RunData(record, {}, NOISE) for record in records]
    runs = split(data[:2], data[2:])
    return begun(default_chain(runs), runs)


@pytest.fixture(scope="module")
def found(model: Hypothesis) -> Hypothesis:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flexible, "ROTATIONS", (1.0,))  # others take time, and change nothing here
        return fit_flexible(model, lambda text: None)


def test_density_and_pasts_are_found_together(model: Hypothesis, found: Hypothesis) -> None:
    assert not any(run.begins_driven for run in model.staged.runs)
    assert min(model.ratios) > 20.0
    assert max(found.ratios[:2]) < 1.05
    assert found.ratios[2] < 1.7  # two short runs do not determine the density everywhere
    ceramic = found.staged.ceramic
    assert isinstance(ceramic, FlexibleHysteresis)
    assert ceramic.occupancies.start == ceramic.occupancies.stop  # no occupancy is free
    assert not ceramic.start_of(found.vector, 0).prior_voltages  # it was virgin
    for number in (1, 2):
        assert ceramic.start_of(found.vector, number).prior_voltages[-1] == pytest.approx(BETWEEN[-1], abs=3.0)


def test_a_wrong_past_is_found_anew_beside_the_density(found: Hypothesis) -> None:
    lost = refitted_from(found, {1: Start(leg=1.0)}, 0)
    assert lost.ratios[1] > 5.0
    assert 1 in not_described(lost)
    again = with_pasts_sought(lost, IN_THIS_PROCESS)
    assert again.ratios[1] < 1.1
    assert renewed(again) is again  # beside an effect they stay: to seek them takes passes over the lattice


def test_runs_that_are_described_keep_their_pasts(found: Hypothesis) -> None:
    quiet = replace(found.staged, runs=[replace(run, noise=2.0 * run.noise) for run in found.staged.runs])
    satisfied = refitted_from(replace(found, staged=quiet), {}, 0)
    assert with_pasts_sought(satisfied, IN_THIS_PROCESS) is satisfied


@pytest.mark.parametrize(("left", "is_sought_on"), [(9.0, False), (2.0, True)])
def test_pasts_that_leave_most_are_not_sought_further(
    monkeypatch: pytest.MonkeyPatch, left: float, is_sought_on: bool
) -> None:
    """A court case: pasts that stood for a fatigue of 10 x, beside which a density was identified anew for a minute."""
    first, beside, asked = stub(10.0), stub(left), []
    monkeypatch.setattr(flexible, "_lattice", lambda model, known, like=None: first)
    monkeypatch.setattr(flexible, "_pasts_may_tell", lambda found, beyond: True)
    monkeypatch.setattr(flexible, "not_described", lambda each: [0])
    monkeypatch.setattr(flexible, "_has_past", lambda each, number: False)
    monkeypatch.setattr(flexible, "with_pasts_sought", lambda each, workers: beside)
    monkeypatch.setattr(flexible, "_in_turn", lambda model, best, workers: asked.append(best) or best)
    monkeypatch.setattr(flexible, "fitted", lambda staged, *_: staged)
    monkeypatch.setattr(flexible, "exact", lambda each: each)
    assert fit_flexible(stub(20.0), lambda text: None) is first.staged
    assert asked == [beside] * is_sought_on


def test_pasts_that_a_wrong_density_made_up_do_not_spoil_the_right_one() -> None:
    """As of a court case, tilted thresholds, of which Gaussians took three runs of a virgin stage for poled before."""
    rng, runs = np.random.default_rng(5), []
    for number, turns in enumerate(TURNS):
        drive = path(turns)
        time = np.arange(drive.size) / RATE
        _, out = PLANT.step(PLANT.init(Rest()), Signals(time=time, voltage=drive))
        reading = 150e-6 * out.polarization**2 + NOISE * rng.standard_normal(drive.size)
        columns = {"time_s": time, "voltage_V": drive, "displacement_m": reading}
        runs.append(RunData(Record(f"run-{number}", columns), {}, NOISE))
    parts = split(runs[:2], runs[2:])
    wrong = {number: Start((-100.0 - 5.0 * number,), leg=2.0) for number in range(3)}
    model = refitted_from(begun(default_chain(parts), parts), wrong, 0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flexible, "ROTATIONS", (1.0,))
        found = fit_flexible(model, lambda text: None)
    assert max(found.ratios[:2]) < 1.05
    assert found.ratios[2] < 1.2
    assert not any(found.staged.ceramic.start_of(found.vector, number).prior_voltages for number in range(3))


def stub(ratio: float) -> Any:
    """A hypothesis that leaves so many times the noise in its only run."""
    excess = ratio**2 - 1.0
    return SimpleNamespace(
        ratios=[ratio], total=ratio**2, excess=excess, beside="", staged=object(), vector=0, effects=()
    )


def test_a_past_is_what_was_driven_before() -> None:
    """Against the same drive with its past recorded, in one run."""
    shown, leg = path(TURNS[1]), 1.3
    late_time = np.arange(shown.size) / RATE
    before = np.array([0.0, *BETWEEN])
    time = np.concatenate([[-3 * leg, -2 * leg, -leg], late_time])
    span = (-0.4e6, 1.6e6)
    whole = FlexibleHysteresis([time], 1e-4, span, unknown_start=[False])
    late = FlexibleHysteresis([late_time], 1e-4, span, unknown_start=[False]).with_starts([Start(BETWEEN, leg)])
    expected, columns = whole.tangent(whole.start, [np.append(before, shown)])
    polarization, late_columns = late.tangent(late.start, [shown])
    np.testing.assert_allclose(polarization[0], expected[0][3:], atol=1e-12)
    np.testing.assert_allclose(late_columns[0], columns[0][3:], atol=2e-3)
    bare = FlexibleHysteresis([late_time], 1e-4, span, unknown_start=[False])
    assert np.max(np.abs(bare.polarization(bare.start, [shown])[0] - polarization[0])) > 1e-3


def test_an_amplifier_takes_a_past_to_the_ceramic() -> None:
    time = np.arange(3) / RATE
    plain = FlexibleHysteresis([time], 1e-4, (-0.4e6, 1.6e6), unknown_start=[False])
    behind = plain.with_starts([Start((15.0, -3.5), 1.0)])
    behind.gain = 10.0
    at_ceramic = plain.with_starts([Start((150.0, -35.0), 1.0)])
    still = [np.zeros(3)]
    np.testing.assert_array_equal(
        behind.polarization(plain.start, still)[0], at_ceramic.polarization(plain.start, still)[0]
    )


def test_samples_between_which_the_drive_goes_straight_are_passed(records: list[Record]) -> None:
    chain = Chain("lattice", (IdentifiedLattice(), StrainLaw(quadratic=200e-6)), {})
    record = records[1]
    picks = np.arange(5, 3600, 11)
    part = CountedPart(record, picks, int(picks[-1]) + 1)
    fewer = thinned_part(part)
    assert len(fewer.record) < 0.6 * part.end
    past = Start(BETWEEN, 1.0)
    whole, passed = (displacement_of(chain, each, past) for each in (part, fewer))
    assert np.ptp(whole) > 1e-6
    np.testing.assert_allclose(passed, whole, atol=1e-9)


def test_reversals_are_sought_as_far_as_the_whole_run_goes(records: list[Record]) -> None:
    """A run whose first second is looked at was taken to go no farther than in that: 165 x the noise was left."""
    early = CountedPart(records[1], np.arange(0, 80, 2), 80)
    fewer = thinned_part(early)
    assert fewer.end < len(fewer.record)
    assert voltage_bounds(fewer.record) == voltage_bounds(records[1])
    past = Start(BETWEEN, 1.0)
    chain = Chain("lattice", (IdentifiedLattice(), StrainLaw(quadratic=200e-6)), {})
    np.testing.assert_allclose(displacement_of(chain, fewer, past), displacement_of(chain, early, past), atol=1e-9)


def test_a_run_that_no_fit_saw_is_predicted(found: Hypothesis, records: list[Record]) -> None:
    chain = model_of(found, "model", "")
    assert predict(chain, records[2]).rms < 2.5 * NOISE


@pytest.mark.parametrize(
    ("beyond", "left", "may_tell"),
    [
        (1.0, 3.0, True),
        (1.7, 6.0, True),  # a little is missing as well, and far more is the pasts'
        (2.0, 2.3, False),  # a court's lag of 10 x, which pasts were sought for in vain
        (4.0, 5.0, False),
    ],
)
def test_pasts_are_sought_only_where_they_may_tell_most_of_what_is_left(
    beyond: float, left: float, may_tell: bool
) -> None:
    choice = SimpleNamespace(both=beyond * 2.0**0.5)
    there: Any = SimpleNamespace(staged=SimpleNamespace(ceramic=FlexibleHysteresis.__new__(FlexibleHysteresis)))
    there.staged.ceramic.choice = choice
    found: Any = SimpleNamespace(ratios=[left] * 3, excess=2.0 * (left**2 - 1.0), total_at=lambda ratio: 2.0 * ratio**2)
    assert flexible._pasts_may_tell(found, there) is may_tell
