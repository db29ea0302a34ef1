"""The flexible base: a density of thresholds and a strain law as the runs show them, instead of as declared.

The misfit of a declared density must not be taken for an effect (diagnosis-methods.md 3.3), so where the declared model
does not come down to the noise, effects are looked for on this base.
"""

from __future__ import annotations

from collections.abc import Sequence

from pzt_ros.diagnosis.coordinates import coordinate
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.staged import Progress, Staged
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.sysid.identified import IdentifiedHysteresis
from pzt_ros.sysid.run import Start

_STEPS = 25
_LEAST_TERM = 0.05  # of the quadratic term at 0.25 C/m^2: where the others start
_TYPICAL_POLARIZATION = 0.25


class FlexibleHysteresis(IdentifiedHysteresis):
    """The identified lattice as a `staged.Hysteresis`."""

    def exact_at(self, vector: Array, voltages: Sequence[Array]) -> FlexibleHysteresis:
        """Itself: it has no approximation."""
        return self

    def start_of(self, vector: Array, number: int) -> Start:
        """The occupancy that was fitted, or its own initial state."""
        return Start(occupancy=tuple(float(share) for share in self.occupancy(vector, number)))

    def places_of(self, number: int) -> list[int]:
        """The occupancy at the start of a run belongs to it alone."""
        place = self._places(number)
        return list(range(place.start, place.stop))


def fit_flexible(declared: Hypothesis, unknown: Sequence[bool], resolution: int, progress: Progress) -> Hypothesis:
    """Fit the identified lattice and a cubic strain law in place of the declared ceramic and its strain.

    Args:
        declared: the fitted declared model; what else is in its chain stays.
        unknown: of each run, whether what was before it is unknown.
        resolution: coarse cells over the driven range of field.
        progress: is told what is being done.
    """
    progress(f"fitting the density, {resolution} cells a side")
    runs = declared.staged.runs
    chain = declared.staged.chain_at(declared.vector)
    ceramic = next(link for link in chain.links if isinstance(link, Ferroelectric))
    low = min(float(run.record.voltage.min()) for run in runs) / ceramic.layer_thickness
    high = max(float(run.record.voltage.max()) for run in runs) / ceramic.layer_thickness
    times = [run.record.time for run in runs]
    flexible = FlexibleHysteresis(
        times, ceramic.layer_thickness, (low, high), unknown_start=unknown, resolution=resolution
    )
    law = next((_law(link) for link in chain.links if isinstance(link, Electrostriction)), StrainLaw())
    placeholder = flexible.link(flexible.start)
    replaced = chain.with_links(lambda link: _replaced(link, placeholder, law))
    size = _LEAST_TERM * abs(law.quadratic)
    coordinates = (
        coordinate(law, "linear", typical=size * _TYPICAL_POLARIZATION),
        coordinate(law, "quadratic", typical=abs(law.quadratic)),
        coordinate(law, "cubic", typical=size / _TYPICAL_POLARIZATION),
    )
    kept = tuple(each for each in declared.staged.coordinates if each.kind != Electrostriction.kind)
    staged = Staged(replaced, flexible, runs, (*coordinates, *kept))
    start = staged.start
    if kept:
        start[-len(kept) :] = declared.vector[-len(kept) :]
    return fitted(staged, start, most_steps=_STEPS)


def _law(link: Electrostriction) -> StrainLaw:
    return StrainLaw(linear=0.0, quadratic=link.coefficient * link.active_length, cubic=0.0)


def _replaced(link: Link, ceramic: Link, law: StrainLaw) -> Link:
    if isinstance(link, Ferroelectric):
        return ceramic
    return law if isinstance(link, Electrostriction) else link
