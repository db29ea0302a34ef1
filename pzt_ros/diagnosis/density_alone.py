"""Names that stand for what a formula of a density is off by, and go where an identified one leaves nothing."""

from __future__ import annotations

from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.formula import identified_about, is_formula_off
from pzt_ros.diagnosis.search import Search


def density_alone(branch: Branch, search: Search) -> Branch:
    """The branch on a density identified about its formula, where that leaves nothing without the names; else itself.

    Args:
        branch: with names or without.
        search: on a lattice.
    """
    asked, base, final = search.thresholds, branch.base, branch.final
    is_off = is_formula_off(base, asked) or (base.fit.ratio <= asked.in_sight and is_formula_off(final, asked))
    if not (final.effects and is_off) or search.limit.is_over():
        return branch
    search.progress("identifying the density about its formula")
    alone = identified_about(base)
    is_all = alone is not base and search.at_floor(alone)
    return Branch("identified", alone, ()) if is_all else branch
