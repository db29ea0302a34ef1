"""The court's tables: how many of how many, with 95 % binomial intervals, beside the targets of issue 4."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from .effects import PLAIN
from .outcome import FAILED, PAIR, RIGHT, VERDICTS, WRONG, Outcome

GOOD_SCORE = 1.10
"""Error on score runs over the noise that counts as repaired."""

PER_RUN = ("thermal_drift", "mains_hum")
"""Effects whose course is another in each run: no model can predict them in a run that it has not seen."""


@dataclass(frozen=True)
class Share:
    """How many of how many."""

    hits: int
    total: int

    def __str__(self) -> str:
        if not self.total:
            return "none tried"
        low, high = self.interval
        return f"{self.hits}/{self.total} = {100 * self.value:.1f} % ({100 * low:.1f} to {100 * high:.1f})"

    @property
    def value(self) -> float:
        """Observed share [-]."""
        return self.hits / self.total if self.total else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval after Wilson [-]."""
        found = stats.binomtest(self.hits, self.total).proportion_ci(0.95, method="wilson")
        return float(found.low), float(found.high)


def share(outcomes: Iterable[Outcome], holds: Callable[[Outcome], bool]) -> Share:
    """Of how many it holds."""
    answers = [holds(outcome) for outcome in outcomes]
    return Share(sum(answers), len(answers))


@dataclass(frozen=True)
class Target:
    """One line of issue 4."""

    what: str
    found: Share
    at_least: float | None = None
    at_most: float | None = None

    @property
    def met(self) -> str:
        """shown: the whole interval keeps the bound; yes: what was observed does; no; or - where none was tried."""
        if not self.found.total:
            return "-"
        low, high = self.found.interval
        if self._keeps(low) and self._keeps(high):
            return "shown"
        return "yes" if self._keeps(self.found.value) else "**no**"

    def _keeps(self, value: float) -> bool:
        return (self.at_least is None or value >= self.at_least) and (self.at_most is None or value <= self.at_most)

    @property
    def bound(self) -> str:
        """In words."""
        parts = [f">= {100 * self.at_least:g} %"] if self.at_least is not None else []
        parts += [f"<= {100 * self.at_most:g} %"] if self.at_most is not None else []
        return " and ".join(parts)


def targets(outcomes: Sequence[Outcome]) -> list[Target]:
    """Every target that is a share of cases."""
    tried = [outcome for outcome in outcomes if outcome.reachable]

    def of(kind: str, size: float | None = None) -> list[Outcome]:
        return [each for each in tried if each.kind == kind and size in (None, each.size)]

    def says(verdict: str) -> Callable[[Outcome], bool]:
        return lambda outcome: outcome.verdict == verdict

    identified = [each for each in tried if each.verdict == RIGHT and each.effects]
    lasting = [each for each in identified if not set(each.effects) & set(PER_RUN)]
    followed = [each for each in of("confounded") if each.separated is not None]
    starts = [each for each in of("unknown_start") if not each.effects]
    inside = [parameter.inside for each in identified for parameter in each.parameters]
    found = [
        Target("false alarms, structure right", share(of("null_right"), says(WRONG)), at_most=0.01),
        Target("right effect alone, structure right, 1x", share(of("effect_right", 1.0), says(RIGHT)), at_least=0.95),
        Target("the same, 1.5x", share(of("effect_right", 1.5), says(RIGHT)), at_least=0.95),
        Target("the same, 3x", share(of("effect_right", 3.0), says(RIGHT)), at_least=0.97),
        Target("the same, 10x", share(of("effect_right", 10.0), says(RIGHT)), at_least=0.97),
        Target("false alarms, structure wrong", share(of("null_wrong"), says(WRONG)), at_most=0.02),
    ]
    for size, least in ((3.0, 0.6), (10.0, 0.8)):
        wrong = of("effect_wrong", size)
        found.append(Target(f"right, structure wrong, {size:g}x", share(wrong, says(RIGHT)), at_least=least))
        found.append(Target(f"wrong name, structure wrong, {size:g}x", share(wrong, says(WRONG)), at_most=0.03))
    return [
        *found,
        Target("both of two effects named", share(of("pair"), says(RIGHT)), at_least=0.75),
        Target("effect outside the library: named as one inside", share(of("outside"), says(WRONG)), at_most=0.05),
        Target("effect outside: reported as unexplained", share(of("outside"), lambda o: o.unexplained), at_least=0.9),
        Target("score error <= 1.10 x noise where identified", share(identified, repaired), at_least=0.9),
        Target("the same, effects that last from run to run", share(lasting, repaired), at_least=0.9),
        Target("95 % intervals that hold the true parameter", Share(sum(inside), len(inside)), 0.9, 0.98),
        Target("confounded design answered with the pair", share(of("confounded"), says(PAIR)), at_least=0.95),
        Target("proposed next experiment separates", share(followed, lambda o: bool(o.separated)), at_least=0.9),
        Target("unknown start: score error <= 1.10 x noise, nulls", share(starts, repaired), at_least=0.9),
        Target("no report", share(tried, says(FAILED)), at_most=0.0),
    ]


def repaired(outcome: Outcome) -> bool:
    """Whether the repaired model predicts every score run to within GOOD_SCORE."""
    return bool(outcome.after) and float(np.max(outcome.after)) <= GOOD_SCORE


def markdown(outcomes: Sequence[Outcome], heading: str) -> str:
    """The page."""
    tried = [outcome for outcome in outcomes if outcome.reachable]
    parts = [
        heading,
        _target_table(outcomes),
        "## What was said, by table\n\n" + _verdict_table(tried, lambda each: (each.kind, _size(each))),
        "## Structure right, by effect\n\n" + _of_kind(tried, "effect_right", _effect_and_size),
        "## Structure wrong, by family\n\n" + _of_kind(tried, "effect_wrong", lambda o: (o.family, _size(o))),
        "## Structure wrong, by effect\n\n" + _of_kind(tried, "effect_wrong", _effect_and_size),
        "## Structure wrong, nothing hidden, by family\n\n" + _of_kind(tried, "null_wrong", lambda o: (o.family,)),
        "## Outside the library, by effect\n\n" + _of_kind(tried, "outside", _effect_and_size),
        "## Confounded designs\n\n" + _of_kind(tried, "confounded", lambda o: (o.protocol, *_effect_and_size(o))),
        "## Wrong names\n\n" + _confusions(tried),
        "## After the repair\n\n" + _score_table(tried),
        "## Intervals, by parameter\n\n" + _interval_table(tried),
        _footing(outcomes, tried),
    ]
    return "\n\n".join(parts) + "\n"


def _size(outcome: Outcome) -> str:
    return f"{outcome.size:g}x" if outcome.effects else "null"


def _effect_and_size(outcome: Outcome) -> tuple[str, ...]:
    return "+".join(outcome.effects), _size(outcome)


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [f"| {' | '.join(head)} |", "|" + " --- |" * len(head)]
    lines += [f"| {' | '.join(str(cell) for cell in row)} |" for row in rows]
    return "\n".join(lines)


def _target_table(outcomes: Sequence[Outcome]) -> str:
    rows = [(each.what, each.bound, str(each.found), each.met) for each in targets(outcomes)]
    words = "*shown*: the whole interval keeps the target; *yes*: what was observed does."
    return f"## Targets\n\n{words}\n\n" + _table(("figure", "target", "found (95 % interval)", "met"), rows)


def _verdict_table(outcomes: Sequence[Outcome], key: Callable[[Outcome], tuple[str, ...]]) -> str:
    if not outcomes:
        return "None tried."
    groups: dict[tuple[str, ...], list[Outcome]] = {}
    for outcome in outcomes:
        groups.setdefault(key(outcome), []).append(outcome)
    rows = []
    for name, members in sorted(groups.items()):
        counts = [sum(each.verdict == verdict for each in members) for verdict in VERDICTS]
        rows.append((" ".join(name), len(members), *(count or "" for count in counts)))
    return _table(("case", "tried", *VERDICTS), rows)


def _of_kind(outcomes: Sequence[Outcome], kind: str, key: Callable[[Outcome], tuple[str, ...]]) -> str:
    return _verdict_table([each for each in outcomes if each.kind == kind], key)


def _confusions(outcomes: Sequence[Outcome]) -> str:
    """Which name was given for what."""
    counts: dict[tuple[str, str, str], int] = {}
    for outcome in outcomes:
        if outcome.verdict == WRONG:
            key = (outcome.kind, "+".join(outcome.effects) or "nothing", "+".join(outcome.named))
            counts[key] = counts.get(key, 0) + 1
    if not counts:
        return "None."
    rows = [(*key, count) for key, count in sorted(counts.items(), key=lambda each: -each[1])]
    return _table(("table", "hidden", "named", "cases"), rows)


def _score_table(outcomes: Sequence[Outcome]) -> str:
    """Error on the worst score run over the noise, by effect, where it was identified."""
    rows = []
    for name in PLAIN:
        members = [o for o in outcomes if o.effects == (name,) and o.verdict == RIGHT and o.after and o.before]
        if members:
            before = np.array([max(each.before) for each in members])
            after = np.array([max(each.after) for each in members])
            quantiles = [f"{np.quantile(after, q):.2f}" for q in (0.5, 0.9, 1.0)]
            rows.append((name, len(members), f"{np.median(before):.2f}", *quantiles, share(members, repaired)))
    head = ("effect", "cases", "before, median", "after, median", "90 %", "worst", "<= 1.10")
    return _table(head, rows) if rows else "None identified."


def _interval_table(outcomes: Sequence[Outcome]) -> str:
    groups: dict[tuple[str, str], list[bool]] = {}
    for outcome in outcomes:
        for each in outcome.parameters:
            groups.setdefault((each.effect, each.parameter), []).append(each.inside)
    rows = [(*key, Share(sum(inside), len(inside))) for key, inside in sorted(groups.items())]
    return _table(("effect", "parameter", "inside"), rows) if rows else "None."


def _footing(outcomes: Sequence[Outcome], tried: Sequence[Outcome]) -> str:
    seconds = np.array([each.seconds for each in tried if each.verdict != FAILED] or [0.0])
    memory = max((each.megabytes for each in tried), default=0.0)
    lines = [
        f"Time of a diagnosis: median {np.median(seconds):.1f} s, 95 % below {np.quantile(seconds, 0.95):.1f} s, "
        f"longest {seconds.max():.1f} s; largest memory of a process {memory:.0f} MB.",
        f"{len(outcomes) - len(tried)} of {len(outcomes)} cases left out: their runs cannot show an effect so large.",
    ]
    failures = sorted({each.failure for each in tried if each.failure})
    lines += [f"No report: {failure}" for failure in failures[:10]]
    return "## Time, memory, cases left out\n\n" + "\n\n".join(lines)
