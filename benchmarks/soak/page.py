"""docs/faults.md: the fault table with what a long series came to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pzt_benchmarks.report import Provenance
from pzt_benchmarks.soak.series import Result
from pzt_benchmarks.table import markdown_rows

HEAD = """# Faults

Written by `python -m pzt_benchmarks.soak` (benchmarks/soak). **All instruments are simulated**; processes, topics,
files and times are real, except where a time is of the run. `make test` performs each fault once
(tests/graph/test_fault_table.py).

{provenance}
{commits}

The limit of a ramp to 0 V is the *declared safe time* of the default limits ([safety](safety.md)): the watchdog's
patience, the way from the edge of the window at the safe rate, and 0.2 s.

"""

HEADS = ("fault", "how it is made", "expected reaction", "time measured", "times", "worst", "limit", "verdict")


def page(results: Sequence[Result], not_yet: Sequence[str], made: Provenance) -> str:
    """The page; `not_yet` are the faults that this series has not come to."""
    lines = markdown_rows(HEADS, [_row(result) for result in results])
    problems = [f"* {r.fault.name}: {problem}" for r in results for problem in _listed(r)]
    tail = ["", "## What was not as expected", "", *(problems or ["Nothing."]), ""]
    if not_yet:
        tail += ["## Not in this series yet", "", f"Performed by `make test` only: {', '.join(not_yet)}.", ""]
    return HEAD.format(provenance=made.line(), commits=_commits(results)) + "\n".join([*lines, *tail])


def _commits(results: Sequence[Result]) -> str:
    """A series takes hours and goes on where it stopped, also after a commit: how many rows are of which code."""
    counted = Counter(result.commit for result in results if not result.skipped)
    return "Rows performed " + "; ".join(f"on {commit}: {count}" for commit, count in counted.items()) + "."


def _row(result: Result) -> tuple[str, ...]:
    fault = result.fault
    if result.skipped:
        return fault.name, fault.made, fault.expected, fault.timed, "0", "", f"{fault.limit:g} s", result.skipped
    verdict = "within the limit" if not result.problems else f"**{len(result.problems)} not as expected**"
    worst = "" if result.worst is None else f"{result.worst:.3f} s"
    return (
        fault.name,
        fault.made,
        fault.expected,
        fault.timed,
        str(result.performed),
        worst,
        f"{fault.limit:g} s",
        verdict,
    )


def _listed(result: Result) -> list[str]:
    """The first few problems, each in one line."""
    shown = [" ".join(problem.split())[:300] for problem in result.problems[:5]]
    left = len(result.problems) - len(shown)
    return [*shown, f"and {left} more"] if left > 0 else shown
