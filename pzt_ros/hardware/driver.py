"""What every driver is: settings that open an instrument, and how an instrument says that it failed.

A new driver is one file with a settings class, and one line in `table.py`. The instrument itself keeps to the
protocols in `amplifier.py` and `stage.py`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.errors import RunFailedError
from pzt_ros.hardware.amplifier import AmplifierDriver
from pzt_ros.hardware.stage import SensorDriver
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Rest


class DriverError(RunFailedError):
    """An instrument does not do what it should; one line: which one, what it did, what to do."""


@dataclass(frozen=True)
class Bench:
    """What a driver may want to know of the run: the chain that would be simulated, its rest, and how time is cut.

    Attributes:
        chain: of the simulated stage.
        rest: its state before the first sample.
        sample_rate: samples per second [Hz].
        block_size: samples in a block.
    """

    chain: Chain
    rest: Rest
    sample_rate: float
    block_size: int


@dataclass(frozen=True, kw_only=True)
class AmplifierSettings(ABC):
    """Settings of an amplifier driver; fields are declared with `parameter` (a number) or `choice` (a word)."""

    kind: ClassVar[str]

    @abstractmethod
    def build(self, bench: Bench) -> AmplifierDriver:
        """The driver, not opened yet."""


@dataclass(frozen=True, kw_only=True)
class SensorSettings(ABC):
    """Settings of a sensor driver; a sensor that reads the simulated truth needs the plant to run."""

    kind: ClassVar[str]
    reads_truth: ClassVar[bool] = False

    @abstractmethod
    def build(self, bench: Bench) -> SensorDriver:
        """The driver, not opened yet."""
