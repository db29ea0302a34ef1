"""Candidates of one round: every effect screened, those that promise most refitted, from several places."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import repeat

import numpy as np

from pzt_ros.diagnosis.candidates import Candidate, best_of_each
from pzt_ros.diagnosis.elimination import without
from pzt_ros.diagnosis.elsewhere import from_elsewhere_soon
from pzt_ros.diagnosis.finish import finished
from pzt_ros.diagnosis.histories import with_histories_of
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.judge import Judge
from pzt_ros.diagnosis.refinement import refits, rivals_of, seen_as
from pzt_ros.diagnosis.screen import Prospect, Screen
from pzt_ros.diagnosis.time_limit import TimeLimit
from pzt_ros.effects.effect import Effect
from pzt_ros.effects.insert import effects_in
from pzt_ros.effects.table import EFFECT_OF, EFFECTS
from pzt_ros.errors import BenchError
from pzt_ros.parallel import IN_THIS_PROCESS, Workers, side_by_side

_NO_START = "no start of it can be evaluated on these runs"
_AT_ONCE = 2  # effects that are screened
_MORE = 2  # effects beyond those that are refitted, whose shape is sought before the choice
_MORE_THAN_ALIKE = 1.05  # times what its like promises, for a variant with numbers of each run to be refitted instead
_NEARBY = 2.0  # times what the base leaves, up to which a place is nearby that leaves more
_LIKELIEST = 3  # effects each tried on a density of its own, though it explains little on the one for all
_STUCK = 0.1  # of what it promised and the best gained: a refit that gains less did not leave the base


@dataclass
class Seeker(Judge):
    """Finds what may be added to a hypothesis.

    Attributes:
        effects: that may be named.
        progress: is told what is being tried.
        workers: refit the candidates.
        origins: the base in other places, each fitted when it is asked for. A base fitted without an effect bends to
            make up for it, sometimes so far that no refit finds its way back; candidates are then refitted from these.
        sooner: those of them that are tried before the base itself, which went astray.
        is_lost: whether no origin helps, for the base is wrong; asked where no effect explains half, nor do two all.
        limit: after which what was found until then has to do.
        identify: a density, or elements, anew beside an effect; none where that takes long, or there is nothing to
            identify.
        hidden: names of effects that a base bends for until they promise nothing, which are refitted nevertheless.
        is_at_bottom: whether a refit comes down no more by polishing, as one on a density that is identified beside it.
        known: what was refitted beside a base, from where it is: that is not done again.
    """

    effects: Sequence[Effect] = EFFECTS
    progress: Callable[[str], None] = lambda text: None
    workers: Workers = IN_THIS_PROCESS
    origins: Callable[[], Iterable[Hypothesis]] = lambda: ()
    sooner: Callable[[], Iterable[Hypothesis]] = lambda: ()
    is_lost: Callable[[], bool] = lambda: False
    limit: TimeLimit = field(default_factory=TimeLimit)
    identify: Callable[[Hypothesis], Hypothesis] | None = None
    hidden: frozenset[str] = frozenset()
    is_at_bottom: bool = False
    known: tuple[Hypothesis, Sequence[Candidate]] | None = None

    def _from_anywhere(self, before: Hypothesis, most: float) -> tuple[tuple[Candidate, ...], dict[str, str]]:
        """The best refits of each effect, and why the rest was not refitted.

        A first effect is sought from the base and from the origins, until one comes down to the noise.
        """
        first = not before.effects and not self.at_floor(before)
        sooner = list(self.sooner()) if first else []
        candidates: tuple[Candidate, ...] = ()
        refused: dict[str, str] = {}

        def places() -> Iterator[Hypothesis]:
            yield from sooner
            yield before
            if first and not self.blind(before):
                yield from self.elsewhere(before, candidates)

        for place in places():
            found, refused = self._candidates(before, place, most)
            candidates = best_of_each((*candidates, *found))
            # what is elsewhere led astray, or is far from runs whose pasts are not known there
            is_costly = any(place is each for each in sooner) or before.staged.has_past
            if self._is_settled(candidates) or (is_costly and self._stands_alone(candidates)):
                break
            if candidates and self.limit.is_over():
                break
        names = {candidate.name for candidate in candidates}
        return candidates, {name: why for name, why in refused.items() if name not in names}

    def beside(self, base: Hypothesis) -> tuple[Candidate, ...]:
        """Effects refitted beside a base, from where it is."""
        return self._candidates(base, base)[0]

    def with_effects(self, base: Hypothesis, names: Sequence[str]) -> Hypothesis:
        """A base refitted with effects, one after another; without those that promise nothing beside it."""
        for name in names:
            base = self.with_best(base, (name,))
        return base

    def with_best(self, base: Hypothesis, names: Sequence[str]) -> Hypothesis:
        """A base refitted with the one of some effects that leaves least; as it is where none promises anything."""
        found = replace(self, effects=tuple(EFFECT_OF[name] for name in names)).beside(base)
        return found[0].after if found else base

    def _is_settled(self, candidates: Sequence[Candidate]) -> bool:
        return any(max(c.after.ratios) <= self.thresholds.settled for c in candidates)

    def elsewhere(self, base: Hypothesis, candidates: Sequence[Candidate]) -> Iterable[Hypothesis]:
        """The origins; none where the base is wrong, and no effect explains half of what is left, nor do two all."""
        tells = any(c.share >= self.thresholds.share for c in candidates)
        is_a_start = tells or self.complementary(candidates) or self.half_seen(candidates)
        is_lost = not (is_a_start or base.staged.has_past) and self.is_lost()
        return () if is_lost else self.origins()

    def _stands_alone(self, candidates: Sequence[Candidate]) -> bool:
        """Whether one explains nearly all that is left, down to near the noise, and is far ahead of all others."""
        if not candidates:
            return False
        best, asked = candidates[0], self.thresholds
        near = max(best.after.fit.ratio, best.after.selection.ratio) < asked.near_floor and best.share > asked.whole
        return near and all(self.is_far_ahead(best, each) for each in candidates if each.cause != best.cause)

    def _anew(self, found: Hypothesis, name: str) -> list[Hypothesis]:
        """Refits with one of the effects sought once more beside the others, from several places."""
        bare = without(found, name)
        if bare is None:
            return []
        starts = [Screen(place).best(EFFECT_OF[name]) for place in self._places(bare)]
        return [each.after for each in self._refitted(bare, [start for start in starts if start is not None])]

    def _places(self, found: Hypothesis) -> Iterator[Hypothesis]:
        """A hypothesis where it is, and with its ceramic as in those origins where it can be evaluated."""
        yield found
        own = found.staged.ceramic.start.size
        for origin in (*self.sooner(), *self.origins()):
            vector = np.concatenate((origin.vector[: origin.staged.ceramic.start.size], found.vector[own:]))
            with suppress(BenchError):
                yield fitted(replace(found.staged, ceramic=origin.staged.ceramic), vector, found.effects, 0)

    def _candidates(
        self, before: Hypothesis, seen_from: Hypothesis, most: float = math.inf, most_alone: float = 0.0
    ) -> tuple[tuple[Candidate, ...], dict[str, str]]:
        """Effects refitted beside what is in a hypothesis, from where another promises most; why the rest was not.

        Those that promise to leave more than `most` of the mean square are not refitted, unless they are seen from
        where the base was not fitted to its end: there less has to be promised. Where none promises so much, the best
        is, if it promises to leave no more than `most_alone`.
        """
        self.progress(f"screening {len(self.effects)} effects" + before.beside)
        screen = Screen(seen_from)
        reasons = {effect.name: self._why_not(effect, before) for effect in self.effects}
        refused = {name: reason for name, reason in reasons.items() if reason}
        asked = [effect for effect in self.effects if not reasons[effect.name]]
        seen = side_by_side(screen.best, asked, _AT_ONCE)
        refused.update({e.name: _NO_START for e, prospect in zip(asked, seen, strict=True) if prospect is None})
        prospects = sorted((prospect for prospect in seen if prospect is not None), key=_left)
        is_nearby = before.total < seen_from.total <= _NEARBY * before.total
        there = seen_from if is_nearby else before
        most = max(most, there.total) if is_nearby else most
        near = self.thresholds.refits + _MORE
        sought = [p for n, p in enumerate(prospects) if p.effect.limits or (n < near and self._is_worth(there, p))]
        refined = dict(
            zip((p.effect.name for p in sought), side_by_side(screen.refined, sought, _AT_ONCE), strict=True)
        )
        prospects = sorted((refined.get(p.effect.name, p) for p in prospects), key=_left)
        promising = [p for p in prospects if self._is_worth(there, p)]
        alone = [p for p in promising if p.total <= most_alone][:1]
        worth = _one_of_alike(there, [p for p in promising if p.total <= most]) or alone
        causes = list(dict.fromkeys(p.effect.reported for p in worth))[: self.thresholds.refits]
        hidden = [p for p in prospects if p.effect.name in self.hidden and p.effect.reported not in causes]
        causes += [p.effect.reported for p in hidden]
        worth += [p for p in hidden if p not in worth]
        asked_of = [p for p in worth if p.effect.reported in causes]
        done = self._done(before, seen_from, asked_of)
        found, tried = self._refitted_in_turn(before, [p for p in asked_of if p.effect.name not in done])
        found, tried = [*found, *done.values()], [*tried, *(p for p in asked_of if p.effect.name in done)]
        for prospect in prospects:
            if prospect not in tried:
                refused[prospect.effect.name] = f"promises {_promise(before, prospect):.0%} of the excess, " + (
                    f"{_promise(before, worth[0]):.0%} the best" if worth else "too little to look for"
                )
        return tuple(sorted(found, key=lambda c: c.after.total)), refused

    def _done(self, before: Hypothesis, seen_from: Hypothesis, asked: Sequence[Prospect]) -> dict[str, Candidate]:
        """Those that were refitted beside this base, from where it is, by name."""
        if self.known is None or not (before is seen_from is self.known[0]):
            return {}
        names = {prospect.effect.name for prospect in asked}
        return {each.name: each for each in self.known[1] if each.name in names}

    def _refitted_in_turn(
        self, before: Hypothesis, worth: Sequence[Prospect]
    ) -> tuple[list[Candidate], Sequence[Prospect]]:
        """Those that may be as good as the best refitted, the others only where none of those is enough; and which."""
        least = self.thresholds.promised * _promise(before, worth[0]) if worth else 0.0
        first = [prospect for prospect in worth if _promise(before, prospect) >= least]
        found = self._refitted(before, first)
        if len(first) == len(worth) or any(c.share >= self.thresholds.share for c in found) or self.limit.is_over():
            return found, first
        return [*found, *self._refitted(before, worth[len(first) :])], worth

    @property
    def _holds_back(self) -> bool:
        """Whether the base bends for what is missing until a refit beside it gains little: elements that slip do."""
        return self.identify is not None and not self.is_at_bottom

    def _is_worth(self, before: Hypothesis, prospect: Prospect) -> bool:
        return before.total - prospect.total > self.thresholds.promise

    def _why_not(self, effect: Effect, before: Hypothesis) -> str:
        causes = {EFFECT_OF[link.kind].reported for link in effects_in(before.staged.chain)}
        if effect.reported in causes:  # a variant beside its like would name one cause twice
            return "is in the model"
        missing = [column for column in effect.needs if any(column not in r.record.columns for r in before.staged.runs)]
        return f"cannot be seen without {', '.join(missing)}" if missing else ""

    def _refitted(self, before: Hypothesis, prospects: Sequence[Prospect]) -> list[Candidate]:
        if not prospects:
            return []
        names = [prospect.effect.name for prospect in prospects]
        self.progress(f"refitting with {', '.join(dict.fromkeys(names))}" + before.beside)
        begun = refits(prospects, before.effects, self.workers)
        afters = self._from_the_best(before, prospects, begun)
        afters = [after and from_elsewhere_soon(after, self.thresholds) for after in afters]
        tried = [(prospect, after) for prospect, after in zip(prospects, afters, strict=True) if after]
        found = [Candidate(prospect.effect.name, seen_as(before, prospect), after) for prospect, after in tried]
        if self.limit.is_over():
            return found
        found = self._on_own_densities(found)
        rivals = [rival for rival in rivals_of(found) if self.is_worth_finishing(rival)]
        better = dict(zip(rivals, self._finished([candidate.after for candidate in rivals]), strict=True))
        return [replace(candidate, after=better.get(candidate, candidate.after)) for candidate in found]

    def _on_own_densities(self, found: list[Candidate]) -> list[Candidate]:
        """Refits each on a density, or on elements, identified beside its effect.

        One that was identified without an effect has bent for it, and so has its law of strain, which shows where it
        was not fitted: beside a creep 2.9 x the noise was left there, and 1.0 x on a density identified beside the two.
        An effect has to explain enough where it was fitted for that, or to be among the likeliest: a fatigue of 10 x
        explained a third of what plays left, and all of it on relays beside it. Elements may only have held the refit
        back: beside a bias field of 10 x, which they let explain 1 %, they leave the noise.
        """
        if self.identify is None or not found:
            return found
        least = -math.inf if self._holds_back else self.thresholds.share
        bent = [each for each in found if each.fit_share >= least]
        bent += [each for each in sorted(found, key=lambda each: each.after.total)[:_LIKELIEST] if each not in bent]
        afters = self.workers.map(self.identify, [each.after for each in bent])
        pairs = zip(bent, afters, strict=True)
        told = {each: min(each.after, after, key=lambda found: found.total) for each, after in pairs}
        return [replace(each, after=told.get(each, each.after)) for each in found]

    def _finished(self, rivals: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Refits taken on; beside unknown pasts from those of the best where it comes to the floor by them.

        A search for pasts of its own takes each a minute, and what is as good beside the same runs is so beside theirs.
        """
        best = min(rivals, key=lambda each: each.total, default=None)
        if best is None or not best.staged.has_past:
            return list(self.workers.map(finished, rivals, [not self.at_floor(each) for each in rivals]))
        others = [each for each in rivals if each is not best]
        there = finished(best, not self.at_floor(best))
        if self.at_floor(there):
            afters = iter(self.workers.map(with_histories_of, others, repeat(there)))
        else:
            afters = iter(self.workers.map(finished, others, [not self.at_floor(each) for each in others]))
        return [there if each is best else next(afters) for each in rivals]

    def _from_the_best(
        self, before: Hypothesis, prospects: Sequence[Prospect], afters: Sequence[Hypothesis | None]
    ) -> list[Hypothesis | None]:
        """Refits that hardly left the base begin again where the best went: that another did is none of its merits."""
        reached = [after for after in afters if after]
        best = min(reached, key=lambda after: after.total, default=before)

        def stuck(prospect: Prospect, after: Hypothesis | None) -> bool:
            promised, gained = before.total - prospect.total, before.total - (after or before).total
            return best is not after and gained < _STUCK * min(promised, before.total - best.total)

        again = [n for n, pair in enumerate(zip(prospects, afters, strict=True)) if stuck(*pair)]
        there = [prospects[n].beginning_at(best.vector) for n in again]
        found = list(afters)
        for n, after in zip(again, refits(there, before.effects, self.workers), strict=True):
            if after and after.total < (found[n] or before).total:
                found[n] = after
        return found


def _one_of_alike(before: Hypothesis, prospects: Sequence[Prospect]) -> list[Prospect]:
    """Without variants that have numbers of each run and promise no more than their like, or without that like.

    Both are reported as one cause, and take up what the other does; a refit of such a variant takes longest.
    """
    promised = {prospect.effect.name: _promise(before, prospect) for prospect in prospects}
    dropped = set()
    for effect in (prospect.effect for prospect in prospects):
        if effect.variant_of in promised and effect.per_run:
            is_more = promised[effect.name] > _MORE_THAN_ALIKE * promised[effect.variant_of]
            dropped.add(effect.variant_of if is_more else effect.name)
    return [prospect for prospect in prospects if prospect.effect.name not in dropped]


def _left(prospect: Prospect) -> float:
    return prospect.total


def _promise(before: Hypothesis, prospect: Prospect) -> float:
    return max(before.total - prospect.total, 0.0) / before.excess
