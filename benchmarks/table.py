"""What a benchmark gives back, and how it is shown."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date


@dataclass(frozen=True)
class Table:
    """One table of figures: a title, column heads, rows of text, and what one has to know to read them."""

    title: str
    heads: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def markdown(self) -> str:
        """The table as Markdown."""
        lines = [f"### {self.title}", "", "| " + " | ".join(self.heads) + " |", "|" + " --- |" * len(self.heads)]
        lines += ["| " + " | ".join(row) + " |" for row in self.rows]
        return "\n".join([*lines, "", self.note, ""] if self.note else [*lines, ""])


def provenance() -> str:
    """Machine, commit and day of a measurement, in one line."""
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False)
    machine, python = platform.machine(), platform.python_version()
    return f"{os.cpu_count()} cores {machine}, Python {python}, commit {commit.stdout.strip()}, {date.today()}"
