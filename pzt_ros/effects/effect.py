"""What an effect is: an optional link of the chain, its place, and what a search for it has to know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array

AT_COMMAND, AT_FIELD, AT_POLARIZATION, AT_DISPLACEMENT, AT_SENSOR = (
    "amplifier", "ferroelectric", "strain", "structure", "sensor",
)  # fmt: skip
PLACES = (AT_COMMAND, AT_FIELD, AT_POLARIZATION, AT_DISPLACEMENT, AT_SENSOR)
"""Where an effect may stand, in the order of the signal.

End of the amplifier section; right before the ferroelectric link; right after it; after the strain link; start of the
sensor section.
"""


@runtime_checkable
class GoesOn(Protocol):
    """A link that is not the same again after a run."""

    def gone_through(self, polarization: Array) -> float:
        """What a run with this polarization [C/m^2] adds to the parameter that `Effect.goes_on` names."""
        ...


@dataclass(frozen=True)
class Effect:
    """An optional link and what the diagnosis needs to look for it.

    Attributes:
        link: the class; `link.kind` is the effect's name, and with its default values it is the identity, to the bit.
        place: one of PLACES.
        amplitude: the parameter whose zero means "absent", the other parameters as in any of `starts`.
        starts: shapes to begin a search from [SI], each with a small amplitude; what is not named keeps its default.
        free: parameters a fit may move, the amplitude included.
        per_run: those of `free` that belong to a run and not to the stage.
        linear: parameters that the output is linear in, one alone at a time; the amplitude where empty.
        additive: those of `free` that a search moves by sums and not by ratios: 0 is a value like any other.
        details: parameters that are moved as well once the effect is the best of its round, and where the runs show
            them: they say how it acts, and whether it is there does not hang on them.
        spans: parameters for the middle and for half the width of the displacement that it acts on, which are given
            and not found; empty where there are none.
        zero: the parameter for the polarization where P is 0, which is found beside a density that was identified, for
            that has its zero anywhere; one of `details`. Empty where the effect knows no zero.
        goes_on: the parameter that counts what was gone through before a run, where that may be known from the runs
            before it; given and not found. Such a link is a `GoesOn`. Empty where there is none.
        needs: columns of the record without which the effect cannot be asked for.
        absence: what its absence leaves in a residual.
        next_experiment: which run would show it alone.
        limits: whether the amplitude says from where on it acts, so that half of it is not half the effect.
        has_own_frequency: whether it is a tone that the drive has no part in, so that no hysteresis that is wrong makes
            up for it, or is made up for by it.
        variant_of: name of the effect whose cause it shares and as which it is reported; empty where it has its own.
    """

    link: type[Link]
    place: str
    amplitude: str
    starts: tuple[Mapping[str, float], ...]
    free: tuple[str, ...]
    per_run: tuple[str, ...] = ()
    linear: tuple[str, ...] = ()
    additive: tuple[str, ...] = ()
    details: tuple[str, ...] = ()
    spans: tuple[str, ...] = ()
    zero: str = ""
    goes_on: str = ""
    needs: tuple[str, ...] = ()
    absence: str = ""
    next_experiment: str = ""
    limits: bool = False
    has_own_frequency: bool = False
    variant_of: str = ""

    @property
    def columns(self) -> tuple[str, ...]:
        """Parameters whose signatures a search combines linearly."""
        return self.linear or (self.amplitude,)

    @property
    def name(self) -> str:
        """As in chain files."""
        return self.link.kind

    @property
    def reported(self) -> str:
        """As in reports: the name of what causes it."""
        return self.variant_of or self.name
