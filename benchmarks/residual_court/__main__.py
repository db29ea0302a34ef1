"""`python -m pzt_benchmarks.residual_court`: try the diagnosis on synthetic runs and write the scoreboard."""

from __future__ import annotations

import argparse
import functools
import os
import shlex
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from pzt_benchmarks.report import provenance
from pzt_benchmarks.residual_court.cases import KINDS
from pzt_benchmarks.residual_court.court import chosen, hold, read_results
from pzt_benchmarks.residual_court.outcome import Outcome

_TEXT = """# The residual court

{line}

Seed {seed}; {what}. **Everything here is simulated**, by a generator that shares no code with the library
(benchmarks/residual_court). Sizes are the rms that an effect leaves after the base has adapted, in units of the noise
(12 nm on a stroke of about 12 um). Intervals are Wilson's, 95 %. What the words mean stands in
benchmarks/residual_court/outcome.py."""


def parser() -> argparse.ArgumentParser:
    """The arguments."""
    made = argparse.ArgumentParser(prog="python -m pzt_benchmarks.residual_court", description=__doc__)
    made.add_argument("--sample", type=int, metavar="N", help="only N cases of each table")
    made.add_argument("--rounds", type=int, metavar="N", help="N rounds of each table instead of the whole court's")
    made.add_argument("--seed", type=int, default=1, help="of the cases; a fresh one for a scored run")
    made.add_argument(
        "--kinds", nargs="+", choices=list(KINDS), default=list(KINDS), metavar="KIND", help=", ".join(KINDS)
    )
    made.add_argument("--out", type=Path, default=Path("docs/court.md"), help="the scoreboard")
    made.add_argument(
        "--results", type=Path, help="file of outcomes; goes on where it stopped, the page is of all in it"
    )
    made.add_argument("--keep", type=Path, metavar="DIR", help="keep runs, reports and models of each case here")
    made.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1), help="processes at once")
    return made


def main() -> None:
    """Entry point."""
    given = parser().parse_args()
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"  # a process for each case is parallel enough; workers inherit this
    from pzt_benchmarks.residual_court.scoreboard import markdown
    from pzt_benchmarks.residual_court.trial import Trial

    specs = chosen(given.kinds, given.seed, given.sample, given.rounds)
    with tempfile.TemporaryDirectory(prefix="court-") as scratch:
        trial = Trial(given.keep or Path(scratch), keep=given.keep is not None)
        results = given.results or Path(scratch) / "results.jsonl"
        hold(specs, trial, results, given.workers, _teller(len(specs)))
        outcomes = read_results(results)
    command = shlex.join(["python", "-m", "pzt_benchmarks.residual_court", *sys.argv[1:]])
    tables = dict.fromkeys(outcome.kind for outcome in outcomes)
    what = f"{len(outcomes)} cases of {', '.join(tables)}"
    heading = _TEXT.format(line=provenance(command).line(), seed=given.seed, what=what)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(markdown(outcomes, heading), encoding="utf-8")
    print(given.out)


def _teller(total: int) -> Callable[[int, Outcome], None]:
    """A line for each case in a terminal, for each fiftieth elsewhere."""

    def tell(left: int, outcome: Outcome, every: int) -> None:
        if left % every == 0 or outcome.failure:
            print(f"{left} of {total} left: {outcome.name}: {outcome.verdict} {outcome.failure}", file=sys.stderr)

    return functools.partial(tell, every=1 if sys.stderr.isatty() else 50)


if __name__ == "__main__":
    main()
