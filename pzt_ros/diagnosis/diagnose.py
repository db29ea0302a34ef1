"""Fit, find what is missing, add it, and say how far the model is from the runs before and after."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from contextlib import nullcontext
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from pzt_ros.diagnosis.baselines import baselines
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.branches import branches_of, chosen_of
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.checks import check_runs
from pzt_ros.diagnosis.data import SCORE, RunData, split
from pzt_ros.diagnosis.final_fit import fitted_to_all, identified_beside_effects
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.hindsight import is_of_pasts
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.identifiability import DENSITY, Alike, alike_by_design, stood_in_for, taken_up
from pzt_ros.diagnosis.intervals import note_intervals, of_any_polarization
from pzt_ros.diagnosis.next_experiment import (
    Bench,
    Design,
    design_between,
    designed,
    for_amplitudes,
    for_unexplained,
)
from pzt_ros.diagnosis.outcome import Errors, errors_from, errors_of, model_of
from pzt_ros.diagnosis.remains import Remains, remains_of
from pzt_ros.diagnosis.remarks import LAW, PAST, SPARSE, WORSE, of_model, of_readings, of_samples
from pzt_ros.diagnosis.report import FoundEffect, Report, Tried
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.diagnosis.time_limit import SECONDS, TimeLimit
from pzt_ros.diagnosis.undeclared import fit_base, has_powers
from pzt_ros.diagnosis.wandering import less_wandering, size_of, wanders
from pzt_ros.effects.table import EFFECT_OF, reported
from pzt_ros.parallel import IN_THIS_PROCESS, Workers, on_one_core, one_blas_thread, threads
from pzt_ros.physics.chain import Chain
from pzt_ros.records import Record

_SLOW_FLOOR = 2.0


def diagnose(
    train: Sequence[Record],
    test: Sequence[Record],
    chain: Chain | None = None,
    *,
    thresholds: Thresholds | None = None,
    progress: Progress = lambda text: None,
    command: str = "",
    workers: Workers | None = None,
    profile: bool = False,
    time_limit: float = SECONDS,
) -> Report:
    """Find what a chain lacks to describe the train runs, choosing by half of each test run, scoring with the rest.

    Args:
        train, test: runs.
        chain: declared; where None, one in proportion to the runs.
        thresholds: what is asked of an effect.
        progress: is told what is being done.
        command: that asked for it, for the report.
        workers: refit candidates side by side, with the same result wherever; threads of this process where None.
        profile: find 95 % intervals of the effects' parameters, which may be lopsided, by refits along each.
        time_limit: after which nothing new is tried, and what was found until then reported [s].

    Raises:
        BenchError: runs that are too short, do not move, are given twice; a chain without a ceramic.
    """
    began, limit = time.monotonic(), TimeLimit(time_limit)
    asked = thresholds or Thresholds()
    asked = asked if chain else asked.on_undeclared()
    check_runs(train, test)
    all_runs = with_floors((*train, *test))
    runs = split(all_runs[: len(train)], all_runs[len(train) :])
    refitting = threads() if workers is None else nullcontext(workers)
    # candidates are refitted side by side, and BLAS threads would fight with them
    with one_blas_thread(), on_one_core(workers is IN_THIS_PROCESS), refitting as pool:
        bases = fit_base(chain, runs, asked, progress, pool)
        asked = asked.on_free_law() if chain is None and has_powers(bases.declared.staged.chain) else asked
        branches = branches_of(bases, asked, progress, pool, limit)
        chosen = chosen_of(branches, asked)
        progress("predicting")
        reached = _reached(runs, chosen, asked, command, pool, limit)
        branches = [reached.branch if branch is chosen else branch for branch in branches]
        report = _report(runs, len(train), branches, reached, asked, command)
    if limit.has_cut:
        report = dataclasses.replace(report, verdict=report.verdict + _TIME.format(limit.seconds), is_cut=True)
    if profile and report.effects:
        progress(f"intervals of {', '.join(reached.final.effects)}")
        note_intervals(report, reached.final)
    if chain is None and not any(run.has_polarization for run in runs):
        report = of_any_polarization(report)
    return dataclasses.replace(report, seconds=time.monotonic() - began)


def _report(
    runs: Sequence[RunData],
    trained: int,
    branches: Sequence[Branch],
    reached: _Reached,
    asked: Thresholds,
    command: str,
) -> Report:
    chosen, before, after = reached.branch, reached.before, reached.after
    blind = alike_by_design([run.record for run in runs])
    tied = tuple(tuple(reported(name) for name in step.tied) for step in chosen.steps if step.tied)
    if chosen.density == "identified" and not (tied or chosen.final.effects):
        tied = stood_in_for(branches[0].base, chosen.final, blind, asked)
    has_past = chosen.final.staged.has_past  # a few reversals are off by something slow
    slow_floor = math.inf if has_past or chosen.density == "shaped" else _SLOW_FLOOR
    floors = chosen.remains_floor(asked), slow_floor
    remains = remains_of(runs, less_wandering(chosen.final, after.residuals), *floors)
    asks = remains.present and not remains.only_spikes
    is_past = asks and is_of_pasts(chosen.final, runs, after.residuals, floors)
    sparse = asks and not is_past and _is_sparse(chosen, asked)
    if is_past or sparse:
        remains = dataclasses.replace(remains, present=False)
    effects = _found(reached, runs, asked, command)
    silent = "" if effects or tied or remains.present else _SILENT[sparse]
    if silent and not sparse:
        tied = taken_up(blind)
    why, design = _next_experiment(effects, tied, remains, sparse, blind)
    drive = designed(design, _bench(chosen, runs), why) if design else None
    return Report(
        train=tuple(runs[:trained]),
        test=tuple(runs[trained:]),
        noise=math.sqrt(float(np.mean([run.noise**2 for run in runs]))),
        base=_base_as_data(chosen),
        before=before,
        after=after,
        baseline=reached.baseline,
        model=reached.model,
        effects=effects,
        tried=tuple(_tried(branches)),
        not_identifiable=tied,
        remains=remains,
        next_experiment=f"{why} {drive.sentence}" if drive else why,
        next_drive=drive,
        remarks=(
            *reached.remarks,
            *((SPARSE,) if sparse else ()),
            *((PAST,) if is_past else ()),
            *((LAW,) if chosen.has_free_law else ()),
            *of_model(chosen.base),
            *of_readings(chosen.final),
            *(each.remark for each in blind),
            *of_samples(runs),
        ),
        verdict=_verdict(effects, tied, remains, (before, after), len(runs) > trained, silent)
        + _by_chance(chosen.final, remains, after),
        baselines=baselines(runs),
        command=command,
    )


class _Reached(NamedTuple):
    """Where a diagnosis ends: the names that hold, the last fit, chains without and with them, and their errors.

    Attributes:
        anew: whether there was time to identify a density anew beside names.
    """

    branch: Branch
    final: Hypothesis
    baseline: Chain
    model: Chain
    before: Errors
    after: Errors
    remarks: tuple[str, ...]
    anew: bool


def _reached(
    runs: Sequence[RunData], chosen: Branch, asked: Thresholds, command: str, workers: Workers, limit: TimeLimit
) -> _Reached:
    """The ends of a branch, fitted for the last time; names with which the prediction of what scores is worse go.

    A straight drift does not go before it was tried as readings that wander.
    """
    ends = [chosen.base] if chosen.final is chosen.base else [chosen.base, chosen.final]
    anew = not limit.is_over()
    fits = list(workers.map(_last_fit, ends, repeat(chosen.density), repeat(runs), repeat(asked), repeat(anew)))
    baseline, model = model_of(fits[0], "baseline", command), model_of(fits[-1], "model", command)
    errors = list(workers.map(errors_of, [baseline, model][: len(ends)], repeat(runs)))
    before, after = errors[0], errors[-1]
    tested = any(SCORE in run.picks for run in runs)
    foretold = [errors_from(less_wandering(chosen.final, each.residuals), runs).score for each in (before, after)]
    if not tested or foretold[1] <= asked.worsens * foretold[0]:
        return _Reached(chosen, fits[-1], baseline, model, before, after, (), anew)
    if not any(run.wander for run in chosen.final.staged.runs):  # a drift foretells wrongly what goes its own way
        steps = Search(asked, workers=workers).with_last_drift_wandering(chosen.steps, chosen.base)
        if steps:
            return _reached(runs, dataclasses.replace(chosen, steps=tuple(steps)), asked, command, workers, limit)
    remark = WORSE.format(before=foretold[0] * 1e9, after=foretold[1] * 1e9)
    nameless = chosen.without_names("it makes the prediction of what scores worse")
    return _Reached(nameless, fits[0], baseline, model_of(fits[0], "model", command), before, before, (remark,), anew)


def _last_fit(
    found: Hypothesis, density: str, runs: Sequence[RunData], asked: Thresholds, anew: bool = True
) -> Hypothesis:
    """As it is written down, fitted to all that may be seen where that changes it, its density identified anew or not.

    Declared densities have too few parameters; what goes on from run to run is known best by the last of them.
    """
    found = identified_beside_effects(found, runs, asked) if anew else found
    return fitted_to_all(found) if density == "identified" or found.staged.given else found


def _is_sparse(chosen: Branch, asked: Thresholds) -> bool:
    """Whether an identified density is clean where it was fitted, and runs that it was not fitted to may go elsewhere.

    What is left of those is its own matter then, and not something that no effect explains.
    """
    final = chosen.final
    tested = any(SCORE in run.picks for run in final.staged.runs)
    return chosen.density == "identified" and tested and final.fit.ratio <= asked.floor


_MORE_AMPLITUDES = "Minor loops at amplitudes and offsets between those of the train runs, which the density lacks."


def _base_as_data(chosen: Branch) -> dict[str, Any]:
    return {"model": chosen.base.staged.ceramic.link(chosen.base.staged.ceramic.start).kind, "density": chosen.density}


def _found(reached: _Reached, runs: Sequence[RunData], asked: Thresholds, command: str) -> tuple[FoundEffect, ...]:
    """The effects that stand alone, each with the error before and after it was added, and as the model has them."""
    chosen, former = reached.branch, reached.before
    added = [candidate for step in chosen.steps if not step.tied for candidate in step.accepted]
    final = reached.model.notes["fit"]["parameters"]
    found = []
    for candidate in added:
        if candidate.after is chosen.final:
            now = reached.after
        else:
            last = _last_fit(candidate.after, chosen.density, runs, asked, reached.anew)
            now = errors_of(model_of(last, "step", command), runs)
        own = {name.split(".", 1)[1]: value for name, value in final.items() if name.split(".", 1)[0] == candidate.name}
        place = EFFECT_OF[candidate.cause].place
        found.append(FoundEffect(candidate.cause, place, former.test, now.test, own, _probability(candidate, chosen)))
        former = now
    return tuple(found)


def _probability(candidate: Candidate, chosen: Branch) -> float:
    """Against the best of the other candidates and against nothing, by what they gain where nothing was fitted."""
    step = next(step for step in chosen.steps if candidate in step.accepted)
    rivals = [c for c in step.candidates if c.cause != candidate.cause]
    gain = min(candidate.fit_gain, candidate.selection_gain)
    others = [min(c.fit_gain, c.selection_gain) for c in rivals]
    odds = [math.exp(min(0.5 * (other - gain) / _INFLATION, 0.0)) for other in (0.0, *others)]
    return min(candidate.share, 1.0) ** 0.5 / (1.0 + sum(odds)) if odds else 1.0


_INFLATION = 10.0


def _tried(branches: Sequence[Branch]) -> list[Tried]:
    found = []
    for branch in branches:
        for number, step in enumerate(branch.steps, start=1):
            for candidate in step.candidates:
                accepted = candidate in step.accepted
                found.append(
                    Tried(
                        number,
                        branch.density,
                        candidate.name,
                        _test_rms(candidate.after),
                        candidate.fit_gain,
                        candidate.selection_gain,
                        candidate.fit_share,
                        candidate.selection_share,
                        accepted and not step.tied,
                        _why(candidate, step),
                    )
                )
            nan = math.nan
            found += [
                Tried(number, branch.density, name, nan, nan, nan, nan, nan, False, why)
                for name, why in step.refused.items()
            ]
    return found


def _why(candidate: Candidate, step: Step) -> str:
    here, there = max(candidate.fit_share, 0.0), max(candidate.selection_share, 0.0)
    shares = f"{here:.0%} of the excess where it was fitted"
    shares += f", {there:.0%} where not" if candidate.before.choosing else ""
    if candidate.name in step.tied:
        return f"{shares}; as good as {', '.join(name for name in step.tied if name != candidate.name)}"
    if candidate in step.accepted:
        return f"{shares}; {step.verdict}"
    if step.accepted:
        first = step.accepted[0]
        plainer = first.cause == candidate.cause and first.unknowns < candidate.unknowns
        return f"{shares}; {first.name} explains {'as much with fewer unknowns' if plainer else 'more'}"
    return f"{shares}; {step.verdict}"


def _test_rms(hypothesis: Hypothesis) -> float:
    """On the test runs, or on the train runs where there are none [m]."""
    runs = hypothesis.staged.runs
    tested = [number for number, run in enumerate(runs) if "score" in run.picks] or list(range(len(runs)))
    outputs = hypothesis.staged.outputs(hypothesis.vector, tested)
    left = [runs[number].record.displacement - out[0] for number, out in zip(tested, outputs, strict=True)]
    return math.sqrt(float(np.mean(np.concatenate([(r - r.mean()) ** 2 for r in left]))))


def _next_experiment(
    effects: Sequence[FoundEffect],
    tied: Sequence[Sequence[str]],
    remains: Remains,
    sparse: bool,
    blind: Sequence[Alike],
) -> tuple[str, Design | None]:
    """What to do next in words, and the design of its drive where one is needed."""
    if tied:
        return design_between([name for name in tied[0] if name != DENSITY])
    if blind and not effects:
        return design_between(sorted(blind[0].effects))
    if sparse:
        return _MORE_AMPLITUDES, for_amplitudes
    if remains.only_spikes:
        return _CONTACTS, None
    if remains.present:
        return _REPEAT, for_unexplained
    if effects:
        return f"To confirm {effects[0].name}: {EFFECT_OF[effects[0].name].next_experiment}", None
    return "None needed: a run at another rate and amplitude would widen the range that this holds for.", None


_CONTACTS = "Check plugs, cables and the sensor's interface for what makes readings stand alone; then repeat a run."
_REPEAT = "Repeat the part named above as it was; then with the drive at rest; then at another rate and amplitude."


def _bench(chosen: Branch, runs: Sequence[RunData]) -> Bench:
    """What the runs and the effects that tie, as refitted, say about it."""
    alike = [c for step in chosen.steps for c in step.candidates if c.name in step.tied]
    chains = [(c.name, c.after.staged.chain_at(c.after.vector)) for c in alike]
    links = [link for name, chain in chains for link in chain.links if link.kind == name]
    return Bench.of([run.record for run in runs], links)


def _verdict(
    effects: Sequence[FoundEffect],
    tied: Sequence[Sequence[str]],
    remains: Remains,
    errors: tuple[Errors, Errors],
    tested: bool,
    silent: str,
) -> str:
    before, after = errors
    which = "runs not fitted" if tested else "the train runs"
    way = "falls" if after.test <= before.test else "rises"
    fall = f"the error on {which} {way} from {before.test * 1e9:.4g} to {after.test * 1e9:.4g} nm rms"
    sentences = []
    if effects:
        sentences.append(f"Missing: {', '.join(_words(e.name) for e in effects)}; {fall}")
    if silent:
        sentences.append(f"{silent}: {remains.times_noise:.2f} x the noise floor is left")
    if tied:
        either = " or ".join(_words(name) for name in tied[0])
        same = effects or after is before
        why = ", which could hide there" if silent else ""
        sentences.append(f"Not identifiable from this data{why}: {either}" + ("" if same else f"; {fall}"))
    if remains.present:
        start = "Something is missing that is not named" if not (effects or tied) else "Something unexplained remains"
        sentences.append(f"{start}: {remains.what_is_seen}")
    return ". ".join(sentences) + "."


def _by_chance(found: Hypothesis, remains: Remains, after: Errors) -> str:
    """A further sentence of the verdict where readings wander."""
    if not wanders(found):
        return ""
    size = size_of(found, after.residuals) * 1e9
    return (
        f" The drift goes by chance, {size:.3g} nm rms within a run, and stays in every prediction; beside it"
        f" {remains.times_noise:.2f} x the noise floor is left."
    )


_TIME = " The time limit of {:.4g} s was reached before all was tried; more time may find more."

_SILENT = {
    False: "Nothing is missing that these runs show",
    True: "No effect shows itself, but the train runs do not determine the density where the test runs go",
}


def _words(name: str) -> str:
    return name.replace("_", " ")
