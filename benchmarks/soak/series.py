"""Performs faults again and again, and keeps count."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

import numpy as np

from pzt_benchmarks.soak.fault import Fault, NotHereError
from pzt_ros.errors import BenchError

SEED = 20261122


@dataclass
class Result:
    """What a series of one fault came to.

    Attributes:
        fault: the row of the table.
        worst: the longest reaction time that was measured [s]; None where none was.
        problems: what was not as expected, one line each.
        skipped: why it was not performed at all; empty otherwise.
        commit: the code it was performed on.
    """

    fault: Fault
    performed: int = 0
    worst: float | None = None
    problems: list[str] = field(default_factory=list)
    skipped: str = ""
    commit: str = ""


def chance(fault: Fault, trial: int) -> np.random.Generator:
    """The random numbers of one trial."""
    return np.random.default_rng([SEED, sum(fault.name.encode()), trial])


def series(faults: Iterable[Fault], repeat: Callable[[Fault], int], tell: Callable[[str], None]) -> Iterator[Result]:
    """Perform each fault as often as `repeat` says; those that share a bench share one of its making."""
    for make, group in groupby(faults, key=lambda fault: fault.bench):
        rows = list(group)
        with tempfile.TemporaryDirectory(prefix="soak-") as folder:
            try:
                entered = make(Path(folder))
            except NotHereError as error:
                yield from (Result(fault, skipped=str(error)) for fault in rows)
                continue
            with entered as bench:
                for fault in rows:
                    yield _repeated(fault, bench, repeat(fault), tell)


def _repeated(fault: Fault, bench: object, times: int, tell: Callable[[str], None]) -> Result:
    result, began = Result(fault), time.monotonic()
    for trial in range(times):
        try:
            seen = fault.perform(bench, chance(fault, trial))
            problem = fault.problem(seen)
        except (AssertionError, BenchError) as error:  # the bench itself found what must not be
            seen, problem = None, str(error)
        result.performed += 1
        if problem or seen is None:
            result.problems.append(f"trial {trial}: {problem}")
        if seen is not None:
            result.worst = max(result.worst or 0.0, seen.seconds)
        spent = time.monotonic() - began
        tell(f"{fault.name}: {result.performed} of {times}, {len(result.problems)} problems, {spent:.0f} s")
    return result
