"""Measured runs: fit the first half, predict the second. Prints one table; skips where ../shared/data is absent.

Run: python benchmarks/measured_runs.py
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from pzt_ros.bags import load_run
from pzt_ros.chains import load_chain
from pzt_ros.sysid.fit import Fit
from pzt_ros.sysid.predict import predict
from pzt_ros.sysid.run import Span

DATA = Path(__file__).parents[2] / "shared" / "data"


@dataclass(frozen=True)
class Case:
    """One split of one record: `train` is counted by the fit, everything after `held_out` by the prediction [s]."""

    file: str
    chain: str
    train: Span
    held_out: float
    remark: str


CASES = (
    Case(
        "picma-p885-micromanipulator/sine_1Hz_full_scale.csv",
        "picma-p885",
        Span(1.0, 9.9975),
        9.9975,
        "first cycle (start-up branch) not counted",
    ),
    Case(
        "afm-x-stage-strain-gauge/triangle6_sine10_0_150V.csv",
        "afm-x-axis",
        Span(None, 2893.8),
        2893.8,
        "nothing left out; fitted on triangles, predicted on sines",
    ),
)


def main() -> int:
    """Fit and predict every case."""
    if not DATA.is_dir():
        print(f"skipped: no measured runs in {DATA}")
        return 0
    table = Table(title="held-out error of measured runs", title_justify="left")
    for name in (
        "run",
        "fit [s]",
        "train rms [nm]",
        "held-out rms [nm]",
        "% of span",
        "x noise",
        "without its mean [nm]",
    ):
        table.add_column(name.replace("[", r"\["), justify="left" if name == "run" else "right")
    table.add_column("remark")
    for case in CASES:
        record = load_run(DATA / case.file)
        began = time.perf_counter()
        result = Fit(load_chain(case.chain), case.train).fit([record])
        seconds = time.perf_counter() - began
        found = predict(result.model(), record, Span(case.held_out, None))
        table.add_row(
            Path(case.file).name,
            f"{seconds:.0f}",
            f"{result.runs[0].rms * 1e9:.1f}",
            f"{found.rms * 1e9:.1f}",
            f"{100 * found.rms / found.span:.3f}",
            f"{found.rms / found.noise:.2f}",
            f"{found.error.std() * 1e9:.1f}",
            case.remark,
        )
    Console(width=160).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
