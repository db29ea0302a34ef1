"""The safety machine: every state times every event, against rules that were written down apart from the table."""

from __future__ import annotations

import pytest

from pzt_ros.hardware import machine as m
from pzt_ros.hardware.machine import DISABLED, ENABLED, FAULT, RAMPING, TRIPPED, SafetyMachine

PAIRS = [(state, event) for state in m.STATES for event in m.EVENTS]


def expected(state: str, event: str) -> str:
    """The state that follows, from the rules in words:

    only a disabled amplifier is enabled, and only where no cause is present; a command changes no state; whatever goes
    wrong while commands are followed trips, what is wrong with the device trips always; what is tripped goes to 0 V and
    stays there until it is reset with no cause present; who is asked to be safe goes to 0 V.
    """
    if state == FAULT:
        return DISABLED if event == m.RESET else FAULT
    if state == TRIPPED:
        return FAULT if event == m.AT_ZERO else TRIPPED
    if event in m.OF_THE_DEVICE or (event in m.OF_THE_RUN and state == ENABLED):
        return TRIPPED
    if state == RAMPING:
        return DISABLED if event == m.AT_ZERO else RAMPING
    if event == m.DISCHARGE or (event == m.DISABLE and state == ENABLED):
        return RAMPING
    if event == m.ENABLE:
        return ENABLED
    return state


def machine_in(state: str) -> SafetyMachine:
    """A machine that got there by events alone."""
    ways = {
        DISABLED: [],
        ENABLED: [m.ENABLE],
        RAMPING: [m.ENABLE, m.DISABLE],
        TRIPPED: [m.ENABLE, m.OVER_CURRENT],
        FAULT: [m.ENABLE, m.OVER_CURRENT, m.AT_ZERO],
    }
    machine = SafetyMachine()
    for event in ways[state]:
        machine.handle(event, "too much")
    assert machine.state == state
    return machine


def test_the_table_has_every_pair_and_nothing_else() -> None:
    assert set(m.TABLE) == set(m.STATES)
    for state, row in m.TABLE.items():
        assert set(row) == set(m.EVENTS), state
        for step in row.values():
            assert step.state in m.STATES
    assert len(PAIRS) == 5 * 23
    assert len(set(m.EVENTS)) == len(m.EVENTS)


@pytest.mark.parametrize(("state", "event"), PAIRS)
def test_every_event_in_every_state(state: str, event: str) -> None:
    machine = machine_in(state)
    answer = machine.handle(event, "two publishers")
    after = expected(state, event)
    assert machine.state == after
    assert bool(answer) == refused(state, event)
    assert "{" not in answer
    if after in (TRIPPED, FAULT):
        assert machine.reason == ("too much" if state in (TRIPPED, FAULT) else "two publishers")
    else:
        assert machine.reason == ""
    assert machine.shown == ("ramping" if after == TRIPPED else after)


def refused(state: str, event: str) -> bool:
    """Whether whoever asked gets a reason instead of what was asked for."""
    if event == m.COMMAND:
        return state != ENABLED
    if event in (m.ENABLE, m.ENABLE_EARLY):
        return state not in (DISABLED, ENABLED) or (state == DISABLED and event == m.ENABLE_EARLY)
    if event in (m.RESET, m.RESET_EARLY):
        return state != FAULT or event == m.RESET_EARLY
    return False


@pytest.mark.parametrize("state", m.STATES)
def test_only_a_reset_leads_out_of_a_fault(state: str) -> None:
    """Every way from tripped or fault to enabled goes through a reset."""
    reachable, frontier = {TRIPPED}, {TRIPPED}
    while frontier:
        frontier = {step.state for s in frontier for event, step in m.TABLE[s].items() if event != m.RESET} - reachable
        reachable |= frontier
    assert reachable == {TRIPPED, FAULT}
    assert (state in reachable) == (state in (TRIPPED, FAULT))


def test_commands_are_followed_in_one_state_only() -> None:
    assert [state for state in m.STATES if not m.TABLE[state][m.COMMAND].answer] == [ENABLED]
    assert [state for state, row in m.STATES.items() if row.puts_out == "commands"] == [ENABLED]
