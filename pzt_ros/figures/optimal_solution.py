"""Figures 4.2 to 4.5 for any problem: an optimal field over time, and over the loops of the ceramic."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pzt_ros.figures.canvas import DASHED, FAST, INK, LADDER, MUTED, POLARIZATION, SLOW, curve, over_field, sheet
from pzt_ros.figures.loads import ramps, respond
from pzt_ros.optimal.solution import Solution
from pzt_ros.physics.signals import Array

_MS = 1e3
_SAMPLES = 400
_FREQUENCIES = (5.0, 0.5, 1.0 / 2000.0)
"""Of the loops, times the horizon: 1250, 125 and 0.125 Hz for the thesis' 4 ms."""


def over_time(solution: Solution) -> Figure:
    """Phase fraction, polarization, cost so far and field over time (figures 4.2 and 4.4)."""
    problem, found = solution.problem, solution.simulated
    figure = sheet(9.8, 6.6, f"optimal control of {problem.name}, by {solution.solver}")
    (fraction, polarization), (cost, field) = figure.subplots(2, 2, sharex=True)
    time = _MS * found.time
    curve(fraction, time, found.phase_fraction, INK)
    fraction.set(ylabel="phase fraction x₊ [-]", title=f"ends at {found.phase_fraction[-1]:.3f}")
    asked = problem.set_point_at(found.time)
    curve(polarization, time, found.polarization, SLOW, "optimal", linewidth=2.6)
    curve(polarization, time, asked, FAST, "set-point", linestyle=DASHED)
    polarization.set(ylabel=POLARIZATION, title=f"misses the set-point by up to {_miss(found.polarization, asked)}")
    polarization.legend(loc="best")
    curve(cost, time, found.spent, INK)
    cost.set(ylabel="squared miss so far [C² s/m⁴]", xlabel="time [ms]", title=f"cost {found.cost:.3g} C² s/m⁴")
    cost.ticklabel_format(axis="y", style="sci", scilimits=(-2, 2))
    grid = _MS * problem.grid
    curve(field, grid, 1e-6 * solution.field, INK, marker=".", markersize=3)
    _limits(field, solution)
    peak = float(solution.field[np.argmax(np.abs(solution.field))])
    title = f"peak {1e-6 * peak:.3f}, end {1e-6 * solution.field[-1]:.3f} kV/mm"
    field.set(ylabel="electric field [kV/mm]", xlabel="time [ms]", title=title)
    return figure


def over_loops(solution: Solution) -> Figure:
    """The optimum in the plane of field and polarization, among loops at three frequencies (figures 4.3 and 4.5)."""
    problem, found = solution.problem, solution.simulated
    figure = sheet(7.2, 5.6, f"optimal control of {problem.name}, by {solution.solver}")
    axis = figure.subplots()
    amplitude = 1.3e-6 * float(np.max(np.abs(solution.field)))
    for times, colour in zip(_FREQUENCIES, LADDER[5::-2], strict=False):
        frequency = times / problem.horizon
        fields, p = _loop(solution, amplitude, frequency)
        curve(axis, fields, p, colour, f"loop at {frequency:.4g} Hz", linewidth=1.0)
    curve(axis, 1e-6 * found.field, found.polarization, INK, "optimal", linewidth=2.0)
    axis.plot(1e-6 * found.field[0], found.polarization[0], "o", color=INK, ms=5)
    axis.plot(1e-6 * found.field[-1], found.polarization[-1], "s", color=INK, ms=6)
    over_field(axis, POLARIZATION, "from the dot to the square")
    axis.legend(loc="best")
    return figure


def _loop(solution: Solution, amplitude: float, frequency: float) -> tuple[Array, Array]:
    """A triangle from its second turn on, so that it is closed: field [kV/mm] and P [C/m^2]."""
    turns = [amplitude, -amplitude, amplitude, -amplitude]
    load = ramps(turns, _SAMPLES, 4.0 * amplitude * frequency)
    p = respond(solution.problem.ceramic, load).polarization
    cycle = slice(load.ends[1], None)
    return load.field[cycle], p[cycle]


def _limits(axis: Axes, solution: Solution) -> None:
    """Lines at the limits of the field where it comes near them."""
    problem = solution.problem
    low, high = float(np.min(solution.field)), float(np.max(solution.field))
    for limit, nearest in ((problem.field_min, low), (problem.field_max, high)):
        if abs(nearest - limit) < 0.25 * (high - low):
            axis.axhline(1e-6 * limit, color=MUTED, lw=0.9, ls=(0, (1, 1.5)), zorder=1)


def _miss(found: Array, asked: Array) -> str:
    return f"{np.max(np.abs(found - asked)):.2g} C/m²"
