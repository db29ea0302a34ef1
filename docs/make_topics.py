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
`/diagnostics`.

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
| `enable` | `std_srvs/SetBool` | true: the amplifier follows commands, and a lock-step graph begins; false: ramp to 0
V |
| `discharge` | `std_srvs/Trigger` | ramp to 0 V |
| `reset` | `std_srvs/Trigger` | clear a fault; the amplifier is disabled afterwards |
| `record` | `std_srvs/SetBool` | pause the recorder, or go on |

The controller in charge is the parameter `controller` of the controller node; gains and limits are parameters with
unit and range, and may be set while running.
"""


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8")
