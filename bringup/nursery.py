"""Node processes by forking: one server imports the libraries of all nodes once, and a node is a fork of it.

Seven interpreters that each import the same take nine seconds on two cores; forks are there at once. The server is that
of the standard library: it has one thread, holds no ROS, and ends with the process that started it.
"""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from io import BufferedReader
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from types import ModuleType
from typing import NoReturn

_CONTEXT = multiprocessing.get_context("forkserver")


def prepare_nursery() -> None:
    """Let the server import while this process goes on with something else."""
    _CONTEXT.set_forkserver_preload(["pzt_nodes.rehearsed"])
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # inherited: Ctrl-C is for the supervisor alone
    try:
        forkserver.ensure_running()
    finally:
        signal.signal(signal.SIGINT, before)


class NodeProcess:
    """A module's `main` in a process and a session of its own; its stdout comes here, its stderr goes into a file."""

    def __init__(self, module: str, arguments: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        prepare_nursery()
        reader, writer = _CONTEXT.Pipe(duplex=False)
        self._process = _CONTEXT.Process(
            target=_be, args=(module, list(arguments), dict(environment), writer, str(log)), name=module, daemon=True
        )
        with _no_main_module():
            self._process.start()
        writer.close()
        self.stdout: BufferedReader = os.fdopen(os.dup(reader.fileno()), "rb")
        reader.close()

    @property
    def pid(self) -> int:
        """Process id."""
        assert self._process.pid is not None
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """None while it lives, below 0 after a signal."""
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        """Where there is still somebody to get it."""
        if self.exit_code is None:
            with contextlib.suppress(ProcessLookupError):  # it ended, and its server has not told yet
                os.kill(self.pid, number)

    def wait(self, patience: float | None = None) -> int | None:
        """Exit code, or None if it still lives after `patience` [s]."""
        self._process.join(patience)
        return self.exit_code


@contextlib.contextmanager
def _no_main_module() -> Iterator[None]:
    """multiprocessing would run the program that starts a graph once more in every fork; a node needs none of it."""
    here = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = here


def _be(module: str, arguments: list[str], environment: dict[str, str], stdout: Connection, log: str) -> None:
    """What a fork does: become the process that `python -m module` would be, and run it."""
    from setproctitle import setproctitle

    setproctitle(
        " ".join((sys.executable, "-m", module, *arguments))
    )  # before the environment changes: it stands there
    os.setsid()  # Ctrl-C reaches the supervisor alone, which stops the nodes in the right order
    os.dup2(stdout.fileno(), 1)
    stdout.close()
    file = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    os.dup2(file, 2)
    os.close(file)
    sys.stdout, sys.stderr = (open(fd, "w", buffering=1, closefd=False) for fd in (1, 2))  # noqa: SIM115 - for good
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = [module, *arguments]
    _leave(_exit_code(importlib.import_module(module).main))


def _exit_code(run: Callable[[], None]) -> int:
    """What the interpreter would end with after that."""
    try:
        run()
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def _leave(code: int) -> NoReturn:
    """End without what C++ libraries do at exit: a fork that has used Fast DDS without shared memory crashes in it."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):  # nobody reads it any more
            stream.flush()
    os._exit(code)
