"""`python -m benchmarks [NAME ...]`: run the benchmarks and write docs/performance.md."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks import measured_runs, ticks
from benchmarks.table import Table, provenance

BENCHMARKS: dict[str, Callable[[], Table]] = {"ticks": ticks.measure, "measured": measured_runs.measure}
"""Every benchmark by name; a new one is one line here."""

PAGE = Path(__file__).parents[1] / "docs" / "performance.md"


def main(names: list[str]) -> None:
    """Run the benchmarks named, or all; only a run of all of them writes the page."""
    unknown = [name for name in names if name not in BENCHMARKS]
    if unknown:
        sys.exit(f"error: unknown benchmark '{unknown[0]}'; known are {', '.join(BENCHMARKS)}")
    tables = []
    for name in names or BENCHMARKS:
        print(f"{name} ...", file=sys.stderr)
        tables.append(BENCHMARKS[name]().markdown())
        print(tables[-1])
    if not names:
        head = (
            f"# Performance\n\nWritten by `make bench`: {provenance()}. Ratios in one run count, times mean little.\n"
        )
        PAGE.write_text("\n".join([head, *tables]), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
