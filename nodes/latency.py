"""How long things took: the last hundred thousand of them, and their percentiles."""

from __future__ import annotations

import numpy as np

CAPACITY = 100_000


class LatencyLog:
    """Durations [s], kept in a ring so that a long run needs no more memory than a short one."""

    def __init__(self) -> None:
        self._ring = np.empty(CAPACITY)
        self._count = 0

    def add(self, duration: float) -> None:
        """Take in one duration [s]."""
        self._ring[self._count % CAPACITY] = duration
        self._count += 1

    def summary(self, name: str) -> dict[str, object]:
        """Median, 99 %, 99.9 % and maximum [us], each under `name` with its suffix; empty if none was added."""
        known = self._ring[: min(self._count, CAPACITY)]
        if not known.size:
            return {}
        values = (*np.percentile(known, (50.0, 99.0, 99.9)), known.max())
        suffixes = ("p50", "p99", "p999", "max")
        return {f"{name}_{suffix}_us": round(1e6 * value, 1) for suffix, value in zip(suffixes, values, strict=True)}
