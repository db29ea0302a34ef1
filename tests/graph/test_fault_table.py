"""Every fault of the fault table, made once: the reaction has to be the one expected.

How soon it comes is measured where the machine is left alone: `python -m pzt_benchmarks.soak` (docs/faults.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from pzt_benchmarks.soak.fault import Bench, Fault, NotHereError
from pzt_benchmarks.soak.series import chance
from pzt_benchmarks.soak.table import FAULTS


class Benches:
    """Opens a bench for the faults that are made on it, one kind at a time; the rows of a kind stand together."""

    def __init__(self, folders: pytest.TempPathFactory) -> None:
        self._folders = folders
        self._open = ExitStack()
        self._kind: Bench | None = None
        self._bench: Any = None

    def get(self, kind: Bench) -> Any:
        if kind is not self._kind:
            self.close()
            try:
                self._bench = self._open.enter_context(kind(self._folders.mktemp("bench")))
            except NotHereError as error:
                pytest.skip(str(error))
            self._kind = kind
        return self._bench

    def close(self) -> None:
        self._kind = None
        self._open.close()


@pytest.fixture(scope="module")
def benches(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Benches]:
    opened = Benches(tmp_path_factory)
    yield opened
    opened.close()


@pytest.mark.parametrize("fault", FAULTS, ids=[fault.name for fault in FAULTS])
def test_fault(fault: Fault, benches: Benches) -> None:
    seen = fault.perform(benches.get(fault.bench), chance(fault, trial=0))
    assert seen.reaction == fault.expected
    assert math.isfinite(seen.seconds)
