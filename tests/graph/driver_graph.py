"""A graph whose instruments are named in a file, and a run for them to replay."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from graph_process import GraphProcess, wait_until

from pzt_ros.loop import Tick, run_in_process
from pzt_ros.records import Record
from pzt_ros.scenario import load_scenario


class DriverGraph(GraphProcess):
    """A graph whose drivers are named in a file."""

    def __init__(self, scenario: Path, drivers: str, folder: Path, *options: str) -> None:
        chosen = scenario.with_name("drivers.yaml")
        chosen.write_text(drivers, encoding="utf-8")
        super().__init__(scenario, folder, "--drivers", str(chosen), *options)

    def log(self, node: str) -> str:
        path = self.folder / "log" / f"{node}.log"
        return path.read_text(encoding="utf-8") if path.exists() else ""

    def wait_for_log(self, node: str, *words: str) -> None:
        self.wait_while_running(
            lambda: all(word in self.log(node) for word in words), f"'{words}' in the log of {node}"
        )

    def wait_while_running(self, happened: Callable[[], bool], what: str) -> None:
        def happened_while_running() -> bool:
            assert self.process.poll() is None, self.wait()
            return happened()

        wait_until(happened_while_running, what)


def recorded(scenario: Path) -> Record:
    """A run of the scenario, simulated in this process, and what its instruments said."""
    columns: dict[str, list[np.ndarray]] = {"time_s": [], "voltage_V": [], "displacement_m": [], "current_A": []}

    def watch(tick: Tick) -> None:
        for name, values in zip(
            columns, (tick.applied.time, tick.applied.voltage, tick.measurement, tick.applied.current), strict=True
        ):
            columns[name].append(values)

    run_in_process(load_scenario(scenario), watch)
    return Record("simulated", {name: np.concatenate(blocks) for name, blocks in columns.items()})
