"""What the browser tests stand on: the panel as a process, nodes that nobody supervises, and a page in Chromium."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import pytest
from scenarios import POLED_QUICKLY

from pzt_bringup.domain import take_domain
from pzt_bringup.plan import Plan, environment, prepare
from pzt_bringup.processes import STOP_ORDER
from pzt_ros.first_run import compile_once
from pzt_ros.scenario import REAL_TIME, load_scenario

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip

needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium is installed: apt install chromium, then these tests run"
)

PATIENCE = 120.0
"""Nothing in these tests takes this long [s] unless it hangs."""


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class PanelProcess:
    """`pzt panel` with options, on a port of its own; ended with Ctrl-C, pressed twice, killed if that does not do."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.port = free_port()
        self.log = folder / f"panel-{self.port}.log"
        pzt = Path(sys.executable).with_name("pzt")
        # NiceGUI takes a process that inherits these for one of its own tests
        inherited = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [str(pzt), "panel", *options, "--port", str(self.port), "--no-browser"],
                stdout=log, stderr=log, cwd=folder, env=inherited, start_new_session=True,
            )  # fmt: skip

    @property
    def said(self) -> str:
        """On stdout and stderr."""
        return self.log.read_text()

    def __enter__(self) -> PanelProcess:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.send_signal(signal.SIGINT)  # as the impatient do
        try:
            self.process.wait(30.0)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            raise


class Nodes:
    """A graph without a supervisor: a node that is killed stays dead until somebody starts it again."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True)
        scenario = folder / "manual.yaml"
        scenario.write_text(POLED_QUICKLY)
        self._lock = take_domain(None)
        self.domain = self._lock.domain
        self._plan = Plan(load_scenario(scenario), folder / "run", False, REAL_TIME, None, self.domain)
        prepare(self._plan)
        compile_once(self._plan.scenario, print)
        self._rows = {row.name: row for row in self._plan.processes}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        for name in self._rows:
            self.start(name)

    def start(self, name: str) -> None:
        """Start a node."""
        command = [sys.executable, "-m", self._rows[name].module, "--ros-args"]
        command += ["--params-file", str(self._plan.parameter_file), "-r", "__ns:=/stage"]
        with self._plan.log(f"{name}-{time.monotonic():.0f}").open("w") as log:
            self._processes[name] = subprocess.Popen(
                command,
                env={**environment(self._plan), "PZT_STATUS": ""},
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def kill(self, name: str) -> None:
        """As a crash would."""
        self._processes[name].kill()
        self._processes[name].wait()

    def __enter__(self) -> Nodes:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        for name in (name for together in STOP_ORDER for name in together if name in self._processes):
            self._processes[name].send_signal(signal.SIGINT)
            try:
                self._processes[name].wait(15.0)
            except subprocess.TimeoutExpired:
                self.kill(name)
        self._lock.release()


class PanelPage:
    """The page in a browser: what a person sees and clicks."""

    def __init__(self, page: Any, panel: PanelProcess) -> None:
        from playwright.sync_api import Error

        self.page = page
        self.asked: list[str] = []
        self.complaints: list[str] = []
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", lambda line: self.complaints.append(line.text) if line.type == "error" else None)
        page.set_default_timeout(1e3 * PATIENCE)
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                page.goto(f"http://127.0.0.1:{panel.port}/")
                break
            except Error:
                assert time.monotonic() < deadline, f"the panel does not answer: {panel.said}"
                time.sleep(0.2)
        self.complaints.clear()  # of attempts before the server was up

    @contextmanager
    def patience(self, wanted: str) -> Iterator[None]:
        """Where something never comes, say what the page showed instead."""
        from playwright.sync_api import TimeoutError as TooLong

        try:
            yield
        except TooLong as error:
            shows = " | ".join(self.page.inner_text("body").split("\n"))
            raise AssertionError(f"waited {PATIENCE:g} s for {wanted}; the page shows: {shows}") from error

    def wait(self, condition: str, **options: Any) -> None:
        """Wait until that holds in the page."""
        with self.patience(condition):
            self.page.wait_for_function(condition, **options)

    def see(self, headline: str, reason: str = "") -> None:
        """Wait until the banner says that."""
        self.wait(
            "([h, r]) => document.querySelector('[data-is=headline]')?.textContent === h"
            " && document.querySelector('[data-is=reason]').textContent.includes(r)",
            arg=[headline, reason],
        )

    def click(self, do: str) -> None:
        """Press a button."""
        with self.patience(f"a button '{do}' that can be pressed"):
            self.page.click(f"[data-do={do}]")

    def fill(self, **fields: str) -> None:
        """Type into fields, named by their `data-is` with underscores."""
        for name, text in fields.items():
            self.page.fill(f"input[data-is={name.replace('_', '-')}]", text)

    def hear(self, words: str) -> None:
        """Wait until the newest answer has these words."""
        deadline = time.monotonic() + PATIENCE
        while words not in (said := self.words()).split("\n")[0]:
            assert time.monotonic() < deadline, f"waited for the answer '{words}', the last ones are: {said}"
            self.page.wait_for_timeout(50)

    def counts(self) -> dict[str, int]:
        """Of the plots: rows pushed, drawings."""
        return self.page.evaluate("getElement(document.querySelector('.scope').id.slice(1)).counts()")

    def rows(self) -> list[list[float | None]]:
        """What is drawn now."""
        return self.page.evaluate("getElement(document.querySelector('.scope').id.slice(1)).rows")

    def enable(self) -> None:
        """Press Enable, once, and wait until blocks flow: by then every node knows."""
        before = self.counts()["pushed"]
        self.click("enable")
        self.hear("amplifier enabled")
        self.see("ENABLED")
        self.wait("n => getElement(document.querySelector('.scope').id.slice(1)).counts().pushed >= n + 5", arg=before)

    def words(self) -> str:
        """What the page answered last."""
        return str(self.page.inner_text("[data-is=words]"))

    def see_movement(self, least: float) -> None:
        """Wait until the measured displacement in the plot spans `least` [m], and the plot goes on being drawn."""
        self.wait(
            "least => { const rows = getElement(document.querySelector('.scope').id.slice(1)).rows.map((r) => r[1]);"
            " return Math.max(...rows) - Math.min(...rows) >= least; }",
            arg=least,
        )
        before = self.counts()["drawn"]
        self.wait("n => getElement(document.querySelector('.scope').id.slice(1)).counts().drawn >= n + 10", arg=before)


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser without a screen."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        try:
            yield browser
        finally:
            browser.close()
