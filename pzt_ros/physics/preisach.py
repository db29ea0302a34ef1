"""The classical Preisach model with a density that was identified from measured runs, as a link of the chain."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics import preisach_kernel as kernel
from pzt_ros.physics.link import State
from pzt_ros.physics.preisach_kernel import Classes, Plays
from pzt_ros.physics.signals import Array, Rest
from pzt_ros.physics.switching import Switching
from pzt_ros.quantities import choice, parameter, table

_DEFAULT_COERCIVE = tuple(float(field) for field in np.linspace(0.0, 1.5e6, 7))
_DEFAULT_INTERACTION = tuple(float(field) for field in np.linspace(-1.5e6, 1.5e6, 9))
_DEFAULT_WEIGHTS = tuple(
    0.012 * float(np.exp(-0.5 * ((coercive - 5e5) / 4e5) ** 2 - 0.5 * (interaction / 8e5) ** 2))
    for coercive in _DEFAULT_COERCIVE
    for interaction in _DEFAULT_INTERACTION
)
_EVEN = 1e-6  # of the distance of two lines: how far another may differ


@dataclass(frozen=True, kw_only=True)
class Preisach(Switching):
    """Voltage to polarization of relays that switch at once, whatever the rate; weighted by coarse hat functions.

    It is the limit of `identified_lattice` in which the thermal field goes to 0, without that one's lines: the relays
    of one coercive field are one play operator.

    State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], then every play [V/m].
    """

    kind: ClassVar[str] = "preisach"
    knows_no_rate: ClassVar[bool] = True
    _kernel: ClassVar[Any] = kernel

    susceptibility: float = parameter(1.7e-8, "C/(V*m)", "of what does not switch", symbol="1/E_1", bounds=(0.0, 1e-4))
    polarization_offset: float = parameter(0.0, "C/m^2", "of domains that never switch", bounds=(-10.0, 10.0))
    plays: float = parameter(100.0, "1", "plays over the coercive fields", bounds=(2.0, 5000.0))
    initial: str = choice("virgin", ("virgin", "down", "up"), "at 0 V, before the run")
    coercive: tuple[float, ...] = table(
        _DEFAULT_COERCIVE, "V/m", "coarse lines of coercive field, ascending from 0", bounds=(0.0, 1e9)
    )
    interaction: tuple[float, ...] = table(
        _DEFAULT_INTERACTION, "V/m", "coarse lines of interaction field, equally spaced", bounds=(-1e9, 1e9)
    )
    weights: tuple[float, ...] = table(
        _DEFAULT_WEIGHTS,
        "C/m^2",
        "polarization of the hat at each pair of lines: all interaction fields of the first coercive field, and so on",
        bounds=(0.0, 100.0),
    )

    def __post_init__(self) -> None:
        for name, lines in (("coercive", np.asarray(self.coercive)), ("interaction", np.asarray(self.interaction))):
            if lines.size < 2 or not np.all(np.diff(lines) > 0.0):
                raise BenchError(
                    f"{self.kind}: {name} of {lines.size} fields that do not all increase; give two or more, sorted"
                )
        steps = np.diff(self.interaction)
        if np.ptp(steps) > _EVEN * steps[0]:
            raise BenchError(
                f"{self.kind}: the lines of interaction are {steps.min():.6g} to {steps.max():.6g} V/m apart;"
                " space them equally"
            )
        wanted = len(self.coercive) * len(self.interaction)
        if len(self.weights) != wanted:
            raise BenchError(
                f"{self.kind}: {len(self.weights)} weights for {len(self.coercive)} lines of coercive field and"
                f" {len(self.interaction)} of interaction field, which have {wanted} pairs; give one weight each"
            )

    @cached_property
    def classes(self) -> Classes:
        """The coarse lines of coercive field as the plays see them."""
        lines = np.asarray(self.coercive)
        line = np.clip(np.searchsorted(lines, self._radii, side="right") - 1, 0, lines.size - 2)
        share = np.clip((self._radii - lines[line]) / np.diff(lines)[line], 0.0, 1.0)
        sums = np.zeros(lines.size)
        np.add.at(sums, line, 1.0 - share)
        np.add.at(sums, line + 1, share)
        return Classes(line.astype(np.int64), share, np.where(sums > 0.0, sums, 1.0))

    @cached_property
    def _radii(self) -> Array:
        count = int(self.plays)
        radii: Array = self.coercive[0] + (np.arange(count) + 0.5) / count * (self.coercive[-1] - self.coercive[0])
        return radii

    @cached_property
    def _numbers(self) -> Plays:
        classes, step = self.classes, float(self.interaction[1] - self.interaction[0])
        coarse = np.reshape(self.weights, (len(self.coercive), len(self.interaction))) / classes.sums[:, None]
        share = classes.share[:, None]
        weight = np.zeros((self._radii.size, len(self.interaction) + 2))
        weight[:, 1:-1] = (1.0 - share) * coarse[classes.line] + share * coarse[classes.line + 1]
        below = np.zeros_like(weight)
        below[:, 1:] = np.cumsum(0.5 * (weight[:, 1:] + weight[:, :-1]), axis=1)
        return Plays(
            radii=self._radii,
            weight=weight,
            below=below,
            low=self.interaction[0] - step,
            step=step,
            susceptibility=self.susceptibility,
            offset=self.polarization_offset,
            layer_thickness=self.layer_thickness,
        )

    def init(self, rest: Rest) -> State:
        """`initial` at 0 V, then straight to the rest."""
        side = {"virgin": 0.0, "down": -1.0, "up": 1.0}[self.initial]
        slope = (self.susceptibility + 2.0 * sum(self.weights) / self.coercive[-1]) / self.layer_thickness
        state = np.concatenate(([rest.time, 0.0, slope], side * self._radii))
        self._run(state, np.array([rest.time]), np.array([rest.voltage]))
        return state

    def columns(self, state: State, time: Array, voltage: Array) -> Array:
        """What is up of each hat, sample by sample, in the order of `weights` [-, shape (n, weights)].

        Raises:
            BenchError: as `step`.
        """
        found = np.empty((time.size, len(self.coercive), len(self.interaction)))
        self._refuse(kernel.run_columns(state.copy(), self._numbers, time, voltage, self.classes, found), time, voltage)
        return found.reshape(time.size, -1)

    @property
    def _state_size(self) -> int:
        return kernel.HEAD + self._radii.size
