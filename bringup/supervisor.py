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
from pzt_ros.bags.continuity import MISSING
from pzt_ros.ros_environment import orphaned

POLL = 0.05
"""The supervisor looks at its processes this often [s]."""
HUNG = 3.0
"""A process whose nodes say nothing of themselves for so long [s] hangs; they do so every second."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended: exit code, one sentence, and what the nodes last said of themselves."""

    exit_code: int
    sentence: str
    status: dict[str, dict[str, Any]] = field(default_factory=dict)


class Interrupts:
    """Ctrl-C and SIGTERM, while `with` lasts: remembered, and no more; a run that nobody is left to stop ends, too."""

    def __init__(self) -> None:
        self._asked = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interrupts:
        self._before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, _number: int, _frame: Any) -> None:
        self._asked = True

    @property
    def came(self) -> bool:
        """Whether the run is to end."""
        return self._asked or orphaned()


class Supervisor:
    """Runs one plan.

    The run is over when the process of the experiment ends. A process that dies before is a failure: the amplifier is
    stopped first and ramps to 0 V, and if it was the amplifier itself, the stack's own relay is waited for.
    """

    def __init__(self, plan: Plan, show: Callable[[dict[str, dict[str, Any]]], None]) -> None:
        self.plan = plan
        self._show = show
        self._children: dict[str, Child] = {}
        self._hung: set[str] = set()
        self._looked = self._awake = time.monotonic()

    def run(self) -> Outcome:
        """Start everything, wait for the end, leave nothing behind."""
        with Interrupts() as interrupts:
            try:
                self.start()
                while (outcome := self.poll(interrupts.came)) is None:
                    self._show(self.status())
            finally:
                self.stop()
        said = outcome.sentence + self._bad_ends(outcome.sentence) + self._gaps()
        return Outcome(outcome.exit_code, said, self.status())

    def start(self) -> None:
        """Start every process of the plan."""
        arguments = ["--ros-args", "--params-file", str(self.plan.parameter_file), "-r", f"__ns:={self.plan.namespace}"]
        for row in self.plan.processes:
            env = environment(self.plan, in_loop=row.nodes != ("recorder",))
            self._children[row.name] = Child(row, arguments, env, self.plan.log(row.name))

    def status(self) -> dict[str, dict[str, Any]]:
        """What each node last said of itself."""
        return {node: status for child in self._children.values() for node, status in child.status.items()}

    def poll(self, asked_to_stop: bool) -> Outcome | None:
        """Look at the processes after a moment; how the run ended, once it has and the stack is safe."""
        time.sleep(POLL)
        self._look_for_hangs()
        if asked_to_stop:
            return Outcome(0, f"stopped on request; {self._make_safe()}")
        last = next(reversed(self._children))  # the one that holds the experiment
        dead = [name for name, child in self._children.items() if child.exit_code is not None]
        return self._ended(dead, last) if dead else None

    def _ended(self, dead: list[str], last: str) -> Outcome:
        code = self._children[dead[0]].exit_code
        if dead == [last] and code == 0:
            return Outcome(0, "run complete")
        safe = self._make_safe()
        if code == 2 or (dead == [last] and code == 1):
            return Outcome(code, self._last_words(dead[0]) + self._hangs())
        died = f"process '{dead[0]}' died ({_how(code)}); {safe}; see {self.plan.log(dead[0])}"
        return Outcome(1, died + self._hangs())

    def _look_for_hangs(self) -> None:
        now = time.monotonic()
        if now - self._looked > 1.0:
            self._awake = now  # the whole machine stood still, or this process: nobody can be blamed yet
        self._looked = now
        if now - self._awake > HUNG:
            self._hung |= {name for name, child in self._children.items() if child.silence > HUNG}

    def _hangs(self) -> str:
        """Processes that lived and said nothing: what the amplifier misses need not be what hangs."""
        return "".join(f"; process '{name}' hung for more than {HUNG:g} s" for name in sorted(self._hung))

    def _gaps(self) -> str:
        """What the recorder could not keep up with."""
        missing = sum(status.get(MISSING, 0) for status in self.status().values())
        return f"; {missing} {MISSING}, see {self.plan.log('recorder')}" if missing else ""

    def _bad_ends(self, said: str) -> str:
        """Processes that crashed or were killed after all, which nobody would notice otherwise; SIGTERM is ours."""
        codes = {name: child.exit_code or 0 for name, child in self._children.items()}
        return "".join(
            f"; process '{name}' ended badly ({_how(code)}), see {self.plan.log(name)}"
            for name, code in codes.items()
            if code < 0 and code != -signal.SIGTERM and f"'{name}' died" not in said
        )

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
        if "amplifier" not in holder.status:
            return "the amplifier had not started"
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

    def stop(self) -> None:
        """See to it that no process is left."""
        for together in STOP_ORDER:
            children = [self._children[name] for name in together if name in self._children]
            for child in children:
                child.ask_to_stop()
            for child in children:
                child.stop()


def _how(code: int | None) -> str:
    if code is not None and code < 0:
        return f"killed by {signal.Signals(-code).name}"
    return f"exit code {code}"
