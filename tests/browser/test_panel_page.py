"""The panel as a person uses it, in headless Chromium; pictures of it stay in the folder that PZT_SCREENSHOTS names."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import psutil
import pytest
from bench import Nodes, PanelPage, PanelProcess, chromium, needs_browser
from scenarios import POLED_QUICKLY

pytestmark = [needs_browser, pytest.mark.timeout(900)]

LOW, HIGH = 2e-6, 13.5e-6
"""Nothing the panel asks for leaves these [m]: the stage where it was found, and the end of its stroke."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    pytest.importorskip("playwright", reason="pip install 'pzt_ros[dev]' brings Playwright, which drives Chromium")
    with chromium() as found:
        yield found


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    folder = Path(os.environ.get("PZT_SCREENSHOTS", tmp_path))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def open_page(browser: Any, panel: PanelProcess, scheme: str = "light") -> PanelPage:
    page = browser.new_page(viewport={"width": 1440, "height": 900}, color_scheme=scheme)
    return PanelPage(page, panel)


def test_enable_scan_crash_reset(browser: Any, tmp_path: Path, pictures: Path) -> None:
    with Nodes(tmp_path / "nodes") as nodes:
        with PanelProcess(tmp_path, "--attach", "--domain", str(nodes.domain)) as panel:
            shown = open_page(browser, panel)
            shown.see("DISABLED")
            operate(shown, pictures)
            nodes.kill("controller")
            shown.see("FAULT", "no command for")
            shown.page.screenshot(path=pictures / "panel-fault.png")
            shown.wait("document.body.innerText.includes('✖ controller')")
            shown.click("enable")
            shown.hear("controller has been silent")
            nodes.start("controller")
            shown.click("reset")
            shown.hear("fault cleared")
            shown.see("DISABLED")
            shown.wait("document.body.innerText.includes('● controller')")
            shown.enable()
            check_held(shown)  # by a controller that knows nothing of what has been
            shown.click("jog-up")
            shown.hear("following a trajectory")
            check_page(shown, panel)
            shown.page.close()
        assert panel.process.returncode == 0, panel.said
        with PanelProcess(tmp_path, "--attach", "--domain", str(nodes.domain), "--read-only") as second:
            watching = open_page(browser, second, "dark")
            watching.see("ENABLED")  # closing the page and the panel left the stage as it was
            assert watching.page.query_selector("[data-do=enable]") is None
            watching.page.screenshot(path=pictures / "panel-read-only-dark.png")
            watching.page.close()


def operate(shown: PanelPage, pictures: Path) -> None:
    """Enable, pole, scan, hold; refused where it has to be, after the picture: that shows a day when all went well."""
    shown.click("scan")
    shown.hear("not enabled")
    shown.enable()
    shown.click("pole")
    shown.click("pole-yes")
    shown.hear("poling has begun")
    shown.see_movement(5e-6)
    shown.page.wait_for_timeout(2000)
    shown.fill(scan_cycles="50")
    shown.click("scan")
    shown.hear("following a trajectory")
    shown.page.wait_for_timeout(6000)
    for scheme, name in (("dark", "panel-dark.png"), ("light", "panel.png")):
        shown.page.emulate_media(color_scheme=scheme)
        shown.page.wait_for_timeout(500)  # until it is drawn anew
        shown.page.screenshot(path=pictures / name)
    shown.click("jog-up")
    shown.hear("still moving")
    shown.click("hold")
    shown.hear("following a trajectory for 0.000 s")
    for field, text, why in (
        ("scan_low", "-100", "outside the window"),
        ("scan_low", "", "'Lowest' is empty"),
        ("scan_size", "1e9", "amplitude of 1e+09 um is outside"),
        ("scan_rate", "1e6", "rate of 1e+06 Hz is outside"),
        ("scan_cycles", "0.5", "give a whole number"),
    ):
        good = shown.page.input_value(f"input[data-is={field.replace('_', '-')}]")
        shown.fill(**{field: text})
        shown.click("scan")
        shown.hear(why)
        shown.fill(**{field: good})


def check_held(shown: PanelPage) -> None:
    """The stage stays where it was enabled; the last of the rows are of a hold."""
    shown.page.wait_for_timeout(500)
    last = shown.rows()[-5:]
    errors = [abs(row[2] - row[1]) for row in last if row[1] is not None and row[2] is not None]
    assert errors
    assert max(errors) < 0.3e-6  # with the line of an open loop it went 3.4 um away


def check_page(shown: PanelPage, panel: PanelProcess) -> None:
    """Nothing came from elsewhere, nothing went wrong unseen, and nothing drawn left the stroke."""
    assert {urlsplit(url).netloc for url in shown.asked if not url.startswith(("data:", "blob:"))} == {
        f"127.0.0.1:{panel.port}"
    }
    assert shown.complaints == []
    measured = [row[1] for row in shown.rows() if row[1] is not None]
    assert min(measured) > LOW - 1e-6
    assert max(measured) < HIGH


def test_one_command_brings_the_graph_and_says_how_it_ended(browser: Any, tmp_path: Path, pictures: Path) -> None:
    scenario = tmp_path / "manual.yaml"
    scenario.write_text(POLED_QUICKLY)
    with PanelProcess(tmp_path, str(scenario), "--out", str(tmp_path / "run")) as panel:
        shown = open_page(browser, panel, "dark")
        shown.see("DISABLED")
        shown.page.wait_for_selector("text=SIMULATED")
        shown.enable()
        shown.click("jog-up")
        shown.hear("following a trajectory")
        shown.page.wait_for_timeout(1000)
        shown.page.screenshot(path=pictures / "panel-jog-dark.png")
        victim = next(
            process
            for process in psutil.Process(panel.process.pid).children(recursive=True)
            if any("controller_node" in word for word in process.cmdline())
        )
        victim.send_signal(signal.SIGKILL)
        shown.see(
            "GRAPH ENDED", "process 'controller' died (killed by SIGKILL); the amplifier brought the stack to 0 V"
        )
        shown.page.close()
    assert panel.process.returncode == 0, panel.said
    assert "Traceback" not in panel.said

    with PanelProcess(tmp_path, "--bag", str(tmp_path / "run" / "bag")) as replaying:
        shown = open_page(browser, replaying)
        shown.see("REPLAY OVER")
        assert shown.page.query_selector("[data-do=enable]") is None
        measured = [row[1] for row in shown.rows()]
        assert max(measured) - min(measured) > 0.4e-6  # the jog
        check_page(shown, replaying)
        shown.page.close()
