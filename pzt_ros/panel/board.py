"""All that the page shows, as it was last said; filled by a feed (a ROS node or a bag), read by every open page."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pzt_ros.panel.frames import Row, as_record
from pzt_ros.panel.motion import Envelope
from pzt_ros.panel.safety import UNKNOWN, Shown, shown_state

LINES = 3
"""Of what came of requests."""

WINDOW = 10.0
"""That much is kept for a page that is opened now [s]."""


@dataclass
class Board:
    """What is known.

    Attributes:
        rows: of the last seconds (`frames.COLUMNS`).
        health: what each node of the axis last said: level, text, values.
        about: of the axis: namespace, geometry, envelope, names of controllers, whether it is simulated.
        said: what came of the latest requests, the newest first: whether granted, and in words.
        unheard: what the banner says while no amplifier has been heard.
        ended: what the banner says since there is nothing more to come, such as how the graph ended.
    """

    rows: deque[Row] = field(default_factory=deque)
    health: dict[str, dict[str, Any]] = field(default_factory=dict)
    about: dict[str, Any] = field(default_factory=dict)
    said: deque[tuple[bool, str]] = field(default_factory=lambda: deque(maxlen=LINES))
    unheard: Shown = UNKNOWN
    ended: Shown | None = None
    listeners: list[Callable[[list[Row]], None]] = field(default_factory=list)
    _heard: dict[str, float] = field(default_factory=dict)

    def take(self, message: Mapping[str, Any]) -> None:
        """Take in a message of a feed: any of `rows`, `health`, `about`."""
        if "rows" in message:
            self._add(message["rows"])
        if "health" in message:
            for said in message["health"]:
                self.health[said["node"]] = said
                self._heard[said["node"]] = time.monotonic()
        if "about" in message:
            self.about.update(message["about"])

    def end(self, look: str, headline: str, reason: str) -> None:
        """Nothing more will come; `look` as of `safety.Shown`."""
        self.ended = Shown(look, "■", headline, reason)

    def _add(self, rows: list[Row]) -> None:
        if not rows:
            return
        if self.rows and rows[0][0] <= self.rows[-1][0]:  # type: ignore[operator]
            self.rows.clear()  # another run has begun
        self.rows.extend(rows)
        while self.rows[-1][0] - self.rows[0][0] > WINDOW:  # type: ignore[operator]
            self.rows.popleft()
        for listener in self.listeners:
            listener(rows)

    def age(self, node: str) -> float:
        """Time since a node said how it is [s]; infinite if it never did."""
        return time.monotonic() - self._heard.get(node, -math.inf)

    @property
    def safety(self) -> Shown:
        """The banner."""
        if self.ended is not None:
            return self.ended
        if "amplifier" not in self.health:
            return self.unheard
        return shown_state(self.health, {node: self.age(node) for node in self.health})

    @property
    def envelope(self) -> Envelope | None:
        """Where the stage may be sent; None while nobody has said."""
        found = self.about.get("envelope")
        return Envelope(**found) if found else None

    @property
    def may_plan(self) -> bool:
        """Whether the axis has said where it may go, or why that is not known; until then nobody can be told more."""
        return "envelope" in self.about or "problem" in self.about

    @property
    def here(self) -> float | None:
        """Where the stage is asked to be, or where it is if nothing is asked [m]."""
        if not self.rows:
            return None
        last = as_record(self.rows[-1])
        return last["displacement_m"] if last["reference_m"] is None else last["reference_m"]

    @property
    def controller(self) -> str:
        """In charge; empty while unknown."""
        return str(self.health.get("controller", {}).get("values", {}).get("controller", ""))

    @property
    def simulated(self) -> bool:
        """Whether a simulated plant is in the graph, or was when the bag was recorded."""
        return "plant" in self.health or bool(self.about.get("simulated"))
