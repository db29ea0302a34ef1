"""Effects each on a density that was identified beside it: one identified without it has bent for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pzt_ros.diagnosis.beside_effects import BesideEffects, Identify
from pzt_ros.diagnosis.branch import Branch
from pzt_ros.diagnosis.candidates import Candidate, Step
from pzt_ros.diagnosis.flexible import fit_flexible
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.effects.table import LATE

_OWN = 2  # effects that are tried each on a density of its own


def on_own_densities(
    beside: BesideEffects,
    worth: Sequence[Candidate],
    begun: Callable[[Candidate], Hypothesis],
    identify: Identify = fit_flexible,
) -> Branch | None:
    """The first of them each on a density of its own, of another cause each: two variants are no two answers.

    Args:
        beside: the search there.
        worth: it, the likeliest first; the others are tried on the density of one that is as late.
        begun: where a candidate begins.
        identify: a density.
    """
    best_of_cause = {each.cause: each for each in reversed(worth)}
    each_cause = [each for each in worth if best_of_cause[each.cause] is each]
    late = [each for each in each_cause if each.name in LATE]
    likeliest = [each for each in each_cause if each not in late[1:]][:_OWN]
    others = [each.name for each in each_cause if each not in likeliest]
    return beside.on_own_densities({each.name: begun(each) for each in likeliest}, identify, others)


def on_own_lattices(flexible: Hypothesis, first: Step, beside: BesideEffects) -> Branch | None:
    """The effects that explain enough of what a lattice leaves, each on one of its own, where nothing is left there.

    A lattice identified without an effect has bent for it. Of a bias field of 10 x beside tilted densities it left 1.9
    to 6 x and with it still 1.5 to 3, and took a drift beside it to the noise; beside it, it left the noise.
    """
    asked = beside.asked
    worth = [c for c in first.candidates if beside.search.is_significant(c) and c.share >= asked.share]
    return on_own_densities(beside, worth, lambda each: beside.search.with_effects(flexible, [each.name]))
