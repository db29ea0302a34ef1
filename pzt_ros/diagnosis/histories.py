"""What happened before each run, as the declared model sees it: sought and fitted in turn with all else.

Parameters that were fitted to wrong histories defend those, and histories that were sought while an effect was missing
make up for it. So histories are sought more than once, and anew beside an effect.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import repeat

import numpy as np

from pzt_ros.diagnosis.data import FIT, SELECTION, RunData
from pzt_ros.diagnosis.declared import DeclaredHysteresis
from pzt_ros.diagnosis.flexible_lattice import FlexibleHysteresis
from pzt_ros.diagnosis.flexible_preisach import FlexiblePreisach
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, exactly, fitted, total_of
from pzt_ros.diagnosis.hysteresis import WithPasts
from pzt_ros.diagnosis.less_effects import ceramic_alone
from pzt_ros.diagnosis.poling import poled_anew
from pzt_ros.diagnosis.prior_drive import with_best_amplitude
from pzt_ros.diagnosis.staged import Progress, Staged
from pzt_ros.parallel import IN_THIS_PROCESS, Workers
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Array
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.physics.surrogate import with_quick_surrogate, with_surrogate
from pzt_ros.sysid.history_search import first_guesses, settle
from pzt_ros.sysid.run import Start, typical_leg
from pzt_ros.sysid.start import CountedPart, misfit_at, turning_part

_CLEAN, _CLEAN_FROM_REST = 1.005, 1.1  # rms over noise of a run whose history is not asked for
_DESCRIBED = 1.2  # rms over noise of a run from rest that an effect describes with the past that was sought without it
_ROUNDS, _GAINED, _TOLD = 4, 0.1, 0.04  # of histories and all else; until less of the excess, or of `total`, goes
_WORSE = 1.02  # rms over what it was, of a run that another history may suit
_NEARLY_CLEAN, _NEAR = 1.02, 2.0  # rms over noise between which pasts alone may be missing, and are sought thoroughly
_STEPS = 40
_SEARCHED, _SEARCHED_RATELESS = 4_000, 1_000  # samples that a search for histories looks at
_RATELESS = (Preisach, Electrostriction, StrainLaw)


def with_histories(found: Hypothesis, progress: Progress, workers: Workers) -> Hypothesis:
    """With as short a history before each run as its samples ask for, fitted together with the parameters.

    Args:
        found: fitted with every run starting where it begins.
        progress: is told what is being done.
        workers: look for the histories side by side.
    """
    runs, asked = found.staged.runs, _not_clean(found)
    if not asked:
        return found
    progress("history before " + ", ".join(runs[number].record.name for number in asked))
    if any(runs[number].begins_driven for number in asked):
        found = _from_first_guesses(found, asked, workers)
    found = renewed(min(found, _with_other_histories(found, asked, workers), key=total_of), workers)
    return _with_longer_pasts(found, workers)


def renewed(found: Hypothesis, workers: Workers = IN_THIS_PROCESS) -> Hypothesis:
    """With histories sought anew for the runs that begin driven and are not described to the noise.

    Runs from rest lose theirs beside an effect, where they are described as well without: the base made them up. Poled
    ones begin anew: beside a bias field that goes on from run to run pasts that were fitted without it ended at the
    shortest wait, from where no step led on (2.2 x the noise); begun anew, with all else as it was, at 1.005 x. The
    drive before them all is sought anew where nobody knows it. Pasts that alone may be missing are sought thoroughly in
    the end.
    """
    if not isinstance(found.staged.ceramic, WithPasts) or isinstance(found.staged.ceramic, FlexibleHysteresis):
        return found  # those of a lattice are sought where it is identified
    if not found.staged.has_past:
        return _renewed_from_rest(found)
    if isinstance(found.staged.ceramic, FlexiblePreisach):
        return _renewed_relays(found, found.staged.ceramic, workers)
    found = _in_rounds(exact(found), workers)
    asked = _without_their_past(found)
    if found.effects or not asked or not _NEARLY_CLEAN < max(found.ratios) <= _NEAR:
        return found
    return min(found, _with_other_histories(found, asked, workers, thorough=True), key=total_of)


def _in_rounds(found: Hypothesis, workers: Workers) -> Hypothesis:
    """With histories and all else sought in turn, until that gains little.

    Of relays also of runs from rest: one reversal beyond what a run reaches is what is missing there.
    """
    has_relays = isinstance(found.staged.ceramic, FlexiblePreisach)
    for _ in range(_ROUNDS):
        asked = _not_clean(found) if has_relays else _without_their_past(found)
        if not asked:
            break
        again = _with_other_histories(found, asked, workers)
        gained = found.total - again.total > max(_GAINED * found.excess, _TOLD)
        found = min(found, again, key=total_of)
        if not gained:
            break
    return found


def _renewed_relays(found: Hypothesis, relays: FlexiblePreisach, workers: Workers) -> Hypothesis:
    """The same on relays, once beside the same effects: a few numbers for a past leave something, whatever is done."""
    if relays.sought_beside == found.effects:
        return found
    found = _in_rounds(found, workers)
    ceramic = found.staged.ceramic
    assert isinstance(ceramic, FlexiblePreisach)
    staged = dataclasses.replace(found.staged, ceramic=ceramic.sought(found.effects))
    return dataclasses.replace(found, staged=staged)


def _renewed_from_rest(found: Hypothesis) -> Hypothesis:
    """The same where every run begins at rest; relays are then in the state before all runs that suits them best."""
    if not isinstance(found.staged.ceramic, DeclaredHysteresis):
        return found
    for other in (_beside_effects, _sought_beside) if found.effects else ():
        found = min(found, other(found) or found, key=total_of)
    return with_best_amplitude(found)


def _with_longer_pasts(found: Hypothesis, workers: Workers) -> Hypothesis:
    """With pasts of more reversals before the few runs from rest that alone are not described, if that describes them.

    A stage may have been left in the midst of minor loops. Sought while more is missing, such pasts make up for it.
    """
    asked = [number for number in _not_clean(found) if not found.staged.runs[number].begins_driven]
    if not asked or len(asked) != len(_not_clean(found)) or 2 * len(asked) > len(found.ratios):
        return found
    again = _fitted_with(found, _histories(found, asked, workers, is_alone=True))
    return again if not _not_clean(again) else found


def with_histories_of(found: Hypothesis, other: Hypothesis) -> Hypothesis:
    """Refitted from the histories of another on the same base; as it is where that is no better, or knows none.

    Which histories a search finds is partly luck, and effects are to be compared on equal terms.
    """
    ceramic, vector = other.staged.ceramic, other.vector
    both = isinstance(ceramic, WithPasts) and isinstance(found.staged.ceramic, WithPasts)
    if not both or not other.staged.has_past:
        return found
    starts = {number: ceramic.start_of(vector, number) for number in range(len(other.staged.runs))}
    return min(found, _fitted_with(found, starts), key=total_of)


def _beside_effects(found: Hypothesis) -> Hypothesis | None:
    """With the pasts of runs that were poled begun anew, or without those of others; None where that is as it is."""
    anew = poled_anew(found)
    if not anew:
        return without_histories(found)
    return exact(refitted_from(found, anew)) if _not_clean(found) else None


def _sought_beside(found: Hypothesis) -> Hypothesis | None:
    """With other pasts before the runs from rest that an effect does not describe, where it describes one; or None.

    Pasts that were sought without it made up for it. A current limit that left 1.1 x the noise of two runs left 11 x of
    one whose past was taken for none, and beside pasts that were sought anew 1.0 x of all four.
    """
    starts = [found.staged.ceramic.start_of(found.vector, number) for number in range(len(found.ratios))]
    asked = _not_clean(found)
    if not asked or min(found.ratios) > _DESCRIBED or not any(start.prior_voltages for start in starts):
        return None
    again = _with_other_histories(found, asked, IN_THIS_PROCESS)
    return again if max(again.ratios) <= _DESCRIBED else None


def without_histories(declared: Hypothesis) -> Hypothesis | None:
    """The declared model fitted with every run starting where it begins; None where that is as it is, or nonsense.

    A base may make up a history for what an effect does to a run, and the effect then finds nothing left to explain.
    """
    staged = declared.staged
    ceramic = staged.ceramic
    if staged.has_past or not isinstance(ceramic, DeclaredHysteresis):
        return None
    if not any(start.prior_voltages for start in ceramic.starts):
        return None
    return exact(refitted_from(declared, {number: Start() for number in range(len(staged.runs))}))


def _not_clean(found: Hypothesis) -> list[int]:
    """Indices of the runs of which so much is left that they may have a history."""
    clean = [_CLEAN if run.begins_driven else _CLEAN_FROM_REST for run in found.staged.runs]
    reached = [number for number, run in enumerate(found.staged.runs) if not run.since]
    return [number for number in reached if found.ratios[number] > clean[number]]


def _without_their_past(found: Hypothesis) -> list[int]:
    """Those of them that begin driven."""
    return [number for number in _not_clean(found) if found.staged.runs[number].begins_driven]


def _from_first_guesses(found: Hypothesis, asked: Sequence[int], workers: Workers) -> Hypothesis:
    """The best of fits that begin as declared, some runs with the best short history of a kind each.

    A fit of a run that has a past to a model without one leads nowhere from where its past could be seen.
    """
    staged = found.staged
    begin = dataclasses.replace(found, vector=staged.start)
    chain = with_surrogate(staged.chain_at(staged.start))
    guesses = list(workers.map(first_guesses, repeat(chain), [_part(staged.runs[number]) for number in asked]))
    tried = [refitted_from(begin, dict(zip(asked, starts, strict=True))) for starts in zip(*guesses, strict=True)]
    return min((found, *tried), key=total_of)


def _with_other_histories(
    found: Hypothesis, asked: Sequence[int], workers: Workers, thorough: bool = False
) -> Hypothesis:
    """Fitted with histories sought anew, those of runs that came off worse by that once more.

    A run that only chooses had found its own beside parameters that the histories of the others then changed.
    """
    again = _fitted_with(found, _histories(found, asked, workers, thorough))
    driven = [number for number in asked if found.staged.runs[number].begins_driven]  # others hardly have one
    worse = [number for number in driven if again.ratios[number] > _WORSE * found.ratios[number]]
    if not worse or len(worse) == len(driven):
        return again
    return min(again, _fitted_with(again, _histories(again, worse, workers, thorough)), key=total_of)


def with_other_pasts(found: Hypothesis, workers: Workers) -> Hypothesis:
    """With short pasts of the runs that are not described, beside all else as it is."""
    return refitted_from(found, _histories(found, _not_clean(found), workers), 0)


def _fitted_with(found: Hypothesis, known: Mapping[int, Start]) -> Hypothesis:
    """Fitted with other histories of some runs; exactly at once where it was so near that they were sought exactly."""
    return exactly(refitted_from(found, known, 0)) if _is_near(found) else exact(refitted_from(found, known))


def _is_near(found: Hypothesis) -> bool:
    """Whether it is so near the noise that what the model in place of the ceramic is off by would hide the rest."""
    return found.fit.ratio <= found.staged.far


def refitted_from(found: Hypothesis, known: Mapping[int, Start], steps: int = _STEPS) -> Hypothesis:
    """Fitted with other histories of some runs, from where it is."""
    staged = found.staged
    ceramic, numbers = staged.ceramic, range(len(staged.runs))
    assert isinstance(ceramic, WithPasts)
    starts = [known.get(number, staged.ceramic.start_of(found.vector, number)) for number in numbers]
    other = dataclasses.replace(staged, ceramic=ceramic.with_starts(starts))
    begin = other.start
    begin[_parameters_of(other)] = found.vector[_parameters_of(staged)]
    return fitted(other, begin, found.effects, steps)


def _part(run: RunData) -> CountedPart:
    """What a search for its history may look at."""
    picks = run.picks[FIT] if FIT in run.picks else run.picks[SELECTION]
    picks = picks[:: -(-picks.size // _SEARCHED)]
    return CountedPart(run.record, picks, int(picks[-1]) + 1)


def _histories(
    found: Hypothesis, asked: Sequence[int], workers: Workers, thorough: bool = False, is_alone: bool = False
) -> dict[int, Start]:
    if isinstance(found.staged.ceramic, FlexiblePreisach):  # without effects a search passes most samples by
        found = ceramic_alone(found)
    each = workers.map(_history, repeat(found), asked, repeat(thorough), repeat(is_alone))
    return dict(zip(asked, each, strict=True))


def _history(found: Hypothesis, number: int, thorough: bool, is_alone: bool) -> Start:
    """The shortest history of a run that its samples ask for."""
    run = found.staged.runs[number]
    part = _part(run)
    chain = found.staged.chain_at(found.vector, number)
    quick = with_quick_surrogate(chain, run.record.voltage)
    bases = [*_bases(found, number), *_most_alike(found, number, quick, part)]
    if thorough or isinstance(found.staged.ceramic, FlexiblePreisach):
        bases = [*bases, Start(leg=typical_leg(run.record))]
    chain = chain if _is_near(found) else quick
    absorbed = _absorbed(found, number, part)
    if all(isinstance(link, _RATELESS) for link in chain.links):
        every = -(-part.picks.size // _SEARCHED_RATELESS)
        part = turning_part(dataclasses.replace(part, picks=part.picks[::every]))
        absorbed = None if absorbed is None else absorbed[::every]
    return settle(chain, part, bases, absorbed, run.noise, thorough, is_alone)


def _absorbed(found: Hypothesis, number: int, part: CountedPart) -> Array | None:
    """What of a run is not its history's to explain: what parameters do, what wanders, what fades [shape (n, p)].

    Hundreds of weights of relays, which may not be negative, would explain any history as columns without bounds.
    """
    run = found.staged.runs[number]
    columns = []
    if FIT in run.picks and not isinstance(found.staged.ceramic, FlexiblePreisach):
        jacobian = found.staged.jacobians(found.vector, [number], FIT)[1][0][: run.picks[FIT].size]
        columns.append(run.noise * jacobian[:: -(-run.picks[FIT].size // _SEARCHED), _parameters_of(found.staged)])
    if run.has_nuisances:
        curves = run.nuisances(part.picks)
        columns.append(curves - curves.mean(axis=0))
    return np.column_stack(columns) if columns else None


def _bases(found: Hypothesis, number: int) -> list[Start]:
    """From where to seek the history of a run: as it is, and as runs begin in the median, poled most likely."""
    numbers = range(len(found.staged.runs))
    starts = [found.staged.ceramic.start_of(found.vector, each) for each in numbers]
    here, run = starts[number], found.staged.runs[number]
    known = [start.prior_voltages[0] for start in starts if start.prior_voltages]
    if not known or not run.begins_driven:
        as_poled = [here] if here.approach is not None else []
        return [*as_poled, Start(leg=typical_leg(run.record))]
    poled = dataclasses.replace(here, prior_voltages=(float(np.median(known)),))
    return [here, poled] if here.prior_voltages not in ((), poled.prior_voltages) else [poled]


def _most_alike(found: Hypothesis, number: int, chain: Chain, part: CountedPart) -> list[Start]:
    """The past of another run that suits a run that begins driven best, for runs of one bench may begin alike."""
    staged, leg = found.staged, typical_leg(part.record)
    others = [each for each, run in enumerate(staged.runs) if each != number and run.begins_driven]
    pasts = {staged.ceramic.start_of(found.vector, each).prior_voltages for each in others}
    starts = [Start(past, leg) for past in sorted(pasts) if past]
    if not staged.runs[number].begins_driven or not starts:
        return []
    return [min(starts, key=lambda start: float(np.std(misfit_at(chain, part, start))))]


def _parameters_of(staged: Staged) -> list[int]:
    """Where the vector has what is not the history of a run."""
    places = range(staged.start.size)
    histories = {place for number in range(len(staged.runs)) for place in staged.ceramic.places_of(number)}
    return [place for place in places if place not in histories]
