"""Several axes under one supervisor: a graph of its own for each, in one ROS domain, and one bag of all."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml

from pzt_bringup.child import Child
from pzt_bringup.plan import Plan, environment
from pzt_bringup.processes import SEPARATE
from pzt_bringup.supervisor import Interrupts, Outcome, Supervisor
from pzt_ros.errors import BenchError

RECORDER = next(row for row in SEPARATE if row.nodes == ("recorder",))


class AxesSupervisor:
    """Runs the plans of several axes, whose run folders are in one folder, with the bag of all in it.

    The run is over when the last axis is. An axis that fails, or the recorder, ends the run of all: an axis that goes
    on alone would move against a stage that stands still.
    """

    def __init__(self, plans: Sequence[Plan], folder: Path, show: Callable[[dict[str, dict[str, Any]]], None]) -> None:
        self._folder = folder
        self._show = show
        self._axes = {plan.namespace.strip("/"): Supervisor(plan, show) for plan in plans}
        self._outcomes: dict[str, Outcome] = {}
        self._recorder: Child | None = None

    def run(self) -> Outcome:
        """Start everything, wait for the end, leave nothing behind.

        Raises:
            BenchError: the folder holds a run already.
        """
        self._begin()
        with Interrupts() as interrupts:
            try:
                self._start()
                while len(self._outcomes) < len(self._axes):
                    self._look(interrupts.came)
            finally:
                for axis in self._axes.values():
                    axis.stop()
                if self._recorder is not None:
                    self._recorder.stop()
        code = max(outcome.exit_code for outcome in self._outcomes.values())
        sentence = "; ".join(f"{name}: {self._outcomes[name].sentence}" for name in self._axes)
        return Outcome(code, sentence, self._status())

    def _begin(self) -> None:
        """The folder of all, with the parameters of the recorder."""
        bag, plans = self._folder / "bag", [axis.plan for axis in self._axes.values()]
        if bag.exists():
            raise BenchError(f"{self._folder} holds a run already ({bag.name}/ is there); choose another --out")
        own = {"bag": str(bag), "axes": ",".join(plan.namespace for plan in plans), "nodes": ",".join(plans[0].nodes)}
        (self._folder / "log").mkdir(parents=True, exist_ok=True)
        (self._folder / "recorder.yaml").write_text(yaml.safe_dump({"/**": {"ros__parameters": own}}), encoding="utf-8")
        noted = {"axes": list(self._axes), "domain": plans[0].domain}
        (self._folder / "run.json").write_text(json.dumps(noted, indent=1), encoding="utf-8")

    def _start(self) -> None:
        plan = next(iter(self._axes.values())).plan
        arguments = ["--ros-args", "--params-file", str(self._folder / "recorder.yaml"), "-r", "__ns:=/"]
        self._recorder = Child(RECORDER, arguments, environment(plan), self._folder / "log" / "recorder.log")
        for axis in self._axes.values():
            axis.start()

    def _look(self, asked_to_stop: bool) -> None:
        assert self._recorder is not None
        failed = any(outcome.exit_code for outcome in self._outcomes.values())
        lost = self._recorder.exit_code is not None
        for name, axis in self._axes.items():
            if name in self._outcomes:
                continue
            outcome = axis.poll(asked_to_stop or failed or lost)
            if outcome is not None:
                axis.stop()
                why = f"process 'recorder' died; {outcome.sentence}" if lost else outcome.sentence
                self._outcomes[name] = Outcome(max(outcome.exit_code, int(lost)), why)
        self._show(self._status())

    def _status(self) -> dict[str, dict[str, Any]]:
        found = {f"{name}/{node}": said for name, axis in self._axes.items() for node, said in axis.status().items()}
        return {**found, **(self._recorder.status if self._recorder is not None else {})}
