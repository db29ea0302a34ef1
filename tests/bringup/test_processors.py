"""A composed loop in real time has a processor of its own, and all else of the graph keeps off it."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pzt_bringup.plan import Plan, environment
from pzt_ros.processors import OTHERS, OWN, processors, shared_out
from pzt_ros.scenario import RATES, REAL_TIME, load_scenario

ALLOWED = sorted(os.sched_getaffinity(0))
ASK = """
import threading
from pzt_ros.processors import *
keep_to_others()
said = [processors()]
go = threading.Event()
thread = threading.Thread(target=lambda: (go.wait(), said.append(processors())))
thread.start()
take_own()
said.append(processors())
go.set()
thread.join()
print(*said)
"""


def answers(**wanted: str) -> list[str]:
    """Where a process may run before DDS starts, where the thread of the loop may, and a thread started before."""
    done = subprocess.run([sys.executable, "-c", ASK], env={**os.environ, **wanted}, capture_output=True, text=True)
    assert done.stderr == ""
    return done.stdout.split()


def test_the_loop_has_one_and_the_others_share_the_rest() -> None:
    assert shared_out({3, 1, 2}, in_loop=True) == {OTHERS: "1,2", OWN: "3"}
    assert shared_out({3, 1, 2}, in_loop=False) == {OTHERS: "1,2"}
    assert shared_out({0}, in_loop=True) == {}


@pytest.mark.skipif(len(ALLOWED) < 2, reason="one processor only")
def test_only_a_composed_loop_in_real_time_has_its_own(tmp_path: Path) -> None:
    paced = Plan(load_scenario("scan"), tmp_path, True, REAL_TIME, None, 1)
    assert environment(paced, in_loop=True)[OWN] == str(ALLOWED[-1])
    assert OWN not in environment(paced)
    assert environment(paced)[OTHERS] == ",".join(map(str, ALLOWED[:-1]))
    for change in ({"composed": False}, {"rate": RATES[0]}, {"own_recorder": False}):
        assert OTHERS not in environment(dataclasses.replace(paced, **change), in_loop=True)


@pytest.mark.skipif(len(ALLOWED) < 2, reason="one processor only")
def test_threads_started_before_stay_with_the_others() -> None:
    low, high = str(ALLOWED[0]), str(ALLOWED[-1])
    assert answers(**{OTHERS: low, OWN: high}) == [low, high, low]
    assert answers(**{OTHERS: low}) == [low, low, low]


def test_nothing_changes_unasked_or_where_there_is_no_such_processor() -> None:
    everywhere = ",".join(map(str, ALLOWED))
    assert answers() == [everywhere] * 3
    assert answers(**{OTHERS: "4096", OWN: "x"}) == [everywhere] * 3
    assert processors() == everywhere
