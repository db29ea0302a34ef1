"""What is believed of effects that were refitted: every decision that asks the thresholds only, and fits nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from pzt_ros.diagnosis.candidates import Candidate, Step, gain_of, share_of
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.identifiability import Alike, alike_by_design
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.strain_laws import STRAIN_LAW
from pzt_ros.effects.table import CONFOUNDED, EFFECT_OF


@dataclass
class Judge:
    """Decisions by thresholds.

    Attributes:
        thresholds: what is asked of an effect.
    """

    thresholds: Thresholds = field(default_factory=Thresholds)

    def explains(self, steps: Sequence[Step], base: Hypothesis) -> bool:
        """Whether a search ended where nothing is left, or nothing but what its effects' shapes are off by."""
        final = steps[-1].after if steps else base
        share = share_of(base, final) if final is not base else 0.0
        near = max(final.ratios) < self.thresholds.near_floor
        return self.at_floor(final) or (share > self.thresholds.whole and near)

    def is_outdone(self, steps: Sequence[Step], other: Hypothesis) -> bool:
        """Whether another base without an effect leaves far less beyond the noise than the search so far."""
        return self._leaves_far_less(other, steps[-1].after)

    def at_floor(self, hypothesis: Hypothesis) -> bool:
        """Whether nothing is left in any run that would have to be explained."""
        return max(hypothesis.ratios) <= self.thresholds.floor

    def is_half_told(self, steps: Sequence[Step]) -> bool:
        """Whether what is missing looks like two effects, neither of which is enough alone.

        So it does where two make it up between them, where one explains nearly the half that is asked, as one of two of
        a size does, and where one is all that is missing where it was fitted, or where not: so much is not missing by
        chance, and another effect hides in the others. Two that make it up where it was fitted are enough, if one of
        them shows everywhere: a base that bent for both may be off elsewhere until it has both. One that was added may
        stand for two others that make up more.
        """
        first, asked = steps[0], self.thresholds
        if first.accepted:
            others = [c for c in first.candidates if c.name not in first.after.effects]
            return first.accepted[-1].share < asked.pair_share and bool(self.complementary(others))
        sound = [c for c in first.candidates if self.is_significant(c) and c.share > asked.half_share]
        most = max((max(c.fit_share, c.selection_share) for c in sound), default=0.0)
        nearly_half = any(c.share >= asked.nearly_half for c in sound)
        if most > asked.whole or nearly_half or self.complementary(first.candidates):
            return True
        others = [c for c in first.candidates if c.fit_share >= asked.half_share]
        return any(
            one.fit_share + other.fit_share >= asked.pair_share and not self.is_alike(one, other)
            for one in sound
            for other in others
        )

    def half_seen(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Those that make up what was fitted together with another, be it an alike one, where none shows itself alone.

        What one leaves of the other remembers itself, which noise does not.
        """
        asked = self.thresholds
        there = [c for c in candidates if min(c.fit_share, c.selection_share) >= asked.half_share]

        def make_up(one: Candidate, other: Candidate) -> bool:
            return one.cause != other.cause and one.fit_share + other.fit_share >= asked.pair_share

        is_any_seen = any(self.is_significant(c) for c in candidates)
        return [] if is_any_seen else [c for c in there if any(make_up(c, other) for other in there)]

    def complementary(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Those that make up what two effects have to explain together with another that is not easily taken for them.

        Each may be one that the other kind of parts hardly shows.
        """
        least = self.thresholds.pair_share

        def make_up(one: Candidate, other: Candidate) -> bool:
            if self.is_alike(one, other):
                return False
            selection = one.selection_share + other.selection_share
            return min(one.fit_share + other.fit_share, selection) >= least

        return [c for c in candidates if self.is_significant(c) and any(make_up(c, other) for other in candidates)]

    @staticmethod
    def is_alike(one: Candidate, other: Candidate) -> bool:
        """Whether they are of one cause, or easily taken for one another."""
        return one.cause == other.cause or frozenset((one.cause, other.cause)) in CONFOUNDED

    def is_significant(self, candidate: Candidate) -> bool:
        """Whether it shows itself, where it was fitted and where not, beyond what noise that remembers itself does."""
        asked = self.thresholds
        shows = candidate.fit_gain > asked.fit_gain and candidate.fit_size > asked.size
        is_seen = candidate.selection_size > asked.selection_size or candidate.is_all_but_quiet
        ahead = candidate.selection_gain > asked.selection_gain and is_seen
        return ahead and (shows or self.is_foretold(candidate))

    def is_foretold(self, candidate: Candidate) -> bool:
        """Whether fitted runs that hardly show an effect tell enough of it to explain what is left of the others."""
        asked = self.thresholds
        told = not EFFECT_OF[candidate.name].per_run and candidate.fit_gain > asked.foretold_gain
        return told and candidate.selection_gain > asked.foretells and candidate.selection_share >= asked.pair_share

    def is_enough(self, winner: Candidate) -> bool:
        """Whether it explains so much that it is named; beside one that it is taken for easily, nearly all of it."""
        before, asked = winner.before, self.thresholds
        if not before.effects:
            is_there = winner.share >= asked.share or self._tells_what_was_fitted(winner)
            return is_there or (self.at_floor(winner.after) and not self.at_floor(before))
        causes = [EFFECT_OF[name].reported for name in before.effects]
        alike = any(frozenset((winner.cause, cause)) in CONFOUNDED for cause in causes)
        return winner.share >= (asked.pair_share if alike else asked.share)

    def _tells_what_was_fitted(self, winner: Candidate) -> bool:
        """Whether it is all that is missing where it was fitted, on a base that others may lack more of."""
        asked = self.thresholds
        return winner.fit_share >= asked.fitted_whole and winner.after.fit.ratio <= asked.near_floor

    def best_of(self, sound: Sequence[Candidate]) -> Candidate:
        """What leaves least; where that explains too little, the first that explains enough of what counts more.

        Of an effect that remembers, what dies out in runs with an unknown past does not count, before it either. What
        leaves least by that alone is not the best.

        Args:
            sound: what leaves least comes first.
        """
        least = sound[0]
        if self.is_enough(least):
            return least
        return next((c for c in sound if c.before is not least.before and self.is_enough(c)), least)

    def is_needed(self, second: Candidate) -> bool:
        """Whether a second effect explains half of what the first leaves; of runs not fitted where that is anything."""
        left = second.before.selection.ratio > self.thresholds.floor
        return (second.share if left else second.fit_share) >= self.thresholds.share

    def shows_beside(self, candidate: Candidate) -> bool:
        """Whether an effect shows itself beside all others, and explains enough of what they leave."""
        return self.is_significant(candidate) and candidate.share >= self.thresholds.share

    def is_outvoted(self, winner: Candidate, other: Candidate) -> bool:
        """Whether what chooses says little between the two: the winner has values of its own in each run there."""
        confounded = frozenset((winner.cause, other.cause)) in CONFOUNDED
        return confounded and bool(EFFECT_OF[winner.name].per_run) and other.fit_gain > self.thresholds.fit_gain

    def is_as_good(self, winner: Candidate, other: Candidate) -> bool:
        """Whether another explains so nearly as much that these runs do not decide between the two.

        What a winner leaves is the most that the base can be off by; so one that leaves many times as much is out.
        """
        gained = winner.before.total - winner.after.total
        explained = self.at_floor(winner.after) or self.is_far_ahead(winner, other)
        alike = not explained and frozenset((winner.cause, other.cause)) in CONFOUNDED
        asked = self.thresholds.alike_tie if alike else self.thresholds.tie
        if self.is_outvoted(winner, other):
            before, here, there = (found.fit for found in (winner.before, winner.after, other.after))
            left = max(here.ratio, winner.after.selection.ratio)
            if self.at_floor(winner.after) and left <= self.thresholds.settled < there.ratio:
                return False  # rates of its own do not bring a wrong effect down to the noise
            near = there.ratio <= self.thresholds.near_floor * here.ratio
            return near and before.total - there.total >= asked * (before.total - here.total)
        if winner.before.total - other.after.total < asked * gained:
            return False
        if other.before is not winner.before and not self.is_enough(other):
            return False  # it leaves little because less of its runs counts
        return not (explained and self._is_decided(winner, other))

    def _is_decided(self, winner: Candidate, other: Candidate) -> bool:
        """Whether the likelihoods decide, both where it was fitted and where not, or the former beyond all doubt."""
        asked, fitted = self.thresholds, gain_of(other.after.fit, winner.after.fit)
        chosen = gain_of(other.after.selection, winner.after.selection)
        if winner.after.staged.has_past:  # what pasts are off by averages out no more than a wrong model does
            all_settled = max(winner.after.ratios) <= asked.settled
            return all_settled and fitted > asked.beside_pasts and chosen > 0.0
        if other.after.fit.ratio**2 - winner.after.fit.ratio**2 > asked.told_apart:
            return True
        settled = winner.after.fit.ratio <= asked.settled
        beyond_doubt = settled and fitted > asked.overwhelming and chosen > 0.0
        return beyond_doubt or min(fitted, chosen) > asked.decisive

    def is_far_ahead(self, winner: Candidate, other: Candidate) -> bool:
        """Whether a winner explains nearly all, and what another leaves is many times what it leaves."""
        return winner.share > self.thresholds.whole and self._leaves_far_less(winner.after, other.after)

    def _leaves_far_less(self, one: Hypothesis, other: Hypothesis) -> bool:
        return one.excess < self.thresholds.outdone * other.excess

    @staticmethod
    def blind(found: Hypothesis) -> list[Alike]:
        """What the runs cannot tell apart by their design, wherever it is sought."""
        return alike_by_design([run.record for run in found.staged.runs])

    def may_be_decided(self, step: Step) -> bool:
        """Whether effects tie although the runs could tell them apart, beside something else that is left."""
        near, far = self.thresholds.near_floor, self.thresholds.reachable
        if not step.tied or STRAIN_LAW in step.tied or not near < step.after.fit.ratio <= far:
            return False
        return not any(step.accepted[-1].cause in each.effects for each in self.blind(step.before))

    def is_worth_finishing(self, candidate: Candidate) -> bool:
        """Whether a name could still come of a refit that is made exact and goes on."""
        asked, left = self.thresholds, candidate.after.fit.ratio
        near = left <= max(asked.finishable, asked.much_less * candidate.before.fit.ratio)
        return near and candidate.fit_share >= asked.finish_share
