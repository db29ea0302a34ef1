"""Tones that stand out beside whatever else is left: they are the drive's, or their own.

What a base lacks says nothing against a tone of its own frequency (147), however much more it is. A hum of 4 x the
noise in a stage of another structure was a tenth of what any base left, and a line over its surroundings all the same.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.data import FIT, SELECTION, RunData
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.lines import CLEAR, may_stand_out, standing_out
from pzt_ros.diagnosis.refinement import refits
from pzt_ros.diagnosis.screen import Screen
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.effects.mains_hum import MainsHum
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.parallel import Workers

_STAYS = 0.25  # of how far a tone stands out, with it in the model

_VERDICT = "a line at {frequency:.2f} Hz that stands out of all that is left, {times:.0f} times over its surroundings"


def with_hum(branch: Branch, asked: Thresholds, workers: Workers) -> Branch:
    """A search that left something, and a hum beside what it found where one stands out in what chooses, too.

    A drive that repeats itself has lines of its own, and so has what a wrong hysteresis leaves: at those nothing is
    said.
    """
    name, final = MainsHum.kind, branch.final
    if name in final.effects or branch.explains(asked):
        return branch
    prospect = Screen(final).best(EFFECT_OF[name])
    after = refits([prospect], final.effects, workers)[0] if prospect else None
    if after is None:
        return branch
    frequency = _frequency_of(after)
    runs = enumerate(final.staged.runs)
    heard = [number for number, run in runs if may_stand_out(run.record.time[_seen(run)], frequency)]
    times = min((_standing_out(final, after, number, frequency) for number in heard), default=0.0)
    if times < CLEAR:
        return branch
    hum = Candidate(name, final, after)
    verdict = _VERDICT.format(frequency=frequency, times=times)
    return dataclasses.replace(branch, steps=(*branch.steps, Step(final, (hum,), {}, (hum,), (), verdict)))


def _frequency_of(found: Hypothesis) -> float:
    """Of the hum in a model [Hz]."""
    links = found.staged.chain_at(found.vector).links
    hum = next(link for link in links if isinstance(link, MainsHum))
    return hum.frequency + hum.detuning


def _standing_out(before: Hypothesis, after: Hypothesis, number: int, frequency: float) -> float:
    """How far a tone stands out of what is left of a run without it; 0 where it stays, or the drive has it as well."""
    run = before.staged.runs[number]
    picks = _seen(run)
    without, told = (found.staged.outputs(found.vector, [number])[0][0] for found in (before, after))
    measured = run.record.displacement
    alone, beside, driven = (
        standing_out(run.record.time[picks], values[picks], frequency)
        for values in (measured - without, measured - told, without)
    )
    return alone if beside <= _STAYS * alone and driven < CLEAR else 0.0


def _seen(run: RunData) -> NDArray[np.intp]:
    """Samples that a diagnosis may look at before it scores [shape (n,)]."""
    return run.picks[FIT] if FIT in run.picks else run.picks[SELECTION]
