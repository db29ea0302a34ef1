"""The machinery's own floor: a ring of nodes that do nothing but hand on the bytes of a block.

`run_ring` starts it in separate processes or in one, and returns the durations of its rounds.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np

COLUMNS = ("time_s", "voltage_V", "current_A", "charge_C")


def serve(index: int, hops: int, ticks: int, period: float, composed: bool, samples: int) -> None:
    """Be one node of the ring, or all of them; node 0 starts the rounds and prints how long they took [us]."""
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.experimental import EventsExecutor
    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.task import Future
    from std_msgs.msg import Float64MultiArray

    from pzt_ros.wire import encode

    rclpy.init()
    executor, done = EventsExecutor(), Future()
    data = encode(COLUMNS, tuple(np.zeros(samples) for _ in COLUMNS))
    rounds: list[float] = []
    sent = [0.0]

    def make(number: int) -> Node:
        node = Node(f"hop{number}")
        publisher = node.create_publisher(Float64MultiArray, f"ring{(number + 1) % hops}", QoSProfile(depth=10))

        def pass_on(message: bytes) -> None:
            publisher.publish(message)

        def close_round(message: bytes) -> None:
            now = time.perf_counter()
            rounds.append(now - sent[0])
            if len(rounds) >= ticks:
                done.set_result(None)
                return
            if period:
                time.sleep(max(0.0, sent[0] + period - now))
            sent[0] = time.perf_counter()
            publisher.publish(message)

        callback = close_round if number == 0 else pass_on
        node.create_subscription(Float64MultiArray, f"ring{number}", callback, QoSProfile(depth=10), raw=True)
        if number == 0:

            def start() -> None:
                ready = all(
                    node.count_publishers(f"ring{n}") and node.count_subscribers(f"ring{n}") for n in range(hops)
                )
                if ready and not sent[0]:
                    sent[0] = time.perf_counter()
                    publisher.publish(data)

            node.create_timer(0.5, start)
        return node

    nodes = [make(n) for n in range(hops)] if composed else [make(index)]
    for node in nodes:
        executor.add_node(node)
    parent = os.getppid()
    with contextlib.suppress(ExternalShutdownException):  # the last round is over, and we were told to go
        while not done.done() and os.getppid() == parent:
            executor.spin_until_future_complete(done, timeout_sec=0.2)
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()
    if index == 0:
        print(" ".join(f"{1e6 * r:.1f}" for r in rounds[min(50, ticks // 10) :]))


def run_ring(
    hops: int,
    ticks: int,
    period: float,
    composed: bool,
    environment: dict[str, str],
    samples: int = 100,
    prefix: Sequence[str] = (),
) -> np.ndarray:
    """Durations of the rounds of a ring [us]; `period` 0 is as fast as possible, otherwise seconds.

    `samples` are those of the block that goes round; `prefix` goes before every command (`chrt -r 10`).
    """
    command = [*prefix, sys.executable, "-m", "pzt_benchmarks.bare_loop"]
    arguments = [str(hops), str(ticks), str(period), str(int(composed)), str(samples)]
    others = [] if composed else range(1, hops)
    helpers = [subprocess.Popen([*command, str(n), *arguments], env=environment) for n in others]
    try:
        done = subprocess.run(
            [*command, "0", *arguments], env=environment, capture_output=True, text=True, check=True, timeout=120
        )
    finally:
        for helper in helpers:
            helper.terminate()
            helper.wait()
    return np.array(done.stdout.split(), dtype=float)


if __name__ == "__main__":
    index, hops, ticks = map(int, sys.argv[1:4])
    serve(index, hops, ticks, float(sys.argv[4]), sys.argv[5] == "1", int(sys.argv[6]))
