"""Unknown history and unknown zero of a run: tried on a grid, refined, and kept as short as the data allow.

What happened before the first sample acts through the reversal points it left behind (diagnosis-methods.md 4). So a
history is a few prior reversal voltages, run through before the record, and, where a drive had waited or hurried, how
long ago the last was left; the offset of the displacement is linear and solved exactly. More unknowns fit anything
better, so each has to pay for itself.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import optimize

from pzt_ros.physics.chain import Chain
from pzt_ros.physics.identified_lattice import IdentifiedLattice
from pzt_ros.physics.signals import Array
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.physics.surrogate import with_quick_surrogate
from pzt_ros.records import Record
from pzt_ros.sysid.covariance import effective_samples
from pzt_ros.sysid.history_shares import (
    USUAL,
    WIDE,
    share_bounds,
    shares_of,
    voltage_bounds,
    voltages_at,
    with_shares,
)
from pzt_ros.sysid.run import Start, begins_driven, rms, typical_leg
from pzt_ros.sysid.start import CountedPart, displacement_of, dying_out, thinned_part, with_offset

_LONGEST, _LONGEST_FROM_REST = 8, 2
"""Prior reversals at most of a run that begins driven: inside minor loops it takes one to four to come down to the
noise; and of one that begins at rest, where more of them would make up for what is missing in the model."""

_GUESSED = 2  # reversals of a first guess

_least_squares: Any = optimize.least_squares  # SciPy carries no types

Misfit = Callable[[Start], Array]
"""From a history to what is left of the counted samples beside it [m]."""

_ROOM = 0.02  # from the bounds of shares, where a search begins
_CYCLES, _AT_END = 20, 0.03  # of the drive from one end to the other, and how near is there, of its span
_FEWEST = 100  # samples to search by
_FEW = 1_000  # samples that are compared where a chain has no surrogate
_NEED_NOT_EVERY_SAMPLE = (IdentifiedLattice, Electrostriction, StrainLaw)
_LEVELS, _MORE_LEVELS = 9, 13
_GUESSED_LEVELS = 5
_APPROACHES = 0.1, 10.0, 100.0, 1e3  # usual legs: what a search begins with
_REFINED = 2
_ROUGH, _FINE = (6, 1e-4), (40, 1e-6)  # evaluations at most of a local search, and the shares it may stop at
_CORRECTIONS = 3
_FAR_OWN = 10.0  # spreads of what was expected, as far as a parameter of the run may be off
PRICE = 10.0  # fall of n_eff ln(SSR) that one more unknown has to bring; chi^2 of 1 degree of freedom, p = 0.002


def first_guesses(chain: Chain, part: CountedPart) -> list[Start]:
    """The best of the grid with no, one and two prior reversals, for a chain that is not fitted yet.

    Only the shape of the motion is compared: the scale of such a chain may be far off.
    """
    part = telling_part(part)
    misfit = _misfit_of(chain, part, any_scale=True)
    leg = typical_leg(part.record)
    return [Start(leg=leg)] + [_best_of_grid(misfit, part.record, count, leg)[0] for count in range(1, _GUESSED + 1)]


def settle(
    chain: Chain,
    part: CountedPart,
    bases: Sequence[Start] = (),
    tangent: Array | None = None,
    noise: float = 0.0,
    thorough: bool = False,
    is_alone: bool = False,
) -> Start:
    """The shortest history that the counted samples ask for, and the offset with it.

    Histories are looked for with the chain's surrogate, in the samples that tell most, and judged with the chain itself
    in all of them: a sine of 280 cycles took minutes to be searched.

    Args:
        chain: with its parameters fixed.
        part: what may be looked at.
        bases: histories to start from; one without prior reversals where there are none.
        tangent: how the counted samples change with the parameters, and what else is not the history's to explain
            [shape (n, p)]; a history is then judged by what is left when these adapt to it, or parameters fitted to a
            wrong history would defend it.
        noise: of the displacement [m]; a history that leaves no more than that is not questioned.
        thorough: look further beyond the run's range, too, with more of a grid.
        is_alone: nothing else is missing, so a run from rest may have had as long a past as one that begins driven.
    """
    begins = [base.without_reading for base in bases] or [Start(leg=typical_leg(part.record))]
    low, high = voltage_bounds(part.record)
    if low == high:  # nothing was driven, so no reversal could be told from another
        return with_offset(chain, part, begins[0])
    if _passes_by(chain) and not begins_driven(part.record):
        return best_of(chain, part, begins, tangent)
    misfits = _Misfits(chain, part, tangent)
    shares = np.linspace(*WIDE, _MORE_LEVELS + 2) if thorough else np.linspace(*USUAL, _LEVELS + 2)
    levels = voltages_at(part.record, shares[1:-1])
    longest = _LONGEST if is_alone or begins_driven(part.record) else _LONGEST_FROM_REST
    found = [_grown(misfits, begin, longest, part.record, noise, levels) for begin in begins]
    best = min(found, key=lambda each: _price(each, misfits.exactly(each))) if len(found) > 1 else found[0]
    return with_offset(chain, part, best)


def best_of(chain: Chain, part: CountedPart, starts: Sequence[Start], tangent: Array | None = None) -> Start:
    """Of some histories, and of a grid, the one that pays best where local search takes it, and the offset with it.

    For a lattice, whose histories would take a minute to grow one reversal after the other.

    Args:
        chain, part, tangent: as `settle` has them.
        starts: from which searches begin, too.
    """
    whole, (part, tangent) = part, _fewer(chain, part, tangent)
    misfit = _misfit_of(chain, part, tangent=tangent)
    leg = typical_leg(part.record)
    grid = [each for count in range(1, _GUESSED + 1) for each in _best_of_grid(misfit, part.record, count, leg)]
    begins = dict.fromkeys([*(start.without_reading for start in starts), Start(leg=leg), *grid])
    refined = [_refined(misfit, each, part.record) if each.unknowns else each for each in begins]
    best = min(refined, key=lambda each: _price(each, misfit(each)))
    return with_offset(chain, whole, _refined(misfit, best, part.record, _FINE) if best.unknowns else best)


def at_its_best(chain: Chain, part: CountedPart, start: Start) -> Start:
    """A history where all counted samples like it best beside what dies out, and the offset with it.

    A search stops sooner, for a fit that moves everything follows it. In a prediction nothing does, and what the past
    is off by stays all along a run inside minor loops.
    """
    if not start.unknowns:
        return with_offset(chain, part, start)
    fewer, tangent = _fewer(chain, part, dying_out(chain, part))
    misfit = _misfit_of(chain, fewer, tangent=tangent)
    return with_offset(chain, part, _refined(misfit, start.without_reading, fewer.record, _FINE))


def at_its_best_with(
    chain: Chain, part: CountedPart, start: Start, own: Mapping[str, tuple[float, float]], noise: float
) -> Start:
    """The same with parameters of the run moved along: what acts on the ceramic hides its past, and is hidden by it.

    Args:
        chain: that the run is predicted with.
        part: that may be looked at.
        start: where the search begins, with values of these parameters.
        own: what each is expected to be, and how far it may be from that [SI].
        noise: of the displacement [m], by which that is weighed.
    """
    count, known, names = start.unknowns, dict(start.values), list(own)
    mean, spread = (np.array([own[name][k] for name in names]) for k in (0, 1))
    left, unit = _left_beside(part, dying_out(chain, part)), max(noise, 1e-12)  # m; of a record without any noise

    def moved(vector: Array) -> Start:
        values = {**known, **dict(zip(names, mean + spread * vector[count:], strict=True))}
        shares = with_shares(start.without_reading, part.record, vector[:count])
        return replace(shares, values=tuple((name, float(value)) for name, value in values.items()))

    low, high = np.array(share_bounds(part.record, start)).reshape(-1, 2).T
    far = np.full(mean.size, _FAR_OWN)
    first = (np.array([known[name] for name in names]) - mean) / spread
    shares = np.clip(shares_of(part.record, start), low + _ROOM, high - _ROOM)
    found = _least_squares(
        lambda vector: np.append(left(displacement_of(chain, part, moved(vector))) / unit, vector[count:]),
        np.concatenate((shares, np.clip(first, -0.9 * far, 0.9 * far))),
        bounds=(np.append(low, -far), np.append(high, far)),
        diff_step=1e-3,
        xtol=_FINE[1],
        max_nfev=_FINE[0],
    )
    return with_offset(chain, part, moved(found.x))


def telling_part(part: CountedPart) -> CountedPart:
    """The samples before the drive has been so often at both its ends that what was before acts on alike, or creeps.

    Most of a past is wiped out by then, or stays as it is (return-point memory). As it is where few would be left.
    """
    voltage = part.record.voltage[: part.end]
    low, high = float(np.min(voltage)), float(np.max(voltage))
    room = _AT_END * (high - low)
    at_end = np.flatnonzero((voltage <= low + room) | (voltage >= high - room))
    crossed = at_end[1:][np.diff(voltage[at_end] > 0.5 * (low + high)) != 0]
    if crossed.size <= 2 * _CYCLES:
        return part
    picks = part.picks[part.picks <= crossed[2 * _CYCLES]]
    return replace(part, picks=picks, end=int(picks[-1]) + 1) if picks.size >= _FEWEST else part


def pays(before: Array, after: Array, unknowns: int) -> bool:
    """Whether what more unknowns leave is so much less that they pay for themselves [residuals, each shape (n,)]."""
    ssr_before, ssr_after = float(np.sum(before**2)), float(np.sum(after**2))
    if ssr_after <= 0.0 or ssr_before <= 0.0:
        return ssr_after < ssr_before
    return effective_samples(after) * math.log(ssr_before / ssr_after) > PRICE * unknowns


def _fewer(chain: Chain, part: CountedPart, tangent: Array | None) -> tuple[CountedPart, Array | None]:
    """Some of the samples, all others passed by between which the drive goes straight, for what has no surrogate.

    A lattice takes as long for a sample however little happens, and what is behind it here knows no time.
    """
    if not _passes_by(chain):
        return part, tangent
    every = -(-part.picks.size // _FEW)
    fewer = thinned_part(replace(part, picks=part.picks[::every]))
    return fewer, None if tangent is None else tangent[::every]


def _passes_by(chain: Chain) -> bool:
    return all(isinstance(link, _NEED_NOT_EVERY_SAMPLE) for link in chain.links)


class _Misfits:
    """What is left of a run beside a history [m], from exact to quick to say.

    The surrogate is some tenths of a good sensor's noise off and more, behind which reversals hide. What it is off by
    changes slowly with the history, so it is taken over from the one where the chain itself was asked last.

    Args:
        chain: with its parameters fixed.
        part: all samples that count.
        tangent: as `settle` has it.
    """

    def __init__(self, chain: Chain, part: CountedPart, tangent: Array | None = None) -> None:
        early = telling_part(part)
        self._chain, self._part, self._early = chain, part, early
        self._quick = with_quick_surrogate(chain, part.record.voltage)
        self._is_exact = self._quick is chain
        self._left = _left_beside(part, tangent)
        self._left_early = _left_beside(early, None if tangent is None else tangent[: early.picks.size])
        self._beside = np.zeros(part.picks.size)

    def exactly(self, start: Start) -> Array:
        """By the chain."""
        return self._left(displacement_of(self._chain, self._part, start))

    def quickly(self, start: Start) -> Array:
        """By its surrogate."""
        return self._left(displacement_of(self._quick, self._part, start) + self._beside)

    def early(self, start: Start) -> Array:
        """By that, of the samples that tell most."""
        beside = self._beside[: self._early.picks.size]
        return self._left_early(displacement_of(self._quick, self._early, start) + beside)

    def correct_at(self, start: Start) -> Array:
        """What is left exactly, which `quickly` then says, too."""
        there = displacement_of(self._chain, self._part, start)
        if not self._is_exact:
            self._beside = there - displacement_of(self._quick, self._part, start)
        return self._left(there)


def _grown(
    misfits: _Misfits, best: Start, longest: int, record: Record, clean: float, levels: Sequence[float]
) -> Start:
    """A history with as many more reversals as pay, begun at some levels [V], until only `clean` is left [m]."""
    left = misfits.correct_at(best)
    while len(best.prior_voltages) < longest and rms(left) > clean:
        sought = misfits.early(best)
        longer = [each for each in _longer(misfits.early, best, record, levels) if len(each.prior_voltages) <= longest]
        seen = [(start, misfits.early(start)) for start in longer]
        paying = [(start, early) for start, early in seen if pays(sought, early, _more(start, best))]
        if not paying:
            break
        start = _refined(misfits.quickly, min(paying, key=lambda pair: _price(*pair))[0], record)
        there = misfits.correct_at(start)
        if not pays(left, there, _more(start, best)):
            break
        best, left = start, there
    return _corrected(misfits, best, record)


def _corrected(misfits: _Misfits, best: Start, record: Record) -> Start:
    """A history refined with the surrogate as it is there, for as long as it gets better."""
    left = misfits.correct_at(best)
    for _ in range(_CORRECTIONS if best.unknowns else 0):
        start = _refined(misfits.quickly, best, record)
        better = misfits.correct_at(start)
        if rms(better) >= rms(left):
            break
        best, left = start, better
    return best


def _misfit_of(chain: Chain, part: CountedPart, any_scale: bool = False, tangent: Array | None = None) -> Misfit:
    left = _left_beside(part, tangent, any_scale)
    return lambda start: left(displacement_of(chain, part, start))


def _left_beside(part: CountedPart, tangent: Array | None, any_scale: bool = False) -> Callable[[Array], Array]:
    """From a model's displacement to what is left of the counted samples [m], without what a tangent takes up."""
    measured = part.displacement - part.displacement.mean()
    curves = np.zeros((measured.size, 0)) if tangent is None else tangent
    absorbed = np.linalg.qr(curves - curves.mean(axis=0))[0]  # the mean goes anyway

    def left(model: Array) -> Array:
        model = model - model.mean()
        scale = 1.0
        if any_scale and np.any(model):
            scale = max(float(model @ measured / (model @ model)), 0.0)
        found: Array = measured - scale * model
        return found - absorbed @ (absorbed.T @ found)

    return left


def _longer(misfit: Misfit, start: Start, record: Record, levels: Sequence[float]) -> list[Start]:
    """The best histories with one reversal more at the end, with two more anywhere, and with another approach, refined.

    One more reversal in the middle is passed over by a ramp between its neighbours, so there it takes two.
    """
    known, begin = start.prior_voltages, float(record.voltage[0])
    if not _is_nested(known, begin):
        levels = levels[::2]  # more of them would take too long where none is ruled out
    one = [(*known, level) for level in levels]
    two = [(*known[:k], *pair, *known[k:]) for k in range(len(known) + 1) for pair in itertools.permutations(levels, 2)]
    found = []
    ways = [[each for each in longer if _is_nested(each, begin)] or longer for longer in (one, two)]
    tried = [[replace(start, prior_voltages=each) for each in voltages] for voltages in ways]
    if start.approach is None and begins_driven(record):
        tried.append([replace(start, approach=start.leg * legs) for legs in _APPROACHES])
    for starts in tried:
        near = sorted(starts, key=lambda each: float(np.sum(misfit(each) ** 2)))[:_REFINED]
        found += [_refined(misfit, each, record) for each in near]
    return found


def _is_nested(voltages: Sequence[float], begin: float) -> bool:
    """Whether each reversal, and where a run begins, lies between the two before: others would have wiped those out."""
    path = (*voltages, begin)
    return all(min(a, b) < c < max(a, b) for a, b, c in zip(path, path[1:], path[2:], strict=False))


def _best_of_grid(misfit: Misfit, record: Record, count: int, leg: float) -> list[Start]:
    levels = np.linspace(*voltage_bounds(record), _GUESSED_LEVELS)
    starts = [
        Start(tuple(float(v) for v in voltages), leg)
        for voltages in itertools.product(levels, repeat=count)
        if all(a != b for a, b in itertools.pairwise(voltages))
    ]
    return sorted(starts, key=lambda start: float(np.sum(misfit(start) ** 2)))[:_REFINED]


def _refined(misfit: Misfit, start: Start, record: Record, how: tuple[int, float] = _ROUGH) -> Start:
    """What local search makes of a start; the start itself where that is no better."""
    evaluations, tolerance = how
    unit = max(rms(misfit(start)), 1e-15)  # the tolerances of the search want numbers of order 1
    low, high = np.array(share_bounds(record, start)).T
    found = _least_squares(
        lambda shares: misfit(with_shares(start, record, shares)) / unit,
        np.clip(shares_of(record, start), low + _ROOM, high - _ROOM),
        bounds=(low, high),
        diff_step=1e-3,
        xtol=tolerance,
        max_nfev=evaluations,
    )
    return with_shares(start, record, found.x) if rms(found.fun) < 1.0 else start


def _more(longer: Start, start: Start) -> int:
    return longer.unknowns - start.unknowns


def _price(start: Start, residual: Array) -> float:
    """What is left and what the unknowns cost, to be compared between histories of one run."""
    return residual.size * math.log(max(rms(residual), 1e-30)) + PRICE * start.unknowns
