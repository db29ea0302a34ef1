"""Messages and requests between nodes of one process: in order, in turns of the executor, and to all who listen."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pzt_nodes.intra_process import AT_ONCE, IntraProcess, IntraProcessClient, IntraProcessPublisher
from pzt_nodes.turns import Turns
from pzt_ros.ros_environment import keep_apart, ros_environment


class Executor:
    """What has been asked for, done one at a time."""

    def __init__(self) -> None:
        self.tasks: deque[Callable[[], Any]] = deque()

    def create_task(self, call: Callable[[], Any]) -> None:
        self.tasks.append(call)

    def turn(self) -> None:
        self.tasks.popleft()()

    def spin(self) -> None:
        while self.tasks:
            self.turn()


class Remote:
    """Of rclpy: a publisher or a client whose peers are in other processes."""

    topic_name = "/stage/truth"

    def __init__(self, readers: int = 0, ready: bool = False) -> None:
        self.sent: list[Any] = []
        self._readers, self._ready = readers, ready

    def publish(self, message: Any) -> None:
        self.sent.append(message)

    def get_subscription_count(self) -> int:
        return self._readers

    def wait_for_all_acked(self, timeout: Any) -> bool:
        return True

    def service_is_ready(self) -> bool:
        return self._ready

    def call_async(self, request: Any) -> str:
        return f"asked elsewhere: {request}"


class Kind:
    """Of a service: only its response is made here."""

    class Response:
        answer = ""


@pytest.fixture
def executor() -> Executor:
    return Executor()


@pytest.fixture
def intra_process(executor: Executor) -> Iterator[IntraProcess]:
    turns = Turns()
    with turns.of(executor):
        yield IntraProcess(turns)


def test_all_who_listen_here_hear_everything_in_order(executor: Executor, intra_process: IntraProcess) -> None:
    heard: list[tuple[str, int]] = []
    for name in ("plant", "observer"):
        intra_process.listen("/stage/applied", lambda message, name=name: heard.append((name, message)))
    intra_process.listen("/b/applied", lambda message: heard.append(("another axis", message)))
    for number in range(3):
        intra_process.say("/stage/applied", number)
    assert heard == [], "nothing is delivered while the one who says it is still at work"
    executor.spin()
    assert heard == [(name, number) for number in range(3) for name in ("plant", "observer")]


def test_a_ring_that_never_rests_leaves_turns_to_others(executor: Executor, intra_process: IntraProcess) -> None:
    rounds: list[int] = []

    def pass_on(number: int) -> None:
        rounds.append(number)
        intra_process.say("/ring", number + 1)

    intra_process.listen("/ring", pass_on)
    intra_process.say("/ring", 0)
    executor.turn()
    assert len(rounds) == AT_ONCE
    assert len(executor.tasks) == 1, "it goes on when the others had their turn"
    executor.turn()
    assert rounds == list(range(2 * AT_ONCE))


def test_what_is_said_before_the_executor_is_there_is_not_lost() -> None:
    turns, executor, heard = Turns(), Executor(), []
    intra_process = IntraProcess(turns)
    intra_process.listen("/a", heard.append)
    intra_process.say("/a", 1)
    with turns.of(executor):
        executor.spin()
    assert heard == [1]


def test_a_failure_stops_the_deliveries_and_is_kept_for_the_spinner(executor: Executor) -> None:
    """Raised in a task it would end the executor of these wheels by a segmentation fault, without a word."""
    turns, done = Turns(), []

    def fail(_message: Any) -> None:
        raise ValueError("broken callback")

    intra_process = IntraProcess(turns)
    intra_process.listen("/a", fail)
    intra_process.listen("/a", done.append)
    with turns.of(executor):
        intra_process.say("/a", 1)
        turns.take(lambda: done.append(2))
        executor.spin()
    assert isinstance(turns.failure, ValueError)
    assert done == []


def test_a_publisher_reaches_both_and_counts_both(executor: Executor, intra_process: IntraProcess) -> None:
    heard: list[bytes] = []
    remote = Remote(readers=1)
    publisher = IntraProcessPublisher(remote, intra_process)
    assert publisher.get_subscription_count() == 1
    intra_process.listen("/stage/truth", heard.append)
    assert publisher.get_subscription_count() == 2
    publisher.publish(b"block")
    executor.spin()
    assert heard == remote.sent == [b"block"]


def test_a_request_is_answered_here_or_asked_elsewhere(executor: Executor, intra_process: IntraProcess) -> None:
    def answer(request: str, response: Any) -> Any:
        response.answer = f"yes to {request}"
        return response

    client = IntraProcessClient(Remote(), "/stage/enable", intra_process)
    assert not client.service_is_ready()
    assert IntraProcessClient(Remote(ready=True), "/stage/enable", intra_process).service_is_ready()
    assert client.call_async("1") == "asked elsewhere: 1"
    intra_process.offer("/stage/enable", Kind, answer)
    assert client.service_is_ready()
    future, told = client.call_async("2"), []
    future.add_done_callback(lambda done: told.append(done.result().answer))
    assert not future.done(), "the one who asks goes on first"
    executor.spin()
    assert told == ["yes to 2"]


def test_only_our_own_profile_keeps_nodes_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE", "RMW_FASTRTPS_PUBLICATION_MODE"):
        monkeypatch.setenv(name, "")  # so that all that `keep_apart` sets is undone
        monkeypatch.delenv(name)
    ours = ros_environment(tmp_path)
    theirs = tmp_path / "theirs.xml"
    theirs.write_text("<profiles/>", encoding="utf-8")
    for changed in ({"FASTRTPS_DEFAULT_PROFILES_FILE": str(theirs)}, {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}):
        for name, value in {**ours, **changed}.items():
            monkeypatch.setenv(name, value)
        assert not keep_apart()
        assert os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] == {**ours, **changed}["FASTRTPS_DEFAULT_PROFILES_FILE"]
    for name, value in ours.items():
        monkeypatch.setenv(name, value)
    assert keep_apart()
    assert "ignore_local_endpoints" in Path(os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"]).read_text(encoding="utf-8")
    assert os.environ["RMW_FASTRTPS_PUBLICATION_MODE"] == "ASYNCHRONOUS"
