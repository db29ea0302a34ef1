"""What stands for the ceramic in a chain that a diagnosis fits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.run import Start


class Hysteresis(Protocol):
    """Voltage at the ceramic to polarization, for all runs at once, and how it changes with its own unknowns.

    Voltages are those of all runs; of a run that is not asked for, an empty array, and nothing is returned for it.
    """

    names: list[str]
    start: Array
    lower: Array
    upper: Array
    far: float
    """Rms over noise of a misfit beside which the approximation does not count."""
    knows_no_rate: bool
    """Whether P depends on the order of the voltages only."""

    def polarization(self, vector: Array, voltages: Sequence[Array]) -> list[Array]:
        """P of each run [C/m^2, each shape (n,)]."""
        ...

    def tangent(self, vector: Array, voltages: Sequence[Array]) -> tuple[list[Array], list[Array]]:
        """P and dP/d(vector) of each run [each shape (n,) and (n, p)]."""
        ...

    def regularisation(self) -> tuple[Array, Array]:
        """Rows and targets that hold what the data do not tell [shapes (m, p), (m,)]."""
        ...

    def link(self, vector: Array) -> Link:
        """The ceramic as a link."""
        ...

    def for_one_search(self) -> Hysteresis:
        """What one search may use by itself: what it is asked first may change what it answers then."""
        ...

    def exact_at(self, vector: Array, voltages: Sequence[Array]) -> Hysteresis:
        """The same, without approximation at a vector."""
        ...

    def start_of(self, vector: Array, number: int) -> Start:
        """How a run starts."""
        ...

    def way_of(self, vector: Array, number: int) -> Array:
        """P at the reversals before a run [C/m^2, shape (k,)]; none where they are not known."""
        ...

    def places_of(self, number: int) -> list[int]:
        """Unknowns that belong to one run alone."""
        ...

    def stiffer(self) -> list[Hysteresis]:
        """The same held by stronger priors, where it has any."""
        ...


@runtime_checkable
class WithPasts(Protocol):
    """A hysteresis whose runs may have been driven before, each as its start says."""

    def with_starts(self, starts: Sequence[Start]) -> Hysteresis:
        """The same with other pasts of the runs."""
        ...
