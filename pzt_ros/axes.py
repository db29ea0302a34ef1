"""Several axes in one run: a YAML file that names a scenario for each.

scenario: a stage of two axes
axes:
  x: scan.yaml
  y: {scenario: hold.yaml, drivers: instruments.yaml}

Of simulated axes one may feel another, if its chain has a `cross_coupling`: x: {scenario: scan.yaml, neighbour: y}.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pzt_ros.chains import read_yaml, shipped
from pzt_ros.errors import BenchError


@dataclass(frozen=True)
class Axis:
    """One axis.

    Attributes:
        name: which is its namespace.
        scenario: it runs.
        drivers: its instruments; None: simulated.
        neighbour: the axis whose motion it feels, in simulation; empty for none.
    """

    name: str
    scenario: str
    drivers: Path | None = None
    neighbour: str = ""


def axes_of(name_or_path: str | Path) -> tuple[Axis, ...]:
    """The axes of a scenario, by shipped name or path; none where it is of one axis itself.

    Raises:
        BenchError: no such file, bad YAML, a name that is no ROS name, or an entry that is no scenario.
    """
    files = shipped("scenarios")
    data, where = read_yaml(name_or_path, files, "scenario")
    if not isinstance(data, dict) or "axes" not in data:
        return ()
    unknown = set(data) - {"scenario", "description", "axes"}
    if unknown or not isinstance(data["axes"], dict) or not data["axes"]:
        wrong = f"unknown key {min(unknown)!r} beside 'axes:'" if unknown else f"axes: {data['axes']!r}"
        raise BenchError(f"{where}: {wrong}; expected 'axes:' with a scenario for each axis, such as 'x: scan.yaml'")
    beside = Path(name_or_path).resolve().parent
    axes = tuple(_axis(str(name), entry, beside, where) for name, entry in data["axes"].items())
    for axis in axes:
        others = [other.name for other in axes if other.name != axis.name]
        if axis.neighbour and axis.neighbour not in others:
            raise BenchError(f"{where}: axis {axis.name}: neighbour '{axis.neighbour}' is none of {', '.join(others)}")
    return axes


def _axis(name: str, entry: Any, beside: Path, where: str) -> Axis:
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise BenchError(f"{where}: axis '{name}' cannot be a ROS namespace; use small letters, digits and _")
    entry = {"scenario": entry} if isinstance(entry, str) else entry
    if not isinstance(entry, dict) or "scenario" not in entry or not set(entry) <= {"scenario", "drivers", "neighbour"}:
        keys = "'scenario:', 'drivers:' and 'neighbour:'"
        raise BenchError(f"{where}: axis {name}: expected a scenario, or {keys}, found {entry!r}")
    drivers = beside / str(entry["drivers"]) if "drivers" in entry else None
    scenario = beside / str(entry["scenario"])
    return Axis(
        name, str(scenario) if scenario.is_file() else str(entry["scenario"]), drivers, str(entry.get("neighbour", ""))
    )
