"""One closed-loop tick of the whole graph: free-running and paced, separate and composed, beside a bare ring."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pzt_benchmarks.bare_loop import run_ring
from pzt_benchmarks.table import TICKS, Table
from pzt_bringup.domain import take_domain
from pzt_ros.bags.reader import open_bag

BLOCK_PERIOD = 5e-3
"""100 samples at 20 kHz [s]."""


@dataclass(frozen=True)
class Measured:
    """Duration of ticks [us], how many there were in a second, and how many came too late for their block."""

    median: float
    p99: float
    per_second: float
    late: str = "-"

    def row(self, name: str, floor: float) -> tuple[str, ...]:
        """One row of the table."""
        pace = f"{self.per_second * BLOCK_PERIOD:.1f}"
        return (
            name,
            f"{self.median:.0f}",
            f"{self.p99:.0f}",
            f"{self.per_second:.0f}",
            pace,
            self.late,
            f"{self.median / floor:.2f}",
        )


def measure_graph(composed: bool, paced: bool) -> Measured:
    """Run the scenario `scan` and time the ticks from the bag."""
    with tempfile.TemporaryDirectory() as folder:
        flags = ["--composed"] * composed + ["--real-time"] * paced
        command = [sys.executable, "-m", "pzt_bringup", "scan", "--out", f"{folder}/run", "--quiet", *flags]
        subprocess.run(command, check=True)
        bag = open_bag(f"{folder}/run/bag")
        when = np.array([at for at, _ in bag.messages("/stage/truth")]) * 1e-9
        status = json.loads(Path(folder, "run", "run.json").read_text())["outcome"]["status"]["plant"]
    rate = (len(when) - 1) / (when[-1] - when[0])
    late = f"{100 * status.get('missed_ticks', 0) / len(when):.2f} %" if paced else "-"
    return Measured(status["response_p50_us"], status["response_p99_us"], rate, late)


def measure_ring(hops: int, composed: bool, paced: bool, rounds: int) -> Measured:
    """A ring of as many empty nodes as the signal passes in a tick."""
    lock = take_domain(None)
    lock.release()
    environment = {**os.environ, "ROS_DOMAIN_ID": str(lock.domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    times = run_ring(hops, rounds, BLOCK_PERIOD if paced else 0.0, composed, environment)
    rate = 1.0 / BLOCK_PERIOD if paced else 1e6 / float(np.mean(times))
    return Measured(float(np.median(times)), float(np.percentile(times, 99)), rate)


def measure(quick: bool, tell: Callable[[str], None]) -> list[Table]:
    """All layouts, or the free-running ones, each beside a bare ring of four and of five hops in the same run."""
    rows, rounds = [], 300 if quick else 1500
    for composed in (False, True):
        for paced in (False,) if quick else (False, True):
            layout = f"{'composed' if composed else 'separate processes'}, {'real time' if paced else 'free-running'}"
            tell(layout)
            ring, ring5 = (measure_ring(hops, composed, paced, rounds) for hops in (4, 5))
            graph = measure_graph(composed, paced)
            rows.append(ring.row(f"bare ring of 4, {layout}", ring.median))
            rows.append(ring5.row(f"bare ring of 5, {layout}", ring.median))
            rows.append(graph.row(f"**the graph**, {layout}", ring.median))
    note = (
        "A tick of the graph is the time from the plant's `truth` to the `applied` that answers it: sensor, observer,"
        " controller and amplifier with all their physics, five hops with the plant's own, recorder and experiment"
        " running beside. A bare ring hands on the same bytes and does nothing else. Free-running ticks a second"
        " include the plant, and every phase of the scenario."
    )
    heads = ("layout", "median us", "99 % us", "ticks/s", "x real time", "late", "x bare ring of 4")
    return [Table(TICKS, heads, rows, note)]
