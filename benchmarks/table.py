"""What a benchmark gives back: tables of text, and figures beside the target they have to meet."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

MET, NOT_MET = "met", "**not met**"

TICKS, PACED = "One closed-loop tick (100 samples at 20 kHz)", "Ticks in real time"
PHYSICS = "The physics against its targets"
"""Titles of the tables that the README takes its rows from."""


@dataclass(frozen=True)
class Table:
    """One table of figures: a title, column heads, rows of text, and what one has to know to read them."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def markdown(self) -> str:
        """The table as Markdown."""
        lines = [f"### {self.title}", "", *markdown_rows(self.heads, self.rows), ""]
        return "\n".join([*lines, self.note, ""] if self.note else lines)

    def as_data(self) -> dict[str, Any]:
        """The table for a JSON file."""
        return {"title": self.title, "heads": list(self.heads), "rows": [list(r) for r in self.rows], "note": self.note}


def markdown_rows(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return ["| " + " | ".join(cells) + " |" for cells in lines]


@dataclass(frozen=True)
class Target:
    """A limit that a figure has to keep, and an aim beyond it that would be nice; either may be None."""

    limit: float | None
    at_least: bool = False
    aim: float | None = None

    def keeps(self, value: float, limit: float) -> bool:
        """Whether a value is on the right side of a limit."""
        return value >= limit if self.at_least else value <= limit

    def asked(self, unit: str) -> str:
        """What is asked, in words."""
        sign = "≥" if self.at_least else "≤"
        limit = "" if self.limit is None else f"{sign} {number(self.limit)} {unit}"
        aim = "" if self.aim is None else f"aim {sign} {number(self.aim)}"
        return f"{limit} ({aim})" if limit and aim else limit or f"{aim} {unit}"

    def verdict(self, value: float) -> str:
        """Whether the limit is kept, and the aim reached."""
        limit = None if self.limit is None else (MET if self.keeps(value, self.limit) else NOT_MET)
        if self.aim is None or limit == NOT_MET:
            return limit or ""
        aim = "aim reached" if self.keeps(value, self.aim) else "aim not reached"
        return f"{limit}, {aim}" if limit else aim


@dataclass(frozen=True)
class Figure:
    """One measured number with its unit, and its target if it has one."""

    what: str
    value: float
    unit: str
    target: Target | None = None

    def row(self) -> tuple[str, str, str, str]:
        """What, measured, target, verdict."""
        measured = f"{number(self.value)} {self.unit}"
        if self.target is None:
            return self.what, measured, "", ""
        return self.what, measured, self.target.asked(self.unit), self.target.verdict(self.value)


def figures_table(title: str, figures: Sequence[Figure], note: str) -> Table:
    """Figures beside their targets."""
    return Table(title, ("what", "measured", "target", "verdict"), [figure.row() for figure in figures], note)


def number(value: float) -> str:
    """A measured value with three digits, never in powers of ten where people would write it out."""
    if 100 <= abs(value) < 1e7:
        return f"{value:,.0f}"
    return f"{value:.3g}"
