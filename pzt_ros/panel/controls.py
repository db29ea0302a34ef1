"""The knobs of the panel. Each click becomes a request to the feed; what came of it is said in words."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from pzt_ros.errors import BenchError
from pzt_ros.panel.board import Board
from pzt_ros.panel.feed import Answer, Feed
from pzt_ros.panel.motion import SHAPES, Envelope, Point, jog, scan

CHOICE_KNOWN = 2.5
"""After this time [s] the controller that is shown is the one that the node says is in charge."""

POLING = "Poling drives the stage to its highest voltage and back, over about 20 s, whatever it carries."


class Controls:
    """The column of cards on the right."""

    def __init__(self, board: Board, feed: Feed) -> None:
        self._board = board
        self._feed = feed
        self._chose = -CHOICE_KNOWN
        self._shown: list[tuple[bool, str]] = []
        self._movers: list[ui.button] = []
        with ui.element("div").classes("controls"):
            if feed.read_only:
                with _card("Controls"):
                    ui.label("Read-only: this page shows, and commands nothing.")
                return
            self._power()
            self._jog()
            self._scan()
            self._other()
            with _card("What came of it"):
                self._words = ui.element("div").classes("words").props("role=status aria-live=polite data-is=words")

    # -- cards

    def _power(self) -> None:
        with _card("Stage"), _grid(6):
            _button("Enable", "enable", self._asking(do="enable", value=True), "go span3", "play_arrow")
            _button("Disable", "disable", self._asking(do="enable", value=False), "key span3", "power_settings_new")
            _button("Hold", "hold", self._hold, "halt span6", "pause")
            _button("Reset", "reset", self._asking(do="reset"), "key span2")
            _button("Discharge", "discharge", self._asking(do="discharge"), "key span2")
            _button("Pole …", "pole", self._pole, "key span2")

    def _jog(self) -> None:
        with _card("Jog"), _grid(6):
            step = _number("Step", "jog-step", 0.5, "µm", 0.1, "span2")
            speed = _number("Speed", "jog-speed", 5.0, "µm/s", 1.0, "span2")

            async def move(sign: float) -> None:
                await self._move(
                    lambda envelope, here: jog(envelope, here, sign * _value(step, 1e-6), _value(speed, 1e-6))
                )

            self._movers += [
                _button("", "jog-down", lambda: move(-1.0), "key", "remove", "one step down"),
                _button("", "jog-up", lambda: move(1.0), "key", "add", "one step up"),
            ]

    def _scan(self) -> None:
        with _card("Scan"):
            shape = ui.toggle(list(SHAPES), value="triangle")
            shape.props("data-is=scan-shape dense no-caps spread unelevated")
            with _grid(6):
                low = _number("Lowest", "scan-low", 6.0, "µm", 0.5, "span3")
                size = _number("Peak to peak", "scan-size", 4.0, "µm", 0.5, "span3")
                rate = _number("Rate", "scan-rate", 1.0, "Hz", 0.1, "span2")
                cycles = _number("Cycles", "scan-cycles", 10.0, "", 1.0, "span2")

                async def start() -> None:
                    asked = {"low": (low, 1e-6), "peak_to_peak": (size, 1e-6), "rate": (rate, 1.0)}
                    asked["cycles"] = (cycles, 1.0)
                    await self._move(
                        lambda envelope, here: scan(
                            envelope, here, shape=str(shape.value), **{name: _value(*of) for name, of in asked.items()}
                        )
                    )

                self._movers.append(_button("Scan", "scan", start, "go span2"))

    def _other(self) -> None:
        with _card("Controller and recorder"), _grid(6):
            self._choice = ui.select([], label="in charge").props("dense outlined data-is=controller").classes("span4")
            self._choice.on_value_change(self._select)
            _button("", "record", self._asking(do="record", value=True), "key", "fiber_manual_record", "record")
            _button("", "pause", self._asking(do="record", value=False), "key", "pause_circle", "pause the recorder")

    # -- kept up to date

    def refresh(self) -> None:
        """Show what was answered, and the controller that is in charge, whoever chose it."""
        if self._feed.read_only:
            return
        self._show_answers()
        for button in self._movers:
            button.set_enabled(self._board.may_plan)
        names = list(self._board.about.get("controllers", []))
        if names != self._choice.options:
            self._choice.set_options(names)
        # a node says how it is once a second: a choice just made is not known to the board yet
        if self._board.controller in names and time.monotonic() - self._chose > CHOICE_KNOWN:
            self._choice.set_value(self._board.controller)

    async def _select(self) -> None:
        chosen = str(self._choice.value or "")
        if chosen and chosen != self._board.controller:
            self._chose = time.monotonic()
            await self._ask(do="controller", name=chosen)

    # -- clicks

    def _asking(self, **request: Any) -> Callable[[], Awaitable[None]]:
        return lambda: self._ask(**request)

    async def _ask(self, **request: Any) -> None:
        self._say(await self._feed.ask(request))

    async def _hold(self) -> None:
        await self._ask(do="trajectory", points=[])

    async def _move(self, plan: Callable[[Envelope, float], list[Point]]) -> None:
        """Plan from where the stage is asked to be; a plan that leaves its window is refused here already."""
        envelope, here = self._board.envelope, self._board.here
        try:
            if here is None:
                raise BenchError("the stage is not enabled; enable it first")
            if envelope is None:
                raise BenchError(self._board.about.get("problem", "the window of the stage is not known yet; wait"))
            points = plan(envelope, here)
        except BenchError as error:
            self._say(Answer(False, str(error)))
            return
        await self._ask(do="trajectory", points=points)

    async def _pole(self) -> None:
        with ui.dialog() as dialog, ui.card():
            ui.label(POLING)
            with ui.row():
                ui.button("Pole", on_click=lambda: dialog.submit(True)).props("data-do=pole-yes no-caps unelevated")
                ui.button("Leave it", on_click=lambda: dialog.submit(False)).props("flat no-caps")
        if await dialog:
            await self._ask(do="pole")

    def _say(self, answer: Answer) -> None:
        """On every open page: who stands before another one has to know, too."""
        self._board.said.appendleft((answer.granted, answer.message))
        self._show_answers()

    def _show_answers(self) -> None:
        if self._shown == list(self._board.said):
            return
        self._shown = list(self._board.said)
        self._words.clear()
        with self._words:
            for granted, text in self._shown:
                ui.label(f"{'✔' if granted else '✖'} {text}").classes("" if granted else "no")


def _card(title: str) -> ui.element:
    card = ui.element("section").classes("card")
    with card:
        ui.label(title).classes("title")
    return card


def _grid(columns: int) -> ui.element:
    return ui.element("div").classes(f"grid{columns}")


def _button(
    text: str, do: str, click: Callable[[], Any], classes: str, icon: str | None = None, tip: str = ""
) -> ui.button:
    button = ui.button(text, on_click=click, icon=icon, color=None)
    button.props(f'data-do={do} no-caps unelevated aria-label="{tip or text}"').classes(classes)
    if tip:
        button.props(f'title="{tip}"')
    return button


def _number(label: str, name: str, value: float, unit: str, step: float, classes: str) -> ui.number:
    field = ui.number(label, value=value, step=step, suffix=unit)
    return field.props(f"data-is={name} dense outlined hide-bottom-space").classes(classes)


def _value(field: ui.number, scale: float = 1.0) -> float:
    """What stands in the field, in SI.

    Raises:
        BenchError: no number stands there.
    """
    if isinstance(field.value, bool) or not isinstance(field.value, (int, float)):
        name = str(field.props.get("label", "a field"))
        raise BenchError(f"'{name}' is {'empty' if field.value is None else repr(field.value)}; give a number")
    return scale * field.value
