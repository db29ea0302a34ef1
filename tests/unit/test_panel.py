"""The panel without browser and ROS: rows out of blocks, words for states, access, a replayed bag, its node."""

from __future__ import annotations

import asyncio
import os
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pzt_ros.bags.writer import BagWriter
from pzt_ros.blocks import Block
from pzt_ros.errors import BenchError
from pzt_ros.hardware.machine import CAUSES, DISABLED, STATES, TABLE
from pzt_ros.panel import replay
from pzt_ros.panel.access import COOKIE, Guard, new_token
from pzt_ros.panel.board import WINDOW, Board
from pzt_ros.panel.feed import NodeFeed
from pzt_ros.panel.frames import COLUMNS, Frames
from pzt_ros.panel.page import node_words, tick_words
from pzt_ros.panel.reports import Reports
from pzt_ros.panel.safety import BEGINNING, SILENT_AFTER, UNKNOWN, in_the_way, shown_state
from pzt_ros.wire import decode, decode_any, encode

PERIOD = 0.005
COLUMNS_OF = {
    "measurement": ("time_s", "displacement_m"),
    "reference": ("time_s", "displacement_m"),
    "applied": ("time_s", "voltage_V", "current_A", "charge_C"),
    "estimate": (
        "time_s", "displacement_m", "polarization_C_per_m2", "phase_fraction", "innovation_m", "disturbance_m",
    ),
}  # fmt: skip


def block(topic: str, number: int, value: float) -> Block:
    """Block `number` of a topic: ten samples of `value` in every column, a millionth more from sample to sample."""
    columns = COLUMNS_OF[topic]
    samples = value + 1e-6 * np.arange(-4.5, 5.0)
    time = PERIOD * (number + np.arange(10) / 10)
    return Block(columns, np.column_stack([time] + [samples] * (len(columns) - 1)))


def feed_all(frames: Frames, number: int, topics: tuple[str, ...] = tuple(COLUMNS_OF)) -> None:
    for topic in topics:
        frames.add(topic, block(topic, number, {"reference": 3.0, "measurement": 2.5}.get(topic, 1.0)))


def test_a_stage_is_called_simulated_as_soon_as_its_plant_speaks() -> None:
    board = Board()
    board.take({"health": [{"node": "amplifier", "level": "ok", "text": "", "values": {}}]})
    assert not board.simulated
    board.take({"health": [{"node": "plant", "level": "ok", "text": "", "values": {}}]})
    assert board.simulated


# -- rows


def test_a_row_is_the_mean_of_a_tick() -> None:
    frames = Frames()
    feed_all(frames, 7)
    (row,) = frames.take()
    found = dict(zip(COLUMNS, row, strict=True))
    assert found["time_s"] == pytest.approx(PERIOD * 7.45, abs=1e-4)
    assert found["displacement_m"] == pytest.approx(2.5)
    assert found["error_m"] == pytest.approx(0.5)
    assert found["voltage_V"] == found["phase_fraction"] == pytest.approx(1.0)


def test_a_tick_waits_for_what_it_lacks_but_not_for_a_reference() -> None:
    frames = Frames()
    feed_all(frames, 1, ("measurement", "applied"))
    assert frames.take() == []
    frames.add("estimate", block("estimate", 1, 1.0))
    (row,) = frames.take()
    assert dict(zip(COLUMNS, row, strict=True))["error_m"] is None


def test_rows_are_thinned_to_the_rate() -> None:
    frames = Frames(rate=50.0)
    for number in range(40):
        feed_all(frames, number)
    times = [row[0] for row in frames.take()]
    assert len(times) == 10
    assert np.diff(times).min() >= 1 / 50.0 - 1e-3  # type: ignore[arg-type]


def test_another_run_begins_anew_and_lost_blocks_are_given_up() -> None:
    frames = Frames()
    for number in range(100, 160):
        frames.add("measurement", block("measurement", number, 1.0))
    feed_all(frames, 200)
    assert len(frames.take()) == 1
    assert frames.counts["incomplete"] == 20
    feed_all(frames, 0)
    feed_all(frames, 1)
    assert [row[0] for row in frames.take()] == pytest.approx([0.00225, 0.00725], abs=1e-4)


def test_what_is_no_number_is_shown_as_missing() -> None:
    frames = Frames()
    feed_all(frames, 1, ("measurement", "applied"))
    frames.add("estimate", block("estimate", 1, float("nan")))
    bad = block("measurement", 1, 1.0)
    frames.add("measurement", Block(bad.columns, bad.values * np.inf))
    (row,) = frames.take()
    assert dict(zip(COLUMNS, row, strict=True))["estimate_m"] is None
    assert frames.counts["not finite"] == 1


@pytest.mark.parametrize("count", [1, 3, 100])
def test_blocks_of_any_length_are_read(count: int) -> None:
    columns = COLUMNS_OF["applied"]
    data = encode(columns, tuple(np.arange(count) + k for k in range(4)))
    found, known = decode_any(data, columns), decode(data, columns, count)
    assert found is not None
    assert known is not None
    np.testing.assert_array_equal(found.values, known.values)
    assert decode_any(data[:-1], columns) is None
    assert decode_any(data, COLUMNS_OF["measurement"]) is None


# -- words


def health(state: str, reason: str = "") -> dict[str, Any]:
    return {"amplifier": {"level": "ok", "text": "", "values": {"state": state, "reason": reason}}}


NOW = {"amplifier": 0.0}
STARTING = {**health(DISABLED), "experiment": {"text": "", "values": {"phase": "starting"}}}


def test_every_state_of_the_machine_has_a_sign_and_words_of_its_own() -> None:
    shown = [shown_state(health(state), NOW) for state in {row.shown for row in STATES.values()}]
    shown += [UNKNOWN, shown_state(health("ramping", "why"), NOW), shown_state(health("fault"), {"amplifier": 99.0})]
    shown.append(shown_state(STARTING, dict.fromkeys(STARTING, 0.0)))
    assert len({(s.headline) for s in shown}) == len(shown)
    assert all(s.sign and s.headline and s.reason for s in shown)
    looks = {s.look for s in shown}
    assert looks == {"off", "on", "moving", "fault", "unknown"}


@pytest.mark.parametrize("cause", CAUSES)
def test_every_fault_shows_its_reason(cause: str) -> None:
    state = STATES[TABLE["enabled"][cause].state].shown
    for name in (state, "fault"):
        shown = shown_state(health(name, f"{cause} at 3 s"), NOW)
        assert shown.look == "fault"
        assert f"{cause} at 3 s" in shown.reason


def test_before_anybody_is_heard_the_banner_says_what_is_waited_for() -> None:
    board = Board()
    assert board.safety.headline == "NO GRAPH"
    board.unheard = BEGINNING  # it was started with the panel
    board.take({"health": [{"node": "recorder", **READY}]})
    assert board.safety.headline == "STARTING"
    board.take({"health": [{"node": node, **said} for node, said in GRAPH.items()]})
    assert board.safety.headline == "DISABLED"


def test_a_silent_amplifier_is_not_believed() -> None:
    silent = SILENT_AFTER + 1.0
    assert shown_state(health("enabled"), {"amplifier": silent}).headline == "AMPLIFIER SILENT"
    assert shown_state(health("enabled"), {"amplifier": silent, "panel": 0.5}).headline == "AMPLIFIER SILENT"


def test_a_panel_that_hears_not_even_itself_does_not_blame_the_amplifier() -> None:
    silent = dict.fromkeys(("amplifier", "panel", "sensor"), SILENT_AFTER + 1.0)
    shown = shown_state(health("enabled"), silent)
    assert shown.headline == "PANEL BEHIND"
    assert "the amplifier was enabled" in shown.reason


READY = {"level": "ok", "text": "ready", "values": {"ready": "True"}}
GRAPH = {
    "amplifier": {**READY, "values": {"ready": "True", "state": DISABLED, "nodes": "amplifier,controller"}},
    "controller": READY,
}
YOUNG = dict.fromkeys((*GRAPH, "experiment"), 0.5)


@pytest.mark.parametrize(
    ("graph", "ages", "headline", "why"),
    [
        (GRAPH, YOUNG, "DISABLED", ""),
        (GRAPH, {**YOUNG, "controller": 9.0}, "DISABLED", "controller has been silent for 9 s"),
        ({"amplifier": GRAPH["amplifier"]}, YOUNG, "STARTING", "not heard yet: controller"),
        ({**GRAPH, "panel": READY}, {**YOUNG, "panel": 60.0}, "DISABLED", ""),  # another panel was closed
        (
            {**GRAPH, "controller": {"text": "waiting: no publisher on applied", "values": {"ready": "False"}}},
            YOUNG,
            "STARTING",
            "no publisher on applied",
        ),
        ({**GRAPH, "experiment": STARTING["experiment"]}, YOUNG, "STARTING", "looks for the others"),
    ],
)
def test_whatever_forbids_enabling_is_on_the_banner(
    graph: dict[str, Any], ages: dict[str, float], headline: str, why: str
) -> None:
    shown, problem = shown_state(graph, ages), in_the_way(graph, ages)
    assert shown.headline == headline
    assert bool(problem) == bool(why)
    assert why in problem
    assert why in shown.reason
    assert ("Enable lets it follow" in shown.reason) == (not problem)


def test_before_the_amplifier_was_heard_nobody_knows_who_else_there_should_be() -> None:
    """A graph that starts: one node is there and ready, and enabled now its first block would reach nobody."""
    assert in_the_way({"controller": READY}, YOUNG) == "not yet: not heard yet: amplifier"


@pytest.mark.parametrize(("rate", "words"), [("200.4", "running, 200/s"), ("", "running"), ("often", "running")])
def test_a_node_is_shown_with_its_rate_where_it_has_one(rate: str, words: str) -> None:
    assert node_words({"level": "ok", "text": "running", "values": {"ticks_per_second": rate}}) == words


def test_ticks_are_shown_where_somebody_keeps_the_pace() -> None:
    assert tick_words({}) == ""
    late = {"paced_ticks": "100", "missed_ticks": "3", "lateness_p50_us": "40.0", "lateness_p99_us": "1500.0"}
    words = tick_words({"plant": {"values": late}})
    assert words == "ticks missed 3 of 100, lateness 0.04 ms median, 1.50 ms at 99 %"


# -- board


def row(time: float, displacement: float, reference: float | None = None) -> list[float | None]:
    values: dict[str, float | None] = {"time_s": time, "displacement_m": displacement, "reference_m": reference}
    return [values.get(column) for column in COLUMNS]


def test_the_board_keeps_the_window_and_tells_listeners() -> None:
    board, heard = Board(), []
    board.listeners.append(heard.append)
    board.take({"rows": [row(t, 1e-6) for t in np.arange(0.0, 3 * WINDOW, 1.0)]})
    assert board.rows[-1][0] - board.rows[0][0] <= WINDOW  # type: ignore[operator]
    assert len(heard) == 1
    board.take({"rows": [row(0.0, 5e-6)]})  # another run
    assert len(board.rows) == 1


def test_nothing_is_planned_before_the_window_is_known_or_why_it_is_not() -> None:
    for said in ({"envelope": {}}, {"problem": "no such model"}):
        board = Board()
        board.take({"about": {"namespace": "/stage", "controllers": ["open_loop"]}})
        assert not board.may_plan
        board.take({"about": said})
        assert board.may_plan


def test_here_is_the_reference_where_there_is_one() -> None:
    board = Board()
    assert board.here is None
    board.take({"rows": [row(0.0, 5e-6)]})
    assert board.here == 5e-6
    board.take({"rows": [row(0.1, 5e-6, 6e-6)]})
    assert board.here == 6e-6


def test_the_latest_diagnosis_is_found(tmp_path: Path) -> None:
    assert Reports(tmp_path).words == ""
    for age, name in enumerate(("runs/new", "runs/old", "run-without-diagnosis")):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "report.html").write_text("x")
        os.utime(tmp_path / name / "report.html", (1e9 - age, 1e9 - age))
    for name in ("new", "old"):
        (tmp_path / "runs" / name / "baseline.yaml").write_text("x")
    assert Reports(tmp_path).words == "latest diagnosis: runs/new"


# -- access


async def _ask(guard: Guard, kind: str, headers: dict[str, str], query: str = "") -> tuple[Any, list[Any]]:
    sent: list[Any] = []
    scope = {
        "type": kind, "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
    }  # fmt: skip

    async def receive() -> dict[str, str]:
        return {"type": f"{kind}.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    await guard(scope, receive, send)
    return sent[0].get("status", sent[0]["type"]), sent


async def _app(scope: Any, _receive: Any, send: Any) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
    else:
        await send({"type": "http.response.start", "status": 200, "headers": []})


def ask(guard: Guard, kind: str = "http", query: str = "", **headers: str) -> Any:
    """Status of a request, or how the answer to a websocket begins."""
    return asyncio.run(_ask(guard, kind, headers, query))[0]


def test_on_this_machine_only_pages_of_this_machine_get_in() -> None:
    guard = Guard(_app, "127.0.0.1", "")
    assert ask(guard, host="127.0.0.1:8080") == 200
    assert ask(guard, host="localhost:8080", origin="http://localhost:8080") == 200
    assert ask(guard, "websocket", host="127.0.0.1:8080", origin="http://127.0.0.1:8080") == "websocket.accept"
    assert ask(guard, "websocket", host="127.0.0.1:8080", origin="https://evil.example") == "websocket.close"
    assert ask(guard, host="evil.example:8080") == 403  # a name that somebody made point here
    assert ask(guard, host="127.0.0.1:8080", origin="null") == 403


def test_elsewhere_a_token_is_wanted_by_page_and_websocket() -> None:
    token = new_token()
    guard = Guard(_app, "0.0.0.0", token)
    for kind, granted, refused in (("http", 200, 403), ("websocket", "websocket.accept", "websocket.close")):
        assert ask(guard, kind, host="bench:8080") == refused
        assert ask(guard, kind, f"token={token[:-1]}", host="bench:8080") == refused
        assert ask(guard, kind, f"token={token}", host="bench:8080") == granted
        assert ask(guard, kind, host="bench:8080", cookie=f"{COOKIE}={token}") == granted
        assert ask(guard, kind, host="bench:8080", cookie=f"{COOKIE}=é") == refused
    _, sent = asyncio.run(_ask(guard, "http", {"host": "bench:8080"}, f"token={token}"))
    (cookie,) = [value for name, value in sent[0]["headers"] if name == b"set-cookie"]
    assert b"HttpOnly; SameSite=Strict" in cookie


# -- feeds


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Half a second of an axis at 200 blocks a second."""
    writer = BagWriter(tmp_path / "bag")
    channels = {name: writer.add_topic(f"/lab/{name}", "std_msgs/msg/Float64MultiArray") for name in COLUMNS_OF}
    for number in range(100):
        for name, channel in channels.items():
            found = block(name, number, 1.0)
            data = encode(found.columns, tuple(found.values.T))
            writer.write_all([(channel, data, number * 5_000_000, number * 5_000_000)])
    writer.close()
    return tmp_path / "bag"


def test_a_bag_is_replayed_at_its_own_pace(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]

    async def sleep(duration: float) -> None:
        clock[0] += duration

    monkeypatch.setattr(replay, "asyncio", SimpleNamespace(sleep=sleep))
    monkeypatch.setattr(replay, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    board, frames = Board(), []
    board.listeners.append(frames.append)
    feed = replay.BagFeed(bag, "/lab")
    asyncio.run(feed.run(board))
    assert {len(rows) for rows in frames[1:-1]} <= {10, 11}  # 50 ms of blocks that are 5 ms apart
    assert sum(len(rows) for rows in frames) == 100
    assert clock[0] == pytest.approx(100.0 + 0.5, abs=0.05)  # the bag's length
    assert board.ended is not None
    assert board.ended.look == "off"
    answer = asyncio.run(feed.ask({"do": "enable", "value": True}))
    assert not answer.granted


def test_a_bag_without_the_axis_is_refused(bag: Path) -> None:
    with pytest.raises(BenchError, match=r"no messages on /stage/estimate, .* name the axis with --namespace"):
        replay.BagFeed(bag)


NODE = """
    import json, sys
    print("a library says hello")
    print(json.dumps({"about": {"namespace": "/lab"}}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        if request["do"] == "die":
            sys.exit(3)
        if request["do"] != "nothing":
            print(json.dumps({"answer": request["id"], "granted": True, "message": request["do"]}), flush=True)
"""


def node(tmp_path: Path, *, read_only: bool = False) -> NodeFeed:
    script = tmp_path / "node.py"
    script.write_text(textwrap.dedent(NODE))
    return NodeFeed([sys.executable, str(script)], dict(os.environ), read_only)


def test_requests_reach_the_node_and_its_end_is_said(tmp_path: Path) -> None:
    async def scene() -> tuple[Board, list[Any]]:
        board, feed = Board(), node(tmp_path)
        assert not (await feed.ask({"do": "early"})).granted
        running = asyncio.create_task(feed.run(board))
        while not board.about:
            await asyncio.sleep(0.01)
        answers = await asyncio.gather(feed.ask({"do": "one"}), feed.ask({"do": "two"}))
        answers.append(await feed.ask({"do": "die"}))
        await running
        await feed.close()
        return board, answers

    board, (one, two, dead) = asyncio.run(scene())
    assert (one.granted, one.message, two.message) == (True, "one", "two")
    assert not dead.granted
    assert board.ended is not None
    assert "exit code 3" in board.ended.reason


def test_a_node_that_keeps_silent_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pzt_ros.panel.feed.PATIENCE", 0.1)

    async def scene() -> Any:
        board, feed = Board(), node(tmp_path)
        running = asyncio.create_task(feed.run(board))
        while not board.about:
            await asyncio.sleep(0.01)
        answer = await feed.ask({"do": "nothing"})
        await feed.close()
        await running
        return answer

    answer = asyncio.run(scene())
    assert not answer.granted
    assert "no answer to 'nothing'" in answer.message


def test_read_only_refuses_before_anything_is_sent(tmp_path: Path) -> None:
    answer = asyncio.run(node(tmp_path, read_only=True).ask({"do": "enable", "value": True}))
    assert not answer.granted
    assert "read-only" in answer.message
