"""Unknown history and unknown zero of a run: tried on a grid, refined, and kept as short as the data allow.

What happened before the first sample acts through the reversal points it left behind (diagnosis-methods.md 4). So a
history is a few prior reversal voltages, run through before the record; the offset of the displacement is linear and
solved exactly. More reversals fit anything better, so each has to pay for itself.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.physics.surrogate import with_surrogate
from pzt_ros.records import Record
from pzt_ros.sysid.covariance import effective_samples
from pzt_ros.sysid.run import Span, Start, free_run, rms, typical_leg

LONGEST = 2
"""Prior reversals tried at most; methods tried with four gain a little and cost much."""

_least_squares: Any = optimize.least_squares  # SciPy carries no types

_LEVELS = 7
_CLEAN = 1.05  # rms over noise
_HOPELESS = 2.0  # rms of the best on the grid over what it has to beat, from which refining it is not worth while
_REFINED = 4
PRICE = 10.0  # fall of n_eff ln(SSR) that one more reversal has to bring; chi^2 of 1 degree of freedom, p = 0.002


@dataclass(frozen=True)
class CountedPart:
    """The samples of a run that count.

    Attributes:
        record: the whole run; the chain runs from its first sample.
        picks: indices of the counted samples.
        end: index after the last sample that the chain has to reach.
    """

    record: Record
    picks: NDArray[np.intp]
    end: int

    @property
    def displacement(self) -> Array:
        """Measured at the counted samples [m]."""
        return self.record.displacement[self.picks]


def counted_part(record: Record, span: Span, most: int) -> CountedPart:
    """At most `most` evenly chosen samples of a span; the chain still runs over all of them."""
    first, after = span.of(record)
    stride = math.ceil((after - first) / most)
    return CountedPart(record, np.arange(first, after, stride), after)


def voltage_bounds(record: Record) -> tuple[float, float]:
    """Where prior reversals are looked for [V]: half the run's range beyond it on each side."""
    low, high = float(record.voltage.min()), float(record.voltage.max())
    return low - 0.5 * (high - low), high + 0.5 * (high - low)


def first_guesses(chain: Chain, part: CountedPart) -> list[Start]:
    """The best of the grid with no, one and two prior reversals, for a chain that is not fitted yet.

    Only the shape of the motion is compared: the scale of such a chain may be far off.
    """
    misfit = _misfit_of(chain, part, any_scale=True)
    leg = typical_leg(part.record)
    return [Start(leg=leg)] + [_best_of_grid(misfit, part.record, count, leg)[0] for count in range(1, LONGEST + 1)]


def settle(
    chain: Chain, part: CountedPart, base: Start | None = None, tangent: Array | None = None, noise: float = 0.0
) -> Start:
    """The shortest history that the counted samples ask for, and the offset with it.

    Histories are looked for with the chain's surrogate and judged with the chain itself.

    Args:
        chain: with its parameters fixed.
        part: what may be looked at.
        base: history to start from; one without prior reversals where None.
        tangent: how the counted samples change with the parameters [shape (n, p)]; a history is then judged by what is
            left when the parameters adapt to it, or those fitted to a wrong history would defend it.
        noise: of the displacement [m]; a history that leaves no more than that is not questioned.
    """
    misfit = _misfit_of(chain, part, tangent=tangent)
    quick = with_surrogate(chain)
    searched = misfit if quick is chain else _misfit_of(quick, part, tangent=tangent)
    leg = typical_leg(part.record)
    best = replace(base, offset=0.0) if base else Start(leg=leg)
    low, high = voltage_bounds(part.record)
    if low == high:  # nothing was driven, so no reversal could be told from another
        return with_offset(chain, part, best)
    best_residual = misfit(best)
    for count in range(1, LONGEST + 1):
        if rms(best_residual) <= _CLEAN * noise:
            break
        near = _best_of_grid(searched, part.record, count, leg)
        if rms(searched(near[0])) > _HOPELESS * rms(searched(best)):
            break
        start = _refined(searched, near, part.record)
        residual = misfit(start)
        if _pays(best_residual, residual, max(1, count - len(best.prior_voltages))):
            best, best_residual = start, residual
    return with_offset(chain, part, best)


def with_offset(chain: Chain, part: CountedPart, start: Start) -> Start:
    """The same history with the offset that fits the counted samples best."""
    model = free_run(chain, part.record, replace(start, offset=0.0), part.picks, part.end)
    return replace(start, offset=float(np.mean(part.displacement - model.displacement)))


def _misfit_of(
    chain: Chain, part: CountedPart, any_scale: bool = False, tangent: Array | None = None
) -> Callable[[Start], Array]:
    measured = part.displacement - part.displacement.mean()
    absorbed = np.zeros((measured.size, 0)) if tangent is None else np.linalg.qr(tangent)[0]

    def misfit(start: Start) -> Array:
        model = free_run(chain, part.record, start, part.picks, part.end).displacement
        model = model - model.mean()
        scale = 1.0
        if any_scale and np.any(model):
            scale = max(float(model @ measured / (model @ model)), 0.0)
        left: Array = measured - scale * model
        return left - absorbed @ (absorbed.T @ left)

    return misfit


def _best_of_grid(misfit: Callable[[Start], Array], record: Record, count: int, leg: float) -> list[Start]:
    levels = np.linspace(*voltage_bounds(record), _LEVELS)
    starts = [
        Start(tuple(float(v) for v in voltages), leg)
        for voltages in itertools.product(levels, repeat=count)
        if all(a != b for a, b in itertools.pairwise(voltages))
    ]
    return sorted(starts, key=lambda start: float(np.sum(misfit(start) ** 2)))[:_REFINED]


def _refined(misfit: Callable[[Start], Array], tried: list[Start], record: Record) -> Start:
    """The best that local search makes of a few starts; there are several minima, so one start is not enough."""
    low, high = voltage_bounds(record)
    unit = high - low
    unit_of_misfit = max(rms(misfit(tried[0])), 1e-15)  # the tolerances of the search want numbers of order 1

    def start_of(shares: Array) -> Start:
        return replace(tried[0], prior_voltages=tuple(float(low + unit * share) for share in shares))

    best, least = tried[0], float(np.sum(misfit(tried[0]) ** 2))
    for start in tried:
        begin = np.clip((np.array(start.prior_voltages) - low) / unit, 0.02, 0.98)
        found = _least_squares(
            lambda shares: misfit(start_of(shares)) / unit_of_misfit,
            begin,
            bounds=(0.0, 1.0),
            diff_step=1e-3,
            xtol=1e-4,
            max_nfev=15,
        )
        ssr = 2.0 * found.cost * unit_of_misfit**2
        if ssr < least:
            best, least = start_of(found.x), ssr
    return best


def _pays(before: Array, after: Array, reversals: int) -> bool:
    ssr_before, ssr_after = float(np.sum(before**2)), float(np.sum(after**2))
    if ssr_after <= 0.0 or ssr_before <= 0.0:
        return ssr_after < ssr_before
    return effective_samples(after) * math.log(ssr_before / ssr_after) > PRICE * reversals
