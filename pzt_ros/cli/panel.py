"""`pzt panel`: a page in the browser that shows a stage live and lets it be operated."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pzt_ros.cli.graph import graph_command, run_folder
from pzt_ros.errors import BenchError, RunFailedError
from pzt_ros.graphs import running_graphs
from pzt_ros.ros_environment import ros_environment

if TYPE_CHECKING:
    from pzt_ros.panel.board import Board
    from pzt_ros.panel.serve import Beside

START_TIMEOUT = 20.0
"""A graph that has not begun to start after this time [s] never will."""


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(panel)


def panel(
    scenario: Annotated[str, typer.Argument(help="scenario: shipped name or path of a YAML file")] = "manual",
    attach: Annotated[bool, typer.Option("--attach", help="join a graph that runs already")] = False,
    bag: Annotated[Path | None, typer.Option(help="replay a recorded bag instead, at its own pace")] = None,
    domain: Annotated[int | None, typer.Option(help="ROS domain; a free one, or of the one graph that runs")] = None,
    namespace: Annotated[str, typer.Option(help="namespace of the axis")] = "/stage",
    out: Annotated[Path | None, typer.Option(help="run folder of the graph; runs/SCENARIO-TIME by default")] = None,
    drivers: Annotated[Path | None, typer.Option(help="YAML file of instruments; simulated ones by default")] = None,
    host: Annotated[
        str, typer.Option(help="address to bind to; any but this machine's own needs a token")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="port of the page", min=1, max=65535)] = 8080,
    read_only: Annotated[bool, typer.Option("--read-only", help="show, and command nothing")] = False,
    browser: Annotated[bool, typer.Option(help="open the page in a browser")] = True,
) -> None:
    """Show a stage live in the browser, and operate it by hand.

    Starts the graph of a scenario in real time and the page beside it; Ctrl-C ends both, the stage at 0 V. With
    --attach it joins a graph that runs, and leaves it as it is; with --bag it replays a recorded run.

    Example: pzt panel
    """
    _refuse_what_does_not_fit(attach, bag, out, drivers, domain)
    serve = _serve()
    from pzt_ros.panel.access import HERE, new_token

    token = "" if host in HERE else new_token()
    _say_address(host, port, token)
    page = {"host": host, "port": port, "token": token, "show": browser}
    with _ended_by_signals():
        if bag is not None:
            from pzt_ros.panel.replay import BagFeed

            serve(BagFeed(bag, namespace), **page)
        elif attach:
            serve(_node_feed(_domain_to_join(domain), namespace, read_only), **page)
        else:
            folder = run_folder(out, scenario, False)
            options = {"--domain": domain, "--namespace": namespace, "--drivers": drivers}
            command = graph_command(scenario, folder, options, {"--real-time": True, "--quiet": True})
            with _graph(command) as process:
                joined = _domain_of(process, folder)
                typer.echo(f"graph in ROS domain {joined}, process {process.pid}, recorded in {folder}", err=True)
                feed = _node_feed(joined, namespace, read_only)
                serve(feed, **page, beside=_watch(process, folder))


def _refuse_what_does_not_fit(
    attach: bool, bag: Path | None, out: Path | None, drivers: Path | None, domain: int | None
) -> None:
    if attach and bag is not None:
        raise BenchError("--attach and --bag exclude each other: a graph that runs, or a recorded one")
    if (attach or bag is not None) and (out or drivers):
        raise BenchError(
            "--out and --drivers belong to a graph that is started; leave them out with --attach and --bag"
        )
    if bag is not None and domain is not None:
        raise BenchError("a bag has no ROS domain; leave out --domain")


def _serve() -> Any:
    try:
        from pzt_ros.panel.serve import serve
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "nicegui":
            raise
        raise BenchError("the panel needs NiceGUI, which is not installed; pip install 'pzt_ros[panel]'") from None
    return serve


def _say_address(host: str, port: int, token: str) -> None:
    shown = f"[{host}]" if ":" in host else host
    typer.echo(f"panel at http://{shown}:{port}/{f'?token={token}' if token else ''}  (Ctrl-C ends it)", err=True)


def _node_feed(domain: int, namespace: str, read_only: bool) -> Any:
    from pzt_ros.panel.feed import NodeFeed

    command = [sys.executable, "-m", "pzt_nodes.panel_node", "--ros-args", "-r", f"__ns:={namespace}"]
    command += ["-p", f"read_only:='{str(read_only).lower()}'"]
    logs = Path(os.environ.get("ROS_LOG_DIR", Path.home() / ".ros" / "log"))
    return NodeFeed(command, ros_environment(logs, domain), read_only)


def _domain_to_join(wanted: int | None) -> int:
    """The domain asked for, else of the one graph that runs here, else the shell's."""
    running = list(running_graphs())
    if wanted is not None:
        return wanted
    if len(running) > 1:
        raise BenchError(f"graphs run in the ROS domains {', '.join(map(str, running))}; name one with --domain")
    return running[0] if running else int(os.environ.get("ROS_DOMAIN_ID", "0") or 0)


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """SIGTERM ends the panel as Ctrl-C does, with all that has to be tidied up."""

    def interrupt(_number: int, _frame: Any) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _graph(command: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """The graph as a process, brought to a safe end with the panel."""
    process = subprocess.Popen(command)  # a panel that is killed leaves it as it is
    try:
        yield process
    finally:
        with _undisturbed():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            process.wait()


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Ctrl-C or SIGTERM once more is ignored: the way to 0 V is not left to itself."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _domain_of(process: subprocess.Popen[bytes], folder: Path) -> int:
    """The domain that the bringup took, as it notes in its run folder.

    Raises:
        RunFailedError: it gave up; it has said why.
    """
    deadline = time.monotonic() + START_TIMEOUT
    while time.monotonic() < deadline and process.poll() is None:
        noted = _noted(folder)
        if "domain" in noted:
            return int(noted["domain"])
        time.sleep(0.05)
    raise RunFailedError("the graph did not start, so there is nothing to show")


def _noted(folder: Path) -> dict[str, Any]:
    try:
        return dict(json.loads((folder / "run.json").read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}  # not there yet, or half written


def _watch(process: subprocess.Popen[bytes], folder: Path) -> Beside:
    """Says on the board that the graph starts, and how it ended, if it does."""
    from pzt_ros.panel.safety import BEGINNING

    async def watch(board: Board) -> None:
        board.unheard = BEGINNING
        while process.poll() is None:
            await asyncio.sleep(0.2)
        outcome = _noted(folder).get("outcome", {})
        sentence = outcome.get("sentence", f"the bringup ended with exit code {process.returncode}")
        board.end("off" if process.returncode == 0 else "fault", "GRAPH ENDED", f"{sentence}; start the panel again")

    return watch
