"""How the nodes of a run were, from the diagnostics in its bag."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pzt_ros.bags.reader import Bag

LEVELS = ("ok", "warn", "error", "stale")  # diagnostic_msgs/DiagnosticStatus

_COUNTED = ("refused", "limited", "late")
_PACE = ("paced_ticks", "missed_ticks", "lateness_p50_us", "lateness_p99_us", "lateness_p999_us", "lateness_max_us")


@dataclass
class NodeHealth:
    """What a node said of itself.

    Attributes:
        node: its name, with the namespace.
        level, state: the last ones.
        ticks_per_second: median over the time it was running [1/s]; 0 where it never ran.
        counts: of what it refused or limited, or what came late, by reason.
        reason: why an amplifier is in fault; empty otherwise.
        pace: ticks that had a place on the wall clock, those that missed it, percentiles of the lateness [us]; empty
            for a node that keeps no pace.
    """

    node: str
    level: str = "ok"
    state: str = ""
    ticks_per_second: float = 0.0
    counts: dict[str, int] = field(default_factory=dict)
    reason: str = ""
    pace: dict[str, float] = field(default_factory=dict)


def node_health(bag: Bag, topic: str = "/diagnostics") -> list[NodeHealth]:
    """Every node that reported, in the order of its first report; empty where none did."""
    if topic not in {summary.name for summary in bag.topics() if summary.count}:
        return []
    return summarize(status for _, message in bag.messages(topic) for status in message.status)


def summarize(statuses: Iterable[Any]) -> list[NodeHealth]:
    """The same from DiagnosticStatus messages in the order of recording."""
    nodes: dict[str, NodeHealth] = {}
    rates: dict[str, list[float]] = {}
    for status in statuses:
        health = nodes.setdefault(status.name, NodeHealth(status.name))
        values = {pair.key: pair.value for pair in status.values}
        health.level = LEVELS[status.level] if status.level < len(LEVELS) else "error"
        health.state = status.message
        health.reason = values.get("reason", "")
        health.counts = {
            key: int(value) for key, value in values.items() if key.startswith(_COUNTED) and value.isdigit()
        }
        health.pace = {key: _number(values[key]) for key in _PACE if key in values}
        rates.setdefault(status.name, []).append(_number(values.get("ticks_per_second", "")))
    for name, health in nodes.items():
        running = [rate for rate in rates[name] if rate > 0.0]
        health.ticks_per_second = float(np.median(running)) if running else 0.0
    return list(nodes.values())


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0
