"""Densities with a formula, which come near the noise with a few numbers and are yet off by a little.

Beside tails that were heavy two shapes left 1.03 x of the runs that were fitted, a hysteresis of the strain took that
though none was there, and where an effect was, runs that score were predicted to 1.23 x. A density identified about
what the formula has, and as that where the runs do not tell, left 1.00 x, and 1.03 x of those that score.

And formulas that an effect had bent so far that nothing was to be seen beside them: with the effect as a lattice tells
it, and free shapes, they may be right, and know what no run told. Skewed thresholds with a lag of 10 x left Gaussians
at 6 x, a lattice beside the lag 1.01 x and 1.24 x of the runs that score, and shapes beside it 1.00 x of both.
"""

from __future__ import annotations

from contextlib import suppress

from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.flexible import fit_about
from pzt_ros.diagnosis.flexible_lattice import FlexibleHysteresis
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.of_kinds import of_kinds
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.errors import BenchError
from pzt_ros.parallel import IN_THIS_PROCESS, Workers
from pzt_ros.physics.polycrystal import Polycrystal

_REMEMBERS = 0.8
"""Share of the samples that tell something new from which what is left of them is the noise's: of right densities 1.0,
of shapes that stood for heavy tails 0.2 to 0.5. The noise's size says less: a hum has it estimated too large."""


def is_formula_off(found: Hypothesis, asked: Thresholds) -> bool:
    """Whether what a density with a formula leaves is near the noise, and yet remembers itself as noise does not."""
    links = found.staged.chain.links
    is_formula = any(isinstance(link, Polycrystal) and link.threshold_density is None for link in links)
    if not (is_formula and found.choosing) or found.staged.has_past or max(found.ratios) > asked.near_floor:
        return False
    return any(part.effective < _REMEMBERS * part.samples for part in (found.fit, found.selection))


def formula_again(
    found: Hypothesis, declared: Hypothesis, asked: Thresholds, workers: Workers = IN_THIS_PROCESS
) -> Hypothesis:
    """Beside its effects, densities with a formula in place of a lattice, where those leave hardly more.

    Args:
        found: on an identified lattice, or another base, which stays.
        declared: the base whose densities these are, fitted without an effect; they begin as the lattice tells them.
        asked: how much more they may leave, with far fewer numbers.
        workers: fit formulas side by side.
    """
    lattice, ceramic = found.staged.ceramic, declared.staged.ceramic
    if not (isinstance(lattice, FlexibleHysteresis) and lattice.choice):
        return found
    if not isinstance(ceramic, DeclaredHysteresis) or not isinstance(ceramic.model, Polycrystal):
        return found
    if not ceramic.model.has_formula:
        return found
    if found.staged.has_past or any(run.wander for run in found.staged.runs):
        return found
    with suppress(BenchError):
        other = of_kinds(found, ceramic, workers)
        if other.total <= asked.plainer * found.total:
            return other
    return found


def identified_about(found: Hypothesis) -> Hypothesis:
    """With a density identified about the formula's, where that leaves less of what is fitted and of what chooses.

    It is fitted to the one alone, so the other says whether it only bends.
    """
    with suppress(BenchError):
        other = fit_about(found)
        if other.fit.total < found.fit.total and other.selection.total < found.selection.total:
            return other
    return found
