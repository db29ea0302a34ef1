"""Where the search for a first effect starts, and when it begins anew: all simulated, or stand-ins of what it asks."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis import (
    beside_effects,
    branches,
    from_rest,
    identified_densities,
    judge,
    likeliest,
    own_densities,
    past_instead,
    refinement,
    seeker,
    whole_runs,
)
from pzt_ros.diagnosis import elements as slips
from pzt_ros.diagnosis import search as search_module
from pzt_ros.diagnosis.base import fit_declared
from pzt_ros.diagnosis.beside_effects import BesideEffects
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.data import RunData, split
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.diagnose import _is_sparse
from pzt_ros.diagnosis.hypothesis import Misfit, fitted
from pzt_ros.diagnosis.identifiability import Alike
from pzt_ros.diagnosis.kinetics import with_declared_kinetics
from pzt_ros.diagnosis.screen import Prospect
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.time_limit import TimeLimit
from pzt_ros.diagnosis.undeclared import Bases
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.records import Record
from pzt_ros.sysid.run import Start

ON_DENSITY, ON_FREE_SHAPE = BesideEffects.on_density, branches._on_free_shape


@pytest.fixture(autouse=True)
def densities_of_their_own(monkeypatch: Any) -> None:
    """What stands here for hypotheses has no density that could be fitted."""
    monkeypatch.setattr(branches, "is_shaped", lambda found: False)
    monkeypatch.setattr(branches, "_on_free_shape", lambda *_: None)
    monkeypatch.setattr(branches, "lopsided_instead", lambda *_: None)
    monkeypatch.setattr(whole_runs, "whole_beside", lambda *_: None)
    monkeypatch.setattr(branches, "beside_likeliest", lambda *_: None)
    monkeypatch.setattr(branches, "_first_far_off", lambda *_: None)
    monkeypatch.setattr(branches, "_on_own_relays_soon", lambda *_: None)
    monkeypatch.setattr(branches, "on_lattice_first", lambda *_: None)
    monkeypatch.setattr(branches, "on_own_relays", lambda *_: None)
    monkeypatch.setattr(identified_densities, "told_beyond_pasts", lambda found, *_: found)
    monkeypatch.setattr(BesideEffects, "on_density", lambda *_: None)


NOISE = 8e-9


def leaving(*ratios: float, effects: tuple[str, ...] = (), name: str = "") -> Any:
    """What a search asks of a hypothesis, with so many times the noise left in each run."""
    parts = [Misfit(1000.0 * ratio**2, 1000, 1000.0) for ratio in ratios[:2]]
    total = sum(ratio**2 for ratio in ratios[:2])
    return SimpleNamespace(
        fit=parts[0],
        selection=parts[1],
        ratios=[*ratios],
        total=total,
        excess=total - 2.0,
        over_noise=0.5 * total,
        effects=effects,
        beside="",
        name=name,
        staged=SimpleNamespace(has_past=False, runs=[]),
    )


def base() -> Any:
    """Thesis set P2 with its relaxation time free, fitted to a run of itself with another one."""
    chain = load_chain("thesis-p2")
    chain = dataclasses.replace(chain, notes={"free": ["parametrized.relaxation_time", "electrostriction.coefficient"]})
    time = np.arange(0.0, 3.0, 2e-3)
    voltage = np.interp(time, [0.0, 0.5, 1.0, 1.5, 2.0, 3.0], [0.0, 140.0, 10.0, 110.0, 40.0, 40.0])

    def run(seed: int) -> Record:
        noise = NOISE * np.random.default_rng(seed).standard_normal(time.size)
        _, out = chain.step(chain.init(Rest(time=0.0)), Signals(time=time, voltage=voltage))
        return Record("run", {"time_s": time, "voltage_V": voltage, "displacement_m": out.displacement + noise})

    runs = split([RunData(run(0), {}, NOISE)], [RunData(run(1), {}, NOISE)])
    return fit_declared(chain, runs, lambda text: None)


def test_kinetics_that_ran_away_are_held_as_declared() -> None:
    """A court case: without the relaxation that was there, the relaxation time went to ps, and creep took its place."""
    found = base()
    assert with_declared_kinetics(found) == []
    (place,) = (k for k, each in enumerate(found.staged.ceramic.coordinates) if each.field == "relaxation_time")
    away = found.vector.copy()
    away[place] += math.log(1e3)
    (held,) = with_declared_kinetics(fitted(found.staged, away, most_steps=0))
    assert held.vector[place] == found.staged.ceramic.start[place]
    assert held.vector.size == found.vector.size
    others = [k for k in range(found.vector.size) if k != place]
    assert np.allclose(held.vector[others], found.vector[others], atol=0.01)


@pytest.mark.parametrize("has_past", [False, True])
def test_pasts_make_up_for_much_so_kinetics_are_held_sooner(has_past: bool) -> None:
    """A court case: beside pasts the relaxation time went to 7 x only, and a bandwidth was left at 8 x the noise."""
    found = base()
    (place,) = (k for k, each in enumerate(found.staged.ceramic.coordinates) if each.field == "relaxation_time")
    away = found.vector.copy()
    away[place] += 2.0
    staged = found.staged
    if has_past:
        late = [dataclasses.replace(run, record=_from_later(run.record)) for run in staged.runs]
        starts = [Start() for _ in late]
        ceramic = DeclaredHysteresis(
            staged.ceramic.model, staged.ceramic.quick, staged.ceramic.coordinates, [run.record for run in late], starts
        )
        staged = dataclasses.replace(staged, runs=split(late[:1], late[1:]), ceramic=ceramic)
    assert staged.has_past is has_past
    assert len(with_declared_kinetics(fitted(staged, away, most_steps=0))) == int(has_past)


def _from_later(record: Record) -> Record:
    return Record(record.name, {name: column[150:] for name, column in record.columns.items()})


@pytest.mark.parametrize(("effect", "share"), [("amplifier_current_limit", 1.0), ("sensor_lag", 0.0)])
def test_a_refit_with_a_limit_starts_with_all_of_it(effect: str, share: float) -> None:
    """A court case: a limit that promised nearly all cost more than none until the density had moved with it."""
    staged: Any = SimpleNamespace(
        prior=(np.zeros((0, 2)), np.zeros(0)), residuals=lambda vector: [np.array([1.0 + vector.sum()])]
    )
    link = EFFECT_OF[effect].link()
    prospect = Prospect(EFFECT_OF[effect], link, (), staged, np.zeros(2), np.ones(2), 0.0, 1)
    assert np.array_equal(prospect.best_start(), np.full(2, share))


class Places(Search):
    """A search whose refits from each place are given."""

    def _candidates(self, before: Any, seen_from: Any, most: float = math.inf) -> Any:
        self.seen = [*getattr(self, "seen", []), seen_from.name]
        return tuple(Candidate(kind, before, leaving(*left)) for kind, left in seen_from.found.items()), {}


def place(name: str, **found: tuple[float, float]) -> Any:
    each = leaving(5.0, 5.0, name=name)
    each.found = found
    each.staged = SimpleNamespace(runs=[], has_past=False)
    return each


@pytest.mark.parametrize(
    ("sooner", "seen"),
    [
        ([], ["base", "elsewhere"]),
        ([{"slow_relaxation": (1.03, 1.02), "thermal_drift": (1.1, 1.5)}], ["held"]),
        ([{"slow_relaxation": (1.03, 1.02), "thermal_drift": (1.05, 1.05)}], ["held", "base", "elsewhere"]),
        ([{"slow_relaxation": (1.3, 1.02)}], ["held", "base", "elsewhere"]),
    ],
)
def test_a_base_that_went_astray_is_not_asked_first(
    monkeypatch: pytest.MonkeyPatch, sooner: list[dict[str, tuple[float, float]]], seen: list[str]
) -> None:
    monkeypatch.setattr(judge, "alike_by_design", lambda records: [])
    held = [place("held", **found) for found in sooner]
    elsewhere = place("elsewhere", slow_relaxation=(1.0, 1.0))
    search = Places(sooner=lambda: held, origins=lambda: [elsewhere, place("never")])
    candidates, _ = search._from_anywhere(place("base", slow_relaxation=(3.0, 3.0)), 50.0)
    assert search.seen == seen  # type: ignore[attr-defined]
    assert candidates[0].after.total < 2.2


@pytest.mark.parametrize(
    ("found", "is_lost", "goes_on"),
    [
        ({"slow_relaxation": (4.7, 4.7), "thermal_drift": (4.8, 4.8)}, True, False),
        ({"slow_relaxation": (4.7, 4.7), "thermal_drift": (4.8, 4.8)}, False, True),
        ({"slow_relaxation": (3.0, 3.0)}, True, True),  # half of what is left: the base may have bent for it
        ({"slow_relaxation": (3.8, 3.8), "mains_hum": (3.7, 3.7)}, True, True),  # all, between two
    ],
)
def test_a_base_that_is_wrong_is_not_tried_from_elsewhere(
    monkeypatch: pytest.MonkeyPatch, found: dict[str, tuple[float, float]], is_lost: bool, goes_on: bool
) -> None:
    """A court case: 90 s for refits of effects that explained a quarter, on a density that was another."""
    monkeypatch.setattr(judge, "alike_by_design", lambda records: [])
    monkeypatch.setattr(Places, "is_significant", lambda self, candidate: True)
    search = Places(origins=lambda: [place("elsewhere")], is_lost=lambda: is_lost)
    search._from_anywhere(place("base", **found), 50.0)
    assert search.seen == ["base", *["elsewhere"] * goes_on]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("has_past", "reached", "searched", "told"),
    [(True, 1.0, ["best"], ["rival"]), (True, 1.3, ["best", "rival"], []), (False, 1.0, ["rival", "best"], [])],
)
def test_rivals_of_what_comes_to_the_floor_begin_from_its_pasts(
    monkeypatch: pytest.MonkeyPatch, has_past: bool, reached: float, searched: list[str], told: list[str]
) -> None:
    """Court cases: each of four effects searched pasts of its own for a minute; nine minutes for one diagnosis."""
    rival, best, end = leaving(3.2, 3.2, name="rival"), leaving(3.0, 3.0, name="best"), leaving(reached, reached)
    for each in (rival, best, end):
        each.staged = SimpleNamespace(runs=[], has_past=has_past)
    asked: dict[str, list[str]] = {"searched": [], "told": []}

    def finished(found: Any, further: bool) -> Any:
        asked["searched"].append(found.name)
        return end if found is best else found

    def with_histories_of(found: Any, other: Any) -> Any:
        assert other is end
        asked["told"].append(found.name)
        return found

    monkeypatch.setattr(seeker, "finished", finished)
    monkeypatch.setattr(seeker, "with_histories_of", with_histories_of)
    assert Search()._finished([rival, best]) == [rival, end]
    assert asked == {"searched": searched, "told": told}


@pytest.mark.parametrize(("left", "taken"), [(3.9, 0), (3.0, 1)])
def test_what_explains_next_to_nothing_is_not_polished(
    monkeypatch: pytest.MonkeyPatch, left: float, taken: int
) -> None:
    """A court case: a minute was spent on a curve that explained 17 % and came no further."""
    before, polishes = leaving(4.0, 4.0), []
    found = [Candidate(name, before, leaving(at, at)) for name, at in (("a", 3.95), ("b", left))]
    monkeypatch.setattr(refinement, "taken_on", lambda best, asked: polishes.append(best) or best)
    monkeypatch.setattr(refinement, "with_histories_of", lambda rival, best: rival)
    polished = refinement.polished(tuple(found), Thresholds(), IN_THIS_PROCESS)
    assert [each.name for each in polished] == ["b", "a"]
    assert len(polishes) == taken


@pytest.mark.parametrize(("left", "refitted"), [(1.5, ["lag", "drift"]), (3.5, ["lag", "drift", "curve"])])
def test_what_promises_less_than_half_is_refitted_where_no_other_is_enough(
    monkeypatch: pytest.MonkeyPatch, left: float, refitted: list[str]
) -> None:
    """On a density a screen is to be believed, and a refit takes up to 10 s."""
    before = leaving(4.0, 4.0)
    totals = {"lag": 3.0, "drift": 15.0, "curve": 25.0}
    worth: Any = [SimpleNamespace(effect=SimpleNamespace(name=name), total=total) for name, total in totals.items()]

    def refit(self: Search, before: Any, prospects: Any) -> list[Candidate]:
        return [Candidate("sensor_lag", before, leaving(left, left)) for _ in prospects]

    monkeypatch.setattr(Search, "_refitted", refit)
    found, tried = Search(Thresholds().on_flexible())._refitted_in_turn(before, worth)
    assert [each.effect.name for each in tried] == refitted
    assert len(found) == len(tried)


@pytest.mark.parametrize(("left", "named"), [(1.04, True), (1.0499, False)])
def test_readings_that_wander_explain_half_or_nothing(
    monkeypatch: pytest.MonkeyPatch, left: float, named: bool
) -> None:
    """A court case: of 1.0502 x the noise, of a run whose past is not known, they left 1.0498 x, and were named."""
    before = leaving(1.08, 1.08)
    before.staged = SimpleNamespace(runs=[])
    after = leaving(left, left) if named else leaving(1.0799, 1.0799)
    after.ratios = [left, left]
    monkeypatch.setattr(judge, "alike_by_design", lambda records: [])
    monkeypatch.setattr(search_module, "wandering", lambda *_: after)
    monkeypatch.setattr(search_module, "replace", lambda each, **_: each)
    assert bool(Search()._wandering_step(before, [before], ())) is named


@pytest.mark.parametrize(("left", "together", "taken"), [(1.07, 1.01, True), (1.07, 1.06, False), (1.04, 1.0, False)])
def test_what_a_curve_and_a_law_leave_only_one_by_one_is_no_other_effect(
    monkeypatch: pytest.MonkeyPatch, left: float, together: float, taken: bool
) -> None:
    """A court case: a curve under elements that slip left 1.08 x, and and a hum or a relaxation was there, too."""
    curve, both = leaving(left, left), leaving(together, together)
    monkeypatch.setattr(search_module, "with_free_law", lambda found: both)
    found = Search()._with_law(Candidate("sensor_nonlinearity", leaving(1.7, 1.7), curve))
    assert found.after is (both if taken else curve)


@pytest.mark.parametrize(("has_past", "left", "asked"), [(True, 1.07, 0), (True, 1.3, 1), (False, 1.07, 1)])
def test_what_a_past_is_off_by_is_no_drift_by_chance(
    monkeypatch: pytest.MonkeyPatch, has_past: bool, left: float, asked: int
) -> None:
    """A court case: three reversals stood for a past but for 7 %, and readings that wander took that up."""
    declared = leaving(1.01, left)
    declared.staged = SimpleNamespace(has_past=has_past, runs=[], chain=load_chain("p802"))
    wanders: list[Any] = []
    monkeypatch.setattr(judge, "alike_by_design", lambda records: [])
    searched: list[Any] = []
    monkeypatch.setattr(Search, "run", lambda self, found: searched.append(found) or [Step(found, (), {}, (), (), "")])
    monkeypatch.setattr(Search, "with_wandering", lambda self, steps, base: wanders.append(base) or steps)
    monkeypatch.setattr(branches, "_on_free_law", lambda *_: None)
    monkeypatch.setattr(slips, "fit_bouc_wen", lambda *_: leaving(99.0, 99.0))
    monkeypatch.setattr(branches, "on_densities", lambda *_: [Branch("identified", leaving(1.0, 1.0), ())])
    found = branches._searched(Bases(declared), Thresholds(), lambda text: None, IN_THIS_PROCESS, TimeLimit())
    assert len(searched) == len(wanders) == asked
    assert len(found) == 1 + asked


@pytest.mark.parametrize(
    ("last", "explains", "ends"),
    [("thermal_drift", True, ["lag", "by chance"]), ("thermal_drift", False, []), ("sensor_curve", True, [])],
)
def test_a_drift_that_foretells_wrongly_may_go_its_own_way(
    monkeypatch: pytest.MonkeyPatch, last: str, explains: bool, ends: list[str]
) -> None:
    """A court case: a straight drift, 95 % of what chose, foretold the other half worse than none did."""
    before, lagging = leaving(4.0, 4.0), leaving(2.0, 2.0, effects=("sensor_lag",))
    named: Any = [SimpleNamespace(name=name, after=lagging) for name in ("sensor_lag", last)]
    steps = [Step(before, (), {}, (each,), (), verdict) for each, verdict in zip(named, ("lag", "last"), strict=True)]
    chance = Step(lagging, (), {}, (), (), "by chance")
    places: list[Any] = []
    monkeypatch.setattr(Search, "_wandering_step", lambda self, found, where, others: places.extend(where) or chance)
    monkeypatch.setattr(Search, "explains", lambda self, steps, base: explains)
    found = Search().with_last_drift_wandering(steps, before)
    assert [step.verdict for step in found] == ends
    assert all(each is lagging for each in places)


def test_two_effects_beside_the_declared_density_are_believed_before_one_beside_a_density_that_saw_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A court case: a hysteresis of the strain with a bias field was the latter alone, 2.3 x in a score run; now 1."""
    declared = leaving(2.0, 2.0)
    declared.staged = SimpleNamespace(has_past=False, runs=[], chain=load_chain("p802"))
    both = leaving(1.0, 1.0, effects=("strain_polarization_hysteresis", "bias_field"))
    seen = Branch("identified", leaving(1.0, 1.0), (), is_all_seen=True)
    pair = Step(declared, (), {}, (SimpleNamespace(after=both, name="bias_field"),), (), "")  # type: ignore[arg-type]
    monkeypatch.setattr(judge, "alike_by_design", lambda records: [])
    monkeypatch.setattr(Search, "run", lambda self, found: [Step(found, (), {}, (), (), "")])
    monkeypatch.setattr(Search, "with_wandering", lambda self, steps, base: steps)
    monkeypatch.setattr(Search, "with_pair", lambda self, steps, base: [pair])
    monkeypatch.setattr(slips, "fit_bouc_wen", lambda *_: leaving(99.0, 99.0))
    monkeypatch.setattr(branches, "on_densities", lambda *_: [seen])
    monkeypatch.setattr(branches, "_on_free_law", lambda *_: None)
    found = branches._searched(Bases(declared), Thresholds(), lambda text: None, IN_THIS_PROCESS, TimeLimit())
    assert found[0].final is both
    assert branches.chosen_of(found, Thresholds()) is found[0]


def test_the_search_begins_anew_on_the_base_that_does_as_well_as_an_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """A court case: a curve of the sensor led a driven base out of where it was stuck, and was named with a drift."""
    declared, better = leaving(2.0, 2.0), leaving(1.02, 1.01)
    declared.staged = better.staged = SimpleNamespace(has_past=True, runs=[], chain=load_chain("p802"))
    searched: list[Any] = []

    def run(self: Search, found: Any) -> list[Step]:
        searched.append(found)
        return [Step(found, (), {}, (), (), "", better if found is declared else None)]

    monkeypatch.setattr(Search, "run", run)
    monkeypatch.setattr(judge, "alike_by_design", lambda records: [])
    monkeypatch.setattr(slips.Elements, "tell", lambda self, asked: False)
    (branch,) = branches._searched(Bases(declared), Thresholds(), lambda text: None, IN_THIS_PROCESS, TimeLimit())
    assert branch.base is better
    assert searched == [declared]  # the better one is at the noise


@pytest.mark.parametrize(("left", "steps"), [(1.01, 1), (1.69, 2)])
def test_a_second_effect_may_lead_the_first_to_where_it_explains_all(
    monkeypatch: pytest.MonkeyPatch, left: float, steps: int
) -> None:
    """A court case: a curve left 1.7 x beside a wrong past; fatigue led to the right one, and it was enough."""
    declared, curved = leaving(5.0, 5.0), leaving(1.7, 1.7, effects=("sensor_nonlinearity",))
    there = leaving(left, left, effects=("sensor_nonlinearity",))
    curve = Candidate("sensor_nonlinearity", declared, curved)
    first = Step(declared, (curve,), {}, (curve,), (), "")
    monkeypatch.setattr(Search, "step", lambda self, found: Step(found, (), {}, (), (), "", there))
    monkeypatch.setattr(Search, "may_be_decided", lambda self, step: False)
    monkeypatch.setattr(Search, "_weighed", lambda self, steps: steps)
    found = Search().continued([first], declared)
    assert len(found) == steps
    assert found[0].accepted[0].after is (there if steps == 1 else curved)
    assert found[-1].after.effects == ("sensor_nonlinearity",)


def test_a_base_that_gains_next_to_nothing_is_no_reason_to_begin_anew() -> None:
    declared, hardly, better = leaving(2.0, 2.0), leaving(1.99, 1.99), leaving(1.9, 1.9)
    steps = [Step(declared, (), {}, (), (), "", each) for each in (hardly, better, None)]
    assert branches._better(declared, steps[:1]) is declared
    assert branches._better(declared, steps[1:]) is better
    assert branches._better(declared, steps[2:]) is declared


@pytest.mark.parametrize("takes_all", [True, False])
def test_where_all_runs_are_one_loop_no_effect_is_sought_beside_the_declared_density(
    monkeypatch: pytest.MonkeyPatch, takes_all: bool
) -> None:
    """A court case: eight minutes for the names of a curve and a drift; a lag was there."""
    blind = [Alike(lambda records: True, frozenset({"sensor_lag"}), "", takes_all)]
    declared = leaving(2.0, 2.0)
    declared.staged = SimpleNamespace(has_past=False, runs=[], chain=load_chain("p802"))
    searched: list[Any] = []

    def run(self: Search, found: Any) -> list[Step]:
        searched.append(found)
        return [Step(found, (), {}, (), (), "")]

    monkeypatch.setattr(judge, "alike_by_design", lambda records: blind)
    monkeypatch.setattr(Search, "run", run)
    monkeypatch.setattr(Search, "is_half_told", lambda self, steps: False)
    monkeypatch.setattr(Search, "with_wandering", lambda self, steps, base: steps)
    monkeypatch.setattr(slips, "fit_bouc_wen", lambda *_: leaving(99.0, 99.0))
    monkeypatch.setattr(branches, "on_densities", lambda *_: [Branch("identified", leaving(1.0, 1.0), ())])
    first, second = branches._searched(Bases(declared), Thresholds(), lambda text: None, IN_THIS_PROCESS, TimeLimit())
    assert len(searched) == (0 if takes_all else 1)
    assert (first.density, second.density) == ("gaussian", "identified")


@pytest.mark.parametrize("is_up", [True, False])
def test_nothing_is_begun_beside_the_base_where_the_time_was_up_while_relays_were_searched(
    monkeypatch: pytest.MonkeyPatch, is_up: bool
) -> None:
    """An examiner's stage: a refit on relays took minutes, and the next search began three minutes after the limit."""
    declared, limit = leaving(14.0, 14.0), TimeLimit()
    declared.staged = SimpleNamespace(has_past=False, runs=[], chain=load_chain("p802"))
    begun: list[str] = []

    def tell_first(self: Any, elements: Any, asked: Any) -> bool:
        limit.seconds = 0.0 if is_up else math.inf
        return False

    monkeypatch.setattr(identified_densities.Densities, "tell_first", tell_first)
    monkeypatch.setattr(slips.Elements, "tell", lambda self, asked: False)
    monkeypatch.setattr(judge, "alike_by_design", lambda records: [])
    monkeypatch.setattr(branches, "_may_hide_a_past", lambda *_: True)
    monkeypatch.setattr(Search, "beside", lambda self, base: begun.append("beside") or ())
    monkeypatch.setattr(branches, "poled_instead", lambda *_: None)
    monkeypatch.setattr(branches, "_sooner", lambda *_: begun.append("sooner") or [Branch("none", declared, ())])
    bases = Bases(declared, relays=leaving(13.0, 13.0))
    first, *_ = branches._searched(bases, Thresholds(), lambda text: None, IN_THIS_PROCESS, limit)
    assert first.final is declared
    assert begun == ([] if is_up else ["beside", "sooner"])


@pytest.mark.parametrize(("last", "lawful", "tried"), [(1.08, False, 0), (1.2, False, 2), (1.2, True, 0)])
def test_a_name_near_the_noise_leaves_no_other_base_to_be_tried(
    monkeypatch: pytest.MonkeyPatch, last: float, lawful: bool, tried: int
) -> None:
    """No other would be believed instead; four minutes were spent on identifying densities."""
    declared = leaving(1.3, 1.3, 1.3)
    declared.staged = SimpleNamespace(has_past=False, runs=[], chain=load_chain("p802"))
    declared.over_noise = 1.69
    named = leaving(1.0, 1.01, last, effects=("sensor_lag",))
    named.over_noise = 1.01
    others: list[str] = []

    def other(name: str) -> Any:
        return lambda *_: others.append(name) or [Branch("identified", leaving(1.0, 1.0), ())]

    step = Step(declared, (), {}, (SimpleNamespace(after=named, name="sensor_lag"),), (), "")
    monkeypatch.setattr(Search, "run", lambda self, found: [step])
    monkeypatch.setattr(Search, "explains", lambda self, steps, base: False)
    monkeypatch.setattr(Search, "blind", lambda self, found: [])
    monkeypatch.setattr(Search, "is_half_told", lambda self, steps: False)
    monkeypatch.setattr(Search, "with_wandering", lambda self, steps, base: steps)
    monkeypatch.setattr(Search, "is_outdone", lambda self, steps, base: True)
    monkeypatch.setattr(branches, "_better", lambda declared, steps: declared)
    free = Branch("gaussian", declared, (step,), has_free_law=True) if lawful else None
    monkeypatch.setattr(branches, "_on_free_law", lambda declared, steps, search: free)
    monkeypatch.setattr(slips.Elements, "branches", other("elements"))
    monkeypatch.setattr(slips.Elements, "tell", lambda self, asked: False)
    monkeypatch.setattr(branches, "on_densities", other("relays"))
    found = branches._searched(Bases(declared), Thresholds(), lambda text: None, IN_THIS_PROCESS, TimeLimit())
    assert found[0].final is named
    assert found[0].has_free_law is lawful
    assert len(others) == tried


@pytest.mark.parametrize(
    ("alone", "beside", "effects", "begins"),
    [
        (1.1, None, (), "base"),  # far less than the declared base, without an effect
        (5.0, None, (), None),
        (5.0, 1.0, ("sensor_lag",), "beside"),  # far less only beside what was named there
        (1.1, 1.4, ("sensor_lag",), "base"),
        (5.0, 1.4, ("sensor_lag",), None),
    ],
)
def test_elements_that_slip_are_judged_beside_the_effect_that_was_named(
    monkeypatch: pytest.MonkeyPatch, alone: float, beside: float | None, effects: tuple[str, ...], begins: str | None
) -> None:
    """A court case: without a lag of 10 x their loops went the other way round; named on them, it left 3.5 x."""
    declared, found = leaving(6.0, 6.0), leaving(1.6, 1.6, effects=effects)
    base, there = leaving(alone, alone), leaving(beside or 0.0, beside or 0.0, effects=effects)
    monkeypatch.setattr(slips, "fit_bouc_wen", lambda found, progress: there if found.effects else base)
    monkeypatch.setattr(slips, "without_effects", lambda found: found)
    begun: list[Any] = []

    def run(self: Search, found: Any) -> list[Step]:
        assert found is base
        begun.extend([*self.sooner(), found])
        return [Step(found, (), {}, (), (), "")]

    monkeypatch.setattr(Search, "run", run)
    monkeypatch.setattr(Search, "with_pair", lambda self, steps, found: [*steps])
    searched = slips.Elements(declared, Search()).branches(found, Thresholds())
    assert [branch.base for branch in searched] == ([base] if begins else [])
    assert (begun[0] if begun else None) is {"base": base, "beside": there, None: None}[begins]


@pytest.mark.parametrize(
    ("declares", "left", "alone", "told", "named"),
    [
        (False, 3.5, 1.0, 1.0, True),  # they explain all
        (False, 3.5, 2.4, 1.0, True),  # they explain all with an effect
        (False, 3.5, 2.4, 1.1, True),  # an effect tells nearly all beside them
        (False, 3.5, 3.4, 1.0, False),  # a polycrystal with an effect may explain as much
        (True, 3.5, 3.4, 1.0, False),  # a declared chain with an effect may explain as much
        (True, 3.5, 1.9, 1.0, True),  # unless they leave far less without one
        (False, 3.5, 2.4, 2.0, False),  # the effect does not tell nearly all
        (False, 3.5, 6.0, 1.0, False),  # they are no base for these runs
        (True, 13.0, 4.8, 1.1, True),  # an effect of 10 x was left beside them
        (True, 18.0, 8.1, 1.1, False),  # so much that none of it could be named
    ],
)
def test_relays_without_a_rate_end_the_search_where_they_tell_nearly_all(
    monkeypatch: pytest.MonkeyPatch, declares: bool, left: float, alone: float, told: float, named: bool
) -> None:
    """Court cases of wedge densities took 300 to 900 s, on bases of which nothing came; now 26 to 68."""
    declared, base = leaving(left, left), leaving(alone, alone)
    final = leaving(told, told, effects=("amplifier_bandwidth",))
    for each in (base, final):
        each.choosing, each.staged = True, SimpleNamespace(ceramic=SimpleNamespace(knows_no_rate=True), has_past=False)
    winner = SimpleNamespace(after=final, name="amplifier_bandwidth")
    monkeypatch.setattr(identified_densities, "fit_rate_independent", lambda *_: base)
    monkeypatch.setattr(Search, "run", lambda self, found: [Step(base, (), {}, (winner,), (), "")])  # type: ignore[arg-type]
    monkeypatch.setattr(Search, "with_pair", lambda self, steps, found: [*steps])
    asked = Thresholds() if declares else Thresholds().on_undeclared()
    densities = identified_densities.Densities(Bases(declared), Search(asked.on_flexible()))
    assert densities.tell(asked) is named
    assert not named or densities.on_relays.final is (base if alone == 1.0 else final)


@pytest.mark.parametrize(
    ("declared", "relays", "elements", "lattice", "is_so"),
    [
        (9.8, 5.0, 60.0, 1.0, True),
        (9.8, 5.0, 4.0, 1.0, False),  # elements are so much better that they are searched first
        (7.0, 5.0, 60.0, 1.0, False),  # a name could still come of effects beside the declared base
        (9.8, 2.0, 60.0, 1.0, False),  # relays tell sooner
        (9.8, 4.0, 60.0, 2.9, False),  # it does hardly better than they
        (9.8, 5.0, 60.0, 4.0, False),  # it lacks something, too
        (20.0, 11.6, 60.0, 4.5, True),  # a large effect, which the others lack as well: a creep of 10 x, tilted
        (9.0, 30.0, 60.0, 5.5, False),  # what the declared base leaves is hardly more
        (30.0, 20.0, 60.0, 7.0, False),  # too far from the noise
    ],
)
def test_a_lattice_that_alone_comes_near_the_noise_is_searched_first(
    monkeypatch: pytest.MonkeyPatch,
    declared: float,
    relays: float,
    elements: float,
    lattice: float,
    is_so: bool,
) -> None:
    """A court null, tilted, of which nothing was declared: 264 s, 240 of them for effects at 9.8 x; 36 s now."""
    monkeypatch.setattr(identified_densities, "fit_flexible", lambda *_: leaving(lattice, lattice))
    bases = Bases(leaving(declared, declared), leaving(relays, relays))
    others: Any = SimpleNamespace(base=leaving(elements, elements))
    assert identified_densities.Densities(bases, Search()).lattice_outdoes(others, Thresholds()) is is_so


@pytest.mark.parametrize(
    ("beside", "lattice", "is_so"),
    [
        (3.4, (1.03, 1.22), True),  # a court null of two components, a hysteresis of the strain beside the declared one
        (7.0, (1.31, 1.95), True),  # two components and a bias field of 3 x, another effect beside the declared one
        (3.4, (1.5, 2.5), False),  # two effects that a lattice takes up best
        (2.9, (1.03, 1.22), False),  # effects leave so little that the base may be right
        (3.4, (1.2, 1.25), True),
        (9.3, (2.98, 2.55), True),  # two components and a lag of 10 x, which had bent it: what is missing is beside it
        (3.2, (1.4, 1.45), False),  # not so much less
    ],
)
def test_a_lattice_that_leaves_far_less_ends_a_search_that_is_far_off(
    monkeypatch: pytest.MonkeyPatch, beside: float, lattice: tuple[float, float], is_so: bool
) -> None:
    monkeypatch.setattr(identified_densities, "fit_flexible", lambda *_: leaving(*lattice))
    densities = identified_densities.Densities(Bases(leaving(6.0, 6.0)), Search())
    assert densities.lattice_is_all(leaving(beside, beside), Thresholds()) is is_so


@pytest.mark.parametrize(("left", "effects", "is_so"), [(1.04, 1, True), (1.3, 1, False), (1.04, 0, False)])
def test_a_density_that_bent_for_an_effect_shows_it_where_it_was_not_fitted(
    monkeypatch: pytest.MonkeyPatch, left: float, effects: int, is_so: bool
) -> None:
    """A court case: a hysteresis of the strain of 3 x, 1.01 x where a density was fitted, 1.5 and 3.5 x elsewhere."""
    flexible, found = leaving(1.01, 1.5, 1.6), leaving(1.0, left, left, effects=("sensor_lag",) * effects)
    monkeypatch.setattr(Search, "run", lambda self, base: [Step(base, (), {}, (), (), "")])
    monkeypatch.setattr(Step, "after", property(lambda self: found))
    branch = identified_densities._foretold(flexible, Search())
    assert (branch is not None) is is_so
    assert branch is None or (branch.base is flexible and branch.density == "identified")


@pytest.mark.parametrize(("left", "pairs"), [(1.6, 0), (6.0, 1)])
def test_two_more_are_not_sought_beside_one_that_explains_nearly_all_on_a_density(
    monkeypatch: pytest.MonkeyPatch, left: float, pairs: int
) -> None:
    """A court case: a fatigue of 10 x, 97 % of the excess, with a drift and a bias field that were not there."""
    found, asked = leaving(left, left, effects=("polarization_fatigue",)), []
    step = Step(leaving(10.0, 10.0), (), {}, (SimpleNamespace(after=found, name="polarization_fatigue"),), (), "")
    monkeypatch.setattr(Search, "run", lambda self, base: [step])
    monkeypatch.setattr(Search, "with_pair", lambda self, steps, base: asked.append(base) or steps)
    branch = identified_densities._on_density(step.before, Search())
    assert branch.final is found
    assert len(asked) == pairs


@pytest.mark.parametrize(
    ("density", "fit", "part", "is_so"),
    [
        ("identified", 1.01, "score", True),
        ("identified", 1.2, "score", False),
        ("gaussian", 1.01, "score", False),
        ("identified", 1.01, "fit", False),
    ],
)
def test_what_a_clean_density_leaves_of_other_runs_is_its_own_matter(
    density: str, fit: float, part: str, is_so: bool
) -> None:
    """Nulls of other densities, 1.0 x where all was fitted, had something missing: 1.06 to 1.6 x where nothing was."""
    base = leaving(fit, 1.0, 1.0)
    base.staged = SimpleNamespace(runs=[SimpleNamespace(picks={part: []})])
    assert _is_sparse(Branch(density, base, ()), Thresholds()) is is_so


def leaving_of(before: float, **left: float) -> list[Candidate]:
    """Effects beside a base that leaves so many times the noise, and what each leaves, where no past is unknown."""
    found = [Candidate(name, leaving(before, before), leaving(ratio, ratio)) for name, ratio in left.items()]
    for each in found:
        each.after.staged = SimpleNamespace(has_past=False)  # type: ignore[misc, assignment]
    return found


@pytest.mark.parametrize(("left", "rival", "tied"), [(1.15, 2.9, False), (1.3, 1.7, True), (2.5, 2.9, True)])
def test_easily_taken_for_one_another_but_one_explains_far_more(left: float, rival: float, tied: bool) -> None:
    """A court case: a bandwidth explained 99 % on an identified density, a lag 74 %, and the two were the answer."""
    bandwidth, lag = leaving_of(5.6, amplifier_bandwidth=left, sensor_lag=rival)
    assert Search(Thresholds().on_flexible()).is_as_good(bandwidth, lag) is tied


@pytest.mark.parametrize(
    ("before", "after", "is_all"),
    [
        ((2.74, 1.07), (1.06, 1.05), True),  # an examiner's mode: every step was in a fitted run
        ((2.74, 1.07), (1.06, 1.08), False),  # what chooses speaks against it
        ((2.74, 1.07), (1.3, 1.05), False),  # something else is missing, too
        ((2.74, 1.3), (1.06, 1.29), False),  # what chooses has something to be explained
        ((1.1, 1.07), (1.06, 1.06), False),  # no more than what a base is off by
    ],
)
def test_what_nearly_all_fitted_runs_tell_need_not_show_where_nothing_is_left(
    before: tuple[float, float], after: tuple[float, float], is_all: bool
) -> None:
    found = Candidate("mechanical_resonance", leaving(*before), leaving(*after))
    found.before.staged.fitted, found.before.choosing = [0], [1]  # type: ignore[misc]
    assert found.is_all_but_quiet is is_all
    assert (found.share >= Thresholds().whole) is is_all
    assert Search(Thresholds().on_flexible()).is_significant(found) is is_all


@pytest.mark.parametrize(("left", "rival", "tied"), [(1.6, 5.4, False), (1.6, 1.9, True), (3.0, 5.4, True)])
def test_beside_one_that_leaves_far_less_another_does_not_tie_for_what_is_left(
    left: float, rival: float, tied: bool
) -> None:
    """A court case: a bias field explained 99.3 % on a density, a drift 91 %, and the two were the answer."""
    bias, drift = leaving_of(18.0, bias_field=left, thermal_drift=rival)
    assert Search(Thresholds().on_all_seen()).is_as_good(bias, drift) is tied


@dataclasses.dataclass(frozen=True)
class Held:
    """A model whose density is held so firmly, or may be held more firmly."""

    ceramic: Any


@pytest.mark.parametrize(
    ("choosing", "left", "tried", "best"),
    [([0], {10: 1.1, 100: 1.12}, [10, 100], 10), ([0], {10: 1.4, 100: 1.1}, [10], 1), ([], {10: 1.1, 100: 1.1}, [], 1)],
)
def test_a_density_is_held_more_firmly_for_as_long_as_that_predicts_better(
    monkeypatch: pytest.MonkeyPatch, choosing: list[int], left: dict[int, float], tried: list[int], best: int
) -> None:
    """A rival of a name that all agreed on took half a minute; where nothing chooses, there is nothing to predict."""
    weak, seen = leaving(1.2, 1.3), []
    weak.choosing, weak.vector = choosing, np.zeros(1)
    weak.staged = Held(SimpleNamespace(strength=1, stiffer=lambda: [SimpleNamespace(strength=each) for each in left]))

    def refitted(staged: Held, *_: Any) -> Any:
        seen.append(staged.ceramic.strength)
        held = leaving(left[staged.ceramic.strength], left[staged.ceramic.strength])
        held.staged = staged
        return held

    monkeypatch.setattr(refinement, "fitted", refitted)
    monkeypatch.setattr(refinement, "finished", lambda found, further: found)
    assert refinement.stiffened(weak, Thresholds()).staged.ceramic.strength == best
    assert seen == tried


@pytest.mark.parametrize(("promised", "again"), [(2.5, True), (7.8, False)])
def test_a_refit_that_did_not_leave_the_base_begins_where_the_best_went(
    monkeypatch: pytest.MonkeyPatch, promised: float, again: bool
) -> None:
    """A lag that was there stayed at none, beside it a mode explained 96 %, and the mode was named.

    The base may have fewer unknowns where it was screened than where the search began (its kinetics were held).
    """
    before, best, stuck = leaving(2.0, 2.0), leaving(1.1, 1.1), leaving(1.99, 2.0)
    before.vector, best.vector = np.zeros(4), np.array([3.0, 4.0, 9.0])
    begun: list[list[float]] = []

    def fitted(prospects: list[Any], effects: tuple[str, ...], workers: Any) -> list[Any]:
        begun.extend(each.start.tolist() for each in prospects)
        return [leaving(1.0, 1.0) for _ in prospects]

    monkeypatch.setattr(seeker, "refits", fitted)
    empty = np.zeros(2)
    mode = Prospect(*3 * (Any,), Any, empty, np.array([0.1, 0.2, 0.5]), 2.5, 2)  # type: ignore[arg-type]
    lag = Prospect(*3 * (Any,), Any, empty, np.array([0.1, 0.2, 0.7]), promised, 2)  # type: ignore[arg-type]
    first, second = Search()._from_the_best(before, [mode, lag], [best, stuck])
    assert first is best
    assert begun == ([[3.0, 4.0, 0.7]] if again else [])
    assert (second is stuck) is not again


@pytest.mark.parametrize(
    ("relays", "lattice", "bare", "tied", "ends"),
    [
        (1.04, 9.9, 4.0, False, ["relays"]),  # they tell all: no lattice is identified
        (1.4, 1.04, 4.0, False, ["relays", "lattice"]),
        (1.4, 1.2, 4.0, False, []),  # something is left beside it
        (1.4, 1.04, 1.05, False, []),  # the density needs no effect
        (1.4, 1.04, 4.0, True, ["relays", "lattice"]),  # nor does another effect leave more
    ],
)
def test_a_name_is_kept_on_a_density_that_is_identified_beside_it_where_it_is_needed_there(
    monkeypatch: pytest.MonkeyPatch, relays: float, lattice: float, bare: float, tied: bool, ends: list[str]
) -> None:
    """An examiner's hum: named soon, and four more bases searched for what was the density's: 315 s, now 127."""
    before, after = leaving(4.0, 4.0), leaving(1.3, 1.4, effects=("sensor_lag",))
    step: Any = Step(before, (), {}, (SimpleNamespace(name="sensor_lag", after=after, share=0.95),), (), "")
    tried: list[str] = []

    def identified(name: str, left: float) -> Any:
        return lambda found, *_: tried.append(name) or leaving(left, left, effects=found.effects)

    kinds = identified("relays", relays), identified("lattice", lattice)
    monkeypatch.setattr(beside_effects, "without", lambda found, name: leaving(bare, bare))
    tying = ["amplifier_bandwidth"] if tied else []
    monkeypatch.setattr(Search, "still_tied", lambda self, winner, names: [each for each in names if each in tying])
    monkeypatch.setattr(Candidate, "fit_size", 3.0)
    monkeypatch.setattr(Candidate, "selection_size", 3.0)
    beside = BesideEffects(Search(Thresholds().on_flexible()), Thresholds())
    monkeypatch.setattr(BesideEffects, "on_density", lambda self, steps: ON_DENSITY(self, steps, kinds))
    assert beside.tell_soon([step]) is bool(ends)
    assert tried == (ends or ["relays", "lattice"])
    if ends:
        assert beside.told is not None
        (kept,) = beside.told.steps
        assert [each.name for each in kept.accepted] == ["sensor_lag"]
        assert kept.tied == (("sensor_lag", "amplifier_bandwidth") if tied else ())
        assert beside.told.base.ratios == [bare, bare]


def test_rivals_are_asked_together_whether_they_tie_and_those_that_promise_half_as_much_are_not_refitted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Seven one after the other had taken as long beside correlated densities as all the rest of a search."""
    before = leaving(5.0, 5.0)
    winner: Any = Candidate("slow_relaxation", before, leaving(1.1, 1.1, effects=("slow_relaxation",)))
    names = ["mains_hum", "polarization_fatigue", "sensor_lag", "thermal_drift"]
    calls: list[Any] = []

    def refitted(self: Search, here: Any, seen_from: Any, most: float) -> Any:
        calls.append((tuple(effect.name for effect in self.effects), self.thresholds.refits, most))
        near, far = (Candidate(name, here, leaving(left, left)) for name, left in (("thermal_drift", 1.2), ("x", 3.0)))
        return (near, dataclasses.replace(far, name="polarization_fatigue")), {"mains_hum": "promises 3 %"}

    monkeypatch.setattr(Search, "_candidates", refitted)
    monkeypatch.setattr(search_module, "taken_on", lambda found, asked: found)
    search = Search(Thresholds().on_flexible())
    assert search.still_tied(winner, names) == ["sensor_lag", "thermal_drift"]  # the refit of the lag failed
    assert calls == [(tuple(names), 4, pytest.approx(0.5 * (before.total + winner.after.total)))]
    assert search.still_tied(winner, []) == []
    assert len(calls) == 1


BOTH = ("bias_field", "polarization_fatigue")


@pytest.mark.parametrize(
    ("beside", "told"),
    [
        ({"bias_field": [4.0, 1.05], "polarization_fatigue": [3.0, 2.9]}, ("bias_field", ())),  # in the second turn
        (
            {"bias_field": [1.04], "polarization_fatigue": [1.05]},
            ("bias_field", ("bias_field", "polarization_fatigue")),
        ),
        ({"bias_field": [1.04], "polarization_fatigue": [1.5]}, ("bias_field", ())),  # no second turn of the other
        (
            {"bias_field": [1.04], "polarization_fatigue": [1.12, 1.03]},
            ("polarization_fatigue", ("polarization_fatigue", "bias_field")),
        ),
        ({"bias_field": [1.04], "polarization_fatigue": []}, ("bias_field", ())),  # the other could not be tried
        ({"bias_field": [2.0, 1.9, 1.04], "polarization_fatigue": [3.0, 2.9]}, None),  # it came down too little
        ({"bias_field": [3.0, 2.0, 1.5], "polarization_fatigue": [3.0, 2.9]}, None),  # something is left
    ],
)
def test_effects_are_tried_each_on_a_lattice_of_its_own(
    monkeypatch: pytest.MonkeyPatch, beside: dict[str, list[float]], told: tuple[str, tuple[str, ...]] | None
) -> None:
    """A court case: a lattice had bent for a bias field of 10 x, which left 1.5 to 3 x on it, and 1.0 on its own."""
    ways = {name: iter(left) for name, left in beside.items()}
    base = leaving(4.7, 3.3)

    def identified(found: Any, progress: object, workers: object) -> Any:
        (name,) = found.effects
        left = next(ways[name])
        there = leaving(left, left, effects=(name,))
        there.staged = SimpleNamespace(has_past=False, ceramic=None, runs=[SimpleNamespace(since=0)])
        return there

    monkeypatch.setattr(beside_effects, "without_effects", lambda found: base)
    monkeypatch.setattr(beside_effects, "without", lambda found, name: leaving(4.0, 4.0))
    refitted = {name: leaving(2.0, 2.0, effects=(name,)) for name, left in beside.items() if left}
    monkeypatch.setattr(Search, "with_best", lambda self, bare, names: refitted.get(names[0], bare))
    asked_to_tie: list[str] = []
    monkeypatch.setattr(Search, "still_tied", lambda self, winner, names: asked_to_tie.extend(names) or [])
    monkeypatch.setattr(Candidate, "fit_size", 3.0)
    monkeypatch.setattr(Candidate, "selection_size", 3.0)
    search = BesideEffects(Search(Thresholds().on_flexible()), Thresholds())
    branch = search.on_own_densities({name: refitted.get(name, base) for name in beside}, identified)
    assert (branch is not None) is (told is not None)
    if branch is not None and told is not None:
        (step,) = branch.steps
        assert ([each.name for each in step.accepted], step.tied) == ([told[0]], told[1])
        assert "thermal_drift" in asked_to_tie
        was_tried = bool(beside["polarization_fatigue"])
        assert ("polarization_fatigue" in asked_to_tie) is not was_tried  # on a lattice of its own it was asked more


@pytest.mark.parametrize(
    ("name", "others", "expected"),
    [
        ("amplifier_bandwidth", ["sensor_lag"], "sensor_lag"),
        ("amplifier_bandwidth", [], "amplifier_bandwidth"),
        ("amplifier_bandwidth", ["mains_hum"], "amplifier_bandwidth"),  # is not late
        ("sensor_lag", ["amplifier_bandwidth"], "sensor_lag"),  # which leaves more
    ],
)
def test_an_effect_takes_its_turn_on_the_lattice_of_one_that_is_as_late(
    monkeypatch: pytest.MonkeyPatch, name: str, others: list[str], expected: str
) -> None:
    """A court case: on a lattice that had bent a bandwidth left less than the lag of 10 x that was there."""
    refits = {"sensor_lag": 1.1, "amplifier_bandwidth": 1.4, "mains_hum": 1.0}
    lattices = {"sensor_lag": 1.01, "amplifier_bandwidth": 1.35}
    monkeypatch.setattr(beside_effects, "without_effects", lambda found: found)

    def with_best(self: Search, bare: Any, names: Any) -> Any:
        left, best = min((refits[each], each) for each in names)
        return leaving(left, left, effects=(best,))

    monkeypatch.setattr(Search, "with_best", with_best)

    def identified(found: Any, progress: object, workers: object) -> Any:
        (effect,) = found.effects
        there = leaving(lattices[effect], lattices[effect], effects=(effect,))
        there.staged = SimpleNamespace(has_past=False, ceramic=None)
        return there

    beside = BesideEffects(Search(Thresholds().on_flexible()), Thresholds())
    tried = beside._in_turn({name: leaving(2.0, 2.0, effects=(name,))}, identified, others)
    best = min(tried, key=lambda each: tried[each].total)
    assert (best, tried[best].effects) == (expected, (expected,))


def test_of_effects_that_are_late_only_the_likeliest_has_a_lattice_identified_beside_it() -> None:
    names = ("amplifier_bandwidth", "mechanical_resonance", "sensor_lag", "thermal_drift", "slow_relaxation")
    worth: Any = [SimpleNamespace(name=name, cause=name) for name in names]
    asked: Any = []
    beside: Any = SimpleNamespace(on_own_densities=lambda *given: asked.extend(given))
    own_densities.on_own_densities(beside, worth, lambda candidate: candidate.name)
    found, _, others = asked
    assert found == {"amplifier_bandwidth": "amplifier_bandwidth", "thermal_drift": "thermal_drift"}
    assert others == ["mechanical_resonance", "sensor_lag", "slow_relaxation"]


@pytest.mark.parametrize(("whole", "is_taken"), [(1.01, True), (1.6, False)])
def test_samples_that_a_past_seemed_to_reach_count_where_an_effect_was_what_hid_there(
    monkeypatch: pytest.MonkeyPatch, whole: float, is_taken: bool
) -> None:
    """A court case: a virgin stage with a bias field was taken for one with a past, and predicted to 132 nm, now 12."""
    run = SimpleNamespace(since=100, uncut=RunLike(since=0, poled=True))
    found, there = leaving(1.0, 1.0, effects=("bias_field",)), leaving(whole, whole, effects=("bias_field",))
    found.staged, found.vector = StagedLike(chain=None, runs=[run]), np.zeros(1)
    there.staged = SimpleNamespace(has_past=False, ceramic=None)
    counted: list[Any] = []
    monkeypatch.setattr(from_rest, "seen_through", lambda chain, runs: counted.extend(runs) or runs)
    monkeypatch.setattr(beside_effects, "fitted", lambda staged, vector, effects: found)
    monkeypatch.setattr(beside_effects, "without_effects", lambda whole: whole)
    monkeypatch.setattr(Search, "with_effects", lambda self, bare, names: bare)
    monkeypatch.setattr(BesideEffects, "_in_turn", lambda self, found, *_: dict.fromkeys(found, there))
    beside = BesideEffects(Search(Thresholds().on_flexible()), Thresholds())
    assert (beside._on_whole_runs(found, "bias_field", beside_effects.fit_flexible) is there) is is_taken
    assert [(each.since, each.poled) for each in counted] == [(0, False)]


@dataclasses.dataclass
class RunLike:
    since: int
    poled: bool


@dataclasses.dataclass
class StagedLike:
    chain: Any
    runs: list[Any]


def test_what_leaves_least_because_less_of_its_runs_counts_is_not_the_best() -> None:
    """A court case: what dies out of a past did not count beside a creep, which explained 5 %; a bias field 67 %."""
    base, counts_less = leaving(4.3, 2.1), leaving(2.6, 1.3)
    creep = Candidate("slow_relaxation", counts_less, leaving(2.5, 1.25, effects=("slow_relaxation",)))
    bias = Candidate("bias_field", base, leaving(2.6, 1.4, effects=("bias_field",)))
    search = Search()
    assert creep.after.total < bias.after.total
    assert search.best_of([creep, bias]) is bias
    assert not search.is_as_good(bias, creep)
    alone = Candidate("slow_relaxation", counts_less, leaving(1.0, 1.0, effects=("slow_relaxation",)))
    assert search.best_of([alone, bias]) is alone  # where it explains what counts
    least = Candidate("thermal_drift", base, leaving(1.0, 1.7, effects=("thermal_drift",)))
    assert least.share < search.thresholds.share < bias.share
    assert search.best_of([least, bias]) is least  # of one base, the best has to explain enough


@pytest.mark.parametrize(
    ("fitted_alone", "after", "tries"),
    [
        (4.7, 2.6, True),
        (4.7, 1.4, False),  # so little that it may be named
        (1.04, 2.6, False),  # nothing was left where it was fitted: such a density follows anything
    ],
)
@pytest.mark.parametrize("told", [True, False])
def test_lattices_of_their_own_are_tried_where_one_effect_leaves_too_much(
    monkeypatch: pytest.MonkeyPatch, fitted_alone: float, after: float, tries: bool, told: bool
) -> None:
    flexible, seen = leaving(fitted_alone, 3.3), leaving(4.3, 0.0)
    left = leaving(after, 0.0, effects=("bias_field",))
    causes = {"bias_field": "bias_field", "imprint": "bias_field", "polarization_fatigue": "polarization_fatigue"}
    found: Any = [SimpleNamespace(name=name, cause=cause, after=left, share=0.67) for name, cause in causes.items()]
    step: Any = Step(seen, tuple(found), {}, (found[0],), (), "")
    own, asked_of = Branch("identified", flexible, ()), []
    monkeypatch.setattr(identified_densities, "fitted_to_all", lambda found: seen)
    monkeypatch.setattr(Search, "step", lambda self, before: step)
    monkeypatch.setattr(Search, "is_significant", lambda self, candidate: True)
    monkeypatch.setattr(Search, "continued", lambda self, steps, before: [*steps])
    monkeypatch.setattr(Search, "with_effects", lambda self, bare, names: left)
    monkeypatch.setattr(
        BesideEffects, "on_own_densities", lambda self, found, *_: asked_of.extend(found) or (own if told else None)
    )
    branch = identified_densities._on_all_seen(flexible, Thresholds(), Search(Thresholds().on_lattice()))
    assert asked_of == (["bias_field", "polarization_fatigue"] if tries else [])  # a variant is no other answer
    assert (branch is own) is (tries and told)
    assert branch is own or branch.steps == (step,)


@pytest.mark.parametrize(
    ("shares", "left", "lattice", "asked_of"),
    [
        ((0.77, 0.7, 0.68, 0.6), 4.2, 3.9, ["imprint", "thermal_drift"]),  # a variant is no other answer; two are tried
        ((0.5, 0.77, 0.3, 0.6), 4.2, 3.9, ["bias_field", "sensor_lag"]),  # by what they explain
        ((0.45, 0.4, 0.3, 0.2), 4.2, 3.9, []),
        ((0.77, 0.7, 0.68, 0.6), 13.0, 12.0, []),  # too far off for a name
        ((0.77, 0.7, 0.68, 0.6), 4.2, 1.9, []),  # a lattice leaves far less than any of them
    ],
)
def test_the_likeliest_effects_are_tried_each_on_a_lattice_of_its_own(
    monkeypatch: pytest.MonkeyPatch, shares: tuple[float, ...], left: float, lattice: float, asked_of: list[str]
) -> None:
    """A court case: two kinds of domains and a bias field, which explained 77 % of what was fitted beside Gaussians."""
    causes = {"imprint": "bias_field", "bias_field": "bias_field", "thermal_drift": "", "sensor_lag": "sensor_lag"}
    tried: Any = [
        SimpleNamespace(name=name, cause=cause or name, after=leaving(left, left, effects=(name,)), fit_share=share)
        for (name, cause), share in zip(causes.items(), shares, strict=True)
    ]
    own, found = Branch("identified", leaving(1.0, 1.0), ()), {}
    densities: Any = SimpleNamespace(lattice=leaving(lattice, lattice), lattice_takes=60.0)
    monkeypatch.setattr(BesideEffects, "on_own_densities", lambda self, places, *_: found.update(places) or own)
    assert likeliest.beside_likeliest(tried, densities, Search()) is (own if asked_of else None)
    assert list(found) == asked_of
    assert likeliest.beside_likeliest(tried, densities, Search(limit=TimeLimit(50.0))) is None  # a lattice takes 60 s
    assert all(place.effects == (name,) for name, place in found.items())


@pytest.mark.parametrize("hidden", [(), ("strain_polarization_hysteresis",)])
def test_what_a_base_has_bent_for_is_refitted_whatever_it_promises(
    monkeypatch: pytest.MonkeyPatch, hidden: tuple[str, ...]
) -> None:
    """A court case: of a hysteresis beside a wedge of relays the screen saw less than of four that explain nothing."""
    before, refitted = leaving(4.0, 4.0), []
    before.staged = SimpleNamespace(chain=SimpleNamespace(links=()), runs=[])
    promises = {"sensor_lag": 3.0, "thermal_drift": 2.0, "mains_hum": 1.0, "strain_polarization_hysteresis": 0.0}

    def best(effect: Any) -> Any:
        return SimpleNamespace(effect=effect, total=before.total - promises[effect.name])

    monkeypatch.setattr(seeker, "Screen", lambda seen: SimpleNamespace(best=best, refined=lambda prospect: prospect))
    monkeypatch.setattr(
        Search,
        "_refitted_in_turn",
        lambda self, base, worth: refitted.extend(p.effect.name for p in worth) or ([], worth),
    )
    effects = tuple(EFFECT_OF[name] for name in promises)
    Search(Thresholds(refits=2), effects=effects, hidden=frozenset(hidden))._candidates(before, before)
    assert refitted == ["sensor_lag", "thermal_drift", *hidden]


@pytest.mark.parametrize(
    ("elements", "beside", "is_much"),
    [
        (4.0, 2.0, True),
        (4.0, 1.4, False),  # near the noise beside an effect: they are searched
        (8.0, 2.0, False),  # hardly better than what was declared
        (1.0, 1.0, False),
    ],
)
def test_elements_that_leave_much_beside_each_effect_are_too_few(
    monkeypatch: pytest.MonkeyPatch, elements: float, beside: float, is_much: bool
) -> None:
    candidates = tuple(
        SimpleNamespace(name=name, after=leaving(left, left)) for name, left in (("a", 5.0), ("b", beside))
    )
    monkeypatch.setattr(slips, "fit_bouc_wen", lambda *_: leaving(elements, elements))
    monkeypatch.setattr(Search, "step", lambda self, before: SimpleNamespace(candidates=candidates))
    slipping = slips.Elements(leaving(11.0, 11.0), Search())
    assert slipping.tried == ()  # nothing was asked for yet
    assert slipping.leave_much(Thresholds()) is is_much
    assert slipping.tried == (candidates if 1.0 < elements < 8.0 else ())


@pytest.mark.parametrize(
    ("lattice", "told", "asked_of"),
    [
        (2.6, "polarization_fatigue", [["polarization_fatigue", "thermal_drift"]]),
        (2.6, "sensor_nonlinearity", [["polarization_fatigue", "thermal_drift"], ["imprint", "sensor_nonlinearity"]]),
        (1.0, "polarization_fatigue", []),  # a lattice alone leaves nothing
    ],
)
def test_far_from_the_noise_the_effects_that_a_lattice_asks_for_are_tried_first(
    monkeypatch: pytest.MonkeyPatch, lattice: float, told: str, asked_of: list[list[str]]
) -> None:
    """A court case: a fatigue beside tilted densities, of which Gaussians left least with a bias field."""

    def refit(name: str, share: float) -> Any:
        return SimpleNamespace(name=name, cause=name, after=leaving(4.0, 4.0), fit_share=share)

    there = [refit("polarization_fatigue", 0.92), refit("thermal_drift", 0.64), refit("imprint", 0.14)]
    here: Any = [refit("sensor_nonlinearity", 0.72), refit("imprint", 0.77), refit("thermal_drift", 0.4)]
    own, asked = Branch("identified", leaving(1.0, 1.0), ()), []
    densities = with_lattice(Bases(leaving(11.0, 11.0)), lattice)

    def at_a_glance(self: Search, before: Any) -> list[Any]:
        assert not self.is_worth_finishing(Candidate("", leaving(lattice, lattice), leaving(1.0, 1.0)))
        return there

    monkeypatch.setattr(Search, "beside", at_a_glance)
    monkeypatch.setattr(Search, "is_significant", lambda self, candidate: True)

    def on_own(self: Any, found: Any, identify: Any, others: Any) -> Any:
        asked.append([*found])
        return own if told in found else None

    monkeypatch.setattr(BesideEffects, "on_own_densities", on_own)
    assert likeliest.on_lattice_soon(here, densities, Search()) is (own if asked_of else None)
    assert asked == asked_of


@pytest.mark.parametrize(
    ("declared", "relays", "elements", "lattice", "beside", "is_asked"),
    [
        (14.0, 15.0, 16.0, 10.0, 1.0, True),
        (14.0, 15.0, 16.0, 10.0, 4.0, False),  # the effect beside it may be another's
        (14.0, 15.0, 16.0, 13.5, 1.0, False),  # a polycrystal leaves as little
        (14.0, 15.0, 9.0, 10.0, 1.0, False),  # elements less
        (14.0, 13.0, 16.0, 2.0, 1.0, False),  # the stage knows no rate
        (5.0, 13.0, 16.0, 2.0, 1.0, False),  # an effect beside the declared base is sought in less time
    ],
)
def test_effects_are_tried_first_on_a_lattice_that_leaves_less_than_all_others(
    monkeypatch: pytest.MonkeyPatch,
    declared: float,
    relays: float,
    elements: float,
    lattice: float,
    beside: float,
    is_asked: bool,
) -> None:
    """A court case: a hum beside correlated densities; relays were searched for a minute, and Gaussians for another."""
    hum: Any = SimpleNamespace(name="mains_hum", cause="mains_hum", after=leaving(beside, beside), fit_share=0.9)
    densities = with_lattice(Bases(leaving(declared, declared), leaving(relays, relays)), lattice)
    slipping: Any = SimpleNamespace(base=leaving(elements, elements))
    own = Branch("identified", leaving(1.0, 1.0), ())
    monkeypatch.setattr(Search, "beside", lambda self, before: [hum])
    monkeypatch.setattr(Search, "is_significant", lambda self, candidate: True)
    monkeypatch.setattr(
        BesideEffects, "on_own_densities", lambda self, found, *_: own if "mains_hum" in found else None
    )
    assert likeliest.on_lattice_first(slipping, densities, Search()) is (own if is_asked else None)


def with_lattice(bases: Bases, ratio: float) -> Any:
    """Densities of which a lattice was identified, with so many times the noise left."""
    densities = identified_densities.Densities(bases, Search(Thresholds().on_flexible()))
    densities.__dict__["_lattice"] = (leaving(ratio, ratio), 0.0)
    return densities


@pytest.mark.parametrize(
    ("elements", "is_searched", "shares", "asked_of"),
    [
        (2.6, True, (0.54, 0.3), ["strain_polarization_hysteresis"]),
        (2.6, True, (0.6, 0.8), ["strain_polarization_hysteresis", "slow_relaxation"]),
        (2.6, True, (0.3, 0.2), []),  # none explains half of what elements leave
        (2.6, False, (0.54, 0.3), []),
        (7.0, True, (0.54, 0.3), []),  # elements that leave no less than the declared base say nothing of the stage
    ],
)
def test_the_likeliest_effects_beside_elements_are_tried_each_on_relays_of_its_own(
    monkeypatch: pytest.MonkeyPatch, elements: float, is_searched: bool, shares: Any, asked_of: list[str]
) -> None:
    """A court case: beside plays, a hysteresis of the strain; relays had bent for it and were searched in vain."""
    names = ("strain_polarization_hysteresis", "slow_relaxation")
    pairs = zip(names, shares, strict=True)
    tried: Any = tuple(SimpleNamespace(name=name, cause=name, fit_share=share) for name, share in pairs)
    slipping: Any = SimpleNamespace(tried=tried if is_searched else (), base=leaving(elements, elements))
    relays, own = leaving(5.4, 6.0), Branch("identified", leaving(1.0, 1.0), ())
    densities: Any = SimpleNamespace(declared=leaving(11.0, 11.0), relays=relays, search=Search())
    bent: list[Any] = []
    monkeypatch.setattr(Search, "with_effects", lambda self, bare, names: bent.append(bare) or (bare, *names))

    def on_own(self: Any, found: Any, identify: Any, others: Any) -> Any:
        assert identify is identified_densities.fit_rate_independent
        assert list(found.values()) == [(relays, name) for name in asked_of]
        return own if found else None

    monkeypatch.setattr(BesideEffects, "on_own_densities", on_own)
    assert likeliest.on_own_relays(slipping, densities, Thresholds()) is (own if asked_of else None)
    assert bent == [relays] * len(asked_of)


@pytest.mark.parametrize("is_as_good", [True, False])
@pytest.mark.parametrize("name", ["sensor_nonlinearity", "sensor_lag"])
def test_a_curve_on_a_density_of_its_own_ties_with_a_strain_law_that_explains_as_much(
    monkeypatch: pytest.MonkeyPatch, name: str, is_as_good: bool
) -> None:
    told, asked = leaving(1.0, 1.0, effects=(name,)), Thresholds()
    told.staged = SimpleNamespace(has_past=False, ceramic=None, runs=[SimpleNamespace(since=0)])
    monkeypatch.setattr(BesideEffects, "_in_turn", lambda self, found, *_: found)
    monkeypatch.setattr(beside_effects, "without", lambda found, name: leaving(4.0, 4.0))
    monkeypatch.setattr(Search, "still_tied", lambda self, winner, names: [])
    monkeypatch.setattr(Candidate, "fit_size", 3.0)
    monkeypatch.setattr(Candidate, "selection_size", 3.0)
    monkeypatch.setattr(beside_effects, "is_law_as_good", lambda bare, curved, asked: is_as_good)
    branch = BesideEffects(Search(asked.on_flexible()), asked).on_own_densities({name: told})
    assert branch is not None
    is_open = is_as_good and name == "sensor_nonlinearity"
    assert branch.steps[0].tied == ((name, "strain_law") if is_open else ())


@pytest.mark.parametrize(
    ("likeliest", "explains", "wanders"),
    [("thermal_drift", True, True), ("thermal_drift", False, False), ("bias_field", True, False)],
)
def test_readings_that_wander_on_another_base_are_asked_before_two_effects_where_a_drift_is_likeliest(
    monkeypatch: pytest.MonkeyPatch, likeliest: str, explains: bool, wanders: bool
) -> None:
    """A court case: straight drifts explained 82 % of what was fitted beside relays and foretold hardly what chose."""
    base = leaving(2.6, 4.7)
    other = {"thermal_drift": "bias_field", "bias_field": "thermal_drift"}[likeliest]
    tried: Any = (SimpleNamespace(name=other, fit_share=0.7), SimpleNamespace(name=likeliest, fit_share=0.8))
    asked_of: list[str] = []
    chance = Step(base, (), {}, (), (), "by chance")
    monkeypatch.setattr(Search, "run", lambda self, found: [Step(found, tried, {}, (), (), "")])
    monkeypatch.setattr(Search, "with_wandering", lambda self, steps, found: asked_of.append("wandering") or [chance])
    monkeypatch.setattr(Search, "with_pair", lambda self, steps, found: asked_of.append("pair") or [*steps])
    monkeypatch.setattr(Search, "explains", lambda self, steps, found: explains)
    for searched in (identified_densities._on_density, slips.Elements._searched):
        branch = searched(base, Search(Thresholds().on_flexible()))
        assert (branch.steps == (chance,)) is wanders
        assert asked_of[-1] == ("wandering" if wanders else "pair")


@pytest.mark.parametrize(
    ("freed", "beside", "found", "asked"),
    [
        (1.08, 4.0, 9.9, 0),  # shapes are all that is missing: nothing is searched
        (2.0, 4.0, 1.05, 1),  # and an effect beside them
        (3.9, 1.05, 1.05, 1),  # they hardly help but beside an effect
        (3.9, 3.9, 9.9, -1),  # they do not help
        (2.0, 4.0, 1.9, -1),  # nor is it enough
    ],
)
def test_densities_with_other_shapes_are_searched_where_those_help(
    monkeypatch: pytest.MonkeyPatch, freed: float, beside: float, found: float, asked: int
) -> None:
    base, after = leaving(4.0, 4.0), leaving(3.5, 3.5, effects=("sensor_lag",))
    shapes = {id(base): leaving(freed, freed), id(after): leaving(beside, beside)}
    step: Any = Step(base, (SimpleNamespace(after=after),), {}, (), (), "")
    searched: list[Any] = []
    end: Any = SimpleNamespace(after=leaving(found, found, effects=("sensor_lag",)))
    monkeypatch.setattr(branches, "shaped", lambda each: shapes[id(each)])
    monkeypatch.setattr(branches, "exact", lambda each: each)
    monkeypatch.setattr(branches, "is_shaped", lambda each: True)
    monkeypatch.setattr(Search, "run", lambda self, each: searched.append(each) or [Step(each, (), {}, (end,), (), "")])
    branch = ON_FREE_SHAPE(base, [step], Search(workers=IN_THIS_PROCESS))
    assert (branch is None) is (asked < 0)
    if branch is not None:
        assert branch.density == "shaped"
        assert len(searched) == asked


@pytest.mark.parametrize(("beside", "asked"), [(1.09, 1), (1.2, 0)])
def test_other_shapes_are_tried_beside_what_was_added_where_nothing_more_was_found(
    monkeypatch: pytest.MonkeyPatch, beside: float, asked: int
) -> None:
    """A court case: a fatigue of 10 x beside heavy tails, added at 3.5 x; a round after it that found nothing."""
    base, after = leaving(4.0, 4.0), leaving(3.5, 3.5, effects=("polarization_fatigue",))
    winner: Any = SimpleNamespace(after=after, name="polarization_fatigue")
    steps = [Step(base, (winner,), {}, (winner,), (), ""), Step(after, (), {}, (), (), "")]
    shapes = {id(base): leaving(3.9, 3.9), id(after): leaving(beside, beside)}
    searched: list[Any] = []
    monkeypatch.setattr(branches, "shaped", lambda each: shapes[id(each)])
    monkeypatch.setattr(branches, "exact", lambda each: each)
    monkeypatch.setattr(branches, "is_shaped", lambda each: True)
    end: Any = SimpleNamespace(after=leaving(1.05, 1.05, effects=("polarization_fatigue",)))
    monkeypatch.setattr(Search, "run", lambda self, each: searched.append(each) or [Step(each, (), {}, (end,), (), "")])
    branch = ON_FREE_SHAPE(base, steps, Search(workers=IN_THIS_PROCESS))
    assert len(searched) == asked
    assert (branch is not None) is bool(asked)


@pytest.mark.parametrize(
    ("beside", "found"),
    [
        ((None, 4.0, None), 1),  # the mode: a virgin ceramic left 12 x beside it
        ((6.5, 4.0, None), 1),  # beside a hysteresis that stood for the past it is no quarter
        ((None, None, None), None),  # no run is better poled
        ((None, None, 4.0), 2),
        ((12.5, 12.5, 12.5), None),  # too far for a base
    ],
)
def test_a_poled_past_is_believed_beside_an_effect_where_it_leaves_far_less(
    monkeypatch: pytest.MonkeyPatch, beside: tuple[float | None, ...], found: int | None
) -> None:
    """An examiner's mode on a stage that had been poled: beside that effect alone the past showed itself."""
    most = 30.0 if beside[0] == 12.5 else 12.0
    tried: Any = leaving_of(40.0, strain_polarization_hysteresis=0.8 * most, mechanical_resonance=most)
    tried += leaving_of(40.0, imprint=1.1 * most, thermal_drift=1.2 * most)  # the last explains least: never asked
    poled = {id(each.after): left and leaving(left, left) for each, left in zip(tried, beside, strict=False)}
    monkeypatch.setattr(past_instead, "poled_beside", lambda after: poled[id(after)])
    monkeypatch.setattr(past_instead, "without", lambda each, name: name)
    base = past_instead.poled_instead(tried[::-1], Thresholds())
    assert base == (None if found is None else tried[found].name)


@pytest.mark.parametrize(
    ("declares", "declared", "relays", "elements", "virgin", "is_so"),
    [
        (False, 14.5, 50.0, 60.0, True, True),
        (True, 14.5, 50.0, 60.0, True, False),  # effects beside a declared chain come first
        (False, 7.0, 50.0, 60.0, True, False),  # near enough for names
        (False, 14.5, 5.0, 60.0, True, False),  # a stage without a rate
        (False, 14.5, 50.0, 5.0, True, False),  # elements that slip
        (False, 14.5, 50.0, 60.0, False, False),  # poled already, or with a past
    ],
)
def test_a_base_that_nobody_declared_may_hide_a_past(
    monkeypatch: pytest.MonkeyPatch,
    declares: bool,
    declared: float,
    relays: float,
    elements: float,
    virgin: bool,
    is_so: bool,
) -> None:
    monkeypatch.setattr(branches, "is_taken_for_virgin", lambda found: virgin)
    bases = Bases(leaving(declared, declared), leaving(relays, relays), declares)
    others: Any = SimpleNamespace(base=leaving(elements, elements))
    assert branches._may_hide_a_past(bases, others, Thresholds()) is is_so


@pytest.mark.parametrize(
    ("knows", "left", "tells", "ends"),
    [
        (False, 1.0, True, True),
        (False, 1.9, True, True),  # an effect hides which of them a stage is more like
        (False, 2.1, True, False),
        (False, 1.0, False, False),
        (True, 1.0, True, False),  # what was declared is searched first
    ],
)
def test_elements_that_tell_all_end_the_search_where_nothing_was_declared(
    monkeypatch: pytest.MonkeyPatch, knows: bool, left: float, tells: bool, ends: bool
) -> None:
    """A court case: a fatigue beside elements left them 1.6 of a domain's excess; relays and a lattice took 250 s."""
    declared = leaving(5.0, 5.0)
    declared.staged = SimpleNamespace(has_past=False, runs=[], chain=load_chain("p802"))
    elements = SimpleNamespace(excess=left * declared.excess)
    told = SimpleNamespace(final=leaving(1.0, 1.0), explains=lambda asked: tells)
    monkeypatch.setattr(judge, "alike_by_design", lambda records: [])
    monkeypatch.setattr(slips, "fit_bouc_wen", lambda *_: elements)
    monkeypatch.setattr(slips.Elements, "_searched", staticmethod(lambda base, search, first=None: told))
    monkeypatch.setattr(branches, "_may_hide_a_past", lambda *_: False)
    asked = Thresholds() if knows else Thresholds().on_undeclared()
    bases = Bases(declared, is_known=knows)
    monkeypatch.setattr(branches, "_sooner", lambda *_: ["on another base"])
    found = branches._searched(bases, asked, lambda text: None, IN_THIS_PROCESS, TimeLimit())
    assert (found[-1] is told) is ends
    assert ends or found[-1] == "on another base"


@pytest.mark.parametrize(
    ("left", "explains", "is_taken"), [(1.1, True, True), (1.1, False, False), (1.3, True, False), (None, True, False)]
)
def test_a_name_that_was_told_where_no_past_reaches_is_sought_on_whole_runs(
    monkeypatch: pytest.MonkeyPatch, left: float | None, explains: bool, is_taken: bool
) -> None:
    """A court case: a bias field beside tilted densities, nothing declared, left 18 x of a run that was not fitted."""
    base, told = leaving(5.0, 5.0), leaving(1.0, 1.0, effects=("bias_field",))
    virgin = leaving(20.0, 20.0)
    found: Any = SimpleNamespace(name="bias_field", after=told)
    branch = Branch("shaped", base, (Step(base, (found,), {}, (found,), (), ""),))
    whole = None if left is None else leaving(left, left, effects=("bias_field",))
    monkeypatch.setattr(whole_runs, "whole_beside", lambda final: whole)
    monkeypatch.setattr(whole_runs, "without", lambda beside, name: virgin)
    monkeypatch.setattr(Search, "run", lambda self, place: [Step(place, (), {}, (found,), (), "anew")])
    monkeypatch.setattr(Search, "explains", lambda self, steps, place: explains)
    there = whole_runs.of_whole_runs(branch, Search())
    assert (there.base is virgin) is is_taken
    assert there is branch or there.steps[0].verdict == "anew"


def test_a_base_of_whole_runs_is_not_taken_for_one_with_a_past_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The two would take turns until the time is up."""
    cut, virgin = leaving(4.0, 4.0), leaving(5.0, 5.0)
    cut.staged = virgin.staged = SimpleNamespace(has_past=False, runs=[], chain=load_chain("p802"))
    searched: list[Any] = []
    monkeypatch.setattr(judge, "alike_by_design", lambda records: [])
    monkeypatch.setattr(slips, "fit_bouc_wen", lambda *_: leaving(99.0, 99.0))
    monkeypatch.setattr(Search, "run", lambda self, place: searched.append(place) or [Step(place, (), {}, (), (), "")])
    monkeypatch.setattr(branches, "_sooner", lambda *_: [])
    monkeypatch.setattr(branches, "whole_instead", lambda steps, search: virgin if steps[-1].after is cut else None)
    monkeypatch.setattr(branches, "past_instead", lambda steps, asked: cut)
    monkeypatch.setattr(branches, "_shapes_come_down", lambda *_: False)
    monkeypatch.setattr(branches, "_ended", lambda declared, *_: [Branch("gaussian", declared, ())])
    monkeypatch.setattr(identified_densities.Densities, "lattice_is_all", lambda *_: False)
    bases = Bases(cut, is_known=True)
    (branch,) = branches._searched(bases, Thresholds(), lambda text: None, IN_THIS_PROCESS, TimeLimit())
    assert searched == [cut, virgin]
    assert branch.base is virgin


@pytest.mark.parametrize(("left", "goes_on"), [(2.0, True), (4.5, False)])
def test_on_relays_a_second_effect_is_sought_near_the_noise_only(
    monkeypatch: pytest.MonkeyPatch, left: float, goes_on: bool
) -> None:
    """A court case: heavy tails, whose rate relays lack; two effects on them took three minutes, and told nothing."""
    after = leaving(left, left, effects=("slow_relaxation",))
    first: Any = SimpleNamespace(accepted=("slow_relaxation",), tied=(), after=after)
    searched: list[Search] = []
    monkeypatch.setattr(identified_densities, "_on_relays_from_rest", lambda relays, search: searched.append(search))
    relays = leaving(7.0, 7.0)
    identified_densities.on_relays(relays, Search(Thresholds().on_flexible()))
    (search,) = searched
    assert search._goes_on([first], relays) is goes_on


@pytest.mark.parametrize(
    ("fitted_left", "on_relays", "is_enough"), [(1.08, True, True), (1.3, True, False), (1.08, False, False)]
)
def test_on_relays_an_effect_is_enough_that_tells_all_that_was_fitted(
    monkeypatch: pytest.MonkeyPatch, fitted_left: float, on_relays: bool, is_enough: bool
) -> None:
    """An examiner's mode beside asymmetric plays: of what chose half was left, which no run had told the density."""
    asked = Thresholds().on_flexible()
    base, after = leaving(4.2, 5.0), leaving(fitted_left, 3.7, effects=("mechanical_resonance",))
    mode = Candidate("mechanical_resonance", base, after)
    assert mode.share < asked.share < mode.fit_share
    assert Search(asked.on_relays() if on_relays else asked).is_enough(mode) is is_enough
    searched: list[Search] = []
    monkeypatch.setattr(identified_densities, "_on_relays_from_rest", lambda relays, search: searched.append(search))
    identified_densities.on_relays(leaving(7.0, 7.0), Search(asked))
    first: Any = SimpleNamespace(after=after)
    assert searched[0].is_told([first]) is (fitted_left < 1.15)
