"""Writes docs/performance.md and the README's part about speed from docs/performance.json: `make bench` does both."""

from __future__ import annotations

from pathlib import Path

from pzt_benchmarks.report import Report, read_report, with_part
from pzt_benchmarks.table import PHYSICS, TICKS, Table, markdown_rows

FOLDER = Path(__file__).parent
MEASURED, PAGE, README = FOLDER / "performance.json", FOLDER / "performance.md", FOLDER.parent / "README.md"

BEGIN, END = "<!-- written by make bench -->\n\n", "<!-- until here -->\n"


def readme_part(report: Report) -> str:
    """What the README shows: the graph without pacing beside a bare ring, and the physics beside its targets."""
    ticks, physics = _table(report, TICKS), _table(report, PHYSICS)
    wanted = [ticks.heads.index(head) for head in ("layout", "median us", "99 % us", "ticks/s", "x real time")]
    shown = [row for row in ticks.rows if "ring of 4" not in row[0]]
    lines = [
        report.provenance.line(),
        "",
        *markdown_rows([ticks.heads[k] for k in wanted], [[row[k] for k in wanted] for row in shown]),
        "",
        *markdown_rows(physics.heads, physics.rows),
        "",
    ]
    return "\n".join(lines)


def _table(report: Report, title: str) -> Table:
    for table in report.tables:
        if table.title == title:
            return table
    raise SystemExit(f"error: {MEASURED} has no table '{title}'; measure all with `make bench`")


def main() -> None:
    """Write both."""
    report = read_report(MEASURED)
    PAGE.write_text(report.markdown(), encoding="utf-8")
    readme = README.read_text(encoding="utf-8")
    README.write_text(with_part(readme, BEGIN, END, readme_part(report)), encoding="utf-8")


if __name__ == "__main__":
    main()
