"""Relays told where no past reaches, and then of all samples, for an effect was what pasts had seemed to be.

Plays with a hysteresis of the strain, made by loops of this file; simulated.
"""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.data import RunData, seen_through, split
from pzt_ros.diagnosis.flexible import fit_rate_independent
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.reach_of_pasts import counted_where_no_past_reaches
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.time_limit import TimeLimit
from pzt_ros.diagnosis.undeclared import default_chain
from pzt_ros.diagnosis.whole_runs import on_all_samples
from pzt_ros.effects.strain_polarization_hysteresis import StrainPolarizationHysteresis
from pzt_ros.parallel import IN_THIS_PROCESS, one_blas_thread
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record

NOISE, RATE = 12e-9, 100.0
KIND = StrainPolarizationHysteresis.kind
RADII = np.linspace(4.0, 110.0, 14)  # V


def behind(drive: Array, radius: float) -> Array:
    """A play of that half width, in the middle of its slack at first."""
    out, y = np.empty_like(drive), float(drive[0])
    for k, there in enumerate(drive):
        y = min(max(y, there - radius), there + radius)
        out[k] = y
    return out


def run(seed: int, lead: float, noise: float) -> RunData:
    """Turns at random on a stage that was never driven, behind a first way up to 150 V."""
    rng = np.random.default_rng(seed)
    turns = [0.0, 150.0, 0.0, *rng.uniform(0.0, 150.0, 22)]
    legs = [np.linspace(a, b, max(int(abs(b - a) * RATE / 150.0), 2))[:-1] for a, b in pairwise(turns)]
    volts = np.concatenate([*legs, [turns[-1]]])
    p = 4e-4 * volts + sum(1.2e-4 * behind(volts, radius) for radius in RADII)  # C/m^2
    ahead = p + lead * (p - behind(p, 0.015)) / 0.015
    read = 4e-5 * ahead + 2e-5 * ahead**2 + noise * rng.standard_normal(volts.size)
    columns = {"time_s": np.arange(volts.size) / RATE, "voltage_V": volts, "displacement_m": read}
    return RunData(Record(f"run-{seed}", columns), {}, noise)


def where_no_past_reaches(lead: float, noise: float = NOISE) -> Hypothesis:
    """Relays without an effect."""
    runs = split([run(1, lead, noise), run(2, lead, noise)], [run(3, lead, noise)])
    base = begun(default_chain(runs), runs)
    cut = [counted_where_no_past_reaches(each) for each in base.staged.runs]
    beyond = dataclasses.replace(base.staged, runs=seen_through(base.staged.chain, cut))
    with one_blas_thread():
        return fit_rate_independent(fitted(beyond, base.vector), lambda text: None, IN_THIS_PROCESS)


@pytest.fixture(scope="module")
def told() -> Branch:
    """Relays and the hysteresis where no past reaches, as a search names it there."""
    bare = where_no_past_reaches(0.01)
    with one_blas_thread():
        beside = Search(Thresholds().on_flexible()).with_effects(bare, [KIND])
        after = fit_rate_independent(beside, lambda text: None, IN_THIS_PROCESS)
    found = Candidate(KIND, bare, after)
    return Branch("identified", bare, (Step(bare, (found,), {}, (found,), (), "told where no past reaches"),))


def on_whole(final: Hypothesis) -> Hypothesis:
    """What is left of all samples by what was fitted to some."""
    runs = seen_through(final.staged.chain, [each.uncut for each in final.staged.runs])
    return fitted(dataclasses.replace(final.staged, runs=runs), final.vector, final.effects, most_steps=0)


def test_it_is_identified_on_all_samples_where_its_effect_leaves_nothing_of_them(told: Branch) -> None:
    assert max(told.final.ratios) < 1.1
    assert all(each.since > 0 for each in told.final.staged.runs)
    assert max(on_whole(told.final).ratios) > 1.5
    with one_blas_thread():
        whole = on_all_samples(told, Search(Thresholds().on_flexible()))
    assert not any(each.since for each in whole.final.staged.runs)
    assert max(whole.final.ratios) < Thresholds().near_floor
    assert whole.final.effects == (KIND,)
    assert max(whole.base.ratios) > 2.0


def test_so_it_is_where_nothing_is_missing() -> None:
    bare = where_no_past_reaches(0.0, 3.0 * NOISE)  # beside that a density of two runs is right
    assert all(each.since > 0 for each in bare.staged.runs)
    with one_blas_thread():
        whole = on_all_samples(Branch("identified", bare, ()), Search(Thresholds().on_flexible()))
    assert not any(each.since for each in whole.base.staged.runs)
    assert not whole.steps
    assert max(whole.base.ratios) < Thresholds().near_floor


def test_it_stays_where_a_past_is_what_it_seems(told: Branch) -> None:
    """Of the same runs as if the first way up had been another's; and where the time is up."""
    staged = told.final.staged
    records = [each.record for each in staged.runs]
    wrong = [
        dataclasses.replace(r, columns={**r.columns, "displacement_m": r.displacement + 2e-7 * (r.voltage < 20.0)})
        for r in records
    ]
    runs = [dataclasses.replace(each, record=record) for each, record in zip(staged.runs, wrong, strict=True)]
    other = dataclasses.replace(staged, runs=seen_through(staged.chain, runs))
    final = fitted(other, told.final.vector, told.final.effects, most_steps=0)
    found = dataclasses.replace(told.steps[0].candidates[0], after=final)
    branch = dataclasses.replace(
        told, steps=(dataclasses.replace(told.steps[0], candidates=(found,), accepted=(found,)),)
    )
    with one_blas_thread():
        assert on_all_samples(branch, Search(Thresholds().on_flexible())) is branch
    assert on_all_samples(told, Search(limit=TimeLimit(0.0))) is told
