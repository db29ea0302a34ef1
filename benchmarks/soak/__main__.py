"""`python -m pzt_benchmarks.soak`: perform every fault again and again, and write docs/faults.md."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from pathlib import Path

from pzt_benchmarks.report import provenance
from pzt_benchmarks.soak.fault import Fault
from pzt_benchmarks.soak.page import page
from pzt_benchmarks.soak.series import Result, series
from pzt_benchmarks.soak.table import FAULTS
from pzt_ros.records import write_text


def parser() -> argparse.ArgumentParser:
    """The arguments."""
    made = argparse.ArgumentParser(prog="python -m pzt_benchmarks.soak", description=__doc__)
    made.add_argument("--repeat", type=int, metavar="N", help="perform each fault N times at most; a row's own number")
    made.add_argument("--only", nargs="+", default=[], metavar="WORD", help="only faults with one of these in the name")
    made.add_argument("--out", type=Path, default=Path("docs/faults.md"), help="the page")
    made.add_argument(
        "--results", type=Path, help="file of results; rows in it are not performed again, the page is of all in it"
    )
    return made


def main() -> int:
    """Entry point; 1 if anything was not as expected."""
    given = parser().parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    began = provenance(shlex.join(["python", "-m", "pzt_benchmarks.soak", *sys.argv[1:]]))
    known = _read(given.results)
    wanted = [
        fault
        for fault in FAULTS
        if fault.name not in known and (not given.only or any(word in fault.name for word in given.only))
    ]
    for result in series(wanted, lambda fault: _times(fault, given.repeat), _tell):
        result.commit = began.commit
        known[result.fault.name] = result
        print(f"\r{result.fault.name}: {result.performed} times, {len(result.problems)} problems", file=sys.stderr)
        _write(given.results, known)
    results = [known[fault.name] for fault in FAULTS if fault.name in known]
    write_text(given.out, [page(results, [fault.name for fault in FAULTS if fault.name not in known], began)])
    return int(any(result.problems for result in results))


def _times(fault: Fault, at_most: int | None) -> int:
    return fault.long if at_most is None else min(fault.long, at_most)


def _tell(line: str) -> None:
    if sys.stderr.isatty():
        print(f"\r{line}\033[K", end="", file=sys.stderr)


def _write(path: Path | None, known: dict[str, Result]) -> None:
    if path is not None:
        rows = {name: {**vars(result), "fault": name} for name, result in known.items()}
        path.write_text(json.dumps(rows, indent=1), encoding="utf-8")


def _read(path: Path | None) -> dict[str, Result]:
    if path is None or not path.exists():
        return {}
    rows, faults = json.loads(path.read_text(encoding="utf-8")), {fault.name: fault for fault in FAULTS}
    return {name: Result(**{**row, "fault": faults[name]}) for name, row in rows.items() if name in faults}


if __name__ == "__main__":
    sys.exit(main())
