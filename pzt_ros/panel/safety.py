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

BEGINNING = Shown("off", "…", "STARTING", "the graph is on its way; a machine's first run compiles for half a minute")

_STATES = {
    "disabled": Shown("off", "○", "DISABLED", "the stage ignores commands; Enable lets it follow them"),
    "enabled": Shown("on", "▶", "ENABLED", "the stage follows commands, inside its limits"),
    "ramping": Shown("moving", "▼", "RAMPING TO 0 V", "it was asked to; wait until it is there"),
    "fault": Shown("fault", "✖", "FAULT", "Reset once the cause is gone"),
}


def shown_state(health: Mapping[str, Mapping[str, Any]], ages: Mapping[str, float]) -> Shown:
    """The banner for what the nodes, with the amplifier, last said of themselves, and the times since then [s]."""
    values, age = health["amplifier"]["values"], ages["amplifier"]
    state, reason = str(values.get("state", "")), str(values.get("reason", ""))
    if age > SILENT_AFTER:
        if min(ages.values()) > SILENT_AFTER and "panel" in ages:  # which hears itself, if it has time to
            return Shown(
                "unknown", "?", "PANEL BEHIND",
                f"its own node says nothing either: this machine is too busy, or it hangs. {age:.0f} s ago the"
                f" amplifier was {state}; what is shown is old, look at the stage",
            )  # fmt: skip
        return Shown(
            "fault", "✖", "AMPLIFIER SILENT", f"nothing heard for {age:.0f} s, it was {state}; look at the stage"
        )
    known = _STATES.get(state, Shown("unknown", "?", state.upper() or "UNKNOWN", ""))
    if state == "disabled":
        return _shown_disabled(health, ages, reason)
    if not reason:
        return known
    if state == "ramping":
        return Shown("fault", "▼", "FAULT, RAMPING TO 0 V", reason)
    return Shown(known.look, known.sign, known.headline, f"{reason}. {known.reason}")


def _shown_disabled(health: Mapping[str, Mapping[str, Any]], ages: Mapping[str, float], reason: str) -> Shown:
    """Whoever reads that Enable will do must not be refused when pressing it."""
    if why := waits_for(health):
        return Shown("off", "…", "STARTING", f"a moment: {why}")
    known = _STATES["disabled"]
    says = [part for part in (reason, in_the_way(health, ages) or known.reason) if part]
    return Shown(known.look, known.sign, known.headline, ". ".join(says))


def in_the_way(health: Mapping[str, Mapping[str, Any]], ages: Mapping[str, float]) -> str:
    """Why the stage should not be enabled now, so that the beat does not stop at once; nothing if it may.

    `ages` are the times since each node said how it is [s].
    """
    silent = next((node for node in _members(health) if node in health and ages[node] > SILENT_AFTER), None)
    if silent is not None:
        return f"{silent} has been silent for {ages[silent]:.0f} s; start it again first"
    if why := waits_for(health):
        return f"not yet: {why}"
    return ""


def waits_for(health: Mapping[str, Mapping[str, Any]]) -> str:
    """What a graph that starts still lacks: enabled now, its beat would not begin. Nothing if it has all."""
    members = _members(health)
    if unheard := [node for node in members if node not in health]:
        return f"not heard yet: {', '.join(unheard)}"
    for node in members:
        if health[node]["values"].get("ready", "True") != "True":
            return f"{node} is not ready: {health[node]['text']}"
    if health.get("experiment", {}).get("values", {}).get("phase") == "starting":
        return "the experiment node still looks for the others"
    return ""


def _members(health: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The nodes of the graph, as the amplifier has them, which no panel is; in an old bag all that speak."""
    if "amplifier" not in health:
        return ["amplifier"]  # who else there should be is not known before it has said so
    named = health["amplifier"]["values"].get("nodes", "")
    return named.split(",") if named else list(health)
