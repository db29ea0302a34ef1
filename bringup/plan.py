"""What a bringup is going to do, and the files of its run folder."""

from __future__ import annotations

import json
import os
import shutil
import sys
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from pzt_bringup.processes import SEPARATE, ProcessRow, composed
from pzt_config.topics import NODES
from pzt_ros.errors import BenchError
from pzt_ros.hardware.choose import Drivers, as_parameters
from pzt_ros.processors import shared_out
from pzt_ros.quantities import parameters_of
from pzt_ros.ros_environment import ros_environment
from pzt_ros.scenario import RATES, REAL_TIME, Scenario, Timing


@dataclass(frozen=True)
class Plan:
    """One run of the graph.

    Attributes:
        scenario: what is done.
        folder: of the run; bag, logs, parameters and `run.json` go there.
        composed: the loop in one process, the recorder in another.
        rate: "as fast as possible" or "real time".
        duration: cut the scenario after this time [s]; None for its full length.
        domain: ROS domain.
        namespace: of the axis.
        drivers: the instruments behind the amplifier and the sensor node.
        neighbour: namespace of the axis whose motion the simulated stage feels; empty for none.
        own_recorder: whether it records itself, or another process takes this axis into the bag of all.
        priority: whether the loop asks for a real-time priority while it keeps the pace of the wall clock.
    """

    scenario: Scenario
    folder: Path
    composed: bool
    rate: str
    duration: float | None
    domain: int
    namespace: str = "/stage"
    drivers: Drivers = field(default_factory=Drivers)
    own_recorder: bool = True
    neighbour: str = ""
    priority: bool = True

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes of this graph: the plant is there only if a sensor reads it."""
        return tuple(node for node in NODES if node != "plant" or self.drivers.needs_plant)

    @property
    def processes(self) -> tuple[ProcessRow, ...]:
        """The rows of the process table that are started."""
        started = tuple(node for node in self.nodes if node != "recorder" or self.own_recorder)
        if self.composed:
            return composed(started)
        return tuple(row for row in SEPARATE if set(row.nodes) <= set(started))

    @property
    def bag(self) -> Path:
        """Folder of the bag."""
        return self.folder / "bag"

    def log(self, process: str) -> Path:
        """Where a process' stderr goes."""
        return self.folder / "log" / f"{process}.log"

    @property
    def parameter_file(self) -> Path:
        """The ROS parameters of every node."""
        return self.folder / "parameters.yaml"


def prepare(plan: Plan) -> None:
    """Make the run folder with everything that is needed to repeat the run.

    Raises:
        BenchError: the folder holds a run already, or cannot be written.
    """
    if plan.rate not in RATES:
        raise BenchError(f"rate '{plan.rate}' is not one of {', '.join(RATES)}")
    if plan.bag.exists():
        raise BenchError(f"{plan.folder} holds a run already ({plan.bag.name}/ is there); choose another --out")
    try:
        (plan.folder / "log").mkdir(parents=True, exist_ok=True)
        plan.parameter_file.write_text(yaml.safe_dump(node_parameters(plan), sort_keys=False), encoding="utf-8")
        shutil.copyfile(plan.scenario.source, plan.folder / "scenario.yaml")
        for file in {plan.scenario.plant, plan.scenario.model, *plan.scenario.files}:
            if Path(file).exists():  # not a shipped chain: the scenario's copy finds it beside itself
                shutil.copyfile(file, plan.folder / Path(file).name)
        (plan.folder / "run.json").write_text(json.dumps(_provenance(plan), indent=1), encoding="utf-8")
        if not plan.own_recorder:
            plan.bag.symlink_to(Path("..") / plan.bag.name)
    except OSError as error:
        raise BenchError(f"run folder {plan.folder} cannot be written: {error.strerror}") from None


def node_parameters(plan: Plan) -> dict[str, Any]:
    """The content of the ROS parameter file: each node's section."""
    s = plan.scenario
    timing = {name: float(getattr(s.timing, name)) for name in parameters_of(Timing)}
    common: dict[str, Any] = {**timing, "nodes": ",".join(plan.nodes)}
    own: dict[str, dict[str, Any]] = {
        "recorder": {"bag": str(plan.bag), "nodes": common["nodes"]},
        "amplifier": {
            "chain": s.plant,
            "rate": plan.rate,
            "limits": _values(s.limits),
            **as_parameters(plan.drivers.amplifier),
        },
        "plant": {"chain": s.plant, "rate": plan.rate, "neighbour": plan.neighbour},
        "sensor": {"chain": s.plant, **as_parameters(plan.drivers.sensor)},
        "observer": {"model": s.model, "observer": s.observer.kind, s.observer.kind: _values(s.observer)},
        "controller": {
            "model": s.model,
            "limits": _values(s.bounds),
            **({"controller": s.manual.controller} if s.manual else {}),  # also of one that is started again
            **{name: _values(c) for name, c in s.controllers.items() if _values(c)},
        },
        "experiment": {"scenario": str(s.source), "duration": float(plan.duration or 0.0)},
    }
    prefix = plan.namespace.rstrip("/")
    return {
        f"{prefix}/{node}": {"ros__parameters": values if node == "recorder" else {**common, **values}}
        for node, values in own.items()
    }


def _values(owner: Any) -> dict[str, float]:
    return {name: float(getattr(owner, name)) for name in parameters_of(owner)}


def _provenance(plan: Plan) -> dict[str, Any]:
    packages = ("pzt_ros", "ros-jazzy-rclpy", "ros-jazzy-rmw-fastrtps-cpp", "numpy", "numba", "scipy")
    return {
        "scenario": plan.scenario.name,
        "plant": plan.scenario.plant,
        "model": plan.scenario.model,
        "seed": plan.scenario.seed,
        "simulated": plan.drivers.simulated,
        "drivers": {"amplifier": plan.drivers.amplifier.kind, "sensor": plan.drivers.sensor.kind},
        "namespace": plan.namespace,
        "composed": plan.composed,
        "rate": plan.rate,
        "domain": plan.domain,
        "command": sys.argv,
        "versions": {name: _version(name) for name in packages} | {"python": sys.version.split()[0]},
    }


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


def environment(plan: Plan, in_loop: bool = False) -> dict[str, str]:
    """What a process of the graph finds in its environment; the user's own settings win.

    The recorder is not in the loop: it may come later. A composed loop has a processor of its own; of several axes none
    has, there may be fewer processors.
    """
    paced = plan.rate == REAL_TIME
    hurried = {"PZT_PRIORITY": "1"} if in_loop and plan.priority and paced else {}
    apart = shared_out(os.sched_getaffinity(0), in_loop) if plan.composed and paced and plan.own_recorder else {}
    return {**ros_environment(plan.folder / "log" / "ros", plan.domain), "PZT_STATUS": "1", **hurried, **apart}
