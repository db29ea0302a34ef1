"""Starts the processes of a plan, watches them, and brings everything to a safe end."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pzt_bringup.child import Child
from pzt_bringup.plan import Plan, environment
from pzt_bringup.processes import STOP_ORDER

POLL = 0.05
"""The supervisor looks at its processes this often [s]."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended: exit code, one sentence, and what the nodes last said of themselves."""

    exit_code: int
    sentence: str
    status: dict[str, dict[str, Any]] = field(default_factory=dict)


class Supervisor:
    """Runs one plan.

    The run is over when the process of the experiment ends. A process that dies before is a failure: the amplifier is
    stopped first and ramps to 0 V, and if it was the amplifier itself, the stack's own relay is waited for.
    """

    def __init__(self, plan: Plan, show: Callable[[dict[str, dict[str, Any]]], None]) -> None:
        self.plan = plan
        self._show = show
        self._children: dict[str, Child] = {}
        self._interrupted = False

    def run(self) -> Outcome:
        """Start everything, wait for the end, leave nothing behind."""
        before = {s: signal.signal(s, self._on_signal) for s in (signal.SIGINT, signal.SIGTERM)}
        try:
            self._start()
            outcome = self._watch()
        finally:
            self._stop_all()
            for number, handler in before.items():
                signal.signal(number, handler)
        return Outcome(outcome.exit_code, outcome.sentence, self._status())

    def _on_signal(self, _number: int, _frame: Any) -> None:
        self._interrupted = True

    def _start(self) -> None:
        env = environment(self.plan)
        arguments = ["--ros-args", "--params-file", str(self.plan.parameter_file), "-r", f"__ns:={self.plan.namespace}"]
        for row in self.plan.processes:
            self._children[row.name] = Child(row, arguments, env, self.plan.log(row.name))

    def _status(self) -> dict[str, dict[str, Any]]:
        return {node: status for child in self._children.values() for node, status in child.status.items()}

    def _watch(self) -> Outcome:
        last = next(reversed(self._children))  # the one that holds the experiment
        while True:
            time.sleep(POLL)
            self._show(self._status())
            if self._interrupted:
                return Outcome(0, f"stopped on request; {self._make_safe()}")
            dead = [name for name, child in self._children.items() if child.exit_code is not None]
            if dead:
                return self._ended(dead, last)

    def _ended(self, dead: list[str], last: str) -> Outcome:
        code = self._children[dead[0]].exit_code
        if dead == [last] and code == 0:
            return Outcome(0, "run complete")
        safe = self._make_safe()
        if code == 2 or (dead == [last] and code == 1):
            return Outcome(code, self._last_words(dead[0]))
        return Outcome(1, f"process '{dead[0]}' died ({_how(code)}); {safe}; see {self.plan.log(dead[0])}")

    def _last_words(self, name: str) -> str:
        """The last line a process wrote that names an error."""
        self._children[name].stop()
        lines = self.plan.log(name).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        errors = [line for line in lines if "error" in line.lower()] or lines
        return errors[-1].removeprefix("error: ") if errors else f"process '{name}' gave up without a word"

    def _make_safe(self) -> str:
        """Commands end, the amplifier ramps to 0 V, or its relay is waited for; says what is known of the stack."""
        for name in ("experiment", "controller"):
            if name in self._children:
                self._children[name].ask_to_stop()
        holder = self._children.get("amplifier") or self._children["graph"]
        if holder.exit_code is None:
            holder.stop()
            if holder.status.get("amplifier", {}).get("stack_voltage_V") == 0.0:
                return "the amplifier brought the stack to 0 V"
        elif "plant" in self._children and self._discharged_by_relay():
            return "the amplifier's relay discharged the stack"
        return "nobody is left who knows the voltage of the stack: look at the amplifier"

    def _discharged_by_relay(self) -> bool:
        """Wait until the plant says 0 V; what it said before the amplifier died does not count."""
        plant = self._children["plant"]
        died = time.monotonic()
        deadline = died + self.plan.scenario.limits.declared_safe_time + 5.0
        while plant.exit_code is None and time.monotonic() < deadline:
            if plant.heard.get("plant", 0.0) > died and plant.status["plant"]["stack_voltage_V"] == 0.0:
                return True
            time.sleep(POLL)
        return False

    def _stop_all(self) -> None:
        for name in STOP_ORDER:
            if name in self._children:
                self._children[name].stop()


def _how(code: int | None) -> str:
    if code is not None and code < 0:
        return f"killed by {signal.Signals(-code).name}"
    return f"exit code {code}"
