"""The bringup as a process under test."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any

import psutil

from pzt_bringup.domain import take_domain

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

PATIENCE = 60.0
"""Nothing in these tests takes this long [s] unless it hangs."""


def free_domain() -> int:
    """A ROS domain nobody uses now."""
    lock = take_domain(None)
    lock.release()
    return lock.domain


class GraphProcess:
    """`python -m pzt_bringup` with a run folder of its own; killed with all its nodes if a test fails."""

    def __init__(self, scenario: Path | str, folder: Path, *options: str) -> None:
        self.folder = folder
        command = [sys.executable, "-m", "pzt_bringup", str(scenario), "--out", str(folder)]
        self.process = subprocess.Popen(
            [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )

    def __enter__(self) -> GraphProcess:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        for process in [*self.nodes(), psutil.Process(self.process.pid)] if self.process.poll() is None else []:
            process.kill()
        self.process.wait()
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()

    @cached_property
    def domain(self) -> int:
        """The ROS domain that the bringup took; known before its nodes start."""

        def noted() -> bool:
            with contextlib.suppress(FileNotFoundError, json.JSONDecodeError):  # not there yet, or half of it
                return "domain" in self.run_json()
            assert self.process.poll() is None, self.wait()
            return False

        wait_until(noted, "the domain in run.json")
        return int(self.run_json()["domain"])

    def nodes(self) -> list[psutil.Process]:
        """The processes of the graph."""
        children = psutil.Process(self.process.pid).children(recursive=True)
        return [child for child in children if "-m pzt_nodes." in _title(child)]

    def node(self, name: str) -> psutil.Process:
        """The process of one node."""
        return next(p for p in self.nodes() if f"-m pzt_nodes.{name}" in _title(p))

    def interrupt(self) -> None:
        """Ctrl-C, which a terminal sends to all that it has in the foreground."""
        os.killpg(self.process.pid, signal.SIGINT)

    def wait(self) -> tuple[int, str]:
        """Exit code and what was said on stderr."""
        _, said = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, said

    def run_json(self) -> dict[str, Any]:
        """What the run folder says of the run."""
        return json.loads((self.folder / "run.json").read_text(encoding="utf-8"))


def _title(process: psutil.Process) -> str:
    with contextlib.suppress(psutil.NoSuchProcess):
        return " ".join(process.cmdline())
    return ""


def _status(process: psutil.Process) -> str | None:
    """What it is doing; None if it is no more."""
    # it may end between the two questions
    with contextlib.suppress(psutil.NoSuchProcess):
        return process.status() if process.is_running() else None
    return None


def wait_until(happened: Callable[[], bool], what: str, patience: float = PATIENCE) -> None:
    """Wait for a condition; fail, naming it, if it does not come true."""
    deadline = time.monotonic() + patience
    while not happened():
        assert time.monotonic() < deadline, f"waited {patience:.0f} s in vain: {what}"
        time.sleep(0.01)


def alive(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Those that still run."""
    return [process for process in processes if _status(process) not in (None, psutil.STATUS_ZOMBIE)]
