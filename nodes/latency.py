"""How long things took: a histogram, so that a long run needs no more memory or time than a short one."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from itertools import accumulate

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
        return self._percentiles((percent,))[0]

    def summary(self, name: str) -> dict[str, object]:
        """Median, 99 %, 99.9 % and maximum [us], each under `name` with its suffix; empty if none was added."""
        if not self._count:
            return {}
        found = (*self._percentiles((50.0, 99.0, 99.9)), self._longest)
        suffixes = ("p50", "p99", "p999", "max")
        return {
            f"{name}_{suffix}_us": round(1e6 * min(value, self._longest), 1)
            for suffix, value in zip(suffixes, found, strict=True)
        }

    def _percentiles(self, percents: Sequence[float]) -> list[float]:
        """In one pass over the bins: nodes report each second, between two ticks of a loop."""
        counts = list(accumulate(self._bins))
        places = [bisect_left(counts, math.ceil(self._count * percent / 100.0)) for percent in percents]
        return [SHORTEST * 10.0 ** (place / PER_DECADE) if place else 0.0 for place in places]
