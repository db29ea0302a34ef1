"""Strain that hangs back behind the polarization after each turn, where that was recorded: a play before a law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.effects.strain_polarization_hysteresis import StrainsByTurns
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class StrainPolarizationLag(StrainsByTurns):
    """A share of the polarization that strains follows P by a play operator: (1 - c) P + c play(P).

    The other sign of `StrainPolarizationHysteresis`. Without a record of P it is one more play in the hysteresis of the
    ceramic, and no effect of its own.
    """

    kind: ClassVar[str] = "strain_polarization_lag"

    lagging_share: float = parameter(0.0, "1", "share of P that strains late", symbol="c", bounds=(0.0, 0.9))
    play: float = parameter(
        0.01, "C/m^2", "change of P after the middle of a turn until it follows", symbol="r", bounds=(1e-6, 10.0)
    )

    @property
    def _shape(self) -> tuple[Array, Array]:
        """P - play(P), which strain is behind by."""
        return np.array([-self.lagging_share]), np.array([self.play])
