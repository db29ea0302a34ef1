"""An optimal control problem as data (thesis 4.1), read from YAML; the thesis' two cases are shipped."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pzt_ros.chains import load_chain, parse_chain, read_yaml, shipped
from pzt_ros.errors import BenchError
from pzt_ros.optimal.radau import NODES
from pzt_ros.physics.one_equation import OneEquation
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.parametrized_single import ParametrizedSingle
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import build, choice, form, parameter, table, to_si

UP, DOWN = "up", "down"

_NOTES = ("problem", "description", "source")
_MOST_INTERVALS = 2000


@dataclass(frozen=True)
class Segment:
    """A part of the horizon along one branch: `direction` of switching, up to the time `until` [s]."""

    direction: str
    until: float


def _read_ceramic(content: Any, where: str) -> OneEquation:
    """The parametrized ceramic of a chain by name, or a link as it would stand in a chain."""
    if isinstance(content, str):
        links = load_chain(content).links
    else:
        links = parse_chain({"chain": where, "links": [content]}, where).links
    for link in links:
        if isinstance(link, (Parametrized, ParametrizedSingle)):
            return link
    raise BenchError(f"{where}: no parametrized ceramic found; give a link or a chain with one, such as thesis-p3")


def _read_segments(content: Any, where: str) -> tuple[Segment, ...]:
    if not isinstance(content, list) or not content:
        raise BenchError(f"{where}: expected a list such as - {{direction: up, until: 2 ms}}, found {content!r}")
    found: list[Segment] = []
    for number, entry in enumerate(content, start=1):
        place = f"{where}, segment {number}"
        if not isinstance(entry, Mapping) or set(entry) != {"direction", "until"}:
            raise BenchError(f"{place}: expected {{direction: {UP}, until: 2 ms}}, found {entry!r}")
        if entry["direction"] not in (UP, DOWN):
            raise BenchError(f"{place}: direction {entry['direction']!r} is neither {UP} nor {DOWN}")
        until = to_si(entry["until"], "s", f"{place}.until")
        if until <= (found[-1].until if found else 0.0):
            raise BenchError(f"{place}: until {until:g} s is not after the segment before it; put them in order")
        if found and found[-1].direction == entry["direction"]:
            raise BenchError(f"{place}: has the direction of the one before it; directions alternate")
        found.append(Segment(entry["direction"], until))
    return tuple(found)


def _never_written(_: Any) -> Any:
    raise NotImplementedError("problems are read, not written")


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Minimise the integral of (P - P_set)^2 over the field, linear between grid points (4.1, 4.2).

    A limit that is not given does not hold. The current is the mean one of an interval, as an amplifier of that sample
    rate sees it: the field may have kinks at the grid's points, the current within an interval is not bounded.
    """

    horizon: float = parameter(None, "s", "length of the process", symbol="T", bounds=(1e-9, 1e5))
    intervals: float = parameter(80.0, "1", "of the grid", symbol="N", bounds=(2.0, _MOST_INTERVALS))
    set_point_times: tuple[float, ...] = table(None, "s", "corners of the set-point", bounds=(0.0, 1e5))
    set_point: tuple[float, ...] = table(None, "C/m^2", "polarization at the corners", bounds=(-10.0, 10.0))
    initial_phase_fraction: float = parameter(
        math.nan,
        "1",
        "x+ at the beginning; the ceramic's own at rest by default",
        symbol="x_0",
        bounds=(1e-6, 1 - 1e-6),
    )
    initial_field: float = parameter(
        math.nan, "V/m", "field at the beginning; free by default", symbol="E(0)", bounds=(-1e8, 1e8)
    )
    field_min: float = parameter(-math.inf, "V/m", "lowest field", bounds=(-1e8, 1e8))
    field_max: float = parameter(math.inf, "V/m", "highest field", symbol="E_max", bounds=(-1e8, 1e8))
    slew_rate: float = parameter(math.inf, "V/m/s", "fastest change of the field", bounds=(1e-3, 1e15))
    current: float = parameter(math.inf, "A", "largest mean current of an interval", bounds=(1e-9, 1e3))
    rate_weight: float = parameter(
        0.0, "C^2*s^2/V^2/m^2", "of the squared field rate, beside the squared miss", bounds=(0.0, 1e6)
    )
    end_weight: float = parameter(0.0, "s", "of the squared miss at the end", bounds=(0.0, 1e6))
    ceramic: Any = form(_read_ceramic, _never_written, "parametrized ceramic: a link, or a chain by name")
    segments: Any = form(_read_segments, _never_written, "sequence of branches, for a ceramic with history")

    name: str = choice("problem", (), "how it is called")
    description: str = choice("", (), "for people")

    def __post_init__(self) -> None:
        """Refuse what cannot be solved, in one line."""
        times, levels = self.set_point_times, self.set_point
        if self.ceramic is None:
            self._refuse("ceramic is missing; give a link such as parametrized_single, or the name of a chain")
        if self.intervals != int(self.intervals):
            self._refuse(f"intervals {self.intervals:g} is no whole number")
        if len(times) != len(levels) or len(times) < 1:
            self._refuse(f"set_point has {len(levels)} values for {len(times)} set_point_times; give one for each")
        if any(b <= a for a, b in itertools.pairwise(times)):
            self._refuse("set_point_times do not increase; a jump takes an interval at least")
        if not self.field_min < self.field_max:
            self._refuse(f"field_min {self.field_min:g} V/m is not below field_max {self.field_max:g} V/m")
        if not math.isnan(self.initial_field) and not self.field_min <= self.initial_field <= self.field_max:
            self._refuse(f"initial_field {self.initial_field:g} V/m lies outside field_min to field_max")
        if self.segments is not None and abs(self.segments[-1].until - self.horizon) > 1e-9 * self.horizon:
            self._refuse(f"the last segment ends at {self.segments[-1].until:g} s, the horizon at {self.horizon:g} s")

    def _refuse(self, why: str) -> None:
        raise BenchError(f"{self.name}: {why}")

    @property
    def steps(self) -> int:
        """Intervals of the grid, N."""
        return int(self.intervals)

    @property
    def step(self) -> float:
        """Length of an interval h [s]."""
        return self.horizon / self.steps

    @functools.cached_property
    def grid(self) -> Array:
        """Times of the fields [s, shape (N + 1,)]."""
        return np.linspace(0.0, self.horizon, self.steps + 1)

    @functools.cached_property
    def stage_times(self) -> Array:
        """Times of the Radau points [s, shape (N, 3)]."""
        return (np.arange(self.steps)[:, None] + NODES) * self.step

    def set_point_at(self, time: Array) -> Array:
        """P_set [C/m^2, shape of `time`]: linear between its corners, constant before and after."""
        return np.interp(time, self.set_point_times, self.set_point)

    @property
    def charge_step(self) -> float:
        """Largest change of the polarization over an interval [C/m^2]."""
        return self.current * self.step / float(self.ceramic.electrode_area)

    @property
    def field_step(self) -> float:
        """Largest change of the field over an interval [V/m]."""
        return self.slew_rate * self.step


def shipped_problems() -> dict[str, Path]:
    """The problems that come with the package: name -> file."""
    return shipped("problems")


def load_problem(name_or_path: str | Path) -> Problem:
    """A problem by shipped name or from a YAML file.

    Raises:
        BenchError: no such file, bad YAML, unknown key or unit, or a problem that contradicts itself.
    """
    return parse_problem(*read_yaml(name_or_path, shipped_problems(), "problem"))


def parse_problem(data: Any, where: str) -> Problem:
    """A problem from the content of its YAML file; `where` names it in errors. Raises as `load_problem`."""
    if not isinstance(data, Mapping):
        raise BenchError(f"{where}: not a problem; expected 'problem: name' and its parameters")
    values = {key: value for key, value in data.items() if key not in _NOTES}
    if "name" in values:
        raise BenchError(f"{where}: unknown key 'name'; the name of a problem stands behind 'problem:'")
    values["name"] = str(data.get("problem", where))
    values["description"] = str(data.get("description", "")).strip()
    return build(Problem, values, where)
