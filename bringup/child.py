"""One supervised process: started, listened to, stopped."""

from __future__ import annotations

import json
import signal
import threading
import time
from pathlib import Path
from typing import Any

from pzt_bringup.nursery import NodeProcess
from pzt_bringup.processes import ProcessRow

ESCALATION = ((signal.SIGTERM, 12.0), (signal.SIGKILL, 2.0))
"""Signals in turn, each with the time [s] it gets: the first for the ramp to 0 V, and until the last blocks arrived.

To a node SIGINT would mean the same, but a Python that is still importing answers it with a traceback.
"""

_PREFIX = "PZT_STATUS "


class Child:
    """A node's process.

    What its nodes last said of themselves is in `status`, when [s, monotonic] in `heard`.
    """

    def __init__(self, row: ProcessRow, arguments: list[str], environment: dict[str, str], log: Path) -> None:
        self.row = row
        self.status: dict[str, dict[str, Any]] = {}
        self.heard: dict[str, float] = {}
        self._log = open(log, "ab")  # noqa: SIM115 - as long as the process
        self._process = NodeProcess(row.module, [*row.words, *arguments], environment, log)
        self._listener = threading.Thread(target=self._listen, name=f"listen-{row.name}", daemon=True)
        self._listener.start()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def silence(self) -> float:
        """For how long its nodes have said nothing [s]; 0 before the first word and after its end."""
        if not self.heard or self.exit_code is not None:
            return 0.0
        return time.monotonic() - max(self.heard.values())

    @property
    def exit_code(self) -> int | None:
        """None while it lives."""
        return self._process.exit_code

    def _listen(self) -> None:
        for raw in self._process.stdout:
            line = raw.decode("utf-8", "replace")
            if line.startswith(_PREFIX):
                try:
                    status = json.loads(line[len(_PREFIX) :])
                except json.JSONDecodeError:
                    continue  # the last line of a killed process
                self.status[status["node"]] = status
                self.heard[status["node"]] = time.monotonic()
            else:
                self._log.write(raw)

    def ask_to_stop(self) -> None:
        """Send the first, friendly signal."""
        self._process.send_signal(ESCALATION[0][0])

    def stop(self) -> None:
        """See to it that the process is gone."""
        for number, patience in ESCALATION:
            self._process.send_signal(number)
            if self._process.wait(patience) is not None:
                break
        self._listener.join(1.0)
        self._process.stdout.close()
        self._log.close()
