"""The flexible bases: a density of thresholds and a strain law as the runs show them, instead of as declared.

The misfit of a declared density must not be taken for an effect (diagnosis-methods.md 3.3). So where the declared model
does not come down to the noise, effects are looked for on such a base. There are two: relays with thermal kinetics on a
lattice, and relays that know no rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from pzt_ros.diagnosis.coordinates import Coordinate, coordinate
from pzt_ros.diagnosis.data import RunData
from pzt_ros.diagnosis.flexible_lattice import FlexibleHysteresis
from pzt_ros.diagnosis.flexible_preisach import FlexiblePreisach
from pzt_ros.diagnosis.histories import refitted_from, renewed
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted, total_of
from pzt_ros.diagnosis.hysteresis import Hysteresis
from pzt_ros.diagnosis.lattice_pasts import not_described, with_pasts_sought
from pzt_ros.diagnosis.less_effects import less_effects
from pzt_ros.diagnosis.parts import driven_before, parts_of, reversed_before, wiped_out
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.staged import Progress, Staged
from pzt_ros.diagnosis.strain_laws import coordinates_of
from pzt_ros.effects.insert import effects_in
from pzt_ros.effects.strain_polarization_hysteresis import StrainPolarizationHysteresis
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.parallel import IN_THIS_PROCESS, Workers
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import Link
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.signals import Array
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_hysteresis import StrainHysteresis
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.sysid.identified_fit import Choice, IdentifiedFit, IdentifiedResult
from pzt_ros.sysid.rate_independent import RateIndependentHysteresis
from pzt_ros.sysid.read_off import shares_of
from pzt_ros.sysid.run import Start, amplifier_gain, typical_leg

_STEPS = 4
_ROUNDS, _TURNS, _GAINED = 3, 2, 0.1  # that relays, or a lattice, and pasts are sought; until less of the excess goes
_PASTS_LEAVE = 0.25
"""Share of the excess that pasts may leave when they are first sought, or something else is missing and they stand in
for it: of runs with a past they left 0.1 and less, of a creep and a fatigue of 10 x 0.6 and more, of a creep of 5 x
beside plays 0.35."""
_TYPICALLY_LEAVE = 0.5  # the same of the rms over noise of a typical run

_NEAR = 2.0  # rms over noise up to which a density that the pasts of a model suit is where a search for others begins

ROTATIONS, ORDERS = (0.0, 1.0, 10.0, 100.0), (2, 3)
"""Strengths of the rotation prior and orders of the strain law that are compared."""

RESOLUTIONS, INITIAL = (10, 18, 30), ("virgin", "down", "up")
"""Resolutions, and states before all runs, that are compared where switching has no rate."""


def fit_flexible(model: Hypothesis, progress: Progress, workers: Workers = IN_THIS_PROCESS) -> Hypothesis:
    """Fit the identified lattice and a strain law in place of a model's ceramic and its strain.

    How fine and smooth the density is, and of which order the law, the parts that choose say: between loops of one
    amplitude any density and law will do. Runs from rest have the pasts of the model; where those do not describe them,
    the density is identified from the samples that no past reaches, and others are sought beside it.

    Args:
        model: fitted, its ceramic declared or not; what else is in its chain stays, its effects are taken as it has
            them.
        progress: is told what is being done.
        workers: look for pasts side by side.
    """
    progress("identifying the density" + model.beside)
    found = _lattice(model, model)
    if not_described(found) and any(_has_past(found, number) for number in not_described(found)):
        virgin = refitted_from(found, {number: Start() for number in _from_rest(found)}, 0)
        found = min(found, _lattice(model, virgin), key=total_of)
    if not_described(found):
        found = _beside_pasts(model, found, workers)
    return exact(fitted(found.staged, found.vector, found.effects, _STEPS))


def _beside_pasts(model: Hypothesis, found: Hypothesis, workers: Workers) -> Hypothesis:
    """A lattice beside pasts that are sought beside it, where they tell most of what is left; else as found."""
    begun = [found]
    if max(found.ratios) > _NEAR:
        beyond = _lattice(model, None)
        if not _pasts_may_tell(found, beyond):
            return found
        begun.append(beyond)
    best = min((with_pasts_sought(each, workers) for each in begun), key=_typical)
    is_less = best.excess <= _PASTS_LEAVE * found.excess or _typical(best) <= _TYPICALLY_LEAVE * _typical(found)
    return _lattice(model, _in_turn(model, best, workers)) if best is not found and is_less else found


def _pasts_may_tell(found: Hypothesis, beyond: Hypothesis) -> bool:
    """Whether a lattice leaves so little of the samples that no past reaches that pasts may tell the others.

    Else something else is missing, and to seek them takes a minute in vain.
    """
    left = _choice_of(beyond).both / math.sqrt(2.0)
    excess = found.total_at(left) - found.total_at(1.0)
    return excess <= _PASTS_LEAVE * found.excess or left <= _TYPICALLY_LEAVE * _typical(found)


def fit_about(model: Hypothesis) -> Hypothesis:
    """The same in place of a polycrystal that is nearly right: with its pasts, and its density where no run tells."""
    polycrystal = next(link for link in model.staged.chain_at(model.vector).links if isinstance(link, Polycrystal))
    found = _lattice(model, model, believed=partial(shares_of, polycrystal))
    return exact(fitted(found.staged, found.vector, found.effects, _STEPS))


def _in_turn(model: Hypothesis, found: Hypothesis, workers: Workers) -> Hypothesis:
    """A lattice identified beside the pasts that were sought beside it, and so on, until little is gained.

    A stage was never driven before one run at most, the first; a past that takes the place of that defends itself.
    """
    virgin = refitted_from(found, {0: Start()}, 0)
    begun = [found] if not _has_past(found, 0) else [found, virgin]
    found = min((_lattice(model, each, found) for each in begun), key=total_of)
    for _ in range(_TURNS):
        sought = with_pasts_sought(found, workers)
        again = _lattice(model, sought, sought) if sought is not found else found
        gained = found.total - again.total > _GAINED * found.excess
        found = min(found, again, key=total_of)
        if not gained or not not_described(found):
            break
    return found


def _lattice(
    model: Hypothesis,
    known: Hypothesis | None,
    like: Hypothesis | None = None,
    believed: Callable[[Array], Array] | None = None,
) -> Hypothesis:
    """The same with the pasts that are known; without, from samples that none reaches.

    Args:
        model: in whose place it is fitted.
        known: whose pasts these are.
        like: as fine and smooth a density, and the same law, as this; where None, they are compared.
        believed: shares of the hats on a grid, with which the density stays where the runs do not tell.
    """
    runs = less_effects(model)
    thickness, voltages, reached = driven(model)
    unknown = [run.begins_driven for run in runs]
    starts = [_past_from_rest(model, number, known) for number in range(len(runs))]
    gain = amplifier_gain(model.staged.chain_at(model.vector))
    pasts = [driven_before(start, gain) for start in starts] if known else []
    parts = parts_of(runs, voltages, unknown, pasts)
    parts = parts if known else wiped_out(parts)
    fit = IdentifiedFit(thickness, rotations=ROTATIONS, orders=ORDERS, voltage_range=reached, believed=believed)
    found = (fit.only(_choice_of(like)) if like else fit).fit(*parts)
    base: Any = found.problem.base
    scale = _scale_of(found, model)
    flexible = FlexibleHysteresis(
        [run.record.time for run in runs],
        thickness,
        (reached[0] / thickness, reached[1] / thickness),
        unknown_start=unknown,
        resolution=found.choices[0].resolution,
        total=scale * base.total,
        fine_lines=base.driven_lines,
    )
    flexible.starts, flexible.gain, flexible.choice = tuple(starts), gain, found.choices[0]
    flexible.rotation_strength, flexible.smoothness_strength = base.rotation_strength, base.smoothness_strength
    if believed is not None:
        flexible.believe(believed(flexible.grid))
    fitted_ones = base.occupancies.stop  # the runs that were fitted come first, so do their occupancies
    carried = flexible.carried(base, found.vector[:fitted_ones])  # where a run from rest chooses, to a wider grid
    flexible.start[: carried.size] = carried
    flexible.start[flexible.polarized] *= scale
    return _with_law(model, flexible, found, scale)


def _choice_of(found: Hypothesis) -> Choice:
    ceramic = found.staged.ceramic
    assert isinstance(ceramic, FlexibleHysteresis)
    assert ceramic.choice is not None
    return ceramic.choice


def _from_rest(found: Hypothesis) -> list[int]:
    """Indices of the runs that do not begin driven."""
    return [number for number, run in enumerate(found.staged.runs) if not run.begins_driven]


def _has_past(found: Hypothesis, number: int) -> bool:
    return bool(found.staged.ceramic.start_of(found.vector, number).prior_voltages)


def _typical(found: Hypothesis) -> float:
    """Rms over noise of a run, by the geometric mean: a wrong past of one says nothing of a density that suits others.

    A stage was virgin before its first run and poled by that before the others: beside pasts for those a density left
    0.9 x of each, 17 x of the first and so most in all.
    """
    return float(np.exp(np.mean(np.log(found.ratios))))


def _past_from_rest(model: Hypothesis, number: int, known: Hypothesis | None) -> Start:
    """The past of a run from rest in what is known, or in the model; of one that begins driven, nothing."""
    run, source = model.staged.runs[number], known or model
    past = source.staged.ceramic.start_of(source.vector, number)
    leg = typical_leg(run.record)
    if run.begins_driven or not past.prior_voltages:
        return Start(leg=leg)
    return Start(past.prior_voltages, past.leg, approach=past.approach)


def fit_rate_independent(model: Hypothesis, progress: Progress, workers: Workers = IN_THIS_PROCESS) -> Hypothesis:
    """The same with the Preisach model, and pasts of its own before runs that begin driven.

    A density that was identified beside wrong pasts defends those. So it is identified first from the samples that no
    past reaches, then again beside the pasts that it found.
    """
    progress("identifying a density that knows no rate" + model.beside)
    has_pasts = isinstance(model.staged.ceramic, FlexiblePreisach) or not model.staged.has_past
    found = _relays(model, model if has_pasts else None, workers)
    for _ in range(_ROUNDS if model.staged.has_past else 0):
        again = _relays(model, found, workers)
        gained = found.total - again.total > _GAINED * found.excess
        found = min(found, again, key=total_of)
        if not gained:
            break
    return found


def tells_all(found: Hypothesis, asked: Thresholds) -> bool:
    """Whether an identified density leaves no more than it is off by, and relays no more than the pasts they found."""
    if found.staged.has_past and isinstance(found.staged.ceramic, FlexiblePreisach):
        return found.fit.ratio <= asked.near_floor
    return max(found.ratios) <= asked.flexible_remains


def _relays(model: Hypothesis, known: Hypothesis | None, workers: Workers) -> Hypothesis:
    """The same with the pasts that are known as where their search begins; without, from samples that none reaches."""
    runs = less_effects(model)
    none_unknown = [False] * len(runs)
    thickness, voltages, reached = driven(model)
    starts = [_past_of(run, number, known) for number, run in enumerate(runs)]
    gain = amplifier_gain(model.staged.chain_at(model.vector))
    pasts = [reversed_before(start, gain) for start in starts] if known else []
    parts = parts_of(runs, voltages, none_unknown, pasts)
    parts = parts if known else wiped_out(parts)
    fit = IdentifiedFit(
        thickness, RESOLUTIONS, ROTATIONS, ORDERS, voltage_range=reached, base=RateIndependentHysteresis
    )
    fit = min((replace(fit, initial=state) for state in INITIAL), key=lambda each: each.tried(*parts))
    found = fit.fit(*parts)
    base: Any = found.problem.base
    scale = _scale_of(found, model)
    plays = FlexiblePreisach(
        [run.record.time for run in runs],
        thickness,
        (reached[0] / thickness, reached[1] / thickness),
        resolution=found.choices[0].resolution,
        initial=fit.initial,
        total=scale * base.total,
        starts=starts,
        gain=gain,
    )
    plays.rotation_strength, plays.smoothness_strength = found.choices[0].rotation, fit.smoothness
    plays.start[:] = found.vector[: plays.shared]
    plays.start[base.polarized] *= scale
    begun = _with_law(model, plays, found, scale)
    return renewed(exact(fitted(begun.staged, begun.vector, begun.effects, _STEPS if known else 0)), workers)


def _past_of(run: RunData, number: int, known: Hypothesis | None) -> Start:
    """The reversals before a run that relays know, or that begins driven; others begin in a state before all runs."""
    leg = typical_leg(run.record)
    if known is None or not (run.begins_driven or isinstance(known.staged.ceramic, FlexiblePreisach)):
        return Start(leg=leg)
    return Start(known.staged.ceramic.start_of(known.vector, number).prior_voltages, leg)


def driven(declared: Hypothesis) -> tuple[float, list[Array], tuple[float, float]]:
    """Thickness of a layer [m], voltage at the ceramic in every run, the lowest and the highest [V]."""
    chain = declared.staged.chain_at(declared.vector)
    thickness = next(link.layer_thickness for link in chain.links if isinstance(link, Ferroelectric))
    voltages = declared.staged.voltages(declared.vector)
    return thickness, voltages, (min(float(v.min()) for v in voltages), max(float(v.max()) for v in voltages))


def _scale_of(found: IdentifiedResult, model: Hypothesis) -> float:
    """What to multiply the polarization of an identified density by: displacement does not say how large it is.

    It is as large as recorded, or else as the model has it: one that was identified holds it, a declared one had it
    before it was fitted, for what is reversible may have grown to twice its size for what the model lacks.
    """
    staged, problem = model.staged, found.problem
    if problem.polarization_scale is not None:
        return float(found.vector[problem.polarization_scale])
    was_identified = isinstance(staged.ceramic, (FlexibleHysteresis, FlexiblePreisach))
    modelled = staged.polarizations(model.vector if was_identified else staged.start)
    identified = problem.base.polarization(found.vector[: problem.law.start], problem.voltages(found.vector))
    return _span([modelled[n] for n in staged.fitted]) / _span(identified)


def _span(polarizations: Sequence[Array]) -> float:
    """Of the run that reaches farthest [C/m^2]."""
    return max(float(np.ptp(p)) for p in polarizations)


def _with_law(model: Hypothesis, ceramic: Hysteresis, found: IdentifiedResult, scale: float) -> Hypothesis:
    """An identified ceramic, its polarization so many times as large, and its law beside the rest, not fitted yet."""
    linear, quadratic, cubic = (float(c) / scale**n for n, c in enumerate((*found.law, 0.0)[1:4], start=1))
    law = StrainLaw(linear=linear, quadratic=quadratic, cubic=cubic)
    staged, start = beside_the_rest(model, ceramic, law, found.problem.order)
    return fitted(staged, start, model.effects, most_steps=0)


def beside_the_rest(declared: Hypothesis, ceramic: Hysteresis, law: StrainLaw, order: int) -> tuple[Staged, Array]:
    """A ceramic and a law, free up to an order, beside what else the declared chain has; where its fit may start.

    Effects that count from a zero of P find it anew: it lies elsewhere in another ceramic.
    """
    placeholder = ceramic.link(ceramic.start)
    values = zip(declared.staged.coordinates, declared.vector[declared.staged.ceramic.start.size :], strict=True)
    kept = [(each, value) for each, value in values if each.kind not in _LAWS and not _is_zero(each)]
    chain = declared.staged.chain_at(declared.vector)
    links = tuple(new for link in chain.links for new in _instead(link, placeholder, law))
    leads = [link for link in links if link.kind == StrainPolarizationHysteresis.kind and link not in chain.links]
    lead = [coordinate(link, field) for link in leads for field in ("polarization_lead", "turn_width")]
    zeros = [coordinate(link, EFFECT_OF[link.kind].zero) for link in effects_in(chain) if EFFECT_OF[link.kind].zero]
    own = (*coordinates_of(law)[:order], *lead)
    staged = replace(
        declared.staged,
        chain=replace(chain, links=links),
        ceramic=ceramic,
        coordinates=(*own, *(each for each, _ in kept), *zeros),
    )
    start = staged.start
    first = len(start) - len(zeros) - len(kept)
    start[first : first + len(kept)] = [value for _, value in kept]
    if zeros:
        moved = _first_polarization(declared.staged, declared.vector) - _first_polarization(staged, start)
        start[-len(zeros) :] = [each.scaled(each.start + moved) for each in zeros]
    return staged, start


def _is_zero(each: Coordinate) -> bool:
    """Whether it is where an effect counts P from."""
    return each.kind in EFFECT_OF and each.field == EFFECT_OF[each.kind].zero


def _first_polarization(staged: Staged, vector: Array) -> float:
    """Where the first run begins [C/m^2]."""
    return float(staged.polarizations(vector)[0][0])


def _instead(link: Link, ceramic: Link, law: StrainLaw) -> tuple[Link, ...]:
    """What stands for a declared link; the lead of a declared hysteresis of the strain stays."""
    if isinstance(link, Ferroelectric):
        return (ceramic,)
    if isinstance(link, StrainHysteresis) and link.polarization_lead > 0.0:
        lead = StrainPolarizationHysteresis(polarization_lead=link.polarization_lead, turn_width=link.turn_width)
        return lead, law
    return (law,) if link.kind in _LAWS else (link,)


_LAWS = (Electrostriction.kind, StrainHysteresis.kind, StrainLaw.kind)
