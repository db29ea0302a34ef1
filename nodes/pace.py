"""Keeps a run's own time in step with the wall clock, and says how well that went."""

from __future__ import annotations

import time

from pzt_nodes.latency import LatencyLog


class Pace:
    """Blocks are given out when their time has come on the wall clock; one that is ready only later missed its tick."""

    def __init__(self) -> None:
        self.ticks = 0
        self.missed = 0
        self._began: float | None = None
        self._lateness = LatencyLog()

    def pause(self) -> None:
        """The run's own time stands still; the next block starts it again."""
        self._began = None

    def wait_for(self, due: float) -> None:
        """Wait until the run's own time `due` [s] has come."""
        now = time.monotonic()
        if self._began is None:
            self._began = now - due
        self.ticks += 1
        early = self._began + due - now
        if early > 0.0:
            time.sleep(early)
        elif early < 0.0:
            self.missed += 1
        self._lateness.add(max(0.0, time.monotonic() - self._began - due))

    def summary(self) -> dict[str, object]:
        """Counted ticks, missed ones, and percentiles of the lateness [us]."""
        return {"paced_ticks": self.ticks, "missed_ticks": self.missed, **self._lateness.summary("lateness")}
