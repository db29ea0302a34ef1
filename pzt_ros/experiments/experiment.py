"""Runs through the phases of a scenario, one block of reference per measurement."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pzt_ros.experiments.phases import Phase
from pzt_ros.physics.signals import Array
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference, block_times


class Experiment:
    """The conductor: knows what comes next, and where the stage was when a phase began.

    Every phase takes a whole number of blocks: it is rounded up, and its last value held.
    """

    def __init__(self, phases: Sequence[Phase], sample_rate: float, block_size: int) -> None:
        self.phases = tuple(phases)
        self.sample_rate = sample_rate
        self.block_size = block_size
        self._blocks = [max(1, math.ceil(phase.length * sample_rate / block_size - 1e-9)) for phase in phases]
        self._phase = 0
        self._block = 0
        self._start = 0.0
        self._last: dict[str, float] = {}

    @property
    def phase(self) -> Phase | None:
        """The phase the next block belongs to; None when the scenario is over."""
        return self.phases[self._phase] if self._phase < len(self.phases) else None

    @property
    def length(self) -> float:
        """Duration of the whole scenario [s]."""
        return sum(self._blocks) * self.block_size / self.sample_rate

    @property
    def left(self) -> float:
        """Of the scenario [s]."""
        blocks = sum(self._blocks[self._phase :]) - self._block
        return blocks * self.block_size / self.sample_rate

    @property
    def doing(self) -> str:
        """The kind of the phase the next block belongs to; over when there is none."""
        return self.phase.kind if self.phase is not None else "over"

    def observe(self, time: Array, voltage: Array) -> None:
        """A block was applied; a scenario goes on whatever it was."""

    def spans(self, first_block: int = 1) -> list[tuple[Phase, float, float]]:
        """Each phase with the time [s] at which it begins and ends, if its first block has that number."""
        spans, begin = [], first_block
        for phase, blocks in zip(self.phases, self._blocks, strict=True):
            end = begin + blocks
            spans.append((phase, begin * self.block_size / self.sample_rate, end * self.block_size / self.sample_rate))
            begin = end
        return spans

    def step(self, block: int, displacement: float, voltage: float) -> Reference | None:
        """The reference of block number `block`, or None when the scenario is over.

        Args:
            block: number of the block since the run began; sets the time stamps.
            displacement: where the stage is now, as measured [m]; a move that follows a voltage starts here.
            voltage: across the ceramic now [V]; a ramp that follows a displacement starts here.
        """
        phase = self.phase
        if phase is None:
            return None
        if self._block == 0:
            found = {DISPLACEMENT: displacement, VOLTAGE: voltage}
            self._start = self._last.get(phase.quantity, found[phase.quantity])
        n = self.block_size
        first = self._block * n + 1
        # The first sample of a phase comes one sample after its start value, so that phases join without repeating it.
        since = np.arange(first, first + n) / self.sample_rate
        values = phase.value(self._start, since)
        controller = getattr(phase, "controller", "") if self._block == 0 else ""
        self._last = {phase.quantity: float(values[-1])}
        self._block += 1
        if self._block == self._blocks[self._phase]:
            self._phase, self._block = self._phase + 1, 0
        return Reference(phase.quantity, block_times(block, n, self.sample_rate), values, controller)
