"""The book-keeping of the fault series: failures are counted, their times too, and each row says its commit."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np

from pzt_benchmarks.report import Provenance
from pzt_benchmarks.soak.fault import Fault, Seen
from pzt_benchmarks.soak.page import page
from pzt_benchmarks.soak.series import Result, series

GOOD, LATE, LOST = 0.25, 1.5, None
MADE = Provenance(command="soak", machine="here", versions="", commit="cafe", day="today", load="0")


def performed(*times: float | None) -> Result:
    """The series of a fault whose reaction takes these times; None: the bench finds what must not be."""
    to_come = list(times)

    def perform(_bench: Any, _chance: np.random.Generator) -> Seen:
        seconds = to_come.pop(0)
        assert seconds is not None
        return Seen("stops", seconds)

    fault = Fault("pulled plug", "by hand", "stops", 1.0, "until 0 V", lambda _: nullcontext(None), perform)
    (result,) = series([fault], lambda _: len(times), lambda _: None)
    return result


def test_the_worst_time_is_the_worst_of_all_trials() -> None:
    result = performed(GOOD, LATE, LOST, GOOD)
    assert (result.performed, result.worst) == (4, LATE)
    assert [problem.partition(":")[0] for problem in result.problems] == ["trial 1", "trial 2"]
    assert performed(LOST).worst is None


def test_the_page_says_of_which_code_each_row_is() -> None:
    old, new = performed(GOOD), performed(LATE)
    old.commit, new.commit = "aaa111", "bbb222"
    text = page([old, new, old], ["a fault to come"], MADE)
    assert "Rows performed on aaa111: 2; on bbb222: 1." in text
    assert "| 1 | 0.250 s | 1 s | within the limit |" in text
    assert "| 1 | 1.500 s | 1 s | **1 not as expected** |" in text
    assert "* pulled plug: trial 0: took 1.500 s, limit 1 s" in text
    assert "Performed by `make test` only: a fault to come." in text
