"""A scenario: which stage, which model of it, and what is done with it; as YAML."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pzt_ros.chains import load_chain, read_yaml, shipped
from pzt_ros.controllers.bounds import Bounds
from pzt_ros.controllers.controller import NEVER, Controller
from pzt_ros.controllers.table import CONTROLLERS
from pzt_ros.errors import BenchError
from pzt_ros.experiments.experiment import Experiment
from pzt_ros.experiments.operation import ManualOperation
from pzt_ros.experiments.phases import PHASES, FromFile, Phase
from pzt_ros.experiments.procedures import phases_of
from pzt_ros.hardware.guard import Limits
from pzt_ros.observers.observer import Observer
from pzt_ros.observers.table import OBSERVERS
from pzt_ros.quantities import build, parameter, parameters_of

AS_FAST_AS_POSSIBLE, REAL_TIME = "as fast as possible", "real time"
RATES = (AS_FAST_AS_POSSIBLE, REAL_TIME)
"""The paces of a run."""

STAYS = {"handover_time": f"{NEVER:g} s"}
"""Where an operator moves the stage, a controller without feedback keeps the offset that it found: it has no business
to go where its own line or model says that the stage should have been.
"""


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How time is cut: everything that must be the same in every node."""

    sample_rate: float = parameter(20e3, "Hz", "samples per second", bounds=(1.0, 1e6))
    block_size: float = parameter(100.0, "1", "samples in a block", bounds=(2.0, 1e5))
    seed: float = parameter(1.0, "1", "of every random number in the simulation", bounds=(0.0, 2**53))
    handover_time: float = parameter(0.05, "s", "over which a change of controller is smoothed", bounds=(1e-3, NEVER))


@dataclass(frozen=True)
class Scenario:
    """A scenario as read from its file.

    Attributes:
        name, description: for people.
        plant: chain of the simulated stage (name or path).
        model: chain that observer and controllers believe in (name or path).
        timing: sample rate, block size, seed.
        limits: of the amplifier.
        observer: with its gains.
        controllers: by name, with their gains.
        phases: what happens, in order; none where an operator says what happens.
        manual: settings of manual operation; None for a scenario with phases.
        rate: the pace it is meant for, one of `RATES`.
        source: the file it came from.
    """

    name: str
    description: str
    plant: str
    model: str
    timing: Timing
    limits: Limits
    observer: Observer
    controllers: dict[str, Controller]
    phases: tuple[Phase, ...]
    manual: ManualOperation | None
    rate: str
    source: Path

    @property
    def sample_rate(self) -> float:
        """Samples per second [Hz]."""
        return self.timing.sample_rate

    @property
    def block_size(self) -> int:
        """Samples in a block."""
        return int(self.timing.block_size)

    @property
    def seed(self) -> int:
        """Of every random number in the simulation."""
        return int(self.timing.seed)

    @property
    def bounds(self) -> Bounds:
        """Of what a controller may ask: the amplifier's own limits."""
        return Bounds(**{name: getattr(self.limits, name) for name in parameters_of(Bounds)})

    @property
    def files(self) -> tuple[str, ...]:
        """Paths of the references that come from files."""
        return tuple(phase.path for phase in self.phases if isinstance(phase, FromFile))

    def experiment(self) -> Experiment:
        """A conductor at the beginning of this scenario."""
        return Experiment(self.phases, self.sample_rate, self.block_size)


_KEYS = (
    "scenario", "description", "plant", "model", "observer", "controllers", "limits", "phases", "manual", "rate",
)  # fmt: skip


def load_scenario(name_or_path: str | Path) -> Scenario:
    """A scenario by shipped name or from a YAML file; its chains are checked, too.

    Raises:
        BenchError: no such file, bad YAML, unknown key, bad unit, value out of bounds, no such chain.
    """
    files = shipped("scenarios")
    data, where = read_yaml(name_or_path, files, "scenario")
    if not isinstance(data, dict):
        raise BenchError(f"{where}: not a scenario; expected 'plant:', 'model:' and a list 'phases:'")
    timing_keys = parameters_of(Timing)
    for key in data:
        if key not in _KEYS and key not in timing_keys:
            raise BenchError(f"{where}: unknown key {key!r}; known are {', '.join((*_KEYS, *timing_keys))}")
    for key in ("plant", "model"):
        if key not in data:
            raise BenchError(f"{where}: key '{key}' is missing")
    if ("phases" in data) == ("manual" in data):
        raise BenchError(f"{where}: say either 'phases:', a list of them, or 'manual:' for an operator")
    manual = "manual" in data
    given = {key: data[key] for key in timing_keys if key in data}
    timing = build(Timing, {**STAYS, **given} if manual else given, where)
    for key in ("block_size", "seed"):
        if getattr(timing, key) != int(getattr(timing, key)):
            raise BenchError(f"{where}.{key}: {getattr(timing, key)} is not a whole number")
    path = files.get(str(name_or_path), Path(name_or_path)).resolve()
    return Scenario(
        name=str(data.get("scenario", path.stem)),
        description=str(data.get("description", "")).strip(),
        plant=_chain_name(data["plant"], path),
        model=_chain_name(data["model"], path),
        timing=timing,
        limits=build(Limits, data.get("limits") or {}, f"{where}: limits"),
        observer=_observer(data.get("observer") or {}, where),
        controllers=_controllers(data.get("controllers") or {}, manual, where),
        phases=_phases(data["phases"], where, path) if "phases" in data else (),
        manual=_manual(data["manual"], where) if manual else None,
        rate=_rate(data.get("rate", AS_FAST_AS_POSSIBLE), where),
        source=path,
    )


def _chain_name(name: Any, scenario: Path) -> str:
    """The chain's name, or its path made absolute: a relative path starts at the scenario's folder."""
    beside = scenario.parent / str(name)
    chosen = str(beside) if beside.suffix in (".yaml", ".yml") and beside.is_file() else str(name)
    load_chain(chosen)
    return chosen


def _observer(entry: Any, where: str) -> Observer:
    if not isinstance(entry, dict):
        raise BenchError(f"{where}: observer: expected 'observer: kind' and its gains, found {entry!r}")
    values = {key: value for key, value in entry.items() if key != "observer"}
    kind = entry.get("observer", "disturbance")
    if not isinstance(kind, str) or kind not in OBSERVERS:
        raise BenchError(f"{where}: unknown observer {kind!r}; known are {', '.join(OBSERVERS)}")
    observer: Observer = build(OBSERVERS[kind], values, f"{where}: observer")
    return observer


def _controllers(entries: Any, manual: bool, where: str) -> dict[str, Controller]:
    if not isinstance(entries, dict):
        raise BenchError(f"{where}: controllers: expected a controller's name and its gains, found {entries!r}")
    for name in entries:
        if name not in CONTROLLERS:
            raise BenchError(f"{where}: unknown controller {name!r}; known are {', '.join(CONTROLLERS)}")

    def gains(name: str) -> Any:
        given = entries.get(name) or {}
        return {**STAYS, **given} if manual and CONTROLLERS[name].keeps_offset and isinstance(given, dict) else given

    return {name: build(cls, gains(name), f"{where}: controllers.{name}") for name, cls in CONTROLLERS.items()}


def _manual(entry: Any, where: str) -> ManualOperation:
    operation: ManualOperation = build(ManualOperation, entry or {}, f"{where}: manual")
    _known_controller(operation.controller, f"{where}: manual")
    return operation


def _rate(value: Any, where: str) -> str:
    if value not in RATES:
        raise BenchError(f"{where}: rate {value!r} is not one of {', '.join(RATES)}")
    return str(value)


def _known_controller(name: str, where: str) -> None:
    if name not in CONTROLLERS:
        raise BenchError(f"{where}: unknown controller '{name}'; known are {', '.join(CONTROLLERS)}")


def _found(phase: FromFile, where: str, scenario: Path) -> FromFile:
    """The phase with an absolute path; the run's own copy of a file lies beside that of the scenario."""
    beside = scenario.parent / phase.path
    path = beside if beside.is_file() else scenario.parent / Path(phase.path).name
    if not path.is_file():
        raise BenchError(f"{where}: path '{phase.path}': no such file; a relative one starts at {scenario.parent}")
    found = dataclasses.replace(phase, path=str(path))
    if not found.length > 0.0:
        raise BenchError(f"{where}: {path} ends when it begins; give rows at different times")
    return found


def _phases(entries: Any, where: str, scenario: Path) -> tuple[Phase, ...]:
    if not isinstance(entries, list) or not entries:
        raise BenchError(f"{where}: phases: expected a list of phases, found {entries!r}")
    phases: list[Phase] = []
    for number, entry in enumerate(entries, start=1):
        here = f"{where}: phase {number}"
        if isinstance(entry, dict) and "experiment" in entry:
            phases.extend(phases_of(entry, here))
            continue
        if not isinstance(entry, dict) or str(entry.get("phase")) not in PHASES:
            known = f"'phase: kind', kind one of {', '.join(PHASES)}, or 'experiment: family'"
            raise BenchError(f"{here}: expected {known}; found {entry!r}")
        values = {key: value for key, value in entry.items() if key != "phase"}
        phase = build(PHASES[entry["phase"]], values, f"{here} ({entry['phase']})")
        if isinstance(phase, FromFile):
            phase = _found(phase, here, scenario)
        if controller := getattr(phase, "controller", ""):
            _known_controller(controller, here)
        phases.append(phase)
    return tuple(phases)
