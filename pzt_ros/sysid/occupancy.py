"""The past of a run as occupancies of an identified lattice: nearly linear, so no search is needed.

Polarization is linear in the occupancy at the first sample (diagnosis-methods.md 4), only the strain law bends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pzt_ros.physics import identified_lattice_kernel as kernel
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.change import Change, Columns
from pzt_ros.physics.identified_hats import hats_of, node_count
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.sysid.gauss_newton import solve
from pzt_ros.sysid.run import Start, drive_of
from pzt_ros.sysid.start import CountedPart, with_offset

_LINES = 13  # of the grid of occupancies, where no fitted run tells how many
_STRENGTH = 1.0  # of what is expected: a distance of 1 counts as much as the rms of the noise
_STEPS, _TOLERANCE = 10, 1e-5


def has_lattice(chain: Chain) -> bool:
    """Whether the ceramic of a chain starts from occupancies."""
    return any(isinstance(link, IdentifiedLattice) for link in chain.links)


def settle_occupancy(chain: Chain, part: CountedPart, fitted: Sequence[Start], noise: float) -> Start:
    """The occupancy at the first sample that the counted samples ask for, and the offset with it.

    Where they do not tell, it is as in the mean of the fitted runs.

    Args:
        chain: with an identified lattice, its parameters fixed.
        part: what may be looked at.
        fitted: starts of the runs that the chain was fitted to.
        noise: of the displacement [m].

    Raises:
        BenchError: as the links of the chain.
    """
    known = [start.occupancy for start in fitted if start.occupancy]
    expected = np.mean(known, axis=0) if known else np.full(node_count(_LINES), 0.5)
    past = _Past(chain, part, expected.size, max(noise, 1e-12))
    held = _STRENGTH * np.eye(expected.size), _STRENGTH * expected
    bounds = np.zeros(expected.size), np.ones(expected.size)
    found = solve(past, expected, *bounds, most_steps=_STEPS, tolerance=_TOLERANCE, prior=held)
    start = Start(occupancy=tuple(float(share) for share in found.vector))
    return with_offset(chain, part, start)


@dataclass(frozen=True)
class _Past:
    """Misfit of the counted samples over the occupancy; a `gauss_newton.Problem`.

    Attributes:
        chain: the model.
        part: what is compared.
        size: of the occupancy.
        noise: of the displacement [m].
    """

    chain: Chain
    part: CountedPart
    size: int
    noise: float

    def residuals(self, occupancy: Array) -> list[Array]:
        return self._compared(occupancy, False)[0]

    def linearise(self, occupancy: Array) -> tuple[list[Array], list[Array]]:
        return self._compared(occupancy, True)

    def _compared(self, occupancy: Array, with_columns: bool) -> tuple[list[Array], list[Array]]:
        signals = drive_of(self.part.record, slice(self.part.end))
        change, jacobians = None, []
        for link in self.chain.links:
            rest = Rest(float(signals.time[0]), float(signals.voltage[0]))
            if isinstance(link, IdentifiedLattice):
                rest = replace(rest, occupancy=occupancy)
                change = Change(self._columns(link, signals, rest)) if with_columns else None
            elif change is not None:
                change = link.carry(signals, change)
            _, signals = link.step(link.init(rest), signals)
        picks = self.part.picks
        left = (self.part.displacement - signals.displacement[picks]) / self.noise
        if change is not None:
            columns = change.displacement[picks].astype(float) / -self.noise
            jacobians = [columns - columns.mean(axis=0)]
        return [left - left.mean()], jacobians

    def _columns(self, link: IdentifiedLattice, signals: Signals, rest: Rest) -> Columns:
        """How P changes with every occupancy [C/m^2, shape (n, size)]."""
        lines = round((np.sqrt(8.0 * self.size + 1.0) - 1.0) / 2.0)
        starts = hats_of(link.lines, np.linspace(link.grid[0], link.grid[-1], lines))
        first = node_count(link.hats.size)  # what the weights do comes out before, and is not wanted
        table = np.zeros((signals.time.size, first + self.size), dtype=np.float32)
        left, polarization = link.left_of_start(rest), np.empty(signals.time.size)
        run = link.init(rest), left, link.relays, signals.time, signals.voltage
        kernel.run_columns(*run, polarization, table, link.hats, 0, starts, first)
        return 2.0 * table[:, first:]
