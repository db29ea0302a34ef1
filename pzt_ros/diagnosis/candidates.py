"""Effects refitted beside a base, and the rounds of a search in which they are judged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pzt_ros.diagnosis.hypothesis import Hypothesis, Misfit
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.effects.table import EFFECT_OF

_QUIET, _NEARLY_ALL = Thresholds.near_floor, Thresholds.whole  # of what chooses and of every run; of the excess


@dataclass(frozen=True, eq=False)  # two of one effect are two refits, and what they hold are arrays
class Candidate:
    """An effect refitted with the base, against the hypothesis without it.

    Attributes:
        name: of the effect.
        before, after: without and with it.
    """

    name: str
    before: Hypothesis
    after: Hypothesis

    @property
    def cause(self) -> str:
        """Name as which it is reported; variants of an effect share it."""
        return EFFECT_OF[self.name].reported

    @property
    def unknowns(self) -> int:
        """How many parameters of effects were fitted, those of all runs together."""
        return len(self.after.staged.coordinates)

    @property
    def fit_gain(self) -> float:
        """n_eff ln(before/after) on what was fitted [-]."""
        return gain_of(self.before.fit, self.after.fit)

    @property
    def selection_gain(self) -> float:
        """The same on what chooses."""
        return gain_of(self.before.selection, self.after.selection)

    @property
    def fit_share(self) -> float:
        """Of the excess over the noise, on what was fitted [-]."""
        return _share(self.before.fit, self.after.fit)

    @property
    def selection_share(self) -> float:
        """The same on what chooses; 1 where nothing chooses."""
        return _share(self.before.selection, self.after.selection)

    @property
    def share(self) -> float:
        """The smaller of both: an effect has to show itself where it was not fitted, too."""
        return share_of(self.before, self.after)

    @property
    def is_all_but_quiet(self) -> bool:
        """Whether it is nearly all that is missing, and what chooses hardly shows anything."""
        return _is_all_but_quiet(self.before, self.after)

    @property
    def fit_size(self) -> float:
        """Rms that it explains in units of the noise, in the fitted run where that is most."""
        return self._size(self.before.staged.fitted)

    @property
    def selection_size(self) -> float:
        """The same on what chooses; infinite where nothing chooses."""
        return self._size(self.before.choosing)

    def _size(self, runs: Sequence[int]) -> float:
        gained = [self.before.ratios[run] ** 2 - self.after.ratios[run] ** 2 for run in runs]
        return math.sqrt(max(0.0, *gained)) if gained else math.inf


def share_of(before: Hypothesis, after: Hypothesis) -> float:
    """Of the excess over the noise that is explained, the smaller of both kinds of parts [-].

    Of both together where what chooses hardly shows anything, and nearly all is explained: steps that a mode rings
    after may all be in fitted runs, and the rest is what a base is off by.
    """
    if _is_all_but_quiet(before, after):
        return _together(before, after)
    return min(_share(before.fit, after.fit), _share(before.selection, after.selection))


def _is_all_but_quiet(before: Hypothesis, after: Hypothesis) -> bool:
    """Whether nearly all is explained, down to near the noise in every run, and what chooses was near it before."""
    is_quiet = max(before.selection.ratio, *after.ratios) <= _QUIET and after.selection.total < before.selection.total
    return is_quiet and _together(before, after) >= _NEARLY_ALL


def _together(before: Hypothesis, after: Hypothesis) -> float:
    return (before.total - after.total) / before.excess


def _share(before: Misfit, after: Misfit) -> float:
    return (before.total - after.total) / before.excess if before.samples else 1.0


def gain_of(before: Misfit, after: Misfit) -> float:
    """n_eff ln(before/after) of one kind of parts [-]; infinite where there is none."""
    if not before.samples:
        return math.inf
    return after.effective * math.log(before.total / after.total)


@dataclass(frozen=True)
class Step:
    """One round of the search.

    Attributes:
        before: the hypothesis that it started from.
        candidates: refitted, the accepted one first, then the best.
        refused: why each effect that was not refitted was not, by name.
        accepted: the effects added, none where the search ended.
        tied: names any of which explains the residual as well, the winner first; empty where there is one answer.
        verdict: why it was decided so.
        base_instead: what was there before, as good as with the best, from where that had taken it.
    """

    before: Hypothesis
    candidates: tuple[Candidate, ...]
    refused: dict[str, str]
    accepted: tuple[Candidate, ...]
    tied: tuple[str, ...]
    verdict: str
    base_instead: Hypothesis | None = None

    @property
    def after(self) -> Hypothesis:
        """Where the search goes on."""
        return self.accepted[-1].after if self.accepted else self.before


def best_of_each(candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Of each effect the refit that came out best, the best effect first."""
    best: dict[str, Candidate] = {}
    for candidate in sorted(candidates, key=lambda c: c.after.total):
        best.setdefault(candidate.name, candidate)
    return tuple(best.values())
