"""The picture of the convergence study."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from pzt_benchmarks.drives import LAYER_THICKNESS, SAMPLE_RATE
from pzt_ros.physics.signals import Array, Signals
from pzt_ros.report.style import Theme

if TYPE_CHECKING:
    from pzt_benchmarks.convergence import Point

MARKERS = ("o", "s", "^", "D")


def draw(points: Sequence[Point], agreement: float, drive: Signals, fraction: Array, theme: Theme, path: Path) -> None:
    """Three panels: the loops, error over domains, error over the time of a sample."""
    with plt.rc_context(theme.settings()):
        figure, (loops, domains, cost) = plt.subplots(
            1, 3, figsize=(11.5, 4.2), gridspec_kw={"width_ratios": [0.85, 1.1, 1.1]}
        )
        loops.plot(drive.voltage / LAYER_THICKNESS / 1e6, fraction, color=theme.ink, linewidth=1.0)
        loops.set(title="The record", xlabel="field, MV/m", ylabel="x+")
        _errors(domains, points, theme, [point.domains for point in points])
        _fine_grids(domains, agreement, theme)
        domains.set(title="Error over the number of domains", xlabel="domains", ylabel="rms error of x+")
        _errors(cost, points, theme, [1e6 * point.seconds for point in points])
        cost.axvline(1e6 / SAMPLE_RATE, color=theme.muted, linewidth=1.0, linestyle=(0, (4, 3)))
        cost.annotate(
            "real time ", (1e6 / SAMPLE_RATE, 0.97), xycoords=("data", "axes fraction"), ha="right", va="top",
            color=theme.muted, fontsize=9,
        )  # fmt: skip
        cost.set(title="Error over its price", xlabel="us a sample (midpoint, one core)")
        cost.sharey(domains)
        cost.tick_params(labelleft=False)
        handles, labels = domains.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        figure.savefig(path, dpi=160)
        plt.close(figure)


def _errors(axes: Axes, points: Sequence[Point], theme: Theme, along: Sequence[float]) -> None:
    rules = list(dict.fromkeys(point.rule for point in points))
    for rule, colour, marker in zip(rules, _colours(theme), MARKERS, strict=True):
        own = [(x, point.rms) for x, point in zip(along, points, strict=True) if point.rule == rule]
        axes.loglog(*zip(*own, strict=True), color=colour, marker=marker, markersize=4.5, label=rule)


def _fine_grids(axes: Axes, agreement: float, theme: Theme) -> None:
    axes.axhline(agreement, color=theme.muted, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.annotate(
        "the two fine grids differ by this at most", (0.02, agreement), xycoords=("axes fraction", "data"),
        xytext=(0, 3), textcoords="offset points", color=theme.muted, fontsize=9,
    )  # fmt: skip


def _colours(theme: Theme) -> list[str]:
    """Lattice, thesis, wider Gauss-Legendre, equal probability."""
    return [theme.colour(name) for name in ("inverse", "open_loop", "pi", "inverse_pi")]
