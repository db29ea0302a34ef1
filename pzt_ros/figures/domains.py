"""Figures 3.18 to 3.21: a minor loop, and which domains have switched on its way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap

from pzt_ros.figures.canvas import FAST, INK, MUTED, POLARIZATION, SHADE, SLOW, curve, legend_below, over_field, sheet
from pzt_ros.figures.loads import Load, ramps
from pzt_ros.figures.polycrystal import shipped
from pzt_ros.figures.thesis_figure import Drawing, Finding, below
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.polycrystal_kernel import HEAD
from pzt_ros.physics.signals import Array, Rest, Signals

_POINTS = (-2.0, 0.0, -1.0)
"""Fields at the points (1), (2) and (3) [kV/mm]."""

_SATURATION = -4.0  # [kV/mm]; from the virgin state a drive to point (1) alone would leave some domains up

_NOTE = (
    "Parameters of figure 3.6, on a fine lattice of domains; the thesis prints none for it. Before point (1) the"
    f" specimen was saturated at {_SATURATION:g} kV/mm, which is not drawn."
)


@dataclass(frozen=True, eq=False)
class States:
    """The drive through points (1), (2) and (3), and the domains there.

    Attributes:
        load: to saturation, to points (1), (2) and (3), then the major loop: leg k ends at point (k).
        polarization: along it [C/m^2].
        coercive, interaction: fields of the domains [kV/mm], shapes (m,), (n,).
        density: of the domains, shape (m, n), its sum 1.
        fraction: x+ of every domain at the three points, shape (3, m, n).
    """

    load: Load
    polarization: Array
    coercive: Array
    interaction: Array
    density: Array
    fraction: Array

    def up(self, point: int) -> Array:
        """x+ of every domain at point (1), (2) or (3) [-]."""
        found: Array = self.fraction[point - 1]
        return found

    def share(self, point: int) -> float:
        """x+ of all domains at a point [-]."""
        return float(np.sum(self.density * self.up(point)))


@cache
def states(samples: int) -> States:
    """Run through the points, and once around the major loop."""
    source = shipped()
    names = ("coercive_field", "coercive_field_spread", "interaction_field_spread", "relaxation_time",
             "domain_polarization", "reciprocal_permittivity", "temperature", "domain_volume")  # fmt: skip
    spacing = 0.5 if samples >= 100 else 1.5  # thermal widths; coarse drives get a coarse lattice
    lattice = Lattice(**{name: getattr(source, name) for name in names}, spacing=spacing)
    (coercive, rows), (interaction, columns) = lattice.nodes()
    load = ramps([_SATURATION, *_POINTS, -2.0, 2.0, -2.0], samples)
    state, polarization, fraction = lattice.init(Rest()), [], []
    for part in load.legs:
        block = slice(part.start + 1, part.stop)
        voltage = 1e6 * load.field[block] * lattice.layer_thickness
        state, out = lattice.step(state, Signals(time=load.time[block], voltage=voltage))
        polarization.append(out.polarization)
        fraction.append(state[HEAD:].reshape(rows.size, columns.size))
    first = np.array([polarization[0][0]])
    return States(
        load, np.concatenate([first, *polarization]), coercive / 1e6, interaction / 1e6, np.outer(rows, columns),
        np.array(fraction[1:4]),
    )  # fmt: skip


def minor_loop(samples: int) -> Drawing:
    """Figure 3.18."""
    found = states(samples)
    load, p = found.load, found.polarization
    figure = sheet(6.6, 5.0, "polycrystal on a lattice, parameters of figure 3.6")
    axis = figure.subplots()
    for leg, label in ((5, "major loop"), (6, "")):
        curve(axis, load.field[load.leg(leg)], p[load.leg(leg)], SHADE, label)
    own = slice(load.leg(2).start, load.leg(3).stop)
    curve(axis, load.field[own], p[own], SLOW, "(1) to (2) to (3)", linewidth=2.0)
    for number, shift in ((1, (-3, 11)), (2, (9, -12)), (3, (-6, 10))):
        at = (load.field[load.ends[number]], p[load.ends[number]])
        axis.plot(*at, "o", color=FAST, ms=7)
        axis.annotate(f"({number})", at, xytext=shift, textcoords="offset points", weight="bold")
    over_field(axis, POLARIZATION)
    axis.legend(loc="upper left")
    return Drawing(figure, (_starts_down(found), _inside(found)), _NOTE)


def _starts_down(found: States) -> Finding:
    return below("at (1) all domains are down, x+ = 0", "x+ is", 100 * found.share(1), 1.0)


def _inside(found: States) -> Finding:
    """The minor loop stays within the major one."""
    load, p = found.load, found.polarization
    back, outer = load.leg(3), load.leg(6)
    gap = np.interp(-load.field[back], -load.field[outer], p[outer]) - p[back]
    return Finding(
        "the minor loop lies within the major one",
        f"on the way back to (3) P is {gap.min():.3f} to {gap.max():.3f} C/m² below the major branch",
        bool(gap.min() > 0),
    )


def at_point(number: int) -> Callable[[int], Drawing]:
    """How figures 3.19, 3.20 and 3.21 are drawn: the domains at points (1), (2) and (3)."""
    return lambda samples: _surfaces(states(samples), number)


def _surfaces(found: States, number: int) -> Drawing:
    up, share = found.up(number), found.share(number)
    figure = sheet(9.4, 4.6, f"domains at point ({number}), E = {_POINTS[number - 1]:g} kV/mm")
    axes = figure.subplots(1, 2, sharey=True)
    _map(axes[0], found, found.density * up, f"up: x₊ = {share:.3f}")
    _map(axes[1], found, found.density * (1 - up), f"down: x₋ = {1 - share:.3f}")
    axes[1].set_ylabel("")
    findings: tuple[Finding, ...] = (_starts_down(found),) if number == 1 else (_plane_finding(found, number),)
    for axis in axes if number > 1 else ():
        _plane(axis, edge(found, 2), 1.0, "from (1) to (2)")
        if number == 3:
            _plane(axis, edge(found, 3), -1.0, "from (2) to (3)")
    if number > 1:
        legend_below(figure, axes[0])
    if number == 3:
        findings = (*findings, _perpendicular(found))
    return Drawing(figure, findings, f"{_NOTE} {_FROM_ABOVE}")


_FROM_ABOVE = (
    "The thesis draws surfaces in space; here they are seen from above. Colour is the density of domains, the thin"
    " lines are that of all domains at a half and a twentieth of its peak."
)
_DENSITY = LinearSegmentedColormap.from_list("density", [(0.0, 0.447, 0.698, 0.0), (0.0, 0.447, 0.698, 1.0)])
"""From nothing to blue, so that the ground shows through whatever its colour."""

_TOP = 2.1  # of the drawing [kV/mm]


def _map(axis: Axes, found: States, values: Array, title: str) -> None:
    half = 0.5 * (found.coercive[1] - found.coercive[0])
    reach = (
        found.interaction[0] - half,
        found.interaction[-1] + half,
        found.coercive[0] - half,
        found.coercive[-1] + half,
    )
    axis.grid(False)
    axis.imshow(
        values,
        cmap=_DENSITY,
        vmin=0.0,
        vmax=float(found.density.max()),
        extent=reach,
        origin="lower",
        aspect="auto",
        interpolation="bilinear",
    )
    source = shipped()
    e_c = np.linspace(0.0, _TOP, 200)
    outline = np.outer(source.coercive.at(1e6 * e_c), source.interaction.at(1e6 * found.interaction))
    axis.contour(found.interaction, e_c, outline / outline.max(), levels=(0.05, 0.5), colors=MUTED, linewidths=0.6)
    axis.set(xlim=(-1.8, 1.8), ylim=(0.0, _TOP), xlabel="interaction field $E_e$ [kV/mm]", title=title)
    axis.set_ylabel("coercive field $E_c$ [kV/mm]")


def _plane(axis: Axes, at: tuple[Array, Array], sign: float, way: str) -> None:
    """The line B_e = sign E_c - E_e through an edge."""
    barrier = float(np.median(sign * at[0] - at[1]))
    e_c = np.array([0.0, _TOP])
    colour, style = (FAST, "-") if sign > 0 else (INK, (0, (4, 2)))
    law = "$B_e = E_c - E_e$" if sign > 0 else "$B_e = -E_c - E_e$"
    label = f"plane {way}: {law} = {barrier:.2f} kV/mm"
    curve(axis, sign * e_c - barrier, e_c, colour, label, linestyle=style, linewidth=1.6)


def edge(found: States, point: int) -> tuple[Array, Array]:
    """E_c and E_e where half of the domains have switched on the last leg to point (2) or (3) [kV/mm].

    Domains of low E_c are left out: within about the thermal width of 0 they flip to and fro. At point (3) those of
    high E_c are not reached yet and still have the edge of point (2).
    """
    met = []
    for e_c, fraction in zip(found.coercive, found.up(point), strict=True):
        place = int(np.argmax(fraction > 0.5))
        if place > 0:
            share = (0.5 - fraction[place - 1]) / (fraction[place] - fraction[place - 1])
            step = found.interaction[place] - found.interaction[place - 1]
            met.append((e_c, found.interaction[place - 1] + share * step))
    e_c, e_e = np.array(met).T
    last = 0.35 if point == 3 else 1.5
    chosen = (e_c > 0.1) & (e_c < last)
    return e_c[chosen], e_e[chosen]


def _plane_finding(found: States, number: int) -> Finding:
    sign = 1.0 if number == 2 else -1.0
    e_c, e_e = edge(found, number)
    barriers = sign * e_c - e_e
    return below(
        f"domains that switch together lie in one plane, B_e = {'E_c - E_e' if sign > 0 else '-E_c - E_e'}",
        f"for E_c from {e_c.min():.2f} to {e_c.max():.2f} kV/mm the edge is at B_e = {np.median(barriers):.3f} kV/mm;"
        " it strays by at most",
        float(np.max(np.abs(barriers - np.median(barriers)))),
        0.05,
        "kV/mm",
    )


def _perpendicular(found: States) -> Finding:
    slopes = [float(np.polyfit(*edge(found, point), 1)[0]) for point in (2, 3)]
    return Finding(
        "the plane of the way back is perpendicular to the first",
        f"slopes of the edges E_e over E_c {slopes[0]:.3f} and {slopes[1]:.3f}, product {slopes[0] * slopes[1]:.3f};"
        " taken as agreeing within 5 % of -1",
        bool(abs(slopes[0] * slopes[1] + 1) < 0.05),
    )
