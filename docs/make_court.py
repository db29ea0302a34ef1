"""Writes docs/court-samples.md and the README's table of what was said from the outcomes in benchmarks/results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from pzt_benchmarks.report import with_part
from pzt_benchmarks.residual_court.court import read_results
from pzt_benchmarks.residual_court.outcome import (
    FAILED,
    OTHER_PAIR,
    PAIR,
    PARTLY,
    RIGHT,
    SILENT,
    UNEXPLAINED,
    WRONG,
    Outcome,
)
from pzt_benchmarks.residual_court.scoreboard import markdown
from pzt_benchmarks.table import markdown_rows

FOLDER = Path(__file__).parent
RESULTS = FOLDER.parent / "benchmarks" / "results"
PAGE, README = FOLDER / "court-samples.md", FOLDER.parent / "README.md"

BEGIN, END = "<!-- written by docs/make_court.py -->\n\n", "<!-- until here -->\n"

_TEXT = """# All samples of the residual court together

`python docs/make_court.py`, of the {count} outcomes in [benchmarks/results](../benchmarks/results): {files}.
Each sample had fresh seeds and rules frozen in a commit before, which are not the rules of today: what a sample showed
was mended after it, so the latest tell more than all together. What each showed stands on its own page, and what those
before showed on [another](court-history.md). **Everything here is simulated**, by a generator that shares no code with
the library."""

_COLUMNS = {
    "right": (RIGHT,),
    "in a group, or one of two": (PAIR, OTHER_PAIR, PARTLY),
    "something is missing": (UNEXPLAINED,),
    "silent": (SILENT,),
    "wrong name": (WRONG,),
    "no report": (FAILED,),
}

_ROWS: tuple[tuple[str, Callable[[Outcome], bool]], ...] = (
    ("nothing, structure right", lambda o: o.kind == "null_right"),
    ("an effect of 1 to 10 x, structure right", lambda o: o.kind == "effect_right"),
    ("nothing, structure wrong", lambda o: o.kind == "null_wrong"),
    ("an effect of 1 or 1.5 x, structure wrong", lambda o: o.kind == "effect_wrong" and o.size < 3.0),
    ("an effect of 3 x, structure wrong", lambda o: o.kind == "effect_wrong" and o.size == 3.0),
    ("an effect of 10 x, structure wrong", lambda o: o.kind == "effect_wrong" and o.size == 10.0),
    ("two effects of 3 x", lambda o: o.kind == "pair"),
    ("an effect that is not in the library", lambda o: o.kind == "outside"),
    ("one that the design hides (one sine, one hold)", lambda o: o.kind == "confounded"),
    ("nothing, inside minor loops", lambda o: o.kind == "unknown_start" and not o.effects),
    ("an effect of 3 x, inside minor loops", lambda o: o.kind == "unknown_start" and bool(o.effects)),
)


def samples() -> list[Path]:
    """Files of outcomes, the oldest first."""
    return sorted(RESULTS.glob("court-*.jsonl"))


def page() -> str:
    """What the court's page says of one sample, of all."""
    files = samples()
    outcomes = _tried(files)
    links = ", ".join(f"[{_seeds(path)}]({_page_of(path)}) ({len(read_results(path))})" for path in files)
    return markdown(outcomes, _TEXT.format(count=len(outcomes), files=f"seeds (and cases) {links}"))


def _seeds(path: Path) -> str:
    return path.stem.removeprefix("court-").replace("-", " to ")


def _page_of(path: Path) -> str:
    """Named by the last seed, but for the latest."""
    own = f"court-{path.stem.rpartition('-')[2]}.md"
    return own if (FOLDER / own).exists() else "court.md"


def readme_part() -> str:
    """How often what was said, of what was hidden."""
    outcomes = [each for each in _tried(samples()) if each.reachable]
    rows = []
    for what, holds in _ROWS:
        members = [each for each in outcomes if holds(each)]
        rows.append((what, str(len(members)), *(_count(members, verdicts) for verdicts in _COLUMNS.values())))
    return "\n".join([*markdown_rows(["what is hidden", "cases", *_COLUMNS], rows), ""])


def _tried(files: Sequence[Path]) -> list[Outcome]:
    return [outcome for path in files for outcome in read_results(path)]


def _count(members: Sequence[Outcome], verdicts: Sequence[str]) -> str:
    return str(sum(each.verdict in verdicts for each in members) or "")


def main() -> None:
    """Write both."""
    PAGE.write_text(page(), encoding="utf-8")
    readme = README.read_text(encoding="utf-8")
    README.write_text(with_part(readme, BEGIN, END, readme_part()), encoding="utf-8")


if __name__ == "__main__":
    main()
