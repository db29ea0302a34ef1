"""A run folder read back: what was asked, what the stage did, and how the nodes were."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pzt_ros.bags.reader import Bag, open_bag
from pzt_ros.blocks import Block
from pzt_ros.errors import BenchError, RunFailedError
from pzt_ros.physics.signals import Array
from pzt_ros.report.tracking import PhaseTracking, Stretch, stretches, track
from pzt_ros.scenario import Scenario, load_scenario

_SIGNALS = {
    "reference": ("reference", "displacement_m"),
    "voltage": ("applied", "voltage_V"),
    "current": ("applied", "current_A"),
    "measurement": ("measurement", "displacement_m"),
    "truth": ("truth", "displacement_m"),
}
"""Each signal with the topic below the namespace and the column of its blocks."""

_EVERY_SAMPLE = ("applied", "measurement", "estimate", "truth")
"""The topics that have a row for every sample of a run."""


@dataclass(frozen=True)
class RunData:
    """A run on one time grid; NaN where a signal was not recorded.

    Attributes:
        folder: of the run.
        provenance: content of `run.json`.
        scenario: that was run.
        bag: the recording.
        time: sample times [s, shape (n,)].
        reference, measurement, truth: displacement [m, shape (n,)].
        voltage: across the ceramic [V, shape (n,)].
        current: into the ceramic [A, shape (n,)].
        stretches: the phases in time, as planned.
        duration: end of the scenario as asked with --duration [s]; its full length otherwise; 0 where an operator ended
            it.
        missing: samples that each topic which has a row for every one lacks, between its first and its last.
    """

    folder: Path
    provenance: Mapping[str, Any]
    scenario: Scenario
    bag: Bag
    time: Array
    reference: Array
    measurement: Array
    truth: Array
    voltage: Array
    current: Array
    stretches: tuple[Stretch, ...]
    duration: float
    missing: Mapping[str, int]

    @property
    def name(self) -> str:
        """Of the scenario; the run's copy may not say it."""
        return str(self.provenance.get("scenario", self.scenario.name))

    @property
    def simulated(self) -> bool:
        """Whether the stage was a simulated one; a run that does not say counts as real."""
        return self.provenance.get("simulated") is True

    @property
    def displacements(self) -> dict[str, Array]:
        """What errors are taken against [each m, shape (n,)], the one to judge by first."""
        if self.simulated and np.any(np.isfinite(self.truth)):
            return {"truth": self.truth, "measurement": self.measurement}
        return {"measurement": self.measurement}

    @property
    def displacement(self) -> Array:
        """The one to judge by: the truth in a simulation, the measurement otherwise [m, shape (n,)]."""
        return next(iter(self.displacements.values()))

    @property
    def outcome(self) -> Mapping[str, Any] | None:
        """Exit code and sentence of the bring-up; None where it did not live to write them."""
        return self.provenance.get("outcome")

    @property
    def recorded(self) -> float:
        """How far the scenario came, which begins after the first block [s]."""
        rate = self.scenario.sample_rate
        return float(self.time[-1] + (1 - self.scenario.block_size) / rate)

    @property
    def wall_time(self) -> float:
        """From the first measurement to the last on the wall clock [s]."""
        topic = self.bag.topic(topic_name(self.provenance, "measurement"))
        return (topic.last_ns - topic.first_ns) * 1e-9

    def tracked(self) -> list[PhaseTracking]:
        """Every phase that asked for displacement and was recorded, at least in part."""
        asked = (stretch for stretch in self.stretches if stretch.controller)
        found = (track(stretch, self.time, self.reference, self.displacements) for stretch in asked)
        return [row for row in found if row is not None]


def read_run(folder: str | Path) -> RunData:
    """Read a run folder, complete or not.

    Raises:
        BenchError: no run folder, or its files are damaged.
        RunFailedError: nothing was measured in this run.
    """
    folder = Path(folder)
    provenance = _provenance(folder)
    scenario = _scenario(folder, provenance)
    bag = open_bag(folder / "bag")
    present = {topic.name for topic in bag.topics() if topic.count}
    blocks: dict[str, Block] = {}
    for leaf in (*(leaf for leaf, _ in _SIGNALS.values()), *_EVERY_SAMPLE):
        name = topic_name(provenance, leaf)
        if leaf not in blocks and name in present:
            blocks[leaf] = bag.blocks(name)
    if "measurement" not in blocks:
        raise RunFailedError(f"{folder}: nothing was measured in this run, so there is no report; see {folder / 'log'}")
    rate = scenario.sample_rate
    places = {leaf: np.round(block.time * rate).astype(np.int64) for leaf, block in blocks.items()}
    start = min(int(place.min()) for place in places.values())
    count = max(int(place.max()) for place in places.values()) + 1 - start

    def signal(name: str) -> Array:
        leaf, column = _SIGNALS[name]
        values = np.full(count, np.nan)
        if leaf in blocks:
            values[places[leaf] - start] = blocks[leaf][column]
        return values

    experiment = scenario.experiment()
    return RunData(
        folder=folder,
        provenance=provenance,
        scenario=scenario,
        bag=bag,
        time=(start + np.arange(count)) / rate,
        stretches=tuple(stretches(experiment.spans())),
        duration=0.0 if scenario.manual else _asked_duration(folder, provenance) or experiment.length,
        missing={leaf: _gaps(places[leaf]) for leaf in _EVERY_SAMPLE if leaf in places},
        **{name: signal(name) for name in _SIGNALS},
    )


def _gaps(places: NDArray[np.int64]) -> int:
    """How many places between the first and the last are not among them."""
    return int(places.max() - places.min()) + 1 - len(np.unique(places))


def topic_name(provenance: Mapping[str, Any], leaf: str) -> str:
    """A topic of the run's axis."""
    return f"{str(provenance.get('namespace', '/stage')).rstrip('/')}/{leaf}"


def _provenance(folder: Path) -> dict[str, Any]:
    path = folder / "run.json"
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BenchError(f"{folder}: no run.json in it, so this is no run folder; give the --out of a run") from None
    except (OSError, ValueError) as error:
        raise BenchError(f"{path}: cannot be read ({error}); give the folder of another run") from None
    if not isinstance(found, dict):
        raise BenchError(f"{path}: expected the record of a run, found {type(found).__name__}")
    return found


def _parameters(folder: Path, provenance: Mapping[str, Any], node: str) -> dict[str, Any]:
    """The ROS parameters a node was started with; none where the file is missing or damaged."""
    try:
        data = yaml.safe_load((folder / "parameters.yaml").read_text(encoding="utf-8"))
        found = data[topic_name(provenance, node)]["ros__parameters"]
        return dict(found)
    except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError):
        return {}


def _scenario(folder: Path, provenance: Mapping[str, Any]) -> Scenario:
    """The run's own copy of its scenario, or the original where the copy names chains that lie beside the original."""
    try:
        return load_scenario(folder / "scenario.yaml")
    except BenchError:
        original = Path(str(_parameters(folder, provenance, "experiment").get("scenario", "")))
        if not original.is_file() or original.read_bytes() != (folder / "scenario.yaml").read_bytes():
            raise
        return load_scenario(original)


def _asked_duration(folder: Path, provenance: Mapping[str, Any]) -> float:
    return float(_parameters(folder, provenance, "experiment").get("duration", 0.0))
