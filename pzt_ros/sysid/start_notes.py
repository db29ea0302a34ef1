"""A run's start as the `start:` of a model's file has it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pzt_ros.sysid.run import Start


def start_as_data(start: Start, sha256: str, name: str) -> dict[str, Any]:
    """The entry of a run that was fitted; what it has nothing of is left out."""
    entry = {
        "sha256": sha256,
        "name": name,
        "prior_voltage_V": list(start.prior_voltages),
        "leg_s": start.leg,
        "offset_m": start.offset,
    }
    more: dict[str, Any] = {"occupancy": list(start.occupancy), "values": dict(start.values)}
    more |= {"fading_m": list(start.fading), "approach_s": start.approach}
    return {**entry, **{key: value for key, value in more.items() if value}}


def past_as_data(past: Start) -> dict[str, Any]:
    """How a run that was not fitted may have begun; what it has nothing of is left out."""
    found: dict[str, Any] = {"prior_voltage_V": list(past.prior_voltages)}
    return found if past.approach is None else {**found, "leg_s": past.leg, "approach_s": past.approach}


def past_from_data(entry: Mapping[str, Any], usual_leg: float) -> Start:
    """The past of such an entry; where that does not say how long its ramps took, so long as usual [s].

    Raises:
        KeyError, TypeError, ValueError: it lacks something, or it is no number, or no duration.
    """
    past = Start(tuple(float(v) for v in entry.get("prior_voltage_V", ())), usual_leg)
    if entry.get("approach_s") is None:
        return past
    return replace(past, leg=_duration(entry["leg_s"]), approach=_duration(entry["approach_s"]))


def start_from_data(entry: Mapping[str, Any]) -> Start:
    """The start of an entry.

    Raises:
        KeyError, TypeError, ValueError: the entry lacks something, or it is no number.
    """
    approach = entry.get("approach_s")
    return Start(
        tuple(float(v) for v in entry["prior_voltage_V"]),
        float(entry["leg_s"]),
        float(entry["offset_m"]),
        tuple(float(v) for v in entry.get("occupancy", ())),
        tuple((str(name), float(value)) for name, value in entry.get("values", {}).items()),
        tuple(float(size) for size in entry.get("fading_m", ())),
        None if approach is None else _duration(approach),
    )


def _duration(value: Any) -> float:
    found = float(value)
    if not 0.0 < found < math.inf:
        raise ValueError(f"{found:g} s is no duration")
    return found
