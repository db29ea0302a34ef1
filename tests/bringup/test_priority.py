"""The loop runs before others in real time, where the system allows it; the recorder does not, and nobody has to."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pzt_bringup.plan import Plan, environment
from pzt_nodes.priority import PRIORITY
from pzt_ros.scenario import RATES, REAL_TIME, load_scenario

ASK = "from pzt_nodes.priority import *; take_priority(); print(priority())"


def answer(wanted: str, before: str = "") -> str:
    """What a process of its own has, that was wanted to have a priority or not."""
    environment = {**os.environ, "PZT_PRIORITY": wanted}
    done = subprocess.run([sys.executable, "-c", before + ASK], env=environment, capture_output=True, text=True)
    assert done.stderr == ""
    return done.stdout.strip()


def is_allowed() -> bool:
    """Whether a process may have one here."""
    return subprocess.run(["chrt", "-r", str(PRIORITY), "true"], capture_output=True).returncode == 0


def test_only_the_loop_asks_and_only_in_real_time(tmp_path: Path) -> None:
    paced = Plan(load_scenario("scan"), tmp_path, False, REAL_TIME, None, 1)
    assert environment(paced, in_loop=True)["PZT_PRIORITY"] == "1"
    assert "PZT_PRIORITY" not in environment(paced)
    for other in (dataclasses.replace(paced, priority=False), dataclasses.replace(paced, rate=RATES[0])):
        assert "PZT_PRIORITY" not in environment(other, in_loop=True)


def test_nobody_has_it_unasked() -> None:
    assert answer("") == "normal"


@pytest.mark.skipif(not is_allowed(), reason="no real-time priority allowed here")
def test_who_asks_has_it_and_who_has_one_keeps_it() -> None:
    assert answer("1") == f"SCHED_RR {PRIORITY}"
    assert answer("1", "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(40)); ") == "SCHED_FIFO 40"


def test_where_it_is_not_allowed_the_process_goes_on_without() -> None:
    rights_given_up = (
        "import os, resource; from pzt_nodes.priority import *; resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0)); "
        "os.getuid() or os.setuid(65534); "
    )
    assert answer("1", rights_given_up) == "normal"
