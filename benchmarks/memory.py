"""Peak memory of a run of ten minutes at 20 kHz, streamed as `pzt simulate` does it; its rows go to /dev/null."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from pzt_benchmarks.child import measured_in_child
from pzt_benchmarks.table import Figure, Table, Target

MINUTES, QUICK_MINUTES = 10.0, 0.1
BLOCK = 100_000
SINE = (55.0, 95.0, 1.0)
"""Mean [V], amplitude [V] and frequency [Hz] of the drive."""

MODELS = {"p802": "p802: lattice and all instruments", "front": "front model and electrostriction"}
HEADS = ("chain", "simulated", "samples", "peak MB", "s", "x real time")


def simulate_minutes(model: str, minutes: float) -> dict[str, float]:
    """Simulate in this process; peak of its resident memory [bytes], and the processor time [s]."""
    import numpy as np

    from pzt_benchmarks.drives import SAMPLE_RATE
    from pzt_benchmarks.links import chain_of
    from pzt_ros.sysid.simulate import ACCURACY, simulate_csv, with_accuracy

    chain = with_accuracy(chain_of(model), ACCURACY)
    samples, (mean, amplitude, frequency) = round(60.0 * minutes * SAMPLE_RATE), SINE

    def drive() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for low in range(0, samples, BLOCK):
            at = np.arange(low, min(low + BLOCK, samples)) / SAMPLE_RATE
            yield at, mean - amplitude * np.cos(2 * np.pi * frequency * at)

    began = time.process_time()
    simulate_csv(chain, drive(), Path("/dev/null"))
    # not getrusage: its peak starts at that of the process that started us
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    peak = next(line for line in status.splitlines() if line.startswith("VmHWM:"))
    return {"peak": 1024.0 * int(peak.split()[1]), "seconds": time.process_time() - began, "samples": samples}


def measure(quick: bool, tell: Callable[[str], None]) -> tuple[list[Figure], Table]:
    """The largest peak, and a table of both chains."""
    minutes, rows, largest = QUICK_MINUTES if quick else MINUTES, [], 0.0
    for model, name in MODELS.items():
        tell(f"memory of {minutes:g} minutes of {name}")
        found = measured_in_child("pzt_benchmarks.memory", model, str(minutes))
        pace, peak = 60.0 * minutes / found["seconds"], found["peak"] / 1e6
        rows.append(
            (name, f"{minutes:g} min", f"{found['samples']:,}", f"{peak:.0f}", f"{found['seconds']:.0f}", f"{pace:.1f}")
        )
        largest = max(largest, peak)
    figures = [Figure(f"peak memory, {minutes:g} min at 20 kHz", largest, "MB", Target(1000))]
    note = "Peak of resident memory, Python and its packages included. Much of the time goes into the rows of text."
    return figures, Table("Memory of a long run", HEADS, rows, note)


if __name__ == "__main__":
    print(json.dumps(simulate_minutes(sys.argv[1], float(sys.argv[2]))))
