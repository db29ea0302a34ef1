"""The safety state in words, with a sign and a colour each: whoever sees no colours, or little, reads the same."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SILENT_AFTER = 3.5
"""A node says how it is once a second; after this [s] it counts as gone."""


@dataclass(frozen=True)
class Shown:
    """What the banner shows.

    Attributes:
        look: style of the banner: off, on, moving, fault, unknown.
        sign: a shape that stands for the state.
        headline: the state in a word or two.
        reason: why, and what to do.
    """

    look: str
    sign: str
    headline: str
    reason: str


UNKNOWN = Shown("unknown", "?", "NO GRAPH", "nobody answers in this ROS domain and namespace; is the graph running?")

STARTING = Shown("off", "…", "STARTING", "the nodes find one another; a moment")

_STATES = {
    "disabled": Shown("off", "○", "DISABLED", "the stage ignores commands; Enable lets it follow them"),
    "enabled": Shown("on", "▶", "ENABLED", "the stage follows commands, inside its limits"),
    "ramping": Shown("moving", "▼", "RAMPING TO 0 V", "it was asked to; wait until it is there"),
    "fault": Shown("fault", "✖", "FAULT", "Reset once the cause is gone"),
}


def shown_state(health: Mapping[str, Mapping[str, Any]], age: float) -> Shown:
    """The banner for what the nodes last said of themselves; the amplifier said it `age` [s] ago."""
    amplifier = health.get("amplifier")
    if amplifier is None:
        return UNKNOWN
    values = amplifier["values"]
    state, reason = str(values.get("state", "")), str(values.get("reason", ""))
    if age > SILENT_AFTER:
        return Shown(
            "fault", "✖", "AMPLIFIER SILENT", f"nothing heard for {age:.0f} s, it was {state}; look at the stage"
        )
    known = _STATES.get(state, Shown("unknown", "?", state.upper() or "UNKNOWN", ""))
    if state == "disabled" and is_starting(health):
        return STARTING
    if not reason:
        return known
    if state == "ramping":
        return Shown("fault", "▼", "FAULT, RAMPING TO 0 V", reason)
    return Shown(known.look, known.sign, known.headline, f"{reason}. {known.reason}")


def in_the_way(health: Mapping[str, Mapping[str, Any]], ages: Mapping[str, float]) -> str:
    """Why the stage should not be enabled now, so that the beat does not stop at once; nothing if it may.

    `ages` are the times since each node said how it is [s].
    """
    if is_starting(health):
        return "the graph is still starting; enable it in a moment"
    for node, said in health.items():
        if ages[node] > SILENT_AFTER:
            return f"{node} has been silent for {ages[node]:.0f} s; start it again first"
        if said["values"].get("ready", "True") != "True":
            return f"{node} is not ready: {said['text']}"
    return ""


def is_starting(health: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether the conductor of the graph still waits for the other nodes: enabled now, the beat would not begin."""
    return bool(health.get("experiment", {}).get("values", {}).get("phase") == "starting")
