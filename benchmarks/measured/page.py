"""The page: what was found on each set, in figures, pictures and words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pzt_benchmarks.measured import words
from pzt_benchmarks.measured.ceramic import HEADS as PART_HEADS
from pzt_benchmarks.measured.ceramic import Part
from pzt_benchmarks.measured.judged import HEADS, IDENTIFIED, Judged, Row
from pzt_benchmarks.measured.plots import picture
from pzt_benchmarks.measured.ties import Trial
from pzt_benchmarks.report import Provenance
from pzt_benchmarks.table import MET, NOT_MET, markdown_rows
from pzt_ros.diagnosis.data import SCORE
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.result import SETTLE_TIME

Ties = Sequence[tuple[Trial, Row, Array]]

_INTRODUCTION = """Runs of real actuators, measured by others; the files are in no copy of this project. All of the
train runs is fitted. The first half of the test run chooses how fine and smooth the density is and of which order the
strain law. When that is chosen, it is fitted with the train runs, and says where the zero is and what was before the
test run. Its second half scores. Floor: noise of the displacement from third differences of neighbouring samples, or
from holds where that is much larger. Span: of the displacement over the whole test run. "Looks" says how often errors
on the score part were seen while this was made; what was changed after a look is said with it."""


def page(
    origin: Provenance, judged: Sequence[Judged], ties: Ties, parts: Sequence[Part], ring: tuple[Array, Array]
) -> str:
    """The whole of docs/measured.md."""
    blocks = ["# Measured runs", origin.line(), _INTRODUCTION, *_summary(judged)]
    for each in judged:
        blocks += _section(each, ties, ring)
    blocks += _ceramic(parts)
    return "\n\n".join(blocks) + "\n"


def _summary(judged: Sequence[Judged]) -> list[str]:
    rows = []
    for each in judged:
        if each.which.target > 0.0:
            best = _row(each, IDENTIFIED)
            verdict = MET if best.percent <= each.which.target else NOT_MET
            rows.append((each.which.title, f"{best.percent:.3f} %", f"≤ {each.which.target:.2f} %", verdict))
    named = [f"{each.which.title}: {effect.name}" for each in judged for effect in each.report.effects]
    after = f"Effects that `pzt diagnose` named: {', '.join(named) or 'none, so no table has a row after effects'}."
    return ["\n".join(markdown_rows(("identified base, score part", "error of span", "asked", ""), rows)), after]


def _row(judged: Judged, model: str) -> Row:
    return next(row for row in judged.rows if row.model == model)


def _section(judged: Judged, ties: Ties, ring: tuple[Array, Array]) -> list[str]:
    which, report = judged.which, judged.report
    train = ", ".join(cut.words for cut in which.train)
    blocks = [
        f"## {which.title}",
        f"{which.source}. Train: {train}. Test: {which.test.words}. Left out: {which.left_out}",
        picture(which.key, f"{which.title}: residual"),
        "\n".join(markdown_rows(HEADS, [row.cells() for row in judged.rows])),
        f"**`pzt diagnose` says** ({judged.seconds:.0f} s): {report.verdict}",
        f"It goes by the rule of `pzt predict`, start and zero of the test run from {_told_by(judged)}: error on the"
        f" score part {1e9 * report.before.score:.4g} nm before, {1e9 * report.after.score:.4g} nm after"
        f"{_reaches_in(judged)} Next: {report.next_experiment}",
        *report.remarks,
    ]
    if which.ties:
        blocks += _ties(ties)
    if which.key == "onset":
        blocks.append(_ring(*ring))
    return [*blocks, f"What it means. {words.MEANING[which.key]}", f"Looks at the score part: {words.LOOKS[which.key]}"]


def _told_by(judged: Judged) -> str:
    """What start and zero of the test run come from."""
    if judged.test.begins_driven:
        return "its first half, since it begins driven"
    return "its first second, or from the last fit where that second holds next to nothing"


def _reaches_in(judged: Judged) -> str:
    """Where that second is longer than the part that chooses."""
    time = judged.test.record.time
    if judged.test.begins_driven or float(time[judged.test.picks[SCORE][0]] - time[0]) >= SETTLE_TIME:
        return "."
    return "; here that second reaches into the score part, so these two are not held out."


def _ties(ties: Ties) -> list[str]:
    heads = ("effect behind the base", "size that does best on the selection", *HEADS[1:])
    rows = [(trial.effect.replace("_", " "), trial.size, *row.cells()[1:]) for trial, row, _ in ties]
    return ["\n".join(markdown_rows(heads, rows))]


def _ring(after: Array, frequency: Array) -> str:
    late = slice(1, None)
    return (
        f"The ring in windows of 4 ms: {frequency[0]:.0f} Hz about {1e3 * after[0]:.0f} ms after switch-on,"
        f" {np.median(frequency[late]):.0f} Hz in the median of the windows after that."
    )


def _ceramic(parts: Sequence[Part]) -> list[str]:
    rows = [row for part in parts for row in part.rows()]
    return [
        "## PNZT ceramic: polarization, strain law, hold record",
        picture("ceramic", "PNZT: measured and predicted"),
        "\n".join(markdown_rows(PART_HEADS, rows)),
        f"What it means. {words.CERAMIC}",
    ]
