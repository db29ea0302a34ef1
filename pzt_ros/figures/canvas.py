"""How the figures are drawn: sheets, curves, loops, and colours that exist once for light and once for dark ground."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from pzt_ros.physics.signals import Array
from pzt_ros.report.style import DARK, LIGHT

FIELD, POLARIZATION, STRAIN = "electric field [kV/mm]", "polarization [C/m²]", "strain [%]"
TIME, CURRENT, HOLD_TIME = "time [s]", "current [mA]", "time at constant field [s]"

INK, MUTED, SHADE = LIGHT.ink, LIGHT.muted, LIGHT.shade
SLOW, FAST = LIGHT.controllers["pi"], LIGHT.controllers["open_loop"]
THIRD = LIGHT.controllers["inverse"]
DASHED = (0, (4, 2))

_PLASMA = matplotlib.colormaps["plasma"]
LADDER = tuple(to_hex(_PLASMA(place)) for place in (0.0, 0.2, 0.38, 0.54, 0.69, 0.82))
"""Colours of a family in the order of its parameter; they differ in lightness, so every eye can order them."""

_DARK_LADDER = tuple(to_hex(_PLASMA(place)) for place in (0.28, 0.42, 0.55, 0.68, 0.83, 0.97))
_PARTS = ("ground", "ink", "muted", "grid", "shade")
_DARK_OF = {
    **{getattr(LIGHT, part): getattr(DARK, part) for part in _PARTS},
    **{LIGHT.controllers[name]: DARK.controllers[name] for name in LIGHT.controllers},
    **dict(zip(LADDER, _DARK_LADDER, strict=True)),
}


def for_dark_ground(svg: str) -> str:
    """The same SVG in the colours of the dark theme."""
    return re.sub(r"#[0-9a-f]{6}\b", lambda found: _DARK_OF.get(found[0], found[0]), svg)


def sheet(width: float, height: float, source: str) -> Figure:
    """A new figure [inches] that says of itself that it was simulated, and by which model."""
    figure = Figure(figsize=(width, height), dpi=110)
    figure.suptitle(f"SIMULATED  ·  {source}", x=0.995, ha="right", fontsize=8.5, color=MUTED)
    return figure


def curve(axis: Axes, x: Array, y: Array, colour: str = INK, label: str = "", **style: Any) -> None:
    """A line; the sheets' default width unless told otherwise."""
    axis.plot(x, y, color=colour, label=label or None, **{"linewidth": 1.3, **style})


def over_field(axis: Axes, what: str, title: str = "") -> None:
    """Label an axis whose abscissa is the field."""
    axis.set(xlabel=FIELD, ylabel=what, title=title)


def legend_below(figure: Figure, axis: Axes, title: str = "", columns: int = 6) -> None:
    """One legend for all panels, off the data."""
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(columns, len(labels)), title=title or None,
                  title_fontsize=9, columnspacing=1.6, handlelength=1.6)  # fmt: skip


def same_limits(axes: Sequence[Axes]) -> None:
    """One range of the ordinate for all."""
    low = min(axis.get_ylim()[0] for axis in axes)
    high = max(axis.get_ylim()[1] for axis in axes)
    for axis in axes:
        axis.set_ylim(low, high)
