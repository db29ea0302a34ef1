"""From the blocks of the graph to the rows that a person sees: a mean of each, no more than a screen shows."""

from __future__ import annotations

import math
from collections import Counter

from pzt_ros.blocks import Block

COLUMNS = (
    "time_s",
    "displacement_m",
    "reference_m",
    "error_m",
    "voltage_V",
    "estimate_m",
    "polarization_C_per_m2",
    "phase_fraction",
    "innovation_m",
    "disturbance_m",
)
"""Of a row; what was not said for a block is None."""

SOURCES: dict[str, dict[str, str]] = {
    "estimate": {
        "estimate_m": "displacement_m",
        "polarization_C_per_m2": "polarization_C_per_m2",
        "phase_fraction": "phase_fraction",
        "innovation_m": "innovation_m",
        "disturbance_m": "disturbance_m",
    },
    "applied": {"voltage_V": "voltage_V"},
    "measurement": {"displacement_m": "displacement_m"},
    "reference": {"reference_m": "displacement_m"},
}
"""The topics that are listened to, the last to be said for a block first: column of a row -> column of the block."""

NEEDED = ("estimate", "applied", "measurement")
"""A block is shown when these have said theirs; a reference is not there while the voltage is commanded."""

Row = list[float | None]

PATIENCE = 40
"""A block that lacks something is given up when this many later ones have begun."""


class Frames:
    """Joins the blocks of a tick by their mean time, and hands out rows of means, thinned to a rate.

    A tick whose time is not after the last one means that another run has begun; then everything starts anew.
    """

    def __init__(self, rate: float = 200.0) -> None:
        """Rows are at least 1 / `rate` apart [Hz of the run's own time]."""
        self._apart = 1.0 / rate - 1e-9
        self._waiting: dict[int, dict[str, float]] = {}
        self._last = -math.inf
        self.counts: Counter[str] = Counter()

    def add(self, topic: str, block: Block) -> None:
        """Take in a block of one of the `SOURCES`."""
        means = block.values.mean(axis=0)
        if not math.isfinite(means[0]):
            self.counts["not finite"] += 1
            return
        row = self._waiting.setdefault(round(means[0] * 1e6), {"time_s": float(means[0])})
        row[topic] = 1.0
        row.update({column: float(means[block.columns.index(name)]) for column, name in SOURCES[topic].items()})

    def take(self) -> list[Row]:
        """The rows that are complete, in the order of time; what waits in vain is given up and counted."""
        complete = sorted(key for key, row in self._waiting.items() if all(topic in row for topic in NEEDED))
        if complete and self._waiting[complete[0]]["time_s"] <= self._last:
            self._waiting = {key: self._waiting[key] for key in complete}
            self._last = -math.inf
        rows = []
        for row in map(self._waiting.pop, complete):
            if row["time_s"] - self._last >= self._apart:
                self._last = row["time_s"]
                rows.append(_as_row(row))
        overdue = sorted(self._waiting)[:-PATIENCE]
        for key in overdue:
            del self._waiting[key]
        self.counts["incomplete"] += len(overdue)
        return rows


def _as_row(values: dict[str, float]) -> Row:
    if "reference_m" in values:
        values["error_m"] = values["reference_m"] - values["displacement_m"]
    time, *others = (values.get(column, math.nan) for column in COLUMNS)
    return [round(time, 4), *(_shown(value) for value in others)]


def _shown(value: float) -> float | None:
    """Six digits are more than a screen can show; JSON has no NaN."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def as_record(row: Row) -> dict[str, float | None]:
    """A row by the names of its columns."""
    return dict(zip(COLUMNS, row, strict=True))
