"""The world, in simulation: takes `applied`, says `truth`, and keeps the pace."""

from __future__ import annotations

import time
from collections import deque
from functools import partial

from pzt_config.qos import QOS
from pzt_config.topics import TOPICS
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.latency import LatencyLog
from pzt_nodes.neighbour import Neighbour
from pzt_nodes.pace import Pace
from pzt_nodes.parameters import declare_all, declare_rate, declare_text
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import Block
from pzt_ros.hardware.stage import Relay, SimulatedStage, Truth
from pzt_ros.physics.signals import ABSENT
from pzt_ros.reference import block_times
from pzt_ros.scenario import REAL_TIME


class PlantNode(GraphNode):
    """The simulated stage. With `rate: real time` a block is not given out before its time has come on the wall clock.

    If the amplifier's process dies, nobody is left to ramp the voltage down: then the simulated amplifier's own relay
    discharges the stack through its resistor, as the hardware's would. An enabled amplifier that only holds, because no
    command comes, puts out nothing: its diagnostics are the sign of life then.
    """

    def __init__(self) -> None:
        super().__init__("plant")
        chain = self.load_plant()
        self._pace = Pace() if declare_rate(self) == REAL_TIME else None
        self._enabled = True  # until the amplifier says otherwise
        self.relay = declare_all(self, "relay", Relay(), read_only=True)
        self.stage = SimulatedStage(chain, self.rest)
        self.stage.warm_up()
        self._voltage = 0.0
        self._next_block = 0
        self._heard = time.monotonic()
        self._said: float | None = None
        self._unsaid: deque[Truth] = deque()  # each waits for its time
        self._responses = LatencyLog()
        named = declare_text(self, "neighbour", "", "namespace of an axis whose motion this one feels")
        self._neighbour = Neighbour(self, named) if named else None
        # A ramp to 0 V waits for nobody, and a real stage misses none of it.
        self.listen("applied", self._on_applied, QOS[TOPICS["applied"].qos].sender_depth)
        self.listen_to_health(self._on_health)
        self.create_timer(0.05, self._watch)

    def _on_applied(self, block: Block) -> None:
        self._heard = time.monotonic()
        if self._said is not None:
            self._responses.add(self._heard - self._said)
        self._voltage = float(block["voltage_V"][-1])
        self._next_block = self.tick_of(block) + 1
        neighbour = self._neighbour.along(len(block)) if self._neighbour else ABSENT
        truth = self.stage.step(block.time, block["voltage_V"], neighbour)
        if self._pace is not None and self._enabled:
            self._unsaid.append(truth)
            # in a turn of its own: what else is due now is done while there is time, and not in the middle of a tick
            self.turns.take(partial(self._say_in_time, self._pace, float(block.time[-1]) + 1.0 / self.sample_rate))
        else:
            self._say(truth)

    def _say_in_time(self, pace: Pace, due: float) -> None:
        if self._unsaid:  # else a ramp, which waits for nobody, has been here first
            pace.wait_for(due)
            self._give_out(self._unsaid.popleft())

    def _on_health(self, role: str, _level: str, _text: str, values: dict[str, str]) -> None:
        """Only a beat of commands has a pace: a ramp keeps its own, and between two beats time stands still."""
        if role == "amplifier":
            self._enabled = values.get("state") == "enabled"
            if self._enabled:
                self._heard = time.monotonic()
            if self._pace is not None and not self._enabled:
                self._pace.pause()

    def _say(self, truth: Truth) -> None:
        """At once, and before it what still waits: readers get the truth in the order in which it happened."""
        self._unsaid.append(truth)
        self._say_all()

    def _say_all(self) -> None:
        while self._unsaid:
            self._give_out(self._unsaid.popleft())

    def _give_out(self, truth: Truth) -> None:
        self.ticks += 1
        self.publish("truth", truth.time, truth.displacement, truth.polarization, truth.phase_fraction)
        self._said = time.monotonic()

    def _watch(self) -> None:
        """The relay: opened when the amplifier has been silent for too long with voltage on the stack."""
        if self._voltage == 0.0 or time.monotonic() - self._heard < self.relay.delay:
            return
        self.get_logger().error(f"amplifier silent with {self._voltage:.1f} V on the stack: discharged by its relay")
        times = block_times(self._next_block, self.block_size, self.sample_rate)
        truth, self._voltage = self.stage.discharge(times, self._voltage, self.relay)
        self._next_block += 1
        self._say(truth)
        self.counts["discharged by relay"] += 1
        self._report()

    def stop(self) -> None:
        """Nothing that the stage did stays unsaid."""
        self._say_all()
        super().stop()

    def health(self) -> tuple[str, str, dict[str, object]]:
        """The pace that was kept, the voltage left on the stack, and how soon the graph answers a block of truth."""
        level, text, values = super().health()
        values["stack_voltage_V"] = round(self._voltage, 6)
        if self._pace is not None:
            values.update(self._pace.summary())
        values.update(self._responses.summary("response"))
        return level, text, values


def main() -> None:
    """Run the plant node."""
    run_node(PlantNode)


if __name__ == "__main__":
    main()
