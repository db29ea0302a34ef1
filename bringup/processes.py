"""The process table: what is started, in which order."""

from __future__ import annotations

from dataclasses import dataclass

from pzt_config.topics import NODES


@dataclass(frozen=True)
class ProcessRow:
    """One process of the graph.

    Attributes:
        name: for people.
        module: run with `python -m`.
        nodes: it holds.
    """

    name: str
    module: str
    nodes: tuple[str, ...]

    @property
    def words(self) -> tuple[str, ...]:
        """For the module's command line: a process of several nodes is told which."""
        return self.nodes if len(self.nodes) > 1 else ()


SEPARATE = tuple(ProcessRow(node, f"pzt_nodes.{node}_node", (node,)) for node in NODES)
"""One process per node, in the order of starting: the recorder first, to miss nothing, the experiment last."""


def composed(nodes: tuple[str, ...]) -> tuple[ProcessRow, ...]:
    """The loop in one process, its recorder in another: writing a batch of messages takes longer than a tick."""
    recorder = tuple(row for row in SEPARATE if row.nodes == ("recorder",) and "recorder" in nodes)
    return (*recorder, ProcessRow("graph", "pzt_nodes.composed", tuple(n for n in nodes if n != "recorder")))


STOP_ORDER = (("experiment", "controller", "amplifier"), ("observer", "sensor", "plant", "graph"), ("recorder",))
"""The commands end and the amplifier ramps to 0 V while the others still watch; the recorder sees it all."""
