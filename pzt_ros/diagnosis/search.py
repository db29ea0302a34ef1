"""Adding effects one after another: each is refitted together with the base and judged on both kinds of parts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from pzt_ros.diagnosis.candidates import Candidate, Step, share_of
from pzt_ros.diagnosis.elimination import (
    hysteresis_in_question,
    is_law_as_good,
    law_in_question,
    needed_only,
    without,
)
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.informed import informed
from pzt_ros.diagnosis.refinement import polished, taken_on
from pzt_ros.diagnosis.seeker import Seeker
from pzt_ros.diagnosis.strain_laws import STRAIN_LAW, with_free_law
from pzt_ros.diagnosis.wandering import BY_CHANCE, wandering
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.effects.thermal_drift import ThermalDrift

_RENEWALS, _COMES_DOWN = 3, 0.98  # times that effects are found anew, and what has to be left each time at most


@dataclass
class Search(Seeker):
    """Forward addition of effects; a `Seeker` that decides what is added.

    Attributes:
        is_told: whether what was found so far is all, although something is left beside it; then the search ends.
    """

    is_told: Callable[[Sequence[Step]], bool] = lambda steps: False

    def run(self, base: Hypothesis) -> list[Step]:
        """Add effects one by one until what is left is noise, or no more than their shapes are off by."""
        return self.continued([self.step(base)], base)

    def continued(self, steps: Sequence[Step], base: Hypothesis) -> list[Step]:
        """The run that began with these steps."""
        found = self._decided([*steps], base)
        while self._goes_on(found, base) and not self.is_told(found):
            step = self.step(found[-1].after)
            there = step.base_instead
            if there is not None and there.total <= _COMES_DOWN * found[-1].after.total:
                found = _ending_at(found, there)
            else:
                found = self._renewed(self._decided([*found, step], base), base)
        return self._weighed(found)

    def _renewed(self, steps: list[Step], base: Hypothesis) -> list[Step]:
        """The steps, or with earlier effects found anew beside the last: without that, they had to bend for it."""
        last = steps[-1]
        if len(steps) < 2 or not last.accepted or any(step.tied for step in steps) or self.explains(steps, base):
            return steps
        if self.limit.is_over():
            return steps
        best = last.after
        for _ in range(_RENEWALS):
            former = best
            for name in [each for each in last.after.effects if each != last.accepted[-1].name]:
                best = min((best, *self._anew(best, name)), key=lambda found: found.total)
            if self.at_floor(best) or best.total > _COMES_DOWN * former.total:
                break
        return steps if best is last.after else _ending_at(steps, best)

    def _decided(self, steps: list[Step], base: Hypothesis) -> list[Step]:
        """The steps, or one more where that explains what kept the last from being decided."""
        last = steps[-1]
        if not self.may_be_decided(last) or self.limit.is_over():
            return steps
        further = self.step(last.after)
        if not further.accepted or further.tied or not self.explains([*steps, further], base):
            return steps
        name = last.accepted[-1].name
        bare = without(further.after, name)
        if bare is None:
            return steps
        winner = Candidate(name, bare, further.after)
        alike = self.still_tied(winner, last.tied[1:])
        return [*steps[:-1], replace(last, tied=(name, *alike) if alike else ()), further]

    def still_tied(self, winner: Candidate, names: Sequence[str]) -> list[str]:
        """Those effects that are as good when refitted in the winner's place; a refit that fails rules none out.

        Those that promise too little of what the winner gains are not refitted.
        """
        if not names:
            return []
        before, least = winner.before, self.thresholds.promised
        most = before.total - least * (before.total - winner.after.total)
        finish_share = max(self.thresholds.finish_share, least * winner.fit_share)
        asked = replace(self.thresholds, refits=len(names), promised=0.0, finish_share=finish_share)
        others = replace(self, effects=tuple(EFFECT_OF[name] for name in names), thresholds=asked)
        found, refused = others._candidates(before, before, most)
        refitted = {each.name: each for each in found}

        def is_tied(name: str) -> bool:
            if name not in refitted:
                return name not in refused  # or the screen saw next to nothing of it
            after = taken_on(refitted[name].after, self.thresholds)
            return self.is_as_good(winner, replace(refitted[name], after=after))

        return [name for name in names if is_tied(name)]

    def with_pair(self, steps: Sequence[Step], base: Hypothesis) -> list[Step]:
        """The steps of a run; where they do not explain all, the last may add two effects at once."""
        if self.explains(steps, base) or self.limit.is_over():
            return [*steps]
        paired = self._pair_step(steps[-1])
        return [*steps] if paired is steps[-1] else self._weighed([*steps[:-1], paired])

    def with_wandering(self, steps: Sequence[Step], base: Hypothesis) -> list[Step]:
        """The steps of a run; where they do not explain all, readings that wander by chance may, beside them or alone.

        Where they do but for a little, a straight drift in the end may wander. That is asked last: what goes its own
        way in every run could stand for much that is slow.
        """
        others, explained = _without_last_drift(steps), self.explains(steps, base)
        if (explained and (len(others) == len(steps) or self.at_floor(steps[-1].after))) or self.limit.is_over():
            return [*steps]
        if others and others[-1].accepted and not others[-1].tied:
            beside = self._ending_in_chance(others, base, ())
            if beside:
                return beside
        if explained:
            return [*steps]
        tried = steps[0].candidates
        alone = self._wandering_step(base, chain([base], self.elsewhere(base, tried)), tried)
        return [alone] if alone else self._beside_wandering(steps, base)

    def with_last_drift_wandering(self, steps: Sequence[Step], base: Hypothesis) -> list[Step]:
        """The steps with readings that wander in place of a straight drift in the end; none where that fails."""
        others = _without_last_drift(steps)
        return self._ending_in_chance(others, base, steps[-1].candidates) if len(others) < len(steps) else []

    def _ending_in_chance(
        self, others: Sequence[Step], base: Hypothesis, candidates: Sequence[Candidate]
    ) -> list[Step]:
        """The steps with readings that wander in the end, if there is no drift yet and that explains all; or none."""
        before = others[-1].after if others else base
        if ThermalDrift.kind in before.effects:
            return []
        step = self._wandering_step(before, [before], candidates)
        return [*others, step] if step and self.explains([*others, step], base) else []

    def _wandering_step(
        self, before: Hypothesis, places: Iterable[Hypothesis], others: Sequence[Candidate]
    ) -> Step | None:
        """Readings that wander beside a hypothesis, fitted from the first place where they explain all, and not little.

        Of a run that was at 1.0502 x the noise they left 1.0498 x.
        """
        self.progress("refitting with readings that wander" + before.beside)
        name = ThermalDrift.kind
        for place in places:
            found = wandering(place, self.thresholds, self.thresholds.polishable)
            if found is None:
                continue
            winner = Candidate(name, before, replace(found, effects=(*before.effects, name)))
            step = Step(before, _headed_by(winner, others), {}, (winner,), (), BY_CHANCE)
            if winner.share >= self.thresholds.share and self.explains([step], before):
                return replace(step, tied=self._group(winner, self._beside_chance(winner, others)))
        return None

    def _beside_chance(self, wanders: Candidate, others: Sequence[Candidate]) -> list[Candidate]:
        """Effects that explain as much as readings that wander, or where it was fitted more than these.

        What chooses says nothing against those: curves of its own bring every run down.
        """
        asked = self.thresholds
        return [
            other
            for other in others
            if other.cause != wanders.cause
            and (
                (self.is_significant(other) and self.is_as_good(wanders, other))
                or (other.fit_gain > asked.fit_gain and other.after.fit.ratio < wanders.after.fit.ratio)
            )
        ]

    def _beside_wandering(self, steps: Sequence[Step], base: Hypothesis) -> list[Step]:
        """The steps, or readings that wander and one effect beside them, where a drift is half of what is missing.

        A straight drift beside that effect does not explain all, and without the other neither is enough.
        """
        half_told = next((c for c in self.complementary(steps[0].candidates) if c.name == ThermalDrift.kind), None)
        found = wandering(base, self.thresholds, self.thresholds.nameable) if half_told else None
        if found is None:
            return [*steps]
        drift = Candidate(ThermalDrift.kind, base, replace(found, effects=(ThermalDrift.kind,)))
        first = Step(base, _headed_by(drift, steps[0].candidates), {}, (drift,), (), BY_CHANCE)
        both = [first, self.step(drift.after)]
        return both if both[-1].accepted and self.explains(both, base) else [*steps]

    def _weighed(self, steps: list[Step]) -> list[Step]:
        """The steps without what was only needed until all of them were there."""
        if steps[-1].after.fit.ratio > self.thresholds.nameable:
            return steps
        needed = needed_only(steps, self.shows_beside, self.identify if self._holds_back else None)
        return hysteresis_in_question(law_in_question(needed, self.thresholds), self.thresholds)

    def _goes_on(self, steps: Sequence[Step], base: Hypothesis) -> bool:
        last = steps[-1]
        undecided = bool(last.tied) and STRAIN_LAW not in last.tied  # a law of the model is no rival of an effect
        ended = not last.accepted or undecided or len(last.after.effects) >= self.thresholds.most_effects
        out_of_reach = last.after.fit.ratio > self.thresholds.reachable
        return not (ended or out_of_reach or self.explains(steps, base) or self.limit.is_over())

    def step(self, before: Hypothesis) -> Step:
        """One round: screen, refit, judge."""
        further = self._further_promise(before) if before.effects else 0.0
        most = min(before.total - further * before.excess, before.total_at(self.thresholds.hopeless))
        candidates, refused = self._from_anywhere(before, most)
        if not (self.is_at_bottom or self.limit.is_over()):
            candidates = polished(candidates, self.thresholds, self.workers)
        sound = [c for c in candidates if self.is_significant(c)]
        if not sound:
            pair = self._half_seen_pair(before, candidates)
            return Step(before, candidates, refused, pair, (), _together(pair) if pair else self._nothing(before))
        winner = self._plainest(sound)
        candidates = _headed_by(winner, candidates)
        base_instead = self._base_instead_of(winner) if self.is_enough(winner) else None
        if self.is_enough(winner) and base_instead is None:
            tied = self._tied(winner, [c for c in candidates if c in sound or self.is_outvoted(winner, c)])
            winner = self._with_law(winner) if STRAIN_LAW in tied else winner
            verdict = f"explains {winner.share:.0%} of the excess"
            return Step(before, _headed_by(winner, candidates), refused, (winner,), tied, verdict)
        known = self._informed(candidates, sound)
        if known:
            best, tied, verdict = known
            return Step(before, _headed_by(best, candidates), refused, (best,), tied, verdict)
        verdict = (
            f"the best, {winner.name}, explains {winner.share:.0%} of the excess, {self.thresholds.share:.0%} is asked"
        )
        return Step(before, candidates, refused, (), (), verdict, base_instead)

    def _further_promise(self, before: Hypothesis) -> float:
        asked = self.thresholds
        return asked.further_promise if before.fit.ratio <= asked.in_sight else asked.far_promise

    def _base_instead_of(self, winner: Candidate) -> Hypothesis | None:
        """What was there before, fitted from where a winner took it, if that leaves the winner too little.

        Beside an unknown past, or other effects, a fit stops short of the best: of a drift it left 2 x, and a bias
        field of no size was named that had only led it to 1.01 x.
        """
        if not (winner.after.staged.has_past or winner.before.effects):
            return None
        bare = without(winner.after, winner.name)
        if bare is None or bare.total >= winner.before.total:
            return None
        tried = replace(winner, before=bare)
        is_as_good = self.at_floor(bare) or not (self.is_significant(tried) and self.is_enough(tried))
        return bare if is_as_good else None

    def _informed(
        self, candidates: Sequence[Candidate], sound: Sequence[Candidate]
    ) -> tuple[Candidate, tuple[str, ...], str] | None:
        """The sound one that is best on a density fitted to what chose, too, what ties with it, and why; None where it
        does not explain enough there, either.
        """
        asked = self.thresholds
        worth = [c for c in candidates if c.fit_share >= asked.finish_share and c.fit_gain > asked.fit_gain]
        if max((c.fit_share for c in worth), default=0.0) < asked.informed_share:
            return None
        self.progress("weighing " + ", ".join(c.name for c in worth) + worth[0].before.beside)
        best, *others = informed(worth, self.workers)
        winner = next((c for c in sound if c.name == best.name), None)
        if winner is None or best.share < asked.informed_share or not self.is_enough(best):
            return None
        # nothing is left that chooses, so nothing decides between two that are nearly as good
        near = [o for o in others if o.cause != best.cause and o.share >= asked.flexible_alike * best.share]
        verdict = f"explains {best.share:.0%} of what a density leaves that was fitted to what chose, too"
        return winner, self._group(best, near), verdict

    def _plainest(self, sound: Sequence[Candidate]) -> Candidate:
        """The best, or a variant of it with fewer unknowns that is as good: it says more of runs not fitted."""
        best = self.best_of(sound)
        alike = [c for c in sound if c is not best and c.cause == best.cause]
        fewer = [c for c in alike if c.unknowns < best.unknowns]
        plain = [replace(c, after=taken_on(c.after, self.thresholds)) for c in fewer if self.is_as_good(best, c)]
        return min(plain, key=lambda c: c.unknowns, default=best)

    def _pair_step(self, step: Step) -> Step:
        """Where no effect alone explained enough: two that do together, or the step as it was."""
        sound = self.complementary(step.candidates)
        sound += [c for c in step.candidates if self.is_significant(c) and c.share > self.thresholds.half_share]
        sound = list(dict.fromkeys(sound))
        pair = self._pair(step.before, sound) if not step.accepted else ()
        if not pair:
            return step
        return replace(step, accepted=pair, verdict=_together(pair))

    def _half_seen_pair(self, before: Hypothesis, candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
        """Two effects that hide one another, where both leave nothing; empty where no two do.

        A creep and a drift with the temperature, of 2 and 3 x the noise, left each other so slow a rest that neither
        showed itself in runs of 13 s.
        """
        pair = () if before.effects or self.limit.is_over() else self._pair(before, self.half_seen(candidates))
        return pair if pair and self.at_floor(pair[-1].after) else ()

    def _tied(self, winner: Candidate, others: Sequence[Candidate]) -> tuple[str, ...]:
        """Names that explain the residual as well as the winner, which comes first; empty if it stands alone."""
        return self._group(winner, [o for o in others if o.cause != winner.cause and self.is_as_good(winner, o)])

    def _group(self, winner: Candidate, others: Sequence[Candidate]) -> tuple[str, ...]:
        """The winner with those that are as good, and with what no fit to these runs could tell from it, if any."""
        alike = [other.name for other in others]
        known = {winner.cause, *(EFFECT_OF[name].reported for name in alike)}
        groups = [each.effects for each in self.blind(winner.before)]
        alike += sorted({name for group in groups if known & group for name in group} - known)
        if winner.cause == SensorNonlinearity.kind and self._is_law_as_good(winner):
            alike.append(STRAIN_LAW)
        return (winner.name, *alike) if alike else ()

    def _with_law(self, curve: Candidate) -> Candidate:
        """A curve of the sensor that a strain law ties with; with such a law beside it where both together explain all.

        What neither has alone must not be taken for another effect: beside elements that slip it was a hum.
        """
        freed = None if self.at_floor(curve.after) else with_free_law(curve.after)
        return replace(curve, after=freed) if freed is not None and self.at_floor(freed) else curve

    def _is_law_as_good(self, winner: Candidate) -> bool:
        self.progress("refitting with a strain law of higher order" + winner.before.beside)
        return is_law_as_good(winner.before, winner.after, self.thresholds)

    def _pair(self, before: Hypothesis, sound: Sequence[Candidate]) -> tuple[Candidate, ...]:
        """Two effects neither of which explains enough alone; empty where no two do.

        Far from the noise a screen sees little of what a base that has bent for both will leave: of a creep and a
        current limit it promised 9 x, and 2 x was left. There only the second that promises most is refitted, and none
        beside unknown pasts, where that takes a minute.
        """
        best: tuple[Candidate, ...] = ()
        far = before.total - self.thresholds.pair_promise * before.excess
        most = min(far, before.total_at(self.thresholds.nameable))
        for first in sound[:2]:
            beside = self._candidates(first.after, first.after, most, 0.0 if before.staged.has_past else far)[0]
            # the second has to be needed: half of what the first leaves, or it only takes up what the base is off by
            following = [c for c in beside if self.is_significant(c) and self.is_needed(c)]
            if following:
                pair = (first, self._plainest(following))
                if not best or pair[-1].after.total < best[-1].after.total:
                    best = pair
            if best and self.at_floor(best[-1].after):
                break
        return best if best and share_of(before, best[-1].after) >= self.thresholds.pair_share else ()

    def _nothing(self, before: Hypothesis) -> str:
        if self.at_floor(before):
            return "nothing is left beyond the noise"
        return "no effect of the library explains what is left, where it was fitted and where it was not"


def _ending_at(steps: Sequence[Step], found: Hypothesis) -> list[Step]:
    """The steps with the same effects fitted elsewhere in the end."""
    last = steps[-1]
    winner = replace(last.accepted[-1], after=found)
    candidates = _headed_by(winner, last.candidates)
    return [*steps[:-1], replace(last, candidates=candidates, accepted=(*last.accepted[:-1], winner))]


def _together(pair: Sequence[Candidate]) -> str:
    return f"explains {share_of(pair[0].before, pair[-1].after):.0%} of the excess together"


def _headed_by(winner: Candidate, candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    return (winner, *(each for each in candidates if each.name != winner.name))


def _without_last_drift(steps: Sequence[Step]) -> list[Step]:
    """The steps but for a drift in the end, which may not go straight but wander."""
    last = steps[-1].accepted
    return [*steps[:-1]] if last and last[-1].name == ThermalDrift.kind else [*steps]
