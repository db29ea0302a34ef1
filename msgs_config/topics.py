"""The topic table: every topic of the graph, once.

Names are relative to the axis namespace (`/stage` by default). A block is a `std_msgs/Float64MultiArray` whose layout
names its columns (docs/topics.md). Publishers and subscribers are the nodes of the graph; anybody else may join.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

BLOCK = "std_msgs/msg/Float64MultiArray"
JOINT_STATE = "sensor_msgs/msg/JointState"
JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
FLOAT = "std_msgs/msg/Float64"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes:
        name: relative to the axis namespace, or absolute.
        type: ROS message type.
        publisher: the node that publishes it; "*" for every node, "operator" for whoever is outside the graph.
        subscribers: the nodes that need it (the recorder takes all that is `logged`).
        columns: of a block; empty for other messages.
        optional: the last of them, which a sender that has none leaves out.
        qos: name of a profile in `qos.py`.
        rate: how often it is said, for people.
        description: one line, for people.
        logged: whether the recorder writes it to the bag.
        without_plant: nodes that need it only where no simulated plant is in the graph.
    """

    name: str
    type: str
    publisher: str
    subscribers: tuple[str, ...]
    columns: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    qos: str = "stream"
    rate: str = "one per block"
    description: str = ""
    logged: bool = True
    without_plant: tuple[str, ...] = ()

    @property
    def is_block(self) -> bool:
        """Whether it carries blocks of samples."""
        return self.type == BLOCK

    @property
    def required(self) -> tuple[str, ...]:
        """The columns that a block must have."""
        return self.columns[: len(self.columns) - len(self.optional)]

    @cached_property
    def layouts(self) -> tuple[tuple[str, ...], ...]:
        """The columns of a block, in every way in which it may be said."""
        return (self.columns, self.required) if self.optional else (self.columns,)

    @cached_property
    def layout_of(self) -> dict[int, tuple[str, ...]]:
        """The same by how many columns there are."""
        return {len(columns): columns for columns in self.layouts}


TOPICS: dict[str, Topic] = {
    topic.name: topic
    for topic in (
        Topic("reference", BLOCK, "experiment", ("controller",), ("time_s", "displacement_m"),
              description="displacement asked of the next block"),
        Topic("voltage_reference", BLOCK, "experiment", ("controller",), ("time_s", "voltage_V"),
              description="drive voltage asked of the next block, instead of a displacement (poling)"),
        Topic("drive", BLOCK, "controller", ("amplifier",), ("time_s", "command_voltage_V"),
              description="command to the amplifier for the next block"),
        Topic("applied", BLOCK, "amplifier", ("plant", "observer", "controller", "experiment"),
              ("time_s", "voltage_V", "current_A", "charge_C"), without_plant=("sensor",),
              description="what the amplifier put out: voltage across the ceramic, current, charge (Sawyer-Tower); "
              "without a plant the sensor reads by it"),
        Topic("truth", BLOCK, "plant", ("sensor",),
              ("time_s", "displacement_m", "polarization_C_per_m2", "phase_fraction"),
              description="simulation only: what really happened"),
        Topic("measurement", BLOCK, "sensor", ("observer", "controller", "experiment", "amplifier"),
              ("time_s", "displacement_m"),
              description="the sensor's reading; the heartbeat of the graph"),
        Topic("estimate", BLOCK, "observer", ("controller", "amplifier"),
              ("time_s", "displacement_m", "polarization_C_per_m2", "phase_fraction", "innovation_m", "disturbance_m",
               "displacement_std_m", "polarization_std_C_per_m2", "phase_fraction_std"),
              optional=("displacement_std_m", "polarization_std_C_per_m2", "phase_fraction_std"),
              description="the observer's view of the block just measured; standard deviations where it has them"),
        Topic("joint_trajectory", JOINT_TRAJECTORY, "operator", ("experiment",), rate="on demand",
              description="positions [m] at times, for the scenario `manual`; a new one replaces the present one"),
        Topic("joint_states", JOINT_STATE, "sensor", (), rate="at most 100 Hz",
              description="measured position [m] and velocity [m/s], for plotters"),
        Topic("reference_joint_states", JOINT_STATE, "experiment", (), rate="at most 100 Hz",
              description="reference position [m] and velocity [m/s], for plotters"),
        Topic("voltage", FLOAT, "amplifier", (), rate="at most 100 Hz", description="voltage across the ceramic [V]"),
        Topic("tracking_error", FLOAT, "controller", (), rate="at most 100 Hz",
              description="reference minus measurement [m]"),
        Topic("/diagnostics", DIAGNOSTICS, "*", (), qos="diagnostics", rate="1 Hz",
              description="level, reason and counters of every node"),
    )
}  # fmt: skip

NODES = ("recorder", "amplifier", "plant", "sensor", "observer", "controller", "experiment")
"""The nodes of the simulated graph. On hardware there is no plant."""


def published_by(node: str) -> tuple[Topic, ...]:
    """The topics a node publishes."""
    return tuple(topic for topic in TOPICS.values() if topic.publisher in (node, "*"))


def subscribed_by(node: str, nodes: tuple[str, ...] = NODES) -> tuple[Topic, ...]:
    """The topics a node needs in a graph of `nodes`."""
    if node == "recorder":
        return tuple(topic for topic in TOPICS.values() if topic.logged)
    more = () if "plant" in nodes else tuple(t.name for t in TOPICS.values() if node in t.without_plant)
    return tuple(topic for topic in TOPICS.values() if node in topic.subscribers or topic.name in more)


def readers_of(topic: Topic, nodes: tuple[str, ...]) -> int:
    """How many of `nodes` read a topic."""
    return sum(topic in subscribed_by(node, nodes) for node in nodes)
