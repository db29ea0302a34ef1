"""Fit, find what is missing, add it, and say how far the model is from the runs before and after."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np

from pzt_ros.diagnosis.baselines import baselines
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.branches import branches_of, chosen_of
from pzt_ros.diagnosis.checks import check_runs
from pzt_ros.diagnosis.data import SCORE, RunData, split
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.found import found_effects, tried_candidates
from pzt_ros.diagnosis.hindsight import is_of_pasts
from pzt_ros.diagnosis.identifiability import alike_by_design, stood_in_for, taken_up, with_loads
from pzt_ros.diagnosis.intervals import note_intervals, of_any_polarization
from pzt_ros.diagnosis.next_experiment import designed
from pzt_ros.diagnosis.outcome import Errors
from pzt_ros.diagnosis.reached import Reached, reached_of
from pzt_ros.diagnosis.remains import Remains, remains_of
from pzt_ros.diagnosis.remarks import LAW, PAST, SPARSE, of_model, of_names, of_readings, of_samples
from pzt_ros.diagnosis.report import Report
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.staged import Progress
from pzt_ros.diagnosis.time_limit import SECONDS, TimeLimit
from pzt_ros.diagnosis.tones import with_hum
from pzt_ros.diagnosis.undeclared import fit_base, has_powers
from pzt_ros.diagnosis.verdict import SILENT, TIME, by_chance, verdict_of
from pzt_ros.diagnosis.wandering import less_wandering
from pzt_ros.diagnosis.what_next import bench_of, what_next
from pzt_ros.effects.table import reported
from pzt_ros.parallel import IN_THIS_PROCESS, Workers, on_one_core, one_blas_thread, threads
from pzt_ros.physics.chain import Chain
from pzt_ros.records import Record


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
        best = chosen_of(branches, asked)
        chosen = with_hum(best, asked, pool)
        runs = [run.counted_from(seen.since) for run, seen in zip(runs, chosen.base.staged.runs, strict=True)]
        progress("predicting")
        reached = reached_of(runs, chosen, bases.declared, asked, command, pool, limit)
        branches = [reached.branch if branch is best else branch for branch in branches]
        report = _report(runs, len(train), branches, reached, asked, command)
    if limit.has_cut:
        report = dataclasses.replace(report, verdict=report.verdict + TIME.format(limit.seconds), is_cut=True)
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
    reached: Reached,
    asked: Thresholds,
    command: str,
) -> Report:
    chosen, before, after = reached.branch, reached.before, reached.after
    blind = alike_by_design([run.record for run in runs])
    groups = [tuple(reported(name) for name in step.tied) for step in chosen.steps if step.tied]
    tied = with_loads(dict.fromkeys(groups), [run.record for run in runs])
    if chosen.density == "identified" and not (tied or chosen.final.effects):
        tied = stood_in_for(branches[0].base, chosen.final, blind, asked)
    remains, excuse = _what_remains(chosen, runs, after, asked)
    sparse = excuse == SPARSE
    effects = found_effects(reached)
    silent = "" if effects or tied or remains.present else SILENT[sparse]
    if silent and not sparse:
        tied = taken_up(blind)
    why, design = what_next(effects, tied, remains, sparse, blind)
    drive = designed(design, bench_of(chosen, runs), why) if design else None
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
        tried=tuple(tried_candidates(branches)),
        not_identifiable=tied,
        remains=remains,
        next_experiment=f"{why} {drive.sentence}" if drive else why,
        next_drive=drive,
        remarks=(
            *reached.remarks,
            *((excuse,) if excuse else ()),
            *((LAW,) if chosen.has_free_law else ()),
            *of_model(chosen.base),
            *of_names([each.name for each in effects], runs),
            *of_readings(chosen.final),
            *(each.remark for each in blind),
            *of_samples(runs),
        ),
        verdict=verdict_of(effects, tied, remains, (before, after), len(runs) > trained, silent)
        + by_chance(chosen.final, remains, after),
        baselines=baselines(runs),
        command=command,
    )


def _what_remains(chosen: Branch, runs: Sequence[RunData], after: Errors, asked: Thresholds) -> tuple[Remains, str]:
    """What is left, and the remark why it is not said to be missing; empty where it is, or nothing is left."""
    floors = chosen.remains_floor(asked), chosen.slow_floor(asked)
    remains = remains_of(runs, less_wandering(chosen.final, after.residuals), *floors)
    if not remains.present or remains.only_spikes:
        return remains, ""
    if is_of_pasts(chosen.final, runs, after.residuals, floors):
        return dataclasses.replace(remains, present=False), PAST
    if _is_sparse(chosen, asked):
        return dataclasses.replace(remains, present=False), SPARSE
    return remains, ""


def _is_sparse(chosen: Branch, asked: Thresholds) -> bool:
    """Whether an identified density is clean where it was fitted, and runs that it was not fitted to may go elsewhere.

    What is left of those is its own matter then, and not something that no effect explains.
    """
    final = chosen.final
    tested = any(SCORE in run.picks for run in final.staged.runs)
    return chosen.density == "identified" and tested and final.fit.ratio <= asked.floor


def _base_as_data(chosen: Branch) -> dict[str, Any]:
    return {"model": chosen.base.staged.ceramic.link(chosen.base.staged.ceramic.start).kind, "density": chosen.density}
