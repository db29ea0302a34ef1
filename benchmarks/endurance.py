"""A simulated hour of the graph: what its processes hold and how long its ticks take, at the beginning and at the end.

It runs as fast as it can, with the recorder, separate and composed; each hour leaves a bag of some 12 GB in the folder
for temporary files, which is removed. Twenty minutes each on two cores.
"""

from __future__ import annotations

import contextlib
import re
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import yaml
from numpy.typing import NDArray

from pzt_benchmarks.bag_ticks import ticks_in
from pzt_benchmarks.soak.processes import GraphProcess
from pzt_benchmarks.table import Table
from pzt_ros.errors import RunFailedError
from pzt_ros.scenario import load_scenario

SECONDS, QUICK_SECONDS = 3600.0, 20.0
"""Simulated."""
PATIENCE = "10 s"
PROBE = 2.0
"""Memory is looked at this often [s]."""
STALL_AT, STALL = 2, 1.0
"""Look at which the recorder is held, and for how long [s]. What a sender keeps for one that does not take it grows up
to the depth of its history, once, and is used again: it has to be there before growth is looked for."""
BEGIN, END = (0.1, 0.3), (0.75, 0.95)
"""Shares of the run: what is loaded and compiled is there by then, and it is not over yet. The least in each counts:
the recorder's chunks come and go."""
NODE = re.compile(r"-m pzt_nodes\.(\w+?)(?:_node)?\b")
PART = 1 / 6
"""Of the run, at its beginning and at its end, in which ticks are timed."""


@dataclass(frozen=True)
class Hour:
    """One run.

    Attributes:
        memory: private memory of every process, by name [MB], as often as it was looked at.
        ticks: from each block of truth to the amplifier's answer [ms].
    """

    memory: dict[str, list[float]]
    ticks: NDArray[np.float64]


def measure(quick: bool, tell: Callable[[str], None]) -> list[Table]:
    """Both layouts, one after the other.

    Raises:
        RunFailedError: the graph did not come to its end.
    """
    seconds = QUICK_SECONDS if quick else SECONDS
    hours = {}
    for layout in ("separate processes", "composed"):
        tell(layout)
        with tempfile.TemporaryDirectory() as folder:
            hours[layout] = _hour(Path(folder), seconds, layout == "composed")
    return [_memory(hours, seconds), _latency(hours)]


def _hour(folder: Path, seconds: float, composed: bool) -> Hour:
    scenario = yaml.safe_load(load_scenario("scan").source.read_text(encoding="utf-8"))
    for phase in scenario["phases"]:
        if phase["phase"] == "scan":
            phase["cycles"] = round(seconds)
    scenario["limits"] = {"command_timeout": PATIENCE}  # that a shared machine stops for a second is not the question
    (folder / "hour.yaml").write_text(yaml.safe_dump(scenario), encoding="utf-8")
    memory: dict[str, list[float]] = {}
    with GraphProcess(folder / "hour.yaml", folder / "run", "--quiet", *["--composed"] * composed) as graph:
        while graph.process.poll() is None:
            for name, held in _held(graph).items():
                memory.setdefault(name, []).append(held)
            if len(memory.get("recorder", ())) == STALL_AT:
                _hold_recorder(graph)
            time.sleep(PROBE)
        code, said = graph.wait()
    if code:
        raise RunFailedError(f"the graph ended with {code}: {said.strip()[-300:]}")
    return Hour(memory, ticks_in(folder / "run" / "bag")[1])


def _held(graph: GraphProcess) -> dict[str, float]:
    """Private memory of the bringup and of each process of the graph [MB]; of those that have just ended, nothing."""
    found = {}
    for process in (psutil.Process(graph.process.pid), *graph.nodes()):
        with contextlib.suppress(psutil.Error):
            title = NODE.search(" ".join(process.cmdline()))
            found[title[1] if title else "bringup"] = process.memory_full_info().uss / 1e6
    return found


def _hold_recorder(graph: GraphProcess) -> None:
    """Stop the recorder's process for as long as a slow disk might."""
    with contextlib.suppress(StopIteration, psutil.Error):  # it has ended
        recorder = graph.node("recorder")
        recorder.suspend()
        time.sleep(STALL)
        recorder.resume()


def _memory(hours: dict[str, Hour], seconds: float) -> Table:
    heads = ("layout", "process", "least MB, beginning", "least MB, end", "growth MB", "most MB")
    rows = []
    for layout, hour in hours.items():
        for name, held in sorted(hour.memory.items()):
            begin, end = (min(held[int(a * len(held)) : int(b * len(held)) + 1]) for a, b in (BEGIN, END))
            rows.append((layout, name, f"{begin:.1f}", f"{end:.1f}", f"{end - begin:+.2f}", f"{max(held):.1f}"))
    note = (
        f"The recorder is held for {STALL:g} s at the beginning, so that all that waits for one that does not answer is"
        " there: what a node keeps for it is bounded, and is not given back."
    )
    return Table(f"Private memory over {seconds / 60:.0f} simulated minutes", heads, rows, note)


def _latency(hours: dict[str, Hour]) -> Table:
    heads = ("layout", "ticks", "begin: median ms", "99 % ms", "end: median ms", "99 % ms")
    rows = []
    for layout, hour in hours.items():
        part = round(PART * len(hour.ticks))
        figures = [
            f"{np.percentile(some, q):.2f}" for some in (hour.ticks[:part], hour.ticks[-part:]) for q in (50, 99)
        ]
        rows.append((layout, f"{len(hour.ticks):,}", *figures))
    note = (
        f"From truth to the next block applied, as the recorder heard them; the first and the last {PART:.0%} of them."
    )
    return Table("Ticks at the beginning and at the end", heads, rows, note)
