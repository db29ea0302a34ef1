"""How long a diagnosis goes on beginning something new: a report in time beats a better one that nobody waited for."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

SECONDS = 300.0


@dataclass
class TimeLimit:
    """Time after which what is being done is ended, and nothing new begun.

    Attributes:
        seconds: from its making on [s].
        has_cut: whether something was left out for it.
    """

    seconds: float = math.inf
    has_cut: bool = False
    _begun: float = field(default_factory=time.monotonic)

    @property
    def spent(self) -> float:
        """Time since it was made [s]."""
        return time.monotonic() - self._begun

    def is_over(self, needed: float = 0.0) -> bool:
        """Asked before something new begins, which must not begin then; nor where it needs longer than is left [s]."""
        self.has_cut = self.has_cut or self.spent + needed >= self.seconds
        return self.has_cut
