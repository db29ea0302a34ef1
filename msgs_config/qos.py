"""QoS profiles by name (docs/decisions/0003 has the measurements behind them)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Profile:
    """Reliability, history depth and durability of a topic; the recorder keeps `recorder_depth`.

    The recorder reads every 20 ms, but its disk may stand still for longer: as fast as possible, a composed graph says
    2000 blocks a second. A publisher keeps `sender_depth`: what was lost on the way to a reader without processor time
    is sent again from there, and what is no longer there leaves a gap in the bag.
    """

    reliability: str
    depth: int
    durability: str = "volatile"
    history: str = "keep_last"
    recorder_depth: int = 4000
    sender_depth: int = 1000


QOS: dict[str, Profile] = {
    # "Reliable" with keep-last still overwrites: depth is what prevents loss. Ten blocks are 50 ms of a 20 kHz stream.
    "stream": Profile("reliable", 10),
    "diagnostics": Profile("reliable", 20),
}
