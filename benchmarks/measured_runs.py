"""Measured runs: fit the first half, predict the second; skips where ../shared/data is absent."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pzt_benchmarks.table import Table
from pzt_ros.bags import load_run
from pzt_ros.chains import load_chain
from pzt_ros.sysid.fit import Fit
from pzt_ros.sysid.predict import predict
from pzt_ros.sysid.run import Span

DATA = Path(os.environ.get("PZT_MEASURED_RUNS") or Path(__file__).parents[2] / "shared" / "data")


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


def measure(quick: bool, tell: Callable[[str], None]) -> list[Table]:
    """Fit and predict every case, or the first; no rows where the data is not there."""
    rows = []
    for case in CASES[:1] if quick else CASES:
        tell(case.file)
        if DATA.is_dir():
            rows.append(_row(case))
    heads = ("run", "fit s", "fitted nm", "held out nm", "% of span", "x noise floor", "without its mean nm", "remark")
    note = "The fit did not see the second part; but about six variants of each were tried and their errors seen."
    if not rows:
        note = f"Skipped: no measured runs in {DATA}; PZT_MEASURED_RUNS may name their folder."
    return [Table("Measured runs: fitted on the first part, error on the second", heads, rows, note)]


def _row(case: Case) -> tuple[str, ...]:
    record = load_run(DATA / case.file)
    began = time.perf_counter()
    result = Fit(load_chain(case.chain), case.train).fit([record])
    seconds = time.perf_counter() - began
    found = predict(result.model(), record, Span(case.held_out, None))
    return (
        Path(case.file).name,
        f"{seconds:.0f}",
        f"{result.runs[0].rms * 1e9:.1f}",
        f"{found.rms * 1e9:.1f}",
        f"{100 * found.rms / found.span:.3f}",
        f"{found.rms / found.noise:.2f}",
        f"{found.error.std() * 1e9:.1f}",
        case.remark,
    )
