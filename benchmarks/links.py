"""The links and chains that the benchmarks time, by name."""

from __future__ import annotations

from pzt_ros.chains import load_chain
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.front import Front
from pzt_ros.physics.link import Link

CHAINS = ("p802", "thesis-p3", "thesis-q1")
"""Shipped chains that together have every link but the front model."""


def link_of(kind: str) -> Link:
    """A link of this kind as a shipped chain has it."""
    if kind == Front.kind:
        return Front()
    return next(link for name in CHAINS for link in load_chain(name).links if link.kind == kind)


def chain_of(name: str) -> Chain:
    """A shipped chain; or `front`: the front model, and what turns its polarization into a displacement."""
    if name == Front.kind:
        return Chain(name, (Front(), link_of("electrostriction")))
    return load_chain(name)
