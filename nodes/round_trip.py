"""One message there and back between two processes: what `pzt doctor` tries discovery with.

`python -m pzt_nodes.round_trip` asks, starts `... answer` beside it, and says on stdout in JSON how it went.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import threading
import time
from typing import Any

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Float64

QUESTION, ANSWER = "/pzt_doctor/question", "/pzt_doctor/answer"
PATIENCE = 8.0
"""Two processes that have not found one another after this time [s] will not."""
ROUNDS = 50


class Asker(Node):
    """Asks until it is answered, then as often as `ROUNDS`."""

    def __init__(self) -> None:
        super().__init__("pzt_doctor_asker", start_parameter_services=False)
        self.done: Future = Future()
        self.found_after = 0.0
        self.durations: list[float] = []
        self._began = self._sent = time.monotonic()
        self._questions = self.create_publisher(Float64, QUESTION, 10)
        self.create_subscription(Float64, ANSWER, self._on_answer, 10)
        self.create_timer(0.05, self._ask)

    def _ask(self) -> None:
        if not self.durations:  # later each answer asks for the next
            self._say()

    def _say(self) -> None:
        self._sent = time.monotonic()
        self._questions.publish(Float64(data=self._sent))

    def _on_answer(self, answer: Float64) -> None:
        if answer.data != self._sent:
            return  # to a question that was given up
        now = time.monotonic()
        self.found_after = self.found_after or now - self._began
        self.durations.append(now - self._sent)
        if len(self.durations) < ROUNDS:
            self._say()
        elif not self.done.done():
            self.done.set_result(None)


class Answerer(Node):
    """Sends back what it hears."""

    def __init__(self) -> None:
        super().__init__("pzt_doctor_answerer", start_parameter_services=False)
        answers = self.create_publisher(Float64, ANSWER, 10)
        self.create_subscription(Float64, QUESTION, answers.publish, 10)


def ask() -> dict[str, Any]:
    """Try it; how long it took to be found, and a round trip [s]; nothing where nobody answered."""
    other = subprocess.Popen([sys.executable, "-m", "pzt_nodes.round_trip", "answer"], stdin=subprocess.PIPE)
    asker = Asker()
    _spin(asker, asker.done, PATIENCE)
    asker.destroy_node()
    assert other.stdin is not None
    other.stdin.close()
    try:
        other.wait(5.0)
    except subprocess.TimeoutExpired:
        other.kill()
    if not asker.durations:
        return {}
    return {"found_after_s": asker.found_after, "round_trip_s": statistics.median(asker.durations)}


def answer() -> None:
    """Until the asker closes our stdin."""
    over: Future = Future()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set_result(None)), daemon=True).start()
    answerer = Answerer()
    _spin(answerer, over, 3.0 * PATIENCE)
    answerer.destroy_node()


def _spin(node: Node, done: Future, patience: float) -> None:
    executor: Any = EventsExecutor()
    executor.add_node(node)
    deadline = time.monotonic() + patience
    while not done.done() and time.monotonic() < deadline:
        executor.spin_until_future_complete(done, timeout_sec=0.1)  # never without a deadline: docs/decisions/0003


def main() -> None:
    """Ask, or answer."""
    rclpy.init()
    try:
        if sys.argv[1:] == ["answer"]:
            answer()
        else:
            print(json.dumps(ask()))
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
