"""A declared quadrature whose nodes are too few for what the runs show.

A specimen has no nodes. Those of the thesis are off by 0.7 % of x+, which is 18 x the noise of a good sensor, and an
effect is sought beside that in vain. So the densities that a quadrature stands for are put on a lattice where that
leaves less; what was simulated with the nodes keeps them.
"""

from __future__ import annotations

import dataclasses

from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact_here, fitted
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import Link
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.surrogate import in_place_of

_NOTE = "nodes"


def without_grain(found: Hypothesis, spacing: float) -> Hypothesis:
    """The hypothesis on a lattice, its domains so many thermal widths apart, where a quadrature leaves more."""
    staged, ceramic = found.staged, found.staged.ceramic
    if not isinstance(ceramic, DeclaredHysteresis) or not isinstance(ceramic.model, Quadrature):
        return found
    lattice = in_place_of(ceramic.model, Lattice, spacing=spacing, method=ceramic.model.method)
    chain = staged.chain.with_links(lambda link: _in_place(link, lattice))
    notes = {**chain.notes, _NOTE: "too few"}
    fine = dataclasses.replace(
        staged, chain=dataclasses.replace(chain, notes=notes), ceramic=ceramic.with_polycrystal(lattice)
    )
    other = fitted(fine, found.vector, found.effects, 0)
    return other if exact_here(other).total < exact_here(found).total else found


def was_grainy(found: Hypothesis) -> bool:
    """Whether its lattice stands for a quadrature that was declared."""
    return _NOTE in found.staged.chain.notes


def _in_place(link: Link, lattice: Polycrystal) -> Link:
    return lattice if isinstance(link, Ferroelectric) else link
