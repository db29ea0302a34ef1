"""The page: a bar, the safety state, the plots, the controls, and how every node is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from nicegui import ui

from pzt_ros.panel.board import Board
from pzt_ros.panel.controls import Controls
from pzt_ros.panel.feed import Feed
from pzt_ros.panel.frames import Row
from pzt_ros.panel.reports import REPORT_PATH, Reports
from pzt_ros.panel.safety import SILENT_AFTER
from pzt_ros.panel.scope import Scope, loop_plots, time_plots

STYLE = Path(__file__).with_name("panel.css")

REFRESH = 0.2
"""Words are looked at this often [s]; plots come with the frames."""

SIGNS = {"ok": "●", "warn": "▲", "error": "✖"}
"""Of a node's level: told apart by shape."""

THEMES = {None: ("brightness_auto", "as the system"), False: ("light_mode", "light"), True: ("dark_mode", "dark")}


class Page:
    """One open page over the board. It keeps nothing that another page, or the stage, would miss."""

    def __init__(self, board: Board, feed: Feed, reports: Reports) -> None:
        self._board = board
        self._reports = reports
        self._about = dict(board.about)
        self._nodes: dict[str, tuple[ui.label, ui.label]] = {}
        ui.add_css(STYLE)
        self._dark = ui.dark_mode(None)
        with ui.element("main").classes("panel"):
            self._bar(feed)
            self._banner()
            self._scope = Scope(board, [*time_plots(), *loop_plots(board.about)])
            self._controls = Controls(board, feed)
            self._footer()
        self.refresh()
        ui.timer(REFRESH, self.refresh)

    def show(self, rows: list[Row]) -> None:
        """New rows have come."""
        self._scope.show(rows)

    # -- parts

    def _bar(self, feed: Feed) -> None:
        with ui.element("header").classes("bar"):
            ui.label("pzt panel").classes("brand")
            self._axis = ui.label().classes("axis")
            self._simulated = ui.label("SIMULATED").classes("badge")
            self._source = ui.label().classes("badge hollow")
            ui.label("READ-ONLY").classes("badge hollow").set_visibility(feed.read_only)
            ui.element("span").classes("space")
            self._theme = ui.button(on_click=self._next_theme, color=None).props("flat dense round data-do=theme")
            self._show_theme()

    def _banner(self) -> None:
        with ui.element("section").classes("banner").props("role=status aria-live=assertive") as self._state:
            self._sign = ui.label().classes("sign")
            self._headline = ui.label().classes("headline").props("data-is=headline")
            self._reason = ui.label().classes("reason").props("data-is=reason")

    def _footer(self) -> None:
        with ui.element("footer").classes("nodes") as self._foot:
            self._ticks = ui.label().classes("ticks").props("data-is=ticks")
            self._report = ui.link("", REPORT_PATH, new_tab=True).classes("report")

    # -- kept up to date

    def refresh(self) -> None:
        """Words and signs; NiceGUI sends only what has changed."""
        board, shown = self._board, self._board.safety
        self._axis.set_text(str(board.about.get("namespace", "")))
        self._simulated.set_visibility(board.simulated)
        self._source.set_text(str(board.about.get("source", "")))
        self._source.set_visibility(bool(board.about.get("source")))
        self._state.classes(replace=f"banner banner-{shown.look}")
        self._sign.set_text(shown.sign)
        self._headline.set_text(shown.headline)
        self._reason.set_text(shown.reason)
        self._controls.refresh()
        for node, said in board.health.items():
            self._show_node(node, said)
        self._ticks.set_text(tick_words(board.health))
        self._report.set_text(self._reports.words)
        if self._about != board.about:
            self._about = dict(board.about)
            self._scope.redefine([*time_plots(), *loop_plots(board.about)])

    def _show_node(self, node: str, said: dict[str, Any]) -> None:
        if node not in self._nodes:
            with self._foot, ui.element("div").classes("node") as entry:
                sign, text = ui.label(), ui.label().classes("said")
            entry.move(target_index=sum(known < node for known in self._nodes))  # by name, whoever spoke first
            self._nodes[node] = sign, text
        sign, text = self._nodes[node]
        silent = self._board.age(node) > SILENT_AFTER and self._board.ended is None
        sign.set_text(f"{'✖' if silent else SIGNS.get(said['level'], '?')} {node}")
        text.set_text(f"silent for {self._board.age(node):.0f} s" if silent else node_words(said))

    # -- theme

    def _next_theme(self) -> None:
        order = list(THEMES)
        self._dark.value = order[(order.index(self._dark.value) + 1) % len(order)]
        self._show_theme()

    def _show_theme(self) -> None:
        icon, words = THEMES[self._dark.value]
        self._theme.set_icon(icon)
        self._theme.props(f'aria-label="theme: {words}" title="theme: {words}"')


def node_words(said: dict[str, Any]) -> str:
    """What a node says, and how often it ticks."""
    rate = str(said["values"].get("ticks_per_second", ""))
    counted = said["level"] == "ok" and rate.replace(".", "", 1).isdigit()
    return f"{said['text']}, {float(rate):.0f}/s" if counted else str(said["text"])


def tick_words(health: dict[str, dict[str, Any]]) -> str:
    """How late the ticks are, as the plant has it; empty where nobody keeps the pace."""
    plant = health.get("plant", {}).get("values", {})
    if "paced_ticks" not in plant:
        return ""
    words = f"ticks missed {plant.get('missed_ticks', '?')} of {plant['paced_ticks']}"
    if "lateness_p99_us" in plant:
        middle, late = (1e-3 * float(plant[f"lateness_{name}_us"]) for name in ("p50", "p99"))
        words += f", lateness {middle:.2f} ms median, {late:.2f} ms at 99 %"
    return words
