"""The live panel beside a graph: frames a second, what page and node cost, and what the graph's ticks notice of them.

One graph follows a scan in real time; windows without a panel, with one that nobody looks at, with one whose page is on
another computer (its websocket is here, and drained; no browser is), with one whose browser draws in what processor
time the others leave, and with one that draws beside the graph as any program would, take turns in the same run: what a
browser takes is not the panel's. The ticks are timed by the bag: from the plant's truth to the amplifier's answer to
it.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from subprocess import PIPE
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pzt_benchmarks.bag_ticks import ticks_in
from pzt_benchmarks.table import Table
from pzt_bringup.domain import take_domain
from pzt_ros.errors import BenchError, RunFailedError
from pzt_ros.panel.board import Board
from pzt_ros.panel.feed import NodeFeed
from pzt_ros.panel.motion import scan
from pzt_ros.panel.priority import LOWEST
from pzt_ros.panel.safety import waits_for
from pzt_ros.ros_environment import ros_environment

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")

SETTLE, START_TIMEOUT = 5.0, 60.0
"""Nothing is measured for so long after a panel came or went; what is not there by then never will be [s]."""

WITHOUT, UNSEEN, AWAY = "no panel", "panel, no page", "panel, page elsewhere"
POLITE, DRAWN = "panel, page draws, lowest priority", "panel, page draws"
KINDS = (WITHOUT, UNSEEN, AWAY, POLITE, DRAWN)
"""Of windows."""

SCENARIO = """
scenario: manual, for the panel's benchmark
plant: bench-stage
model: thesis-p2
rate: real time
controllers: {inverse_pi: {integral_gain: 100 1/s}}
limits: {command_timeout: 2 s, late_commands: 0}
manual: {poling_ramp: 0.3 s, poling_hold: 0.2 s}
"""


@dataclass(frozen=True)
class Window:
    """One stretch of the run.

    Attributes:
        begin, end: on the wall clock [ns].
        frames: pushed to the page, and drawn by it, a second; 0 without a page.
        page, node, browser: processor time over time, of one core.
    """

    begin: int
    end: int
    pushed: float = 0.0
    drawn: float = 0.0
    page: float = 0.0
    node: float = 0.0
    browser: float = 0.0


def measure(quick: bool, tell: Callable[[str], None]) -> list[Table]:
    """Windows without and with the panel in turn, over one run.

    Raises:
        BenchError: no Chromium, or no Playwright to drive it.
    """
    if CHROMIUM is None:
        raise BenchError("this benchmark opens the page in Chromium, and there is none; apt install chromium")
    length, turns = (8.0, 2) if quick else (20.0, 4)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with _graph(folder) as domain:
            asyncio.run(_begin_scan(domain, folder))
            windows: dict[str, list[Window]] = {kind: [] for kind in KINDS}
            for turn in range(turns):
                for kind in windows:
                    tell(f"{kind}, {turn + 1} of {turns}")
                    with _panel(domain, folder, kind) if kind != WITHOUT else nullcontext() as page:
                        time.sleep(SETTLE)
                        windows[kind].append(_watch(page, length))
        ticks = ticks_in(folder / "run" / "bag")
    return [_cost(windows), _effect(windows, *ticks)]


# -- the graph


@contextmanager
def _graph(folder: Path) -> Iterator[int]:
    """The graph, in a ROS domain of its own."""
    scenario = folder / "manual.yaml"
    scenario.write_text(SCENARIO, encoding="utf-8")
    lock = take_domain(None)
    lock.release()
    words = [str(scenario), "--out", str(folder / "run"), "--domain", str(lock.domain), "--quiet"]
    process = subprocess.Popen([sys.executable, "-m", "pzt_bringup", *words])
    try:
        yield lock.domain
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


async def _begin_scan(domain: int, folder: Path) -> None:
    """Enable, pole, and scan for longer than the measurement lasts; who asked for it goes, the scan goes on."""
    command = [sys.executable, "-m", "pzt_nodes.panel_node", "--ros-args", "-r", "__ns:=/stage"]
    board, feed = Board(), NodeFeed(command, ros_environment(folder / "log", domain), read_only=False)
    running = asyncio.create_task(feed.run(board))
    await _until(lambda: bool(board.health) and not waits_for(board.health), "the graph")
    await _granted(feed, do="enable", value=True)
    await _until(lambda: board.here is not None and board.envelope is not None, "the first blocks")
    await _granted(feed, do="pole")
    await asyncio.sleep(4.0)
    assert board.here is not None
    assert board.envelope is not None
    points = scan(board.envelope, board.here, shape="triangle", low=6e-6, peak_to_peak=4e-6, rate=0.5, cycles=199)
    await _granted(feed, do="trajectory", points=points)
    await feed.close()
    await running


async def _until(happened: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + START_TIMEOUT
    while not happened():
        if time.monotonic() > deadline:
            raise RunFailedError(f"{what} did not come within {START_TIMEOUT:.0f} s; is the machine too busy?")
        await asyncio.sleep(0.05)


async def _granted(feed: NodeFeed, **request: Any) -> None:
    answer = await feed.ask(request)
    if not answer.granted:
        raise RunFailedError(f"'{request['do']}' was refused: {answer.message}")


# -- the panel


@dataclass(frozen=True)
class _Page:
    """A page that is open, and the processes that show it.

    Attributes:
        shown_by: the processes.
        counts: frames pushed to the page and drawn by it, so far.
        wait: for a while [s]; Playwright wants to be waited with.
    """

    shown_by: list[int]
    counts: Callable[[], dict[str, int]]
    wait: Callable[[float], None] = time.sleep


@dataclass(frozen=True)
class _Panel:
    """The panel's two processes, and the page, if one is open."""

    pid: int
    page: _Page | None


@contextmanager
def _panel(domain: int, folder: Path, kind: str) -> Iterator[_Panel]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    words = ["panel", "--attach", "--domain", str(domain), "--port", str(port), "--no-browser"]
    with open(folder / "panel.log", "a", encoding="utf-8") as log:
        panel = subprocess.Popen([str(Path(sys.executable).with_name("pzt")), *words], stdout=log, stderr=log)
    try:
        _wait_for_server(port)
        with _page(port, kind) as page:
            yield _Panel(panel.pid, page)
    finally:
        panel.send_signal(signal.SIGINT)
        panel.wait()


def _page(port: int, kind: str) -> AbstractContextManager[_Page | None]:
    if kind == UNSEEN:
        return nullcontext()
    return _elsewhere(port) if kind == AWAY else _in_chromium(port, polite=kind == POLITE)


@contextmanager
def _elsewhere(port: int) -> Iterator[_Page]:
    """The other end of a page's websocket; what it costs here is the other computer's."""
    command = [sys.executable, "-m", "pzt_benchmarks.page_elsewhere", str(port)]
    with subprocess.Popen(command, stdin=PIPE, stdout=PIPE, text=True, bufsize=1, start_new_session=True) as page:
        assert page.stdin is not None
        assert page.stdout is not None
        asking, answering = page.stdin, page.stdout

        def counts() -> dict[str, int]:
            asking.write("\n")
            return {"pushed": int(answering.readline()), "drawn": 0}

        _stand_back([page.pid])
        counts()  # it is there
        yield _Page([page.pid], counts)
        asking.close()


@contextmanager
def _in_chromium(port: int, *, polite: bool) -> Iterator[_Page]:
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        raise BenchError("this benchmark drives Chromium with Playwright; pip install playwright") from None
    with sync_playwright() as playwright:
        before = set(_descendants(os.getpid()))
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(f"http://127.0.0.1:{port}/")
        page.wait_for_function("document.querySelector('[data-is=headline]')?.textContent === 'ENABLED'", timeout=60e3)
        processes = sorted(set(_descendants(os.getpid())) - before)
        if polite:
            _stand_back(processes)
        count = "getElement(document.querySelector('.scope').id.slice(1)).counts()"
        yield _Page(processes, lambda: page.evaluate(count), lambda seconds: page.wait_for_timeout(1e3 * seconds))
        browser.close()


def _stand_back(processes: list[int]) -> None:
    """Their session gets the least share of time there is (sched(7), autogroup)."""
    for pid in processes:
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, pid, LOWEST)
            if os.getsid(pid) != os.getsid(0):
                Path(f"/proc/{pid}/autogroup").write_text(str(LOWEST), encoding="ascii")


def _wait_for_server(port: int) -> None:
    deadline = time.monotonic() + START_TIMEOUT
    with socket.socket() as probe:
        while probe.connect_ex(("127.0.0.1", port)):
            if time.monotonic() > deadline:
                raise RunFailedError("the panel's server does not answer; is the machine too busy?")
            time.sleep(0.2)


def _watch(panel: _Panel | None, length: float) -> Window:
    """Frames and processor time over a window of `length` [s]."""
    begin, started = time.time_ns(), time.monotonic()
    if panel is None:
        time.sleep(length)
        return Window(begin, time.time_ns())
    page = panel.page or _Page([], lambda: {"pushed": 0, "drawn": 0})
    groups = {"page": [panel.pid], "node": _descendants(panel.pid), "browser": page.shown_by}
    counts, spent = page.counts(), {name: _processor_time(pids) for name, pids in groups.items()}
    page.wait(length)
    after, took = page.counts(), time.monotonic() - started
    shares = {name: (_processor_time(pids) - spent[name]) / took for name, pids in groups.items()}
    frames = {name: (after[name] - counts[name]) / took for name in ("pushed", "drawn")}
    return Window(begin, time.time_ns(), **frames, **shares)


def _descendants(pid: int) -> list[int]:
    found = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in task.read_text(encoding="ascii").split():
            found += [int(child), *_descendants(int(child))]
    return found


def _processor_time(pids: list[int]) -> float:
    """User and system time of processes [s]; one that has ended counts nothing."""
    total = 0.0
    for pid in pids:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        except OSError:
            continue
        total += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return total


# -- the figures


def _cost(windows: dict[str, list[Window]]) -> Table:
    heads = ("windows", "frames/s to the page", "drawn/s", "page", "node", "page and node", "what shows it")
    rows = [
        (
            kind, f"{w.pushed:.1f}", f"{w.drawn:.1f}", _percent(w.page), _percent(w.node),
            _percent(w.page + w.node), _percent(w.browser),
        )
        for kind in KINDS[1:]
        for w in windows[kind]
    ]  # fmt: skip
    note = "Shares of one core. The browser is headless and draws in software; with a graphics card it costs less."
    return Table("The live panel", heads, rows, note)


def _effect(windows: dict[str, list[Window]], when: NDArray[np.int64], took: NDArray[np.float64]) -> Table:
    heads = ("", "ticks", "median ms", "of each window", "99 % ms", "of each window")
    rows = []
    for kind, ones in windows.items():
        parts = [took[(when >= w.begin) & (when < w.end)] for w in ones]
        every = np.concatenate(parts)
        middle, late = np.percentile(every, (50.0, 99.0))
        of_windows = [", ".join(f"{np.percentile(part, share):.2f}" for part in parts) for share in (50.0, 99.0)]
        rows.append((kind, str(len(every)), f"{middle:.2f}", of_windows[0], f"{late:.2f}", of_windows[1]))
    note = (
        "The graph's answer to a block in real time: from truth to the next block applied, as the recorder heard them. "
        "Windows take turns in one run; how far windows of one kind lie apart is what cannot be told."
    )
    return Table("The graph's tick beside the panel", heads, rows, note)


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def main() -> None:
    """`python -m pzt_benchmarks.panel [--quick]`."""
    from pzt_benchmarks.__main__ import run

    run(["panel"], "--quick" in sys.argv, None, "python -m pzt_benchmarks.panel")


if __name__ == "__main__":
    main()
