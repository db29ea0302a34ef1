"""Writes docs/topics.md from the topic table: `python docs/make_topics.py`; a test holds the two together."""

from __future__ import annotations

from pathlib import Path

from pzt_config.qos import QOS
from pzt_config.topics import TOPICS

PAGE = Path(__file__).with_name("topics.md")

HEAD = """# Topics

Written by `python docs/make_topics.py` from `msgs_config/topics.py`. Names are relative to the axis namespace,
`/stage` by default.

A **block** is a `std_msgs/Float64MultiArray` with `layout.dim = [("sample", N, N*C), ("time_s,voltage_V,...", C, C)]`:
row-major, one row per sample, the columns named in the second label, `time_s` first. Time is the run's own: the first
sample of block 0 is at 0 s. A block of another size or with other columns is refused, counted and named in
`/diagnostics`; the standard deviations of `estimate` are left out by an observer that has none.

"""


def text() -> str:
    """The page."""
    lines = [
        "| topic | type | from | to | columns or content | rate | QoS |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for topic in TOPICS.values():
        kind = "block" if topic.is_block else f"`{topic.type.replace('/msg/', '/')}`"
        content = topic.description + (f": `{', '.join(topic.columns)}`" if topic.columns else "")
        source = "every node" if topic.publisher == "*" else topic.publisher
        profile = QOS[topic.qos]
        qos = f"{profile.reliability}, {profile.depth}"
        readers = ", ".join(topic.subscribers) or "plotters"
        lines.append(f"| `{topic.name}` | {kind} | {source} | {readers} | {content} | {topic.rate} | {qos} |")
    return HEAD + "\n".join(lines) + SERVICES


SERVICES = """

The recorder writes all of them to the bag.

# Services

| service | type | does |
| --- | --- | --- |
| `enable` | `std_srvs/SetBool` | true: commands are followed, and a lock-step graph begins; false: ramp to 0 V |
| `discharge` | `std_srvs/Trigger` | ramp to 0 V |
| `reset` | `std_srvs/Trigger` | clear a fault; the amplifier is disabled afterwards |
| `pole` | `std_srvs/Trigger` | manual operation: the thesis' initialisation (2.2.1); answers how long it takes |
| `record` | `std_srvs/SetBool` | pause the recorder, or go on |

The amplifier and the sensor node also have the services of a managed node, `change_state` and its kin below the node's
name: [hardware.md](hardware.md).

The controller in charge is the parameter `controller` of the controller node; gains and limits are parameters with
unit and range, and may be set while running.

# Manual operation

`pzt run manual` waits for an operator: any node, the panel, or `ros2` on the command line. Nothing is enabled by
itself.

* `enable` holds the stage where it is: the reference is where the displacement is found, the voltage does not jump.
  Disabling ramps to 0 V; enabling again goes on in the same bag, as often as one likes. The run's own time stands
  still in between, because nothing is put out. Wait until the experiment's diagnostics say `phase: not enabled`;
  before, the graph is still starting.
* `joint_trajectory` moves it, as ROS' JointTrajectoryController would: `joint_names` is the axis (`stage`),
  `positions` in metres, `time_from_start` rising. The path begins at the present reference; between two points that
  both have a velocity it is a cubic, between others a straight line; the last point is held, so its velocity is 0 or
  none. A new message replaces the present one, and one without points stops where the reference is. A `header.stamp`
  of 0 means now; any other is the run's own time, as `joint_states` are stamped. Accelerations and efforts are not
  used.
* What is malformed, or beyond stroke, slew or current by the model that the controllers use, is refused as a whole:
  the reason is in the log of the experiment node (and on `/rosout`), the count in its diagnostics, and the present
  path goes on. Nothing is clipped.
* `pole` is refused while a trajectory is followed, and trajectories while it poles; the scenario's `manual:` has its
  voltage and times.
* The pace is real time, because an operator's times are (`rate: real time` in the scenario). The run ends with
  Ctrl-C, or after `--duration` seconds on the wall clock.

```
ros2 service call /stage/enable std_srvs/srv/SetBool "{data: true}"
ros2 topic pub --once /stage/joint_trajectory trajectory_msgs/msg/JointTrajectory \\
  "{joint_names: [stage], points: [{positions: [4.0e-6], time_from_start: {sec: 1}}]}"
```

The same from a node of one's own: [foreign-node.md](foreign-node.md).

A reference can also come out of a CSV file with `time_s` and `reference_m` (or `displacement_m`), as a phase of a
scenario: `{phase: file, path: reference.csv, controller: inverse_pi}`. It is linear between the rows, and a copy goes
into the run folder.
"""


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8")
