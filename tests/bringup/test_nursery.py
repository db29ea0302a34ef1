"""Nodes as forks: what a process of one is like from outside."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from pzt_bringup.domain import take_domain
from pzt_bringup.nursery import NodeProcess
from pzt_ros.ros_environment import ros_environment

PATIENCE = 30.0


Start = Callable[..., NodeProcess]


@pytest.fixture
def node(tmp_path: Path) -> Iterator[Start]:
    """Starts a module that stands in the folder; whatever it does, it is gone in the end."""
    started: list[NodeProcess] = []

    def start(module: str, *arguments: str, **environment: str) -> NodeProcess:
        started.append(NodeProcess(module, arguments, {**os.environ, **environment}, tmp_path / "log"))
        return started[-1]

    yield start
    for process in started:
        process.send_signal(signal.SIGKILL)
        process.wait(PATIENCE)
        process.stdout.close()


def program(tmp_path: Path, body: str) -> str:
    """A module with a `main`, found by the fork in the folder that its environment names."""
    lines = "\n".join(f"    {line}" for line in body.splitlines())
    (tmp_path / "little.py").write_text(f"import os, sys, time\n\ndef main():\n{lines}\n", encoding="utf-8")
    sys.path.insert(0, str(tmp_path))
    return "little"


@pytest.fixture(autouse=True)
def _path() -> Iterator[None]:
    before = list(sys.path)
    yield
    sys.path[:] = before


def test_it_has_arguments_environment_streams_and_a_session_of_its_own(node: Start, tmp_path: Path) -> None:
    said = 'print(sys.argv[1:], os.environ["COLOUR"], os.getsid(0) == os.getpid())\nprint("broken", file=sys.stderr)'
    process = node(program(tmp_path, said), "one", "two", COLOUR="blue")
    assert process.stdout.read().decode() == "['one', 'two'] blue True\n"
    assert process.wait(PATIENCE) == 0
    assert (tmp_path / "log").read_text(encoding="utf-8") == "broken\n"


@pytest.mark.parametrize(
    ("body", "code"),
    [("sys.exit(3)", 3), ("sys.exit()", 0), ("sys.exit('no')", 1), ("raise ValueError('x')", 1), ("return", 0)],
)
def test_it_ends_as_a_program_does(node: Start, tmp_path: Path, body: str, code: int) -> None:
    process = node(program(tmp_path, body))
    assert process.wait(PATIENCE) == code
    assert ("ValueError: x" in (tmp_path / "log").read_text(encoding="utf-8")) == ("ValueError" in body)


def test_a_signal_is_seen_in_the_exit_code_and_the_name_in_the_process_list(node: Start, tmp_path: Path) -> None:
    process = node(program(tmp_path, 'print("here", flush=True)\ntime.sleep(60)'), "--some", "words")
    assert process.stdout.readline() == b"here\n"
    assert process.exit_code is None
    assert " ".join(psutil.Process(process.pid).cmdline()).strip() == f"{sys.executable} -m little --some words"
    process.send_signal(signal.SIGKILL)
    assert process.wait(PATIENCE) == -signal.SIGKILL
    process.send_signal(signal.SIGTERM)  # to nobody


def test_the_program_that_starts_a_node_is_not_run_again_in_it(tmp_path: Path) -> None:
    """A script that starts a graph need not hide behind `if __name__ == "__main__"`."""
    program(tmp_path, "pass")
    (tmp_path / "script.py").write_text(
        "import os\nfrom pathlib import Path\nfrom pzt_bringup.nursery import NodeProcess\nprint('begun', flush=True)\n"
        "process = NodeProcess('little', [], dict(os.environ), Path('log'))\nprint(process.wait(30.0))\n"
        "process.stdout.close()\n",
        encoding="utf-8",
    )
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert (done.stdout, done.stderr) == ("begun\n0\n", "")


@pytest.mark.parametrize("role", ["sensor", "amplifier", "observer"])
def test_a_node_that_has_ended_has_left_dds_for_good(node: Start, tmp_path: Path, role: str) -> None:
    """What is left to the process' own end races with the threads of DDS: one exit in a hundred was SIGABRT."""
    body = (
        "import psutil\n"
        f"from pzt_nodes.{role}_node import {role.title()}Node as Node\n"
        "from pzt_nodes.spin import run\n"
        "code = run([Node])\n"
        "print('left', code, psutil.Process().net_connections('udp'), flush=True)"
    )
    lock = take_domain(None)
    process = node(program(tmp_path, body), PZT_STATUS="1", **ros_environment(tmp_path / "ros", lock.domain))
    assert process.stdout.readline().startswith(b"PZT_STATUS")
    process.send_signal(signal.SIGTERM)
    said = process.stdout.read().decode().splitlines()
    lock.release()
    assert (said[-1], process.wait(PATIENCE)) == ("left 0 []", 0)


@pytest.mark.parametrize("moment", [0.3, 0.9])
def test_ctrl_c_while_everything_is_imported_says_nothing(tmp_path: Path, moment: float) -> None:
    """A terminal sends it to the server as well, which has not yet begun to ignore it by itself."""
    command = [sys.executable, "-m", "pzt_bringup", "scan", "--out", str(tmp_path / "run")]
    program = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    time.sleep(moment)
    os.killpg(program.pid, signal.SIGINT)
    said, _ = program.communicate(timeout=PATIENCE)
    assert "Traceback" not in said
