"""Figures 3.10, 3.13 and 3.23: the parametrized model beside the quadrature, under the same load."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pzt_ros.chains import load_chain
from pzt_ros.figures.canvas import FAST, FIELD, POLARIZATION, SLOW, curve, over_field, sheet
from pzt_ros.figures.experiments import rms_apart
from pzt_ros.figures.loads import NESTED_LOOPS, Load, ramps, respond
from pzt_ros.figures.polycrystal import shipped
from pzt_ros.figures.thesis_figure import Drawing, Finding, below
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.parametrized_single import ParametrizedSingle
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.signals import Array

SPREAD = 1e11
"""b_1 of figure 3.10 and b_2 of figure 3.13 [V^2/m^2]; the thesis prints none, figures 3.4 and 3.5 have this one."""

_NOTE = (
    "Loads and spread are not printed for it; ours are those of figure 3.6 and 1e11 V²/m², as in figures 3.4 and 3.5."
    " The model with one distribution is the library's link `parametrized_single`, no special case of `parametrized`,"
    " the combined model."
)


def coercive_fields(samples: int) -> Drawing:
    """Figure 3.10."""
    load = ramps(NESTED_LOOPS, samples)
    few = _only(load, 20, 12, 1, coercive_field_spread=SPREAD, interaction_field_spread=0.0)
    many = _only(load, 120, 72, 1, coercive_field_spread=SPREAD, interaction_field_spread=0.0)
    model = respond(single("coercive", start="positive"), load)
    left = model.polarization
    figure = _side_by_side(load, left, few, "parametrized (3.23)", "quadrature, 32 elements", "coercive fields only")
    findings = (*_compared(load, left, few, many), _starts_at_zero(load, model.phase_fraction))
    return Drawing(figure, findings, _NOTE)


def interaction_fields(samples: int) -> Drawing:
    """Figure 3.13."""
    load = ramps(NESTED_LOOPS, samples)
    few = _only(load, 1, 1, 16, coercive_field_spread=0.0, interaction_field_spread=SPREAD)
    many = _only(load, 1, 1, 96, coercive_field_spread=0.0, interaction_field_spread=SPREAD)
    model = respond(single("interaction"), load)
    left = model.polarization
    figure = _side_by_side(load, left, few, "parametrized (3.31)", "quadrature, 32 elements", "interaction fields only")
    return Drawing(figure, (*_compared(load, left, few, many), _one_curve(load, model.phase_fraction)), _NOTE)


def combined(samples: int) -> Drawing:
    """Figure 3.23."""
    load = ramps(NESTED_LOOPS, samples)
    left = respond(_link("thesis-p3", Parametrized), load).polarization
    right = respond(_link("thesis-q1", Quadrature), load).polarization
    figure = _side_by_side(
        load, left, right, "parametrized, chain thesis-p3", "quadrature, chain thesis-q1", "both distributions"
    )
    after = slice(load.ends[0], None)
    back = _back(load, left)
    findings = (
        below(
            "the parametrized model produces almost the same characteristics",
            "rms difference of P over the span",
            rms_apart(right[after], left[after]),
            5.0,
        ),
        below(
            "its minor loops return to the point they left",
            "how far P is off, back at 0.4 kV/mm after the loop to -0.2 kV/mm, over the span",
            100 * back / float(np.ptp(left)),
            2.0,
        ),
    )
    note = "Loads are not printed; ours are those of figure 3.6. Both start depolarised, each in its own way."
    return Drawing(figure, findings, note)


def _link(chain: str, kind: type[Ferroelectric]) -> Ferroelectric:
    return next(link for link in load_chain(chain).links if isinstance(link, kind))


def single(distribution: str, **changes: Any) -> ParametrizedSingle:
    """The model with one distribution, with the constants of figure 3.6."""
    source = shipped()
    constants: dict[str, Any] = {
        "coercive_field": source.coercive_field,
        "spread": SPREAD,
        "relaxation_time": source.relaxation_time,
        "domain_polarization": source.domain_polarization,
        "reciprocal_permittivity": source.reciprocal_permittivity,
        "temperature": source.temperature,
        "domain_volume": source.domain_volume,
    }
    return ParametrizedSingle(distribution=distribution, **{**constants, **changes})


def _only(load: Load, above: int, under: int, side: int, **spreads: Any) -> Array:
    """P by quadrature with a number of elements and one spread of 0."""
    return respond(
        shipped(nodes_coercive_above=above, nodes_coercive_below=under, nodes_interaction_side=side, **spreads), load
    ).polarization


def _side_by_side(load: Load, left: Array, right: Array, first: str, second: str, what: str) -> Figure:
    figure = sheet(9.8, 4.5, what)
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    for axis, values, title, colour in zip(axes, (left, right), (first, second), (SLOW, FAST), strict=True):
        curve(axis, load.field, values, colour, linewidth=1.0)
        over_field(axis, POLARIZATION, title)
    axes[1].set(ylabel="", xlabel=FIELD)
    return figure


def _compared(load: Load, left: Array, few: Array, many: Array) -> tuple[Finding, ...]:
    """Left and right alike, and how jagged the right one is; after the first leg, so that the start does not count."""
    after, up = slice(load.ends[0], None), load.leg(2)
    bumps = [_bumps(load.field[up], values[up]) for values in (left, few)]
    return (
        below(
            "both versions produce almost the same loops",
            f"rms difference of P over the span {rms_apart(few[after], left[after]):.2g} %, with six times as many"
            " elements",
            rms_apart(many[after], left[after]),
            5.0,
        ),
        Finding(
            "the quadrature with 32 elements is less smooth",
            f"dP/dE has {bumps[0]} and {bumps[1]} peaks on the ascending major branch: the elements lie about 40 V/mm"
            f" apart, and thermal activation smooths over d = {shipped().thermal_width / 1e3:.0f} V/mm",
            bool(bumps[1] > bumps[0]),
        ),
    )


def _bumps(field: Array, p: Array) -> int:
    """Local maxima of dP/dE that stand out by more than 2 % of the largest one."""
    slope = np.gradient(p, field)
    count, low, rising, least = 0, slope[0], False, 0.02 * float(np.max(slope))
    high = slope[0]
    for value in slope:
        if rising:
            high = max(high, value)
            if value < high - least:
                count, rising, low = count + 1, False, value
        else:
            low = min(low, value)
            if value > low + least:
                rising, high = True, value
    return count


def _starts_at_zero(load: Load, x: Array) -> Finding:
    """Behind every reversal nothing switches until the field has passed 0."""
    moved = []
    for part in load.legs[2:]:
        field, fraction = load.field[part], x[part]
        if field[0] * field[-1] < 0:
            sign = 1.0 if field[-1] > field[0] else -1.0
            moved.append(abs(np.interp(0.0, sign * field, fraction) - fraction[0]))
    return below(
        "the barrier behind a reversal starts from zero",
        "share of domains that switch before the field has passed 0, at most",
        float(100 * max(moved)),
        5.0,
    )


def _one_curve(load: Load, x: Array) -> Finding:
    """Where a leg switches, it does so along the major branch of its direction."""
    worst = 0.0
    for number in range(3, len(load.ends)):
        part = load.leg(number)
        sign = 1.0 if load.field[part][-1] > load.field[part][0] else -1.0
        major = load.leg(2 if sign > 0 else 1)
        on_major = np.interp(sign * load.field[part], sign * load.field[major], x[major])
        expected = np.maximum(on_major, x[part][0]) if sign > 0 else np.minimum(on_major, x[part][0])
        worst = max(worst, float(np.max(np.abs(x[part] - expected))))
    return below(
        "there are no special minor loops: at one x+ the barriers are always the same",
        "every branch keeps its x+ up to the major branch and goes on along it; x+ strays by at most",
        100 * worst,
        5.0,
    )


def _back(load: Load, p: Array) -> float:
    """How far off the shuttle from 0.4 to -0.2 kV/mm closes on the way to 0.8 kV/mm [C/m^2]."""
    return float(abs(np.interp(0.4, load.field[load.leg(10)], p[load.leg(10)]) - p[load.ends[8]]))
