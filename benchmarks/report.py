"""All tables of one run with the machine, the commit and the day; as Markdown, JSON, or in a terminal."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import Any

from pzt_benchmarks.table import Table
from pzt_ros.errors import BenchError
from pzt_ros.records import write_text

SUFFIXES = (".md", ".json")

MEASURED_CODE = ("pzt_ros", "nodes", "msgs_config", "bringup", "benchmarks", "pyproject.toml")
"""What a measurement depends on; the pages that it writes are not among it."""


@dataclass(frozen=True)
class Provenance:
    """Where, of what and when something was measured, and how to do it again."""

    command: str
    machine: str
    versions: str
    commit: str
    day: str
    load: str = ""

    def line(self) -> str:
        """One paragraph for a page."""
        found = f"`{self.command}`, {self.day}, commit {self.commit}. Machine: {self.machine}. {self.versions}."
        return f"{found} Load before: {self.load}." if self.load else found


def provenance(command: str) -> Provenance:
    """Of what is measured from now on; the load is what others asked of the machine in the minute before."""
    packages = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in ("numpy", "scipy", "numba"))
    return Provenance(
        command=command,
        machine=f"{_processor()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}",
        versions=f"Python {platform.python_version()}, {packages}",
        commit=_commit(),
        day=date.today().isoformat(),
        load=f"{os.getloadavg()[0]:.1f}",
    )


def _processor() -> str:
    """The processor's name; on virtual machines it may say little."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown processor"
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _commit() -> str:
    """The commit of the working copy, and whether the code is still that; an installed package knows its version."""
    folder = Path(__file__).parent
    commit = _git(folder.parent, "rev-parse", "--short", "HEAD") if folder.name == "benchmarks" else ""
    if not commit:
        return f"of pzt_ros {importlib.metadata.version('pzt_ros')}"
    changed = _git(folder.parent, "status", "--porcelain", "--", *MEASURED_CODE)
    return f"{commit}, with later changes" if changed else commit


def _git(folder: Path, *words: str) -> str:
    """What git says, or nothing."""
    try:
        found = subprocess.run(["git", *words], capture_output=True, text=True, check=False, cwd=folder)
    except OSError:
        return ""
    return found.stdout.strip() if found.returncode == 0 else ""


@dataclass(frozen=True)
class Report:
    """One run of the benchmarks."""

    provenance: Provenance
    tables: Sequence[Table]

    def markdown(self) -> str:
        """The page."""
        head = f"# Performance\n\n{self.provenance.line()}\n\nRatios in one run count, times mean little.\n"
        return "\n".join([head, *(table.markdown() for table in self.tables)])

    def as_json(self) -> str:
        """The same for programs."""
        data = {**asdict(self.provenance), "tables": [table.as_data() for table in self.tables]}
        return json.dumps(data, indent=1, ensure_ascii=False) + "\n"

    def write(self, out: Path) -> None:
        """Write it as the file's name asks.

        Raises:
            BenchError: neither .md nor .json, or it cannot be written.
        """
        check_out(out)
        write_text(out, [self.as_json() if out.suffix == ".json" else self.markdown()])


def check_out(out: Path) -> None:
    """Find out before hours are spent that a file cannot be written.

    Raises:
        BenchError: neither .md nor .json, or a folder.
    """
    if out.suffix not in SUFFIXES:
        raise BenchError(f"--out {out}: a report is {' or '.join(SUFFIXES)}; choose one of them")
    if out.is_dir():
        raise BenchError(f"--out {out}: is a directory; name a file in it")


def read_report(path: Path) -> Report:
    """A report that was written as JSON."""
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    tables = [Table(**table) for table in data.pop("tables")]
    return Report(Provenance(**data), tables)


def with_part(page: str, begin: str, end: str, part: str) -> str:
    """The page with what stands between a mark and the next other one replaced."""
    before, _, rest = page.partition(begin)
    _, _, after = rest.partition(end)
    return before + begin + part + end + after


def show(table: Table) -> None:
    """A table in the terminal, or as Markdown where the output is none."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table as RichTable

    console = Console()
    if not console.is_terminal:
        print(table.markdown())
        return
    shown = RichTable(title=table.title, title_justify="left", caption=table.note, caption_justify="left")
    for k, head in enumerate(table.heads):
        shown.add_column(head, justify="left" if k == 0 else "right")
    for row in table.rows:
        shown.add_row(*(escape(cell.replace("**", "")) for cell in row))
    console.print(shown)
    console.print()
