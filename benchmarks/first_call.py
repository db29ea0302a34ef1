"""How long the first call takes while Numba compiles, and how long once the code lies on the disk.

Each link runs in a process of its own, first with an empty cache folder, then once more with what that left there.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise

from pzt_benchmarks.child import measured_in_child
from pzt_benchmarks.table import Figure, Table, Target

KINDS = ("quadrature", "front", "parametrized", "amplifier", "strain_hysteresis", "structure", "displacement_sensor")
"""Every link that compiles something; the lattice shares the kernel of the quadrature."""

QUICK_KINDS = ("quadrature",)
HEADS = ("link", "imports", "step", "inverse", "second start: imports", "step and inverse", "verdict")
TARGET = Target(10.0)
"""Of step and inverse together [s]."""


def first_calls(kind: str) -> dict[str, float]:
    """Times of the imports, of the first step and of the first inverse, in this process [s of processor time]."""
    began = time.process_time()
    from pzt_benchmarks.links import link_of
    from pzt_ros.physics.signals import REHEARSAL, Rest, Signals

    link = link_of(kind)
    marks = [began, time.process_time()]
    block = Signals(REHEARSAL, *(1e-3 * REHEARSAL / REHEARSAL[-1] for _ in range(4)))
    for call in (link.step, link.invert):
        call(link.init(Rest()), block)
        marks.append(time.process_time())
    imports, step, inverse = (after - before for before, after in pairwise(marks))
    return {"imports": imports, "step": step, "inverse": inverse}


def measure(quick: bool, tell: Callable[[str], None]) -> tuple[list[Figure], Table]:
    """The slowest first calls, and a table of all."""
    rows, cold_calls, warm_calls = [], {}, {}
    for kind in QUICK_KINDS if quick else KINDS:
        tell(f"first call of {kind}")
        with tempfile.TemporaryDirectory() as cache:
            cold, warm = (measured_in_child("pzt_benchmarks.first_call", kind, NUMBA_CACHE_DIR=cache) for _ in range(2))
        cold_calls[kind], warm_calls[kind] = (found["step"] + found["inverse"] for found in (cold, warm))
        times = (cold["imports"], cold["step"], cold["inverse"], warm["imports"], warm_calls[kind])
        rows.append((kind, *(f"{seconds:.2f}" for seconds in times), TARGET.verdict(cold_calls[kind])))
    slowest = max(cold_calls, key=lambda kind: cold_calls[kind])
    figures = [
        Figure(f"slowest first call, empty cache, step and inverse: {slowest}", cold_calls[slowest], "s", TARGET),
        Figure("slowest first call of a second start", max(warm_calls.values()), "s"),
    ]
    note = (
        f"Seconds of processor time. The verdict is on step and inverse together, at most {TARGET.limit:g} s. The"
        " lattice shares the code of the quadrature; the amplifier is that of p802, whose load is the lattice."
    )
    return figures, Table("First call: compiled, then from the cache on disk", HEADS, rows, note)


if __name__ == "__main__":
    print(json.dumps(first_calls(sys.argv[1])))
