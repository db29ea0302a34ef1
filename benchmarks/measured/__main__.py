"""`python -m pzt_benchmarks.measured`: write docs/measured.md and its pictures, where the measured runs are at hand."""

from __future__ import annotations

import argparse
from pathlib import Path

from pzt_benchmarks.measured import ceramic, plots, ring
from pzt_benchmarks.measured.judged import judge
from pzt_benchmarks.measured.page import page
from pzt_benchmarks.measured.sets import ONSET, PICMA, SETS, Cut
from pzt_benchmarks.measured.ties import compared
from pzt_benchmarks.measured_runs import DATA
from pzt_benchmarks.report import provenance
from pzt_ros.diagnosis.data import split
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.records import write_text


def main() -> None:
    """Judge every set; write the page and the pictures into a folder."""
    from rich.console import Console

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder for the page and its measured/")
    out: Path = parser.parse_args().out
    if not DATA.is_dir():
        print(f"skipped: no measured runs in {DATA}; PZT_MEASURED_RUNS may name their folder")
        return
    origin = provenance("make measured")
    folder = out / "measured"
    folder.mkdir(parents=True, exist_ok=True)
    with Console(stderr=True).status("measured runs") as status:
        judged = [judge(which, DATA, status.update) for which in SETS]
        picma = split(with_floors([PICMA.train[0].record(DATA)]), with_floors([PICMA.test.record(DATA)]))
        ties = compared(*picma, status.update)
        parts = ceramic.study(DATA, status.update)
    whole = Cut(ONSET.test.file, 0.0, 10.0).record(DATA)
    for each in judged:
        if each.which == ONSET:
            plots.draw_onset(each, whole, folder)
        else:
            plots.draw(each, folder)
    plots.draw_parts(parts, folder)
    write_text(out / "measured.md", [page(origin, judged, ties, parts, ring.frequencies(whole)[:2])])


if __name__ == "__main__":
    main()
