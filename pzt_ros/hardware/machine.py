"""The safety machine of the amplifier as a table: where every event leads from every state.

The table is data: the guard walks it, the tests go through all of it, and docs/safety.md is drawn from it.
"""

from __future__ import annotations

from dataclasses import dataclass

DISABLED, ENABLED, RAMPING, TRIPPED, FAULT = "disabled", "enabled", "ramping", "tripped", "fault"


@dataclass(frozen=True)
class StateRow:
    """A state: as others see it, what is put out in it, and one sentence."""

    shown: str
    puts_out: str
    description: str


STATES: dict[str, StateRow] = {
    DISABLED: StateRow("disabled", "nothing", "at rest; the stack keeps the voltage it has, 0 V after a ramp"),
    ENABLED: StateRow("enabled", "commands", "follows the commands, inside the limits"),
    RAMPING: StateRow("ramping", "ramp to 0 V", "on the way to 0 V because it was asked to"),
    TRIPPED: StateRow("ramping", "ramp to 0 V", "on the way to 0 V because of a fault, whose reason is kept"),
    FAULT: StateRow("fault", "nothing", "at 0 V; stays until it is reset after the cause is gone"),
}
"""A tripped amplifier says `ramping` with a reason, one that was disabled says `ramping` without."""

COMMAND, ENABLE, ENABLE_EARLY = "command", "enable", "enable while a cause is present"
DISABLE, DISCHARGE = "disable", "discharge"
RESET, RESET_EARLY = "reset", "reset while a cause is present"
AT_ZERO = "0 V reached"
ASKED = (COMMAND, ENABLE, ENABLE_EARLY, DISABLE, DISCHARGE, RESET, RESET_EARLY)

NOT_FINITE, TOO_OLD, SILENT, SENDERS = "command not a number", "command too old", "commands silent", "two publishers"
OVER_CURRENT, OVER_POWER, DRIVER_FAILED, ASKED_FAULT = "over-current", "over-power", "driver failed", "fault reported"
OPEN_STACK, OVER_TEMPERATURE = "stack takes no charge", "over-temperature"
SENSOR_LOST, SENSOR_NOT_FINITE = "sensor lost", "sensor not a number"
SENSOR_STUCK, DISCREPANCY = "sensor stuck", "observer and sensor disagree"
LATE = "commands late too often"

OF_THE_RUN = (NOT_FINITE, TOO_OLD, SILENT, LATE, SENDERS, SENSOR_LOST, SENSOR_NOT_FINITE, SENSOR_STUCK, DISCREPANCY)
"""Causes that matter only where commands are followed."""
OF_THE_DEVICE = (OVER_CURRENT, OVER_POWER, OVER_TEMPERATURE, OPEN_STACK, DRIVER_FAILED, ASKED_FAULT)
"""Causes that matter in every state."""
CAUSES = OF_THE_RUN + OF_THE_DEVICE

EVENTS = (*ASKED, AT_ZERO, *CAUSES)


@dataclass(frozen=True)
class Step:
    """What an event does in a state: the state that follows, and the answer to whoever asked; none if it was granted.

    An answer may use {state}, {reason} and {cause}.
    """

    state: str
    answer: str = ""


_NO_COMMAND = "amplifier is {state}"
_NOT_YET = "cannot enable: ramping to 0 V; wait until it is there"
_NOT_YET_TRIPPED = "cannot enable: ramping to 0 V ({reason}); wait until it is there"
_RESET_FIRST = "cannot enable: fault ({reason}); reset first"
_NO_ENABLE = "cannot enable: {cause}"
_NO_RESET = "cannot reset: {cause}; see to that first, then reset again"
_NOTHING = "nothing to reset: the amplifier is {state}"

TABLE: dict[str, dict[str, Step]] = {
    DISABLED: {
        COMMAND: Step(DISABLED, _NO_COMMAND),
        ENABLE: Step(ENABLED),
        ENABLE_EARLY: Step(DISABLED, _NO_ENABLE),
        DISABLE: Step(DISABLED),
        DISCHARGE: Step(RAMPING),
        RESET: Step(DISABLED, _NOTHING),
        RESET_EARLY: Step(DISABLED, _NOTHING),
        AT_ZERO: Step(DISABLED),
        **dict.fromkeys(OF_THE_RUN, Step(DISABLED)),
        **dict.fromkeys(OF_THE_DEVICE, Step(TRIPPED)),
    },
    ENABLED: {
        COMMAND: Step(ENABLED),
        ENABLE: Step(ENABLED),
        ENABLE_EARLY: Step(ENABLED),
        DISABLE: Step(RAMPING),
        DISCHARGE: Step(RAMPING),
        RESET: Step(ENABLED, _NOTHING),
        RESET_EARLY: Step(ENABLED, _NOTHING),
        AT_ZERO: Step(ENABLED),
        **dict.fromkeys(CAUSES, Step(TRIPPED)),
    },
    RAMPING: {
        COMMAND: Step(RAMPING, _NO_COMMAND),
        ENABLE: Step(RAMPING, _NOT_YET),
        ENABLE_EARLY: Step(RAMPING, _NOT_YET),
        DISABLE: Step(RAMPING),
        DISCHARGE: Step(RAMPING),
        RESET: Step(RAMPING, _NOTHING),
        RESET_EARLY: Step(RAMPING, _NOTHING),
        AT_ZERO: Step(DISABLED),
        **dict.fromkeys(OF_THE_RUN, Step(RAMPING)),
        **dict.fromkeys(OF_THE_DEVICE, Step(TRIPPED)),
    },
    TRIPPED: {
        COMMAND: Step(TRIPPED, _NO_COMMAND),
        ENABLE: Step(TRIPPED, _NOT_YET_TRIPPED),
        ENABLE_EARLY: Step(TRIPPED, _NOT_YET_TRIPPED),
        DISABLE: Step(TRIPPED),
        DISCHARGE: Step(TRIPPED),
        RESET: Step(TRIPPED, _NOTHING),
        RESET_EARLY: Step(TRIPPED, _NOTHING),
        AT_ZERO: Step(FAULT),
        **dict.fromkeys(CAUSES, Step(TRIPPED)),
    },
    FAULT: {
        COMMAND: Step(FAULT, _NO_COMMAND),
        ENABLE: Step(FAULT, _RESET_FIRST),
        ENABLE_EARLY: Step(FAULT, _RESET_FIRST),
        DISABLE: Step(FAULT),
        DISCHARGE: Step(FAULT),
        RESET: Step(DISABLED),
        RESET_EARLY: Step(FAULT, _NO_RESET),
        AT_ZERO: Step(FAULT),
        **dict.fromkeys(CAUSES, Step(FAULT)),
    },
}
"""Every state times every event."""


class SafetyMachine:
    """Walks the table and keeps the reason of the first cause until the fault is reset."""

    def __init__(self) -> None:
        self.state = DISABLED
        self.reason = ""

    @property
    def shown(self) -> str:
        """The state as it is published."""
        return STATES[self.state].shown

    def handle(self, event: str, why: str = "") -> str:
        """Take in one event; `why` is the reason of a cause, or what is in the way. Returns the answer."""
        step = TABLE[self.state][event]
        answer = step.answer.format(state=self.shown, reason=self.reason, cause=why)
        if step.state == TRIPPED and self.state != TRIPPED:
            self.reason = why
        elif step.state == DISABLED:
            self.reason = ""
        self.state = step.state
        return answer
