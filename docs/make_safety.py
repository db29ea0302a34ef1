"""Writes docs/safety.md from the table of the safety machine: `python docs/make_safety.py`; a test checks the page."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from pzt_ros.hardware import machine
from pzt_ros.hardware.limits import Limits
from pzt_ros.hardware.machine import EVENTS, OF_THE_DEVICE, OF_THE_RUN, STATES, TABLE
from pzt_ros.quantities import parameters_of

PAGE = Path(__file__).with_name("safety.md")

HEAD = """# The safety machine

Written by `python docs/make_safety.py` from `pzt_ros/hardware/machine.py` (the table) and `limits.py` (the limits).

Between every command and the amplifier stands the guard (`pzt_ros/hardware/guard.py`), in the amplifier node, for
every driver. Safe means: ramp to 0 V at the safe rate, then nothing is put out. On hardware the amplifier's own enable
line or watchdog has to do the same when this process dies; in the simulation a relay does.

"""

RULES = """
* A fault **latches**: its first reason is kept, published in `/diagnostics` and logged, until `reset`.
* `reset` is an edge: a call while the cause is still present is refused with that cause, is not remembered, and has to
  be made again when the cause is gone. It leads to *disabled*; moving again takes `enable` as well.
* Enabling starts at the voltage **found** at the stack, so that it does not jump, whoever charged it. A stack outside
  the window is not enabled; `discharge` brings it down first.
* What is outside the window or too fast is limited and counted, not a fault. What is no block, of another size or out
  of turn is refused and counted, not a fault.
* After a driver failed, the amplifier stays *ramping*, with a voltage that is not known, and asks the driver again in
  every block period. When it answers, the ramp goes on from the voltage found, or from the last one that can have been
  put out where the readback claims more.
* A command that is late is waited for: nothing is put out meanwhile, so the stack keeps the last voltage, and the run's
  own time stands still. In real time late commands are counted, and too many of them are a fault (`late_*`); a run as
  fast as possible has no pace to miss.
* A driver may measure a temperature (`Thermometer` in `amplifier.py`); nothing is enabled or reset while it is too hot.
* The watchdog looks after each message as well as by its timer: an executor has its timers wait while messages come,
  and a flood would put it to sleep.
* Two publishers are counted by the discovery of DDS: one that was killed with -9 counts for up to 3 s more.
"""


def text() -> str:
    """The page."""
    return HEAD + _drawing() + _states() + _rules() + _causes() + _limits() + _table()


def _drawing() -> str:
    steps: dict[tuple[str, str], list[str]] = defaultdict(list)
    for state, row in TABLE.items():
        for event, step in row.items():
            if step.state != state:
                steps[state, step.state].append(event)
    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {machine.DISABLED}"]
    for (before, after), events in steps.items():
        lines.append(f"    {before} --> {after}: {_label(events)}")
    return "\n".join([*lines, "```", ""])


def _label(events: list[str]) -> str:
    """The events of one arrow; the groups of causes by their names."""
    named = []
    for group, name in ((OF_THE_RUN, "cause of the run"), (OF_THE_DEVICE, "cause of the device")):
        if set(group) <= set(events):
            events = [event for event in events if event not in group]
            named.append(name)
    return ", ".join([*events, *named])


def _states() -> str:
    lines = ["", "| state | published as | puts out | |", "| --- | --- | --- | --- |"]
    lines += [f"| {name} | `{row.shown}` | {row.puts_out} | {row.description} |" for name, row in STATES.items()]
    return "\n".join([*lines, ""])


def _rules() -> str:
    return "\n## Rules\n" + RULES


def _causes() -> str:
    run, device = ", ".join(OF_THE_RUN), ", ".join(OF_THE_DEVICE)
    return (
        f"\nCauses of the run, which count only while commands are followed: {run}. Causes of the device: {device}.\n"
    )


def _limits() -> str:
    lines = ["", "## Limits", "", "ROS parameters `limits.*` of the amplifier node, and `limits:` of a scenario.", ""]
    lines += ["| limit | default | range | |", "| --- | --- | --- | --- |"]
    for name, p in parameters_of(Limits).items():
        default = getattr(Limits(), name)
        lines.append(f"| `{name}` | {default:g} {p.unit} | {p.lower:g} to {p.upper:g} | {p.description} |")
    return "\n".join([*lines, ""])


def _table() -> str:
    lines = ["", "## Every event in every state", ""]
    lines.append(
        "The state that follows; *no* where whoever asked gets a reason instead. `.` is: stays, nothing happens."
    )
    lines += ["", f"| event | {' | '.join(STATES)} |", "| --- |" + " --- |" * len(STATES)]
    for event in EVENTS:
        cells = [_cell(state, event) for state in STATES]
        lines.append(f"| {event} | {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def _cell(state: str, event: str) -> str:
    step = TABLE[state][event]
    if step.answer:
        return "*no*"
    if event == machine.COMMAND:
        return "followed"
    return "." if step.state == state else step.state


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8")
