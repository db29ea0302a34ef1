"""How long things took: a histogram, so that a long run needs no more memory or time than a short one."""

from __future__ import annotations

import math

SHORTEST, LONGEST = 1e-7, 1e3
"""Durations outside count as these [s]; no duration at all counts as 0."""
PER_DECADE = 100
"""Bins of a factor of ten: a percentile is right to 1.2 %."""


class LatencyLog:
    """Counts durations [s] in bins of equal ratio; the longest one is kept as it was."""

    def __init__(self) -> None:
        self._bins = [0] * (1 + round(PER_DECADE * math.log10(LONGEST / SHORTEST)))
        self._count = 0
        self._longest = 0.0

    def add(self, duration: float) -> None:
        """Take in one duration [s]."""
        kept = min(max(duration, SHORTEST), LONGEST)
        self._bins[round(PER_DECADE * math.log10(kept / SHORTEST))] += 1
        self._count += 1
        self._longest = max(self._longest, duration)

    def percentile(self, percent: float) -> float:
        """This share [%] of all durations was no longer [s]."""
        wanted, seen = math.ceil(self._count * percent / 100.0), 0
        for place, count in enumerate(self._bins):
            seen += count
            if seen >= wanted:
                return SHORTEST * 10.0 ** (place / PER_DECADE) if place else 0.0
        return self._longest

    def summary(self, name: str) -> dict[str, object]:
        """Median, 99 %, 99.9 % and maximum [us], each under `name` with its suffix; empty if none was added."""
        if not self._count:
            return {}
        values = {"p50": 50.0, "p99": 99.0, "p999": 99.9}
        found = {suffix: min(self.percentile(percent), self._longest) for suffix, percent in values.items()}
        return {
            f"{name}_{suffix}_us": round(1e6 * value, 1) for suffix, value in {**found, "max": self._longest}.items()
        }
