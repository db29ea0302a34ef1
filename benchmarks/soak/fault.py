"""A fault as data: how it is made, what has to happen, how soon; and a function that makes it once."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

SAFE = "ramps to 0 V, fault latched and named"
REFUSED = "refused and counted, the run goes on"
LIMITED = "limited and counted, the run goes on"
GOES_ON = "the run goes on"
WITHIN_LIMITS = "nothing outside window and slew rate, then to 0 V when asked"
FOUND = "starts at the voltage found; outside the window it is discharged first"
ONE_LINE = "exit code 2 and one line that names it, before anything moves"
RELAY = "the stack's own relay discharges it; exit code 1, the process is named, nothing is left"
ENDED = "the amplifier ramps to 0 V; exit code 1, the process is named, nothing is left"
ALONE = "the nodes end by themselves, the amplifier at 0 V; the bag is complete, nothing is left"
NOT_CLAIMED = "exit code 1; it is said that nobody knows the voltage of the stack; the bag is readable"
AGAIN = "exit code 1, nothing is left; the next bringup in the same domain runs to its end"
CLEAN = "0 V, exit code 0, no traceback, nothing is left"
NO_MORE_BAG = "said in the log and in /diagnostics; the run goes on, the bag is readable up to there"
READABLE = "the bag is readable, by ours and by the stock reader, up to shortly before"
NAMED = "named, and read up to the damage, or refused; never altered silently"


@dataclass(frozen=True)
class Seen:
    """What one fault led to, in the words above or in its own, and after how long [s]."""

    reaction: str
    seconds: float


Bench = Callable[[Path], AbstractContextManager[Any]]
"""Makes, in a folder of its own, what a fault is performed on; it may serve for many faults in turn."""


@dataclass(frozen=True)
class Fault:
    """One row of the fault table.

    Attributes:
        name: of the fault.
        made: how it is made.
        expected: the reaction, one of the words above.
        limit: of the reaction time [s].
        timed: what the reaction time is, from the fault on.
        bench: what it is performed on.
        perform: makes the fault once.
        long: how often the long series makes it.
    """

    name: str
    made: str
    expected: str
    limit: float
    timed: str
    bench: Bench
    perform: Callable[[Any, np.random.Generator], Seen]
    long: int = 20

    def problem(self, seen: Seen) -> str:
        """What is wrong with what was seen, or nothing."""
        if seen.reaction != self.expected:
            return f"expected: {self.expected}; seen: {seen.reaction}"
        if not seen.seconds <= self.limit:
            return f"took {seen.seconds:.3f} s, limit {self.limit:g} s"
        return ""


class NotHereError(Exception):
    """This machine lacks what is needed to make the fault; says what."""
