"""`python -m pzt_benchmarks [NAME ...]`: what `pzt bench` runs."""

from __future__ import annotations

import argparse
import importlib
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from pzt_benchmarks.report import Report, check_out, provenance, show
from pzt_ros.errors import BenchError

BENCHMARKS = {
    "ticks": "ticks",
    "measured": "measured_runs",
    "physics": "physics",
    "tracking": "tracking",
    "observer": "unknown_histories",
    "optimal": "optimal_control",
    "panel": "panel",
    "endurance": "endurance",
}
"""Every benchmark by name, and the file whose `measure(quick, tell)` returns its tables; a new one is one line here."""

ALL = ("ticks", "measured", "physics")
"""What is run where none is named; the others have a page of their own."""

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
"""One core is what is measured; these have to be set before NumPy is imported, so the benchmarks are imported late."""


def run(names: Sequence[str], quick: bool, out: Path | None, command: str) -> None:
    """Run the benchmarks named, or those of the README, show their tables, and write them to `out`.

    Raises:
        BenchError: a name that is unknown, or a file that cannot be written.
    """
    unknown = [name for name in names if name not in BENCHMARKS]
    if unknown:
        raise BenchError(f"unknown benchmark '{unknown[0]}'; known are {', '.join(BENCHMARKS)}")
    if out is not None:
        check_out(out)
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    began, console, tables = provenance(command), Console(stderr=True), []
    for name in names or ALL:
        module = importlib.import_module(f"pzt_benchmarks.{BENCHMARKS[name]}")
        if not console.is_terminal:
            print(f"{name} ...", file=sys.stderr)
        with console.status(name) as status:
            measured = module.measure(quick, lambda what, name=name: status.update(f"{name}: {what}"))
        for table in measured:
            show(table)
        tables += measured
    if out is not None:
        Report(began, tables).write(out)


def main() -> None:
    """Entry point; one line and exit code 2 for a mistake in the arguments."""
    parser = argparse.ArgumentParser(prog="pzt bench", description="Measure the figures of the README.")
    known = f"{', '.join(BENCHMARKS)}; by default {', '.join(ALL)}"
    parser.add_argument("names", nargs="*", metavar="NAME", help=known)
    parser.add_argument("--out", type=Path, help="write the tables to this file too: .md or .json")
    parser.add_argument("--quick", action="store_true", help="shorter runs; the figures are less sure")
    given = parser.parse_args()
    try:
        run(given.names, given.quick, given.out, shlex.join(["pzt", "bench", *sys.argv[1:]]))
    except BenchError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
