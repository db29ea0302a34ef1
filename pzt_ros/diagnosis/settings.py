"""Every threshold of the diagnosis in one table; frozen before a scored run of the court."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Thresholds:
    """What is asked of an effect before it is named.

    Attributes:
        fit_gain, selection_gain: n_eff ln(before/after) of the squares, on what is fitted and on what chooses.
        foretold_gain, foretells: the same for one that the fitted runs hardly show and that explains `pair_share` of
            what is left where nothing was fitted: a current limit that only one of the other runs reached.
        size: smallest rms that is looked for in a fitted run, in units of the noise.
        selection_size: the same on what chooses, which may show less of an effect: there it need only be there.
        promise: fall of the mean square, in units of the noise, that the screen has to promise before a refit.
        further_promise, far_promise: share of the excess that the screen has to promise of a second or further effect,
            beside those that leave less than `in_sight`, and more.
        share: of the excess over the noise that an effect has to explain, on both kinds of parts.
        half_share: that one of two effects has to explain alone.
        nearly_half: the same for another to be sought beside it before other bases are.
        pair_share: that two effects have to explain together where neither explains `share` alone; and one beside
            another that it is easily taken for; and all names where much is left (`doubtful`).
        pair_promise: the same as the screen has to promise it, which sees along a line only.
        floor: rms over noise up to which nothing is left to explain.
        settled: the same up to which no refit from elsewhere is tried: a wrong effect may come down to 1.04.
        whole, near_floor: share of the excess and rms over noise with which effects are taken for all that is missing.
        fitted_whole: share of the excess of what was fitted with which an effect that leaves it near the noise is
            enough, however much is left where it was not: relays may lack there what no run told of their density.
        nameable: rms over noise, where it was fitted, up to which what is left lets names be trusted: with more, the
            base lacks something else, and an effect may only stand in for it.
        unchecked_nameable: the same for names that stand alone where no run says whether they hold beyond the fit.
        doubtful: the same for names that together explain less than `pair_share` of the excess.
        rateless_nameable: the same on a base that knows no rate: hysteresis beside it may stand for one that it lacks.
        hopeless: the same that the screen may promise to leave of an effect for a refit; of two at once `nameable`.
        finishable: rms over noise up to which a refit is made exact and goes on; beyond it no name would come of it,
        much_less: unless no more than this share of the misfit's rms is left: then the refit has not ended.
        finish_share: share of the excess that it has to explain before, where it was fitted.
        unpolished, polishable: rms over noise of a run from which, and of what was fitted up to which, the best refit
            is taken on for as long as it comes down. (From 1.05 on, a wrong strain law was named a sensor's curve.)
        reachable: the same up to which further effects are looked for beside one that was found.
        trial_promise: as `far_promise` until another base was tried.
        in_sight: rms over noise up to which effects leave so little that the base is taken for right.
        outdone: share of the excess that another base may leave at most for the search on this one to end; and that an
            effect may leave of what another leaves for the two not to be taken for one another easily.
        elements_sooner, elements_outdone: rms over noise that a base leaves from which elements that slip are tried
            sooner than effects beside it, and what share of its excess those may leave at most. Where nothing was
            declared they are tried from the floor on, first of all, and may leave `undeclared_elements` as well: an
            effect hides which of them a stage is more like. (Beside a fatigue of 10 x elements that made the runs left
            1.6 of a domain's.)
        instead: share of what a polycrystal leaves that one domain may leave to be the base where nothing was declared.
        rateless_sooner, rateless_outdone: rms over noise that a base leaves from which relays without a rate are tried
            sooner than effects beside it, and what share of its excess those may leave at most.
        rateless_tells: rms over noise up to which they are searched then: a current limit of 10 x beside them left 4.8.
            Where nothing was declared nothing speaks for the base: then they are tried from the floor on, may leave
            `undeclared_outdone`, and may be as far off as an effect that they lack. (Where relays did not make the runs
            they left 2.7 times the excess and more.)
        rateless_as_near: share of the excess of a base that nobody declared that relays may leave to be searched first.
            (Beside effects of 3 to 9 x relays that made the runs left 0.9 to 1.4.)
        lattice_sooner, lattice_outdone: rms over noise that a lattice may leave, and share of the excess of relays and
            of the declared base, to be searched before those. (An effect of 10 x beside tilted densities left it at
            3.2 to 4.5 x and 0.12 to 0.31 of what relays leave.)
        lattice_leads: share of what polycrystal or elements leave that a lattice may leave for effects to be tried
            there first.
        lattice_asked: rms over noise that a declared base leaves from which effects are tried on a lattice where the
            best beside it leaves much. (Of sixteen pairs of 3 x it left 1.9 to 5.5.)
        lattice_is_all: share of what a search beside the declared base leaves that a lattice without an effect may
            leave for the density to be what is wrong. (Of two components it left 0.02, with a bias field of 3 x beside
            them 0.04, with a lag of 10 x 0.08.)
        rateless: what a base that knows no rate may leave of what the lattice leaves to be searched on.
        shaped_less: share of what the declared base leaves that free shapes of its densities may leave to be searched
            beside.
        lopsided_less: share of what a bias field leaves that interaction fields which prefer a direction may leave.
        lopsided_outdone: share of what a polycrystal leaves that nobody declared that these may leave to be the base.
        plainer: what the declared base, or a formula, may leave, as a multiple of what another leaves, to be preferred.
        tie: share of the winner's gain from which another effect is as good.
        alike_tie: the same for two that are known to be hard to tell apart, where more than the noise is left: what the
            base lacks beside them may tip the scales.
        flexible_alike: the same on a flexible base, which bends so that a wrong one may do.
        decisive: gain of the winner over another, where it was fitted and where not, from which it is not a tie, if the
            winner reaches the floor.
        overwhelming: the same where it was fitted, if what chooses only does not speak against it: that is less and may
            show little of what they differ in.
        beside_pasts: as `overwhelming`, of runs whose past nobody recorded, each of them settled.
        told_apart: mean square, in units of the noise, that another has to leave beyond the winner not to tie with it
            on a density that was fitted to all seen: without an effect that is off by 0.08 at most.
        law_tie: mean square, in units of the noise, that a strain law of higher order may leave beyond what a sensor's
            curve leaves to be as good.
        law_share: the same in units of what the curve gains; up to the third power for one with a fourth it was 1.1 %,
            for a curve that waves 2.9 % and more.
        undeclared_law_tie: as `law_tie`, where no law was declared, so that one up to the third power stands for any:
            of one with a fourth it left 1.034 and 1.038 x the noise, and a curve was named.
        flexible_law_tie: as `law_tie`, on a flexible base, whose density bends for a law of still higher order: a
            curve that takes its misfit from 1.3 x the noise to 1.03 was one of the law, with nothing hidden.
        refits: causes whose candidates are refitted at most.
        promised: what a candidate has to promise of what the best promises to be refitted with that; the others are
            where none of those explains enough.
        most_effects, unchecked_effects: that are added at most; the same where nothing is left that chooses.
        flexible_share, flexible_size: as `share` and `size`, on the flexible base.
        flexible_hopeless: as `hopeless`: that base is all but linear, so a screen is to be believed.
        flexible_told_apart: as `told_apart`, where that is asked.
        flexible_promised: as `promised` on the flexible base, where refits keep 0.7 to 1.2 of it: those that promise
            less than half as much do not tie.
        flexible_finish: as `finish_share`: a refit is all but done after its first steps there.
        informed_share: of the excess where it was fitted, and of what a density leaves that was fitted to what chose,
            too, from which an effect is named that explains less where it was not fitted.
        worsens: rms on what scores, over that without any name, from which all names are taken back.
        slow_remains: slow means over what the noise leaves of them from which something is left.
        relays_whole: as `fitted_whole`, on relays.
        flexible_remains: as `floor`, for what the flexible base leaves of runs that it was not fitted to.
    """

    fit_gain: float = 25.0
    selection_gain: float = 10.0
    foretold_gain: float = 6.0
    foretells: float = 100.0
    size: float = 0.1
    selection_size: float = 0.05
    promise: float = 0.003
    further_promise: float = 0.05
    far_promise: float = 0.1
    share: float = 0.5
    half_share: float = 0.2
    nearly_half: float = 0.35
    pair_share: float = 0.8
    pair_promise: float = 0.4
    floor: float = 1.05
    settled: float = 1.02
    whole: float = 0.9
    near_floor: float = 1.15
    fitted_whole: float = math.inf
    nameable: float = 4.0
    unchecked_nameable: float = 1.15
    doubtful: float = 1.5
    rateless_nameable: float = 1.5
    hopeless: float = math.inf
    finishable: float = 8.0
    much_less: float = 0.35
    finish_share: float = -math.inf
    unpolished: float = 1.1
    polishable: float = 1.5
    reachable: float = 12.0
    trial_promise: float = 0.5
    in_sight: float = 3.0
    outdone: float = 0.25
    elements_sooner: float = 3.0
    elements_outdone: float = 0.25
    instead: float = 0.8
    rateless_sooner: float = 3.0
    rateless_outdone: float = 0.25
    rateless_tells: float = 8.0
    undeclared_elements: float = 2.0
    undeclared_outdone: float = 0.7
    rateless_as_near: float = 2.0
    lattice_sooner: float = 6.0
    lattice_outdone: float = 0.35
    lattice_leads: float = 0.8
    lattice_asked: float = 6.0
    lattice_is_all: float = 0.1
    rateless: float = 3.0
    shaped_less: float = 0.8
    lopsided_less: float = 0.8
    lopsided_outdone: float = 0.5
    plainer: float = 1.05
    tie: float = 0.93
    alike_tie: float = 0.9
    flexible_alike: float = 0.75
    decisive: float = 25.0
    overwhelming: float = 100.0
    beside_pasts: float = 200.0
    told_apart: float = math.inf
    law_tie: float = 0.12
    law_share: float = 0.02
    undeclared_law_tie: float = 0.25
    flexible_law_tie: float = 2.5
    refits: int = 4
    promised: float = 0.0
    most_effects: int = 4
    unchecked_effects: int = 2
    flexible_share: float = 0.6
    flexible_size: float = 0.4
    informed_share: float = math.inf
    worsens: float = 1.02
    slow_remains: float = 2.0
    flexible_remains: float = 1.10
    relays_whole: float = 0.95
    flexible_hopeless: float = 8.0
    flexible_told_apart: float = 0.1
    flexible_promised: float = 0.5
    flexible_finish: float = 0.25

    def on_trial(self) -> Thresholds:
        """What is asked on the declared base before the flexible one was tried."""
        return replace(self, far_promise=self.trial_promise)

    def on_undeclared(self) -> Thresholds:
        """What is asked where no chain was declared, and so no strain law."""
        return replace(
            self,
            law_tie=self.undeclared_law_tie,
            elements_sooner=self.floor,
            elements_outdone=self.undeclared_elements,
            rateless_sooner=self.floor,
            rateless_outdone=self.undeclared_outdone,
            rateless_tells=math.inf,
        )

    def on_shaped(self) -> Thresholds:
        """What is asked on densities that are no Gaussians: two shapes come near one, as an identified one does."""
        return replace(self, floor=self.flexible_remains)

    def on_free_law(self) -> Thresholds:
        """What is asked beside a strain law with more powers than were declared: a sensor's curve may be one more.

        Beside such a law and a density of 10 x the noise from the right one, a curve was named that was not there.
        """
        return replace(self, law_tie=self.flexible_law_tie)

    def on_flexible(self) -> Thresholds:
        """What is asked on the flexible base: its own misfit is less well known, so more."""
        return replace(
            self,
            share=self.flexible_share,
            alike_tie=self.flexible_alike,
            law_tie=self.flexible_law_tie,
            size=self.flexible_size,
            selection_size=self.flexible_size,
            hopeless=self.flexible_hopeless,
            promised=self.flexible_promised,
            finish_share=self.flexible_finish,
        )

    def on_relays(self) -> Thresholds:
        """The same on relays that are identified beside each effect: what is far from the noise then is their rate."""
        return replace(self, reachable=self.in_sight, fitted_whole=self.relays_whole)

    def on_lattice(self) -> Thresholds:
        """The same where the flexible base is a lattice: what its density is off by must not hide an effect."""
        return replace(self.on_flexible(), informed_share=self.flexible_share)

    def at_a_glance(self) -> Thresholds:
        """The same of refits that only say which effects are likeliest there: none goes on for minutes."""
        return replace(self.on_lattice(), finish_share=math.inf)

    def on_all_seen(self) -> Thresholds:
        """What is asked on a density that was fitted to what chose, too: nothing is left that decides between two."""
        return replace(
            self.on_elements(),
            hopeless=self.flexible_hopeless,
            share=self.share,
            tie=self.flexible_alike,
            decisive=math.inf,
            overwhelming=math.inf,
            beside_pasts=math.inf,
            told_apart=self.flexible_told_apart,
            most_effects=self.unchecked_effects,
        )

    def on_elements(self) -> Thresholds:
        """What is asked on elements that slip: no density of theirs can bend for an effect, so it may be small.

        They themselves bend, and far from linearly, so that a screen beside them is not to be believed: of a slew limit
        that took 11 x the noise to 1.04 it promised a third.
        """
        return replace(self.on_flexible(), size=self.size, selection_size=self.selection_size, hopeless=self.hopeless)
