"""One closed-loop tick of the whole graph: free-running and paced, separate and composed, beside a bare ring."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from pzt_benchmarks.bare_loop import run_ring
from pzt_benchmarks.table import PACED, TICKS, Table
from pzt_bringup.domain import take_domain
from pzt_ros.bags.reader import open_bag
from pzt_ros.ros_environment import ros_environment
from pzt_ros.scenario import load_scenario

SAMPLE_RATE, BLOCK_SIZE = 20e3, 100
"""Of the scenario as it is shipped [Hz, samples]."""
REAL_TIME_PRIORITY = ("chrt", "-r", "10")
"""Before a command: it and all it starts run before whatever has no such priority (SCHED_RR)."""
PACES = ((False, 100, False), (False, 100, True), (False, 40, True), (True, 100, False), (True, 40, False),
         (True, 20, False), (True, 20, True), (True, 10, True))  # fmt: skip
"""In real time: composed or not, samples in a block, with a real-time priority or not."""


@dataclass(frozen=True)
class Measured:
    """Duration of ticks [us], how many there were in a second, and the share that came too late for their block."""

    median: float
    p99: float
    per_second: float
    late: float = 0.0

    def row(self, name: str, floor: float) -> tuple[str, ...]:
        """One row of the table of free-running ticks."""
        pace = f"{self.per_second * BLOCK_SIZE / SAMPLE_RATE:.1f}"
        return (name, f"{self.median:.0f}", f"{self.p99:.0f}", f"{self.per_second:.0f}", pace,
                f"{self.median / floor:.2f}")  # fmt: skip


def measure_graph(composed: bool, paced: bool, samples: int = BLOCK_SIZE, first: bool = False) -> Measured:
    """Run the scenario `scan` with so many samples in a block, first of all or not, and time the ticks from the bag."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = yaml.safe_load(load_scenario("scan").source.read_text(encoding="utf-8"))
        file = Path(folder, "scan.yaml")
        file.write_text(yaml.safe_dump({**scenario, "block_size": samples}), encoding="utf-8")
        flags = ["--composed"] * composed + ["--real-time"] * paced + ["--no-priority"] * (not first)
        command = [sys.executable, "-m", "pzt_bringup", str(file), "--out", f"{folder}/run", "--quiet", *flags]
        subprocess.run(command, check=True)
        bag = open_bag(f"{folder}/run/bag")
        when = np.array([at for at, _ in bag.messages("/stage/truth")]) * 1e-9
        status = json.loads(Path(folder, "run", "run.json").read_text())["outcome"]["status"]["plant"]
    rate = (len(when) - 1) / (when[-1] - when[0])
    late = status.get("missed_ticks", 0) / len(when)
    return Measured(status["response_p50_us"], status["response_p99_us"], rate, late)


def measure_ring(
    hops: int, composed: bool, period: float, rounds: int, samples: int = BLOCK_SIZE, prefix: Sequence[str] = ()
) -> Measured:
    """A ring of as many empty nodes as the signal passes in a tick."""
    lock = take_domain(None)
    lock.release()
    with tempfile.TemporaryDirectory() as logs:
        environment = ros_environment(Path(logs), lock.domain)
        times = run_ring(hops, rounds, period, composed, environment, samples, prefix)
    rate = 1.0 / period if period else 1e6 / float(np.mean(times))
    late = float(np.mean(times > 1e6 * period)) if period else 0.0
    return Measured(float(np.median(times)), float(np.percentile(times, 99)), rate, late)


def stalls(seconds: float) -> tuple[float, float]:
    """How often in a second the machine lets a process that never waits stand still for 1 ms or more, and how long at
    most [s]: what comes too late because of that is nobody's fault here.
    """
    count, longest, begin = 0, 0.0, time.perf_counter()
    before = begin
    while before < begin + seconds:
        now = time.perf_counter()
        count += now - before > 1e-3
        longest = max(longest, now - before)
        before = now
    return count / seconds, longest


def measure(quick: bool, tell: Callable[[str], None]) -> list[Table]:
    """Both layouts without pacing, and in real time at several paces, each beside a bare ring in the same run."""
    return [_free_running(300 if quick else 1500, tell), *([] if quick else [_paced(tell)])]


def _free_running(rounds: int, tell: Callable[[str], None]) -> Table:
    rows = []
    for composed in (False, True):
        layout = f"{_layout(composed)}, free-running"
        tell(layout)
        ring, ring5 = (measure_ring(hops, composed, 0.0, rounds) for hops in (4, 5))
        rows.append(ring.row(f"bare ring of 4, {layout}", ring.median))
        rows.append(ring5.row(f"bare ring of 5, {layout}", ring.median))
        rows.append(measure_graph(composed, False).row(f"**the graph**, {layout}", ring.median))
    note = (
        "A tick of the graph is the time from the plant's `truth` to the `applied` that answers it: sensor, observer,"
        " controller and amplifier with all their physics, five hops with the plant's own, recorder and experiment"
        " running beside. A bare ring hands on the same bytes and does nothing else. Free-running ticks a second"
        " include the plant, and every phase of the scenario."
    )
    heads = ("layout", "median us", "99 % us", "ticks/s", "x real time", "x bare ring of 4")
    return Table(TICKS, heads, rows, note)


def _paced(tell: Callable[[str], None]) -> Table:
    rows = []
    for composed, samples, first in PACES:
        name = f"{_layout(composed)}, {SAMPLE_RATE / samples:.0f} Hz{', SCHED_RR' * first}"
        tell(name)
        prefix = REAL_TIME_PRIORITY if first else ()
        if first and subprocess.run([*prefix, "true"], capture_output=True, check=False).returncode:
            rows.append((name, *["-"] * 6, "no real-time priority allowed here"))
            continue
        often, longest = stalls(3.0)
        ring = measure_ring(5, composed, samples / SAMPLE_RATE, round(8 * SAMPLE_RATE / samples), samples, prefix)
        graph = measure_graph(composed, True, samples, first)
        times = (f"{value:.0f}" for each in (ring, graph) for value in (each.median, each.p99))
        rows.append((name, *times, f"{100 * ring.late:.2f} %", f"{100 * graph.late:.2f} %",
                     f"{often:.1f}/s, {1e3 * longest:.1f} ms"))  # fmt: skip
    heads = ("paced", "ring: median us", "99 % us", "graph: median us", "99 % us", "ring: late", "graph: late",
             "the machine stands still")  # fmt: skip
    note = (
        "In real time, beside a bare ring of five at the same pace. Late: the next block was due before the answer to"
        " the one before was there; after a stall the graph makes up for what was missed, and each of those blocks"
        " counts. The last column: how often in a second a process that only looks at the clock is stopped for 1 ms or"
        " more by the machine (a virtual one, shared), and for how long at most; just before that row, in 3 s."
    )
    return Table(PACED, heads, rows, note)


def _layout(composed: bool) -> str:
    return "composed" if composed else "separate processes"
