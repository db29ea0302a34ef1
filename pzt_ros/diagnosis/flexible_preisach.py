"""The Preisach model as the ceramic among other links: exact everywhere, so that refits are."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np

from pzt_ros.diagnosis.hysteresis import Hysteresis
from pzt_ros.diagnosis.stiffer import stiffer_of
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.rate_independent import RateIndependentHysteresis
from pzt_ros.sysid.remembered import Remembered
from pzt_ros.sysid.run import Start

_REMEMBERED = 24  # polarizations of a run at some voltage and vector


class FlexiblePreisach(RateIndependentHysteresis):
    """The rate-independent density as a `hysteresis.Hysteresis`.

    Attributes:
        starts: pasts of the runs.
        sought_beside: effects beside which these were sought last; None where they were not.
    """

    sought_beside: tuple[str, ...] | None = None
    far = math.inf  # no misfit is so large that being exact does not count
    knows_no_rate = Preisach.knows_no_rate

    def __init__(
        self,
        times: Sequence[Array],
        layer_thickness: float,
        field_range: tuple[float, float],
        *,
        resolution: int,
        initial: str,
        total: float,
        starts: Sequence[Start] = (),
        gain: float = 1.0,
    ) -> None:
        """As RateIndependentHysteresis, of runs that all were in the state `initial` before their pasts.

        Args:
            starts: pasts of the runs; none had one where this is empty.
            gain: of the amplifier, which takes these to the ceramic [-].
        """
        known = [False] * len(times)
        super().__init__(
            times,
            layer_thickness,
            field_range,
            unknown_start=known,
            resolution=resolution,
            initial=initial,
            total=total,
        )
        self.gain = gain
        self._begin(list(starts) or [Start()] * len(times))

    def _begin(self, starts: Sequence[Start]) -> None:
        self.starts = tuple(starts)
        self.before = [self.gain * np.asarray(start.prior_voltages) for start in starts]
        self._known: Remembered[Array] = Remembered(_REMEMBERED)

    def polarization(self, vector: Array, voltages: Sequence[Array]) -> list[Array]:
        """P of each run whose voltage is given [C/m^2]; effects behind the ceramic ask for the same again and again."""
        asked = [number for number, voltage in enumerate(voltages) if voltage.size]
        return [self._polarization_of(number, vector, voltages[number]) for number in asked]

    def _polarization_of(self, number: int, vector: Array, voltage: Array) -> Array:
        key = b"%d " % number + vector.tobytes() + voltage.tobytes()
        alone = [voltage if other == number else voltage[:0] for other in range(len(self.times))]
        return self._known.get(key, lambda: RateIndependentHysteresis.polarization(self, vector, alone)[0])

    def for_one_search(self) -> FlexiblePreisach:
        """Itself: what it is asked changes nothing."""
        return self

    def exact_at(self, vector: Array, voltages: Sequence[Array]) -> FlexiblePreisach:
        """Itself: it is exact everywhere."""
        return self

    def start_of(self, vector: Array, number: int) -> Start:
        """How a run starts."""
        return self.starts[number]

    def with_starts(self, starts: Sequence[Start]) -> FlexiblePreisach:
        """The same with other pasts."""
        other = copy.copy(self)
        other._begin(starts)
        return other

    def sought(self, beside: tuple[str, ...]) -> FlexiblePreisach:
        """The same, its pasts marked as sought beside some effects."""
        other = copy.copy(self)
        other.sought_beside = beside
        return other

    def way_of(self, vector: Array, number: int) -> Array:
        """Nothing: how a run came to its start is not known."""
        return np.empty(0)

    def places_of(self, number: int) -> list[int]:
        """Unknowns that belong to one run alone: none."""
        return []

    def on_cells(self, resolution: int, vector: Array) -> tuple[FlexiblePreisach, Array]:
        """The same density on other cells.

        Args:
            resolution: how many over its range.
            vector: as here [shape (p,)].

        Returns:
            The relays, and the vector there [shape (q,)].
        """
        other = FlexiblePreisach(
            self.times,
            self.layer_thickness,
            self.field_range,
            resolution=resolution,
            initial=self.initial,
            total=self.total,
            starts=self.starts,
            gain=self.gain,
        )
        other.rotation_strength, other.smoothness_strength = self.rotation_strength, self.smoothness_strength
        return other, other.carried(self, vector)

    def stiffer(self) -> list[Hysteresis]:
        """The same with a density that is more even along constant coercive field."""
        return [*stiffer_of(self)]
