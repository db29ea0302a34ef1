"""Figures 3.6, 3.7 and 3.22: loops of the polycrystal by quadrature."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
from scipy import optimize, special

from pzt_ros.chains import load_chain
from pzt_ros.figures.canvas import (
    FAST,
    FIELD,
    INK,
    LADDER,
    POLARIZATION,
    SHADE,
    SLOW,
    THIRD,
    curve,
    legend_below,
    over_field,
    sheet,
)
from pzt_ros.figures.loads import NESTED_LOOPS, Load, ramps, respond
from pzt_ros.figures.thesis_figure import Drawing, Finding, below
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.signals import Array, Signals

_least_squares: Any = optimize.least_squares  # SciPy carries no types

SPREADS = (1e10, 1e11, 1e12)
"""b_1 and b_2 of figure 3.7 [V^2/m^2]."""

_GROWING = (0.6, -0.6, 0.6, -1.0, 1.0)
"""Before the other loops in figure 3.6: from the virgin state, so that they are symmetric."""

_PARTS = {
    "major loop, and on to it": (SHADE, (5, 6, 7, 8, 12, 13, 19, 20, 26, 27, 31, 32, 33)),
    "symmetric, from the virgin state": (SLOW, (0, 1, 2, 3, 4)),
    "biased, and shuttles that close": (FAST, (14, 15, 16, 17, 18, 21, 22, 23, 24, 25)),
    "nested": (THIRD, (9, 10, 11, 28, 29, 30)),
}
"""Legs of _GROWING and NESTED_LOOPS, in the order of drawing."""

_LOAD_NOTE = "The thesis does not print its loads; ours have the loops that it names, at its 10 kV/mm/s."


def shipped(chain: str = "thesis-q1", **changes: Any) -> Quadrature:
    """The quadrature of a shipped chain, with some parameters replaced."""
    link = next(link for link in load_chain(chain).links if isinstance(link, Quadrature))
    return dataclasses.replace(link, **changes)


def representative(samples: int) -> Drawing:
    """Figure 3.6."""
    load = ramps(_GROWING + NESTED_LOOPS, samples)
    out = respond(shipped(), load)
    figure = sheet(6.6, 5.0, "quadrature model, 16 x 16 domains, chain thesis-q1")
    axis = figure.subplots()
    for name, (colour, legs) in _PARTS.items():
        for number, leg in enumerate(legs):
            part = load.leg(leg)
            curve(axis, load.field[part], out.polarization[part], colour, "" if number else name, linewidth=1.2)
    over_field(axis, POLARIZATION)
    legend_below(figure, axis, columns=2)
    return Drawing(figure, _loop_findings(load, out.polarization), f"{_LOAD_NOTE} 293 K is assumed.")


def _loop_findings(load: Load, p: Array) -> tuple[Finding, ...]:
    """Symmetry and closure, at the turns of _GROWING and NESTED_LOOPS."""
    span = float(np.ptp(p))
    turns = np.array([p[end] for end in load.ends])
    symmetric = abs(turns[2] + turns[1])  # 0.6 after -0.6 kV/mm
    low, high, shuttle, onwards = (len(_GROWING) + place for place in (19, 20, 8, 10))
    biased = abs(turns[low] + turns[high])  # -1.2 to -0.5 kV/mm
    way = load.leg(onwards)  # from -0.2 to 0.8 kV/mm, past the 0.4 where the shuttle began
    off = abs(np.interp(0.4, load.field[way], p[way]) - turns[shuttle])
    return (
        below(
            "symmetric minor loops without bias",
            "sum of P at -0.6 and 0.6 kV/mm over the span",
            100 * symmetric / span,
            2.0,
        ),
        Finding(
            "biased, asymmetric minor loops",
            f"the loop from -1.2 to -0.5 kV/mm lies between {turns[low]:.3f} and {turns[high]:.3f} C/m²",
            bool(biased > 0.1 * span),
        ),
        below(
            "minor loops close",
            "how far P is off, back at 0.4 kV/mm after the loop to -0.2 kV/mm, over the span",
            float(100 * off / span),
            2.0,
        ),
    )


@cache
def _grid(samples: int) -> tuple[Load, dict[tuple[float, float], Signals]]:
    load = ramps(NESTED_LOOPS, samples)
    pairs = [(b1, b2) for b2 in SPREADS for b1 in SPREADS]
    return load, {
        (b1, b2): respond(shipped(coercive_field_spread=b1, interaction_field_spread=b2), load) for b1, b2 in pairs
    }


def nine(samples: int) -> Drawing:
    """Figure 3.7."""
    load, found = _grid(samples)
    figure = sheet(9.6, 8.2, "quadrature model, 16 x 16 domains")
    axes = figure.subplots(3, 3, sharex=True, sharey=True)
    for row, b2 in zip(axes, SPREADS, strict=True):
        for axis, b1 in zip(row, SPREADS, strict=True):
            curve(axis, load.field, found[b1, b2].polarization, SLOW, linewidth=0.9)
            axis.set_title(f"b₁ {_power(b1)}, b₂ {_power(b2)} V²/m²", fontsize=9)
    for axis in axes[-1]:
        axis.set_xlabel(FIELD)
    for axis in axes[:, 0]:
        axis.set_ylabel(POLARIZATION)
    narrow, wide = SPREADS[0], SPREADS[-1]
    early = {key: 100 * early_share(load, out.phase_fraction) for key, out in found.items()}
    inside = {key: 100 * inner_share(load, out.phase_fraction) for key, out in found.items()}
    rise = [_rise(load, found, *pair) for pair in ((narrow, narrow), (wide, narrow), (narrow, wide))]
    findings = (
        below(
            "top row, narrow E_e: very little switches before the field passes 0",
            f"with b₁ from narrow to wide {', '.join(f'{early[b1, narrow]:.2g}' for b1 in SPREADS)} % of the domains,"
            f" in the bottom row {', '.join(f'{early[b1, wide]:.2g}' for b1 in SPREADS)} %; largest of the top row",
            max(early[b1, narrow] for b1 in SPREADS),
            5.0,
        ),
        Finding(
            "left column, narrow E_c: minor loops almost never switch before they reach the major loop",
            f"up to a thermal width before it switch, from top to bottom, {_column(inside, narrow)} % of the domains in"
            f" the left and {_column(inside, wide)} % in the right column; taken as agreeing below 5 %",
            bool(max(inside[narrow, b2] for b2 in SPREADS) < 5.0),
        ),
        Finding(
            "a flat distribution of either makes the major loop gradual",
            f"the middle half of it switches over {rise[0]:.2f} kV/mm with both narrow, {rise[1]:.2f} with b₁ wide and"
            f" {rise[2]:.2f} with b₂ wide",
            bool(min(rise[1:]) > 3 * rise[0]),
        ),
    )
    return Drawing(figure, findings, _LOAD_NOTE)


def _column(shares: dict[tuple[float, float], float], b1: float) -> str:
    return ", ".join(f"{shares[b1, b2]:.2g}" for b2 in SPREADS)


def _power(value: float) -> str:
    return f"1e{round(np.log10(value))}"


def early_share(load: Load, x: Array) -> float:
    """The share of the domains that switch on the way from saturation down to field 0 [-]."""
    down = load.leg(1)  # from 2 to -2 kV/mm
    return float(x[down.start] - np.interp(0.0, -load.field[down], x[down]))


def inner_share(load: Load, x: Array) -> float:
    """The largest share of domains that switch on a leg inside the major loop [-].

    A leg meets it at the field at which the major branch of its direction has the x that the leg started from. The last
    thermal width before it does not count: over that every corner is rounded.
    """
    shares, width = [0.0], shipped().thermal_width / 1e6
    for number in range(3, len(load.ends) - 2):
        part = load.leg(number)
        field, fraction = load.field[part], x[part]
        sign = 1.0 if field[-1] > field[0] else -1.0
        major = load.leg(2 if sign > 0 else 1)
        meets = np.interp(sign * fraction[0], sign * x[major], load.field[major])
        shares.append(sign * float(np.interp(sign * meets - width, sign * field, fraction) - fraction[0]))
    return float(max(shares))


def _rise(load: Load, found: dict[tuple[float, float], Signals], b1: float, b2: float) -> float:
    """Over which field the middle half of the ascending major branch switches [kV/mm]."""
    up, x = load.leg(2), found[b1, b2].phase_fraction
    low, high = np.interp((0.25, 0.75), x[up], load.field[up])
    return float(high - low)


_REVERSALS = (-0.3, -0.5, -0.7, -0.9, -1.2)


def family(samples: int) -> Drawing:
    """Figure 3.22."""
    turns = [2.0, -2.0, 2.0]
    for reversal in _REVERSALS:
        turns += [reversal, 2.0]
    load = ramps(turns, samples)
    out = respond(shipped(), load)
    figure = sheet(7.0, 5.4, "quadrature model, 16 x 16 domains, chain thesis-q1")
    axis = figure.subplots()
    for leg in (1, 2):
        curve(axis, load.field[load.leg(leg)], out.polarization[load.leg(leg)], INK, "major loop" if leg == 1 else "")
    for number, (reversal, colour) in enumerate(zip(_REVERSALS, LADDER, strict=False)):
        part = load.leg(4 + 2 * number)
        curve(axis, load.field[part], out.polarization[part], colour, f"from {reversal:g}")
    over_field(axis, POLARIZATION)
    legend_below(figure, axis, "ascending branches [kV/mm]", 3)
    return Drawing(
        figure, _shape_findings(load, out.phase_fraction), "Parameters of figure 3.6; the thesis prints none for it."
    )


def _shape_findings(load: Load, x: Array) -> tuple[Finding, ...]:
    """Equation 3.34 put through the major branch, and the same function scaled to the minor ones (3.35)."""
    major = load.leg(2)
    field, fraction = load.field[major], x[major]

    def off(values: Array) -> Array:
        return scaled_shape(field, fraction, values[0], values[1]) - fraction

    fitted = _least_squares(off, (0.6, 1.3), bounds=((0.05, 0.1), (3.0, 10.0)))
    barrier, shape = fitted.x
    misses = []
    for number in range(len(_REVERSALS)):
        part = load.leg(4 + 2 * number)
        minor = scaled_shape(load.field[part], x[part], barrier, shape) - x[part]
        misses.append(100 * np.sqrt(np.mean(minor**2)) / np.ptp(x[part]))
    return (
        below(
            "the major loop resembles an inverse complementary error function",
            f"3.34 fits it with B_e = {barrier:.2f} kV/mm, s = {shape:.2f}; rms error in x+",
            float(100 * np.sqrt(np.mean(fitted.fun**2))),
            2.0,
        ),
        below(
            "minor loops have very similar shapes: the same function, scaled between reversal points",
            f"same B_e and s: rms error over each one's range {', '.join(f'{miss:.1f}' for miss in misses)} %; largest",
            float(max(misses)),
            10.0,
        ),
    )


def scaled_shape(field: Array, fraction: Array, barrier: float, shape: float) -> Array:
    """x+ of 3.34 solved for x, between the first and the last point of an ascending branch (3.35) [-]."""
    passed = special.erfc(-(field / barrier - 1) / shape)
    share = (passed - passed[0]) / (passed[-1] - passed[0])
    return fraction[0] + (fraction[-1] - fraction[0]) * share
