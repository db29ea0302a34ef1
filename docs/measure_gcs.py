"""How fast a GCS conversation is over the loopback: `python docs/measure_gcs.py`; the controller is simulated.

The server runs in a process of its own, so that its work does not count as the driver's.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from pzt_ros.chains import load_chain
from pzt_ros.hardware.driver import Bench
from pzt_ros.hardware.gcs import GcsConnection
from pzt_ros.hardware.gcs_drivers import GcsAmplifierSettings
from pzt_ros.physics.signals import Rest
from pzt_ros.reference import block_times

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "unit"))
COUNT, SIZE = 3000, 10


def serve(pipe: Connection) -> None:
    """A simulated controller until it is told to stop."""
    from gcs_server import GcsServer

    with GcsServer() as server:
        pipe.send(server.port)
        pipe.recv()


def main() -> None:
    """Print the table."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=serve, args=(theirs,))
    process.start()
    port = ours.recv()
    try:
        _round_trips(port)
        _blocks(port)
    finally:
        ours.send("stop")
        process.join()


def _round_trips(port: int) -> None:
    connection = GcsConnection("127.0.0.1", port, 5.0)
    connection.tell("SVO 1 0")
    print("| one sample | median us | p99 us | max us | samples/s |\n| --- | --- | --- | --- | --- |")
    exchanges = {
        "`POS?`": lambda: connection.number("POS?", "1"),
        "`SVA`, `ERR?`, `VOL?` in one packet": lambda: connection.tell("SVA 1 5.0", "VOL? 1"),
    }
    for name, exchange in exchanges.items():
        times = np.empty(COUNT)
        for i in range(COUNT):
            began = time.perf_counter()
            exchange()
            times[i] = time.perf_counter() - began
        median, p99, worst = 1e6 * np.percentile(times, (50, 99, 100))
        print(f"| {name} | {median:.0f} | {p99:.0f} | {worst:.0f} | {1 / times.mean():.0f} |")
    connection.close()


def _blocks(port: int) -> None:
    print(f"\n| asked: samples/s, {SIZE} a block | reached |\n| --- | --- |")
    for rate in (100.0, 500.0, 1000.0, 2000.0, 5000.0):
        settings = GcsAmplifierSettings(host="127.0.0.1", port=float(port), timeout=5.0)
        driver = settings.build(Bench(load_chain("thesis-p2"), Rest(), rate, SIZE))
        driver.open()
        count = max(int(rate / SIZE), 10)
        began = time.perf_counter()
        for block in range(count):
            driver.apply(block_times(block, SIZE, rate), np.full(SIZE, 1.0))
        print(f"| {rate:.0f} | {count * SIZE / (time.perf_counter() - began):.0f} |")
        driver.close()


if __name__ == "__main__":
    main()
