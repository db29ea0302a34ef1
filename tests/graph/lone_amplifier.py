"""The amplifier node alone, with nobody but a foreign node to say anything to it."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from foreign_node import ForeignNode
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from std_srvs.srv import SetBool

from pzt_bringup.domain import take_domain
from pzt_ros.blocks import Block, fill_message
from pzt_ros.ros_environment import ros_environment

RATE, SIZE = 20e3, 100


@contextmanager
def own_domain() -> Iterator[int]:
    """A ROS domain that no other graph takes meanwhile."""
    lock = take_domain(None)
    try:
        yield lock.domain
    finally:
        lock.release()


class Amplifier:
    """The amplifier node alone, commanded by a foreign node."""

    def __init__(self, folder: Path, foreign: ForeignNode, domain: int, *more: str) -> None:
        self.foreign = foreign
        self.log = folder / "amplifier.log"
        self._stream = open(self.log, "wb")  # noqa: SIM115 - as long as the process
        options = ["nodes:=amplifier", "limits.command_timeout:=60.0", "limits.sensor_timeout:=0.2", *more]
        words = [word for option in options for word in ("-p", option)]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "pzt_nodes.amplifier_node", "--ros-args", *words],
            env=ros_environment(folder, domain),
            stderr=self._stream,
            start_new_session=True,
        )
        self._drive = foreign.node.create_publisher(Float64MultiArray, "/stage/drive", QoSProfile(depth=10))
        foreign.listen("/stage/applied", Float64MultiArray)
        foreign.listen("/diagnostics", DiagnosticArray)
        self.applied = foreign.heard["/stage/applied"]

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(20.0)
            finally:
                self.process.kill()
                self.process.wait()
        self._stream.close()

    def call(self, name: str, kind: Any, **request: Any) -> tuple[bool, str]:
        client = self.foreign.node.create_client(kind, f"/stage/{name}")
        self.foreign.spin_until(client.service_is_ready)
        future = client.call_async(kind.Request(**request))
        self.foreign.spin_until(future.done)
        self.foreign.node.destroy_client(client)
        return future.result().success, future.result().message

    def enable(self) -> tuple[bool, str]:
        return self.call("enable", SetBool, data=True)

    def command(self, block: int, value: float) -> None:
        """Send a block; an amplifier that takes it says what it applied."""
        time = (block * SIZE + np.arange(SIZE)) / RATE
        sent = Block.of({"time_s": time, "command_voltage_V": np.full(SIZE, value)})
        self._drive.publish(fill_message(Float64MultiArray(), MultiArrayDimension, sent))

    def state(self) -> dict[str, str]:
        """What the amplifier said last of itself."""
        messages = [s for m in self.foreign.heard["/diagnostics"] for s in m.status if s.name.endswith("amplifier")]
        return {pair.key: pair.value for pair in messages[-1].values} if messages else {}
