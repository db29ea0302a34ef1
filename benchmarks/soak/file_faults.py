"""Faults of files: a bag that is left by a killed recorder, and models that cannot be."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray

from pzt_benchmarks.soak.fault import ONE_LINE, READABLE, Fault, Seen
from pzt_benchmarks.soak.foreign import ForeignNode
from pzt_benchmarks.soak.processes import free_domain
from pzt_config.topics import TOPICS
from pzt_ros.bags.reader import open_bag
from pzt_ros.ros_environment import ros_environment
from pzt_ros.wire import encode

RATE = 20e3


def folder_alone(folder: Path) -> Any:
    """A folder is all that is needed."""
    return contextlib.nullcontext(folder)


# -- a recorder that is killed


def recorder_killed(folder: Path, rng: np.random.Generator) -> Seen:
    """A recorder takes 200 blocks a second and is killed; the time between the last one it has and the kill counts."""
    bag, domain = folder / f"bag-{rng.integers(2**62)}", free_domain()
    recorder = subprocess.Popen(
        [sys.executable, "-m", "pzt_nodes.recorder_node", "--ros-args", "-p", f"bag:={bag}"],
        env=ros_environment(folder, domain),
        start_new_session=True,
    )
    try:
        with ForeignNode(domain) as foreign:
            sent = send_until_killed(foreign, recorder, float(rng.uniform(0.3, 3.0)))
    finally:
        recorder.kill()
        recorder.wait()
    left = open_bag(bag)
    there = "/stage/applied" in (topic.name for topic in left.topics())  # not if it was killed before its first flush
    ours = [when for when, _ in left.messages("/stage/applied")] if there else []
    stock = [r for r in stock_records(bag / f"{bag.name}_0.mcap") if isinstance(r, Message)]
    lost = sent[-1] - (ours[-1] * 1e-9 if ours else sent[0])
    if len(stock) < len(ours):
        return Seen(f"ours reads {len(ours)} messages, the stock reader {len(stock)}", lost)
    return Seen(READABLE, lost)


def send_until_killed(foreign: ForeignNode, recorder: subprocess.Popen[bytes], seconds: float) -> list[float]:
    """Send blocks to a recorder and kill it after a while; the times of sending [s since 1970]."""
    sender = foreign.node.create_publisher(Float64MultiArray, "/stage/applied", QoSProfile(depth=10))
    foreign.spin_until(lambda: sender.get_subscription_count() > 0)
    sent, columns = [], TOPICS["applied"].columns
    begin = time.monotonic()
    while time.monotonic() < begin + seconds:
        time_s = len(sent) * 5e-3 + np.arange(100) / RATE
        sent.append(time.time())
        sender.publish(encode(columns, (time_s, *[np.zeros(100)] * 3)))
        time.sleep(max(begin + len(sent) * 5e-3 - time.monotonic(), 0.0))
    recorder.send_signal(signal.SIGKILL)
    recorder.wait()
    return sent


def stock_records(path: Path) -> list[Any]:
    """What the official reader for files without an end makes of a file."""
    records = []
    with contextlib.suppress(EndOfFile):
        for record in StreamReader(BytesIO(path.read_bytes())).records:
            records.append(record)  # noqa: PERF402 - what came before the end is kept
    return records


# -- models that cannot be

SCENARIO = """
scenario: bad model
plant: bench-stage
model: {model}
phases:
  - {{phase: voltage, to: 10 V, duration: 0.1 s}}
"""


def bad_model(spoil: Callable[[Path, np.random.Generator], None]) -> Callable[[Path, np.random.Generator], Seen]:
    """A run with a model file that something was done to."""

    def perform(folder: Path, rng: np.random.Generator) -> Seen:
        name = f"{rng.integers(2**62)}"
        model, scenario, out = folder / f"model-{name}.yaml", folder / f"{name}.yaml", folder / f"run-{name}"
        spoil(model, rng)
        scenario.write_text(SCENARIO.format(model=model), encoding="utf-8")
        command = [sys.executable, "-m", "pzt_bringup", str(scenario), "--out", str(out)]
        began = time.monotonic()
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        seconds, lines = time.monotonic() - began, done.stderr.strip().splitlines()
        if done.returncode == 2 and len(lines) == 1 and model.name in lines[0] and not out.exists():
            return Seen(ONE_LINE, seconds)
        return Seen(f"exit code {done.returncode}: {done.stderr}", seconds)

    return perform


def shipped_model() -> str:
    """The text of a good one."""
    from pzt_ros.chains import shipped

    return Path(shipped("chains")["thesis-p2"]).read_text(encoding="utf-8")


def corrupt(path: Path, rng: np.random.Generator) -> None:
    """The file was overwritten from some place on."""
    text = shipped_model().encode()
    place = int(rng.integers(len(text) // 4, len(text) // 2))
    path.write_bytes(text[:place] + bytes(rng.integers(128, 256, size=64, dtype=np.uint8)) + text[place:])


def wrong_unit(path: Path, rng: np.random.Generator) -> None:
    """One of the parameters has a unit of another kind."""
    lines = shipped_model().splitlines()
    with_units = [n for n, line in enumerate(lines) if line.rstrip().endswith(("MV/m", "V/m"))]
    chosen = int(rng.choice(with_units))
    lines[chosen] = lines[chosen].rstrip().rsplit(" ", 1)[0] + " kg"
    path.write_text("\n".join(lines), encoding="utf-8")


FILE_FAULTS = (
    Fault("recorder killed while it writes", "200 blocks a second, at a random moment", READABLE, 1.0,
          "what is lost before the kill", folder_alone, recorder_killed, long=100),
    Fault("model file missing", "a path that is not there", ONE_LINE, 20.0, "until it is said", folder_alone,
          bad_model(lambda _path, _rng: None), long=10),
    Fault("model file corrupt", "bytes that are no text", ONE_LINE, 20.0, "until it is said", folder_alone,
          bad_model(corrupt), long=10),
    Fault("model with a wrong unit", "kg where a field strength is asked", ONE_LINE, 20.0, "until it is said",
          folder_alone, bad_model(wrong_unit), long=10),
)  # fmt: skip
