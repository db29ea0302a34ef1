"""`python -m pzt_benchmarks.convergence`: how many domains the polycrystal needs, by which rule; page and picture.

Every rule replaces the same densities (thesis figure 3.6) by more and more domains; the error is that of x+ over a
record of loops with minor loops, against two fine grids that have nothing in common: a lattice, and Gauss-Legendre
nodes to 6 sigma. Of the two deviations the larger counts. Time is integrated so finely (accuracy 1e-8) that only the
domains make a difference.
"""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pzt_benchmarks.convergence_figure import draw
from pzt_benchmarks.drives import NESTED_LEGS, ramps, sampled_ramps, turning_times
from pzt_benchmarks.report import Provenance, provenance
from pzt_benchmarks.stopwatch import best, one_core
from pzt_benchmarks.table import Table
from pzt_ros.physics.density import Density, Nodes, gauss_legendre
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.polycrystal_kernel import HEAD
from pzt_ros.physics.quadrature import Quadrature
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.report.style import THEMES

RATE = 1e7
"""[V/m/s]"""

SAMPLES = 400
ACCURACY = 1e-8
COUNTS = (4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)
"""Nodes along an axis."""

SPACINGS = (3.0, 2.3, 1.8, 1.44, 1.15, 0.9, 0.7, 0.5, 0.4, 0.3, 0.25)
"""Of the lattice, over the thermal width."""

LATTICE, THESIS, WIDE, EQUAL = (
    "lattice",
    "Gauss-Legendre to 3 sigma (thesis)",
    "Gauss-Legendre to 5 sigma",
    "equal probability",
)


class WideLegendre(Quadrature):
    """Gauss-Legendre nodes, split at the peak as the thesis does, but cut farther out."""

    cut = 5.0

    def nodes(self) -> tuple[Nodes, Nodes]:
        """As many nodes as the quadrature asks for, weights that sum to 1."""
        below, above, side = (
            int(count) for count in (self.nodes_coercive_below, self.nodes_coercive_above, self.nodes_interaction_side)
        )
        return self._legendre(self.coercive, below, above), self._legendre(self.interaction, side, side)

    def _legendre(self, density: Density, below: int, above: int) -> Nodes:
        fields, weights = gauss_legendre(density, below, above, cut=self.cut)
        return fields, weights / weights.sum()


class FineLegendre(WideLegendre):
    """One of the two fine grids."""

    cut = 6.0


def counted(kind: type[Quadrature], count: int, rule: str = "thesis") -> Quadrature:
    """A quadrature with `count` nodes along an axis, shared out as the thesis' 16: 6 below the peak, 10 above."""
    below = round(count * 6 / 16)
    return kind(
        nodes_coercive_below=below,
        nodes_coercive_above=count - below,
        nodes_interaction_side=count / 2,
        rule=rule,
        accuracy=ACCURACY,
    )


FINE: tuple[Polycrystal, ...] = (Lattice(spacing=0.16, cut=6.0, accuracy=ACCURACY), counted(FineLegendre, 288))
"""The two references; they share neither nodes nor weights nor where they cut."""


def models() -> dict[str, list[Polycrystal]]:
    """Every rule with a rising number of domains."""
    return {
        LATTICE: [Lattice(spacing=spacing, accuracy=ACCURACY) for spacing in SPACINGS],
        THESIS: [counted(Quadrature, count) for count in COUNTS],
        WIDE: [counted(WideLegendre, count) for count in COUNTS],
        EQUAL: [counted(Quadrature, count, "equal_probability") for count in COUNTS],
    }


@dataclass(frozen=True)
class Point:
    """One rule with one number of domains: its error in x+ [-], and the time of a sample at 20 kHz [s]."""

    rule: str
    grid: str
    domains: int
    rms: float
    largest: float
    seconds: float

    def row(self) -> tuple[str, ...]:
        """One row of the table."""
        return (
            self.rule,
            self.grid,
            f"{self.domains:,}",
            f"{self.rms:.1e}",
            f"{self.largest:.1e}",
            f"{1e6 * self.seconds:.2f}",
        )


def record() -> Signals:
    """The drive, with all its turning points."""
    turns = turning_times(NESTED_LEGS, RATE)
    return ramps(NESTED_LEGS, RATE, np.union1d(np.linspace(0.0, turns[-1], SAMPLES)[1:], turns[1:]))


def fraction(model: Polycrystal, signals: Signals) -> Array:
    """x+ over a record, from the virgin state."""
    return model.step(model.init(Rest()), signals)[1].phase_fraction


def _grid(model: Polycrystal) -> str:
    coercive, interaction = (nodes[0].size for nodes in model.nodes())
    return f"{coercive} x {interaction}"


def study(tell: Callable[[str], None]) -> tuple[list[Point], float, Array]:
    """All points; the largest deviation between the two fine grids; and x+ of the finest."""
    signals, timing = record(), sampled_ramps(RATE, samples=1000)
    tell("the two fine grids")
    exact = [fraction(model, signals) for model in FINE]
    points = []
    for rule, family in models().items():
        for model in family:
            tell(f"{rule}, {_grid(model)}")
            found = fraction(model, signals)
            deviations = [np.abs(found - reference) for reference in exact]
            rms = max(float(np.sqrt(np.mean(deviation**2))) for deviation in deviations)
            quick = replace(model, method="midpoint", accuracy=1e-6)
            start = quick.init(Rest())
            seconds = best(functools.partial(quick.step, start, timing), 5) / timing.time.size
            largest = max(float(np.max(deviation)) for deviation in deviations)
            points.append(Point(rule, _grid(model), start.size - HEAD, rms, largest, seconds))
    return points, float(np.max(np.abs(exact[0] - exact[1]))), exact[0]


def page(origin: Provenance, points: list[Point], agreement: float) -> str:
    """The page; every number in its text is taken from the points."""
    fine = " and ".join(_grid(model) for model in FINE)
    half = points[SPACINGS.index(0.5)]
    thesis, equal = ([p for p in points if p.rule == rule] for rule in (THESIS, EQUAL))
    sixteen = COUNTS.index(16)
    few = best_up_to(points, EQUAL)
    text = f"""# How many domains

{origin.line()}

<picture>
  <source media="(prefers-color-scheme: dark)" srcset="images/convergence-dark.png">
  <img alt="Error of x+ over the number of domains and over the time of a sample" src="images/convergence.png">
</picture>

The same densities (thesis figure 3.6: b1 = b2 = 5e11 V²/m², d = {1e-3 * Lattice().thermal_width:.0f} kV/m) replaced by
more and more domains and driven through twenty legs with minor loops at 10 MV/m/s. The error is that of x+ against
two fine grids which share neither nodes nor weights: a lattice and Gauss-Legendre to 6 sigma, {fine}.
They agree to {agreement:.1e} in x+ at every sample; of the deviations from the two the larger counts. The time of a
sample is that of the midpoint rule at 20 kHz.

- The thesis' 16 x 16 nodes are off by {thesis[sixteen].rms:.1e} rms ({thesis[sixteen].largest:.1e} at most). More of
  them do not get below {min(p.rms for p in thesis):.1e}: that is what lies beyond 3 sigma.
- Equally probable nodes are the best of few: up to {few} of them; 16 x 16 are off by {equal[sixteen].rms:.1e} rms.
- The lattice with a spacing of d/2 is off by {half.rms:.1e} rms ({half.largest:.1e} at most). Its
  {half.domains:,} domains take {1e6 * half.seconds:.1f} us a sample: domains on a diagonal share rates, and few move.

"""
    heads = ("rule", "nodes", "domains", "rms error", "largest error", "us a sample")
    return text + Table("All points", heads, [point.row() for point in points]).markdown()


def best_up_to(points: list[Point], rule: str) -> str:
    """The largest grid of a rule up to which it has the least error of the rules with the same grids."""
    grids = [point for point in points if point.rule == rule]
    good = "none"
    for point in grids:
        if any(other.rms < point.rms for other in points if other.grid == point.grid):
            break
        good = point.grid
    return good


def main() -> None:
    """Run the study; write `convergence.md` and the pictures into a folder."""
    from rich.console import Console

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder for the page and its images/")
    out: Path = parser.parse_args().out
    origin = provenance("make convergence")
    (out / "images").mkdir(parents=True, exist_ok=True)
    with Console(stderr=True).status("convergence") as status, one_core():
        points, agreement, exact = study(status.update)
    for theme in THEMES:
        name = "convergence.png" if theme.name == "light" else f"convergence-{theme.name}.png"
        draw(points, agreement, record(), exact, theme, out / "images" / name)
    (out / "convergence.md").write_text(page(origin, points, agreement), encoding="utf-8")


if __name__ == "__main__":
    main()
