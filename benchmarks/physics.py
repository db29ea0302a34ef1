"""The physics: speed, compile time and memory beside their targets (issue 3), in one run on one core."""

from __future__ import annotations

from collections.abc import Callable

from pzt_benchmarks import first_call, memory, radau, speed
from pzt_benchmarks.stopwatch import one_core
from pzt_benchmarks.table import PHYSICS, Figure, Table, figures_table


def measure(quick: bool, tell: Callable[[str], None]) -> list[Table]:
    """A table of figures and targets, then the tables they come from."""
    figures: list[Figure] = []
    tables: list[Table] = []
    with one_core():
        for part in (speed, radau, first_call, memory):
            found, table = part.measure(quick, tell)
            figures += found
            tables.append(table)
    note = (
        "On one core, in one run; times are processor time, the best of several. A target without a row here is one of"
        " accuracy: those are held by tests."
    )
    return [figures_table(PHYSICS, figures, note), *tables]
