"""A piezo controller that speaks GCS 2.0 on a real socket, with a simulated stage behind it, and can misbehave."""

from __future__ import annotations

import contextlib
import socket
import threading
from types import TracebackType

import numpy as np

from pzt_ros.chains import load_chain
from pzt_ros.hardware.stage import SimulatedStage
from pzt_ros.physics.signals import Rest

SILENT, CLOSE, DRIBBLE, ENDLESS = "silent", "close", "dribble", "endless"
"""Ways to answer a command that are no answer; bytes are sent as they are."""

Trouble = str | bytes


class GcsServer:
    """One axis "1" on channel "1", from -30 to 130 V; `with GcsServer() as server:` listens on `server.port`.

    `trouble` maps the first word of a command to what happens instead of the proper answer. `history` is every voltage
    that was ever at the stack.
    """

    identity = "(c)2019 Physik Instrumente (PI) GmbH & Co. KG, E-000.SIMULATED, 0, 0.0"
    lowest, highest = -30.0, 130.0

    def __init__(self, voltage: float = 0.0, port: int = 0, knows_limits: bool = True) -> None:
        self.trouble: dict[str, Trouble] = {}
        self.servo = True
        self.history = [voltage]
        self.said: list[str] = []
        self.gone = threading.Event()
        self.knows_limits = knows_limits
        self.lock = threading.RLock()
        self._stage = SimulatedStage(load_chain("thesis-p2"), Rest(voltage=voltage))
        self._clock = 0.0
        self._position = 0.0
        self._error = 0
        self._connections: list[socket.socket] = []
        self._listener = socket.socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.bind(("127.0.0.1", port))
        self._listener.listen()
        self.port = self._listener.getsockname()[1]
        self._threads = [threading.Thread(target=self._accept, daemon=True)]

    def __enter__(self) -> GcsServer:
        self._threads[0].start()
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.gone.set()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.hang_up()
        for thread in self._threads:
            thread.join(5.0)
            assert not thread.is_alive(), "a thread of the simulated controller hangs"

    @property
    def voltage(self) -> float:
        """At the stack now [V]."""
        return self.history[-1]

    @property
    def position(self) -> float:
        """Of the stage [um], as POS? says it."""
        return self._position

    def hang_up(self) -> None:
        """Close every connection from this end."""
        with self.lock:
            connections, self._connections = self._connections, []
        for connection in connections:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()

    def power_cycle(self) -> None:
        """Off and on again: 0 V, servo as at power-up, nobody connected."""
        with self.lock:
            self._put(0.0)
            self.servo = True
        self.hang_up()

    # -- the conversation

    def _accept(self) -> None:
        while not self.gone.is_set():
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            with self.lock:
                self._connections.append(connection)
            self._threads.append(threading.Thread(target=self._serve, args=(connection,), daemon=True))
            self._threads[-1].start()

    def _serve(self, connection: socket.socket) -> None:
        with contextlib.suppress(OSError), connection, connection.makefile("rb") as stream:
            for raw in stream:
                command = raw.decode().strip()
                self.said.append(command)
                answer = self.trouble.get(command.split()[0])
                if answer == CLOSE:
                    return
                if answer == SILENT:
                    continue
                if answer == DRIBBLE:
                    while not self.gone.wait(0.01):
                        connection.sendall(b"1")
                if answer == ENDLESS:
                    while not self.gone.is_set():
                        connection.sendall(b"1=1.0 \n" * 100)
                connection.sendall(answer if isinstance(answer, bytes) else self._answer(command).encode())

    def _answer(self, command: str) -> str:
        word, *arguments = command.split()
        with self.lock:
            if word == "*IDN?":
                return f"{self.identity}\n"
            if word == "ERR?":
                error, self._error = self._error, 0
                return f"{error}\n"
            try:
                return self._run(word, arguments)
            except _RefusedError as refused:
                self._error = refused.code
                return ""

    def _run(self, word: str, arguments: list[str]) -> str:
        if arguments[:1] != ["1"]:
            raise _RefusedError(15)
        if word == "SVO":
            self.servo = arguments[1] == "1"
        elif word == "SVA":
            if self.servo:
                raise _RefusedError(303)
            wanted = float(arguments[1])
            if not self.lowest <= wanted <= self.highest:
                raise _RefusedError(302)
            self._put(wanted)
        elif word == "VOL?":
            return f"1={self.voltage:.7e}\n"
        elif word == "POS?":
            return f"1={self._position:.7e}\n"
        elif word in ("VMI?", "VMA?") and self.knows_limits:
            return f"1={self.lowest if word == 'VMI?' else self.highest:.4f}\n"
        else:
            raise _RefusedError(2)
        return ""

    def _put(self, voltage: float) -> None:
        """A millisecond of the stage at its new voltage."""
        self._clock += 1e-3
        truth = self._stage.step(np.array([self._clock]), np.array([voltage]))
        self._position = 1e6 * float(truth.displacement[-1])
        self.history.append(voltage)


class _RefusedError(Exception):
    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code
