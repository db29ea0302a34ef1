"""The PI General Command Set 2.0 over TCP: one line asked, one or more lines answered.

A line ends with LF; of an answer of several lines all but the last have a space before it. A command without question
mark is answered by nothing, so each is followed by `ERR?`, which tells the error of the last command and clears it.
Sources: PI user manual E727T0005 "GCS Commands"; PI's public PIPython for the line ends and the default port.
"""

from __future__ import annotations

import contextlib
import math
import re
import socket
import sys
import time

from pzt_ros.hardware.driver import DriverError

PORT = 50000

MEANINGS = {
    1: "the parameters of the command are malformed",
    2: "the controller does not know this command",
    3: "the command is too long",
    5: "the servo is in the wrong mode for this move",
    7: "the position is outside the controller's limits",
    8: "the velocity is outside the controller's limits",
    10: "the controller was stopped",
    15: "there is no such axis",
    17: "a parameter is out of range",
    23: "this axis is not allowed here",
    24: "the number of parameters is wrong",
    25: "a number is malformed",
    26: "a parameter is missing",
    301: "the controller's send buffer overflowed",
    302: "the voltage is outside the controller's limits",
    303: "open-loop motion is not allowed while the servo is on",
    304: "the command is too long for the controller's buffer",
    307: "the controller received no complete command in time",
    333: "internal hardware error of the controller",
}
"""What the commonest error codes of a controller mean, in our words."""

_LONGEST_LINE = 65_536
_MOST_LINES = 1000
_CHUNK = 4096
_ERROR_CODE = re.compile(r"-?\d{1,5}")


class GcsConnection:
    """One TCP connection to a controller.

    Every wait is bounded by `timeout`. After anything but a proper answer the connection is dropped, because nobody
    knows which question the next line would answer; the next call connects anew, at most once per `retry_after`.

    Args:
        host, port: of the controller.
        timeout: for connecting, and for one answer from its first to its last byte [s].
        retry_after: pause between attempts to connect [s].
    """

    def __init__(self, host: str, port: int, timeout: float, retry_after: float = 1.0) -> None:
        self.name = f"{host}:{port}"
        self._address = (host, port)
        self._timeout = timeout
        self._retry_after = retry_after
        self._socket: socket.socket | None = None
        self._received = b""
        self._next_attempt = 0.0
        self._trouble = ""

    @property
    def connected(self) -> bool:
        """Whether there is a connection, as far as is known."""
        return self._socket is not None

    def connect(self) -> None:
        """Connect, unless that was tried a moment ago.

        Raises:
            DriverError: nobody answers there.
        """
        now = time.monotonic()
        if now < self._next_attempt:
            raise DriverError(f"{self._trouble}; trying again in {self._next_attempt - now:.1f} s")
        self._next_attempt = now + self._retry_after
        try:
            self._socket = socket.create_connection(self._address, self._timeout)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as error:
            raise self._failed(f"cannot be reached ({_told(error)}); is it on, and is this its address?") from None
        self._received = b""

    def allow_attempt(self) -> None:
        """The next attempt may be made at once: somebody asked for it."""
        self._next_attempt = 0.0

    def close(self) -> None:
        """Drop the connection; may be called from another thread, and again."""
        connection, self._socket = self._socket, None
        if connection is not None:
            with contextlib.suppress(OSError):  # it is gone already
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()

    def exchange(self, *commands: str) -> list[list[str]]:
        """Send commands in one packet; the lines of the answer to each that is a question.

        Raises:
            DriverError: no connection, or no proper answer in time.
        """
        if self._socket is None:
            self.connect()
        self._received += self._waiting()
        if self._received:
            raise self._failed(f"said '{_shortened(self._received.decode('latin-1'))}' unasked")
        self._send("".join(f"{command}\n" for command in commands))
        deadline = time.monotonic() + self._timeout
        return [self._answer(command, deadline) for command in commands if command.split()[0].endswith("?")]

    def tell(self, command: str, *questions: str) -> list[list[str]]:
        """Send a command, see that it was accepted, and ask the questions; returns the lines of their answers.

        Raises:
            DriverError: as `exchange`, or the controller reports an error.
        """
        accepted, *answers = self.exchange(command, "ERR?", *questions)
        if len(accepted) != 1 or not _ERROR_CODE.fullmatch(accepted[0].strip()):
            said = _shortened(" / ".join(accepted))
            raise self._failed(f"answered '{said}' to 'ERR?' after '{command}', expected a number")
        error = int(accepted[0])
        if error:
            meaning = MEANINGS.get(error, "see the manual of the controller")
            raise DriverError(f"controller {self.name} refused '{command}' with error {error}: {meaning}")
        return answers

    def number_if_known(self, question: str, item: str) -> float | None:
        """The number in an answer `item=number`, or None where the controller does not know the question.

        A question that is not known is answered by nothing; the code of `ERR?` behind it then comes first.

        Raises:
            DriverError: as `number`.
        """
        self._send(f"{question} {item}\nERR?\n")
        deadline = time.monotonic() + self._timeout
        answer = self._answer(question, deadline)
        if "=" not in answer[0]:
            return None
        self._answer("ERR?", deadline)
        return self.number(question, item, answer)

    def number(self, question: str, item: str, answer: list[str] | None = None) -> float:
        """The number in an answer `item=number`; asks for it unless the answer is given.

        Raises:
            DriverError: as `exchange`, or the answer is anything else.
        """
        lines = self.exchange(f"{question} {item}")[0] if answer is None else answer
        name, equals, text = lines[0].partition("=")
        try:
            if len(lines) != 1 or name.strip() != item or not equals:
                raise ValueError
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            said = _shortened(" / ".join(lines))
            raise self._failed(f"answered '{said}' to '{question} {item}', expected '{item}=' and a number")
        return value

    # -- inside

    def _waiting(self) -> bytes:
        """What has come since the last answer."""
        try:
            connection = self._open_socket()
            connection.settimeout(0.0)
            return connection.recv(_CHUNK)
        except OSError:  # nothing has; if the connection is broken, sending will tell
            return b""

    def _send(self, text: str) -> None:
        try:
            connection = self._open_socket()
            connection.settimeout(self._timeout)
            connection.sendall(text.encode("ascii"))
        except OSError as error:
            raise self._failed(f"took no command ({_told(error)})") from None

    def _open_socket(self) -> socket.socket:
        connection = self._socket
        if connection is None:  # another thread has closed it
            raise ConnectionAbortedError(0, "the driver was closed")
        return connection

    def _answer(self, question: str, deadline: float) -> list[str]:
        lines: list[str] = []
        while len(lines) < _MOST_LINES:
            line = self._line(question, deadline)
            lines.append(line.rstrip(" \r"))
            if not line.endswith(" "):
                return lines
        raise self._failed(f"answers '{question}' without end ({len(lines)} lines)")

    def _line(self, question: str, deadline: float) -> str:
        while b"\n" not in self._received:
            self._receive(question, deadline)
        line, _, self._received = self._received.partition(b"\n")
        try:
            return line.decode("ascii")
        except UnicodeDecodeError:
            raise self._failed(f"answered {_shortened(repr(line))} to '{question}', which is no text") from None

    def _receive(self, question: str, deadline: float) -> None:
        if len(self._received) > _LONGEST_LINE:
            raise self._failed(f"answers '{question}' without end ({len(self._received)} bytes and no line end)")
        late = f"gave no complete answer to '{question}' within {self._timeout:g} s"
        left = deadline - time.monotonic()
        if left <= 0.0:
            raise self._failed(late)
        try:
            connection = self._open_socket()
            connection.settimeout(left)
            _acknowledge_at_once(connection)
            data = connection.recv(_CHUNK)
        except TimeoutError:
            raise self._failed(late) from None
        except OSError as error:
            raise self._failed(f"broke off before it answered '{question}' ({_told(error)})") from None
        if not data:
            raise self._failed(f"closed the connection before it answered '{question}'")
        self._received += data

    def _failed(self, what: str) -> DriverError:
        """Drop the connection; the error to raise."""
        self.close()
        self._trouble = f"controller {self.name} {what}"
        return DriverError(self._trouble)


def _acknowledge_at_once(connection: socket.socket) -> None:
    """Else a controller that sends two answers in two packets waits 40 ms for us before the second (measured)."""
    if sys.platform == "linux":
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)


def _told(error: OSError) -> str:
    return str(error.strerror or error)


def _shortened(text: str) -> str:
    text = text if text.isprintable() else repr(text)[1:-1]
    return text if len(text) <= 60 else text[:57] + "..."
