"""What a person sees of a running graph: one line per node, with state and rate."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

from pzt_config.topics import NODES

STYLES = {"ok": "green", "warn": "yellow", "error": "red"}


class TerminalView:
    """A table that is kept up to date in a terminal; in a pipe, a line whenever a node's state changes."""

    def __init__(self, title: str, quiet: bool = False) -> None:
        self._title = title
        self._quiet = quiet
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, refresh_per_second=4, transient=True)
        self._last: dict[str, str] = {}

    def __enter__(self) -> TerminalView:
        if self._console.is_terminal and not self._quiet:
            self._live.start()
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._live.stop()

    def show(self, status: dict[str, dict[str, Any]]) -> None:
        """Take in the latest status of every node."""
        if self._quiet:
            return
        if self._console.is_terminal:
            self._live.update(self._table(status))
            return
        for node, said in status.items():
            state = str(said["state"])
            if self._last.get(node) != state and not state.startswith("waiting"):
                self._last[node] = state
                print(f"{node}: {state}", file=sys.stderr)

    def _table(self, status: dict[str, dict[str, Any]]) -> Table:
        table = Table(title=f"{self._title}{_progress(status)}", title_justify="left")
        for column in ("node", "state", "blocks/s", "blocks"):
            table.add_column(column, justify="right" if column.startswith("blocks") else "left")
        for node in NODES if set(status) <= set(NODES) else status:
            said = status.get(node)
            if said is None:
                table.add_row(node, "starting", "", "")
            else:
                style = STYLES.get(said["level"], "")
                rate = f"{said['ticks_per_second']:.0f}"
                table.add_row(node, f"[{style}]{said['state']}[/]", rate, str(said["ticks"]))
        return table


def _progress(status: dict[str, dict[str, Any]]) -> str:
    said = status.get("experiment", {})
    if not said.get("run_length_s"):  # an operator says how long
        return f"   {said['phase']}" if "phase" in said else ""
    return f"   {said['run_time_s']:.1f} of {said['run_length_s']:.1f} s, {said['phase']}"
