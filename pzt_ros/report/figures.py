"""The figures of a run, in µm, nm, V and mA. Each draws onto a new figure in the colours of a theme."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pzt_ros.experiments.phases import Scan
from pzt_ros.physics.signals import Array
from pzt_ros.report.rundata import RunData
from pzt_ros.report.style import Theme
from pzt_ros.report.tracking import PhaseTracking, Stretch

POINTS = 3000
"""Curves are thinned to about twice this many points; a figure has fewer pixels."""


VOLTAGE_LABEL = "voltage across the ceramic [V]"


@dataclass(frozen=True)
class Picture:
    """What a figure is drawn from.

    Attributes:
        data: the run.
        rows: the phases to compare, each with its label.
        theme: colours.
    """

    data: RunData
    rows: Sequence[tuple[str, PhaseTracking]]
    theme: Theme

    def colour(self, row: PhaseTracking) -> str:
        """Of the controller of a phase."""
        return self.theme.colour(row.stretch.controller)

    @property
    def judged(self) -> str:
        """What the displacement is, for an axis."""
        return "displacement" if "truth" in self.data.displacements else "measured displacement"


def overview(picture: Picture) -> Figure:
    """One picture of the run: the loop closed, the error over a cycle, the error in numbers."""
    figure = _figure(picture, 12.6, 4.3)
    loop, error, bars = figure.subplots(1, 3, width_ratios=(1.0, 1.25, 1.0))
    _loop_over_reference(loop, picture, opposites(picture.rows))
    loop.legend(loc="upper left")
    loop.set_title("Displacement over reference")
    for label, row in picture.rows:
        part = last_cycle(row.stretch, picture.data)
        time, difference = picture.data.time[part], (picture.data.reference - picture.data.displacement)[part]
        _line(error, 1e3 * (time - time[0]), 1e9 * difference, picture.colour(row), label)
    what = "cycle" if isinstance(picture.rows[0][1].stretch.phase, Scan) else "phase"
    error.set(title=f"Tracking error over one {what}", xlabel=f"time in the {what} [ms]", ylabel="error [nm]")
    error.set_xlim(
        0.0, 1e3 * max(_length(last_cycle(row.stretch, picture.data), picture.data) for _, row in picture.rows)
    )
    error.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.16),
        ncols=min(4, len(picture.rows)),
        columnspacing=1.1,
        handlelength=1.3,
    )
    _error_dots(bars, picture)
    return figure


def loops(picture: Picture) -> Figure:
    """Displacement over voltage, where hysteresis lives, and over the reference, where it should be gone."""
    data = picture.data
    if not picture.rows:
        figure = _figure(picture, 6.4, 4.8)
        axis = figure.subplots()
        _line(axis, data.voltage, 1e6 * data.displacement, picture.theme.ink, stride=True)
        axis.set(title="Over the voltage", xlabel=VOLTAGE_LABEL, ylabel=f"{picture.judged} [µm]")
        return figure
    figure = _figure(picture, 13.4, 4.8)
    voltage, reference, error = figure.subplots(1, 3)
    for label, row in picture.rows:
        part, colour = last_cycle(row.stretch, data), picture.colour(row)
        _line(voltage, data.voltage[part], 1e6 * data.displacement[part], colour, label, stride=True)
        difference = 1e9 * (data.reference - data.displacement)[part]
        _line(error, 1e6 * data.reference[part], difference, colour, stride=True)
    _loop_over_reference(reference, picture, picture.rows)
    voltage.set(title="Displacement over voltage", xlabel=VOLTAGE_LABEL, ylabel=f"{picture.judged} [µm]")
    reference.set_title("Displacement over reference")
    error.set(title="Error over reference", xlabel="reference [µm]", ylabel="error [nm]")
    handles = voltage.get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=min(6, len(picture.rows)))
    return figure


def tracking(picture: Picture) -> Figure:
    """A column for each phase: what was asked and done, the error on a common scale, the error on its own scale."""
    count = len(picture.rows)
    figure = _figure(picture, max(5.0, 3.15 * count), 6.8)
    axes = figure.subplots(3, count, sharex="col", squeeze=False, height_ratios=(1.25, 1.0, 1.0))
    for column, (label, row) in enumerate(picture.rows):
        _track_column(axes[:, column], picture, label, row)
    for line in axes[:2]:
        _same_limits(line)
    for text, axis in zip(
        (f"{picture.judged} [µm]", "error, common scale [nm]", "error, own scale [nm]"), axes[:, 0], strict=True
    ):
        axis.set_ylabel(text)
    figure.align_ylabels(axes[:, 0])
    return figure


def course(picture: Picture) -> Figure:
    """The whole run: displacement, voltage and current with the amplifier's limits."""
    data, theme = picture.data, picture.theme
    figure = _figure(picture, 11.0, 6.8)
    place, voltage, current = figure.subplots(3, 1, sharex=True, height_ratios=(1.3, 1.0, 0.8))
    if np.any(np.isfinite(data.reference)):
        _line(place, data.time, 1e6 * data.reference, theme.shade, "reference", width=3.6)
    _line(place, data.time, 1e6 * data.displacement, theme.ink, picture.judged, width=1.2)
    place.set_ylabel("displacement [µm]")
    place.legend(loc="upper right", ncols=2, bbox_to_anchor=(1.0, 1.02))
    _headroom(place, 0.24)
    limits = data.scenario.limits
    _line(voltage, data.time, data.voltage, theme.ink)
    _limits(voltage, theme, (limits.voltage_min, limits.voltage_max), "V")
    voltage.set_ylabel("voltage [V]")
    _line(current, data.time, 1e3 * data.current, theme.ink)
    _limits(current, theme, (-1e3 * limits.current, 1e3 * limits.current), "mA")
    current.set(ylabel="current [mA]", xlabel="time of the run [s]")
    _bands((place, voltage, current), picture)
    current.set_xlim(data.time[0], data.time[-1])
    figure.align_ylabels((place, voltage, current))
    return figure


Draw = Callable[[Picture], Figure]

CAPTIONS: dict[str, tuple[Draw, bool, str]] = {
    "overview": (
        overview,
        True,
        "The run in one picture. Left: open loop (or the worst phase) and the best one; dashed is perfect. "
        "Middle: error over the last cycle. Right: the error in numbers, without the first cycle, logarithmic.",
    ),
    "loops": (
        loops,
        False,
        "The last cycle of each phase: the hysteresis a controller has to work against, and what it leaves of it.",
    ),
    "tracking": (
        tracking,
        True,
        "Top: reference (dashed) and displacement. Below: reference minus displacement, first on one scale for all, "
        "then each on its own. Shaded: the first cycle, which is left out of the errors as settling.",
    ),
    "course": (
        course,
        False,
        "The whole run; shaded where a controller is in charge, white where the voltage itself is asked.",
    ),
}
"""Every figure: how it is drawn, whether it needs a phase with a reference, what is written below it."""


def opposites(rows: Sequence[tuple[str, PhaseTracking]]) -> list[tuple[str, PhaseTracking]]:
    """What is best shown side by side: open loop, or else the worst, and the phase with the least RMS error."""
    ordered = sorted(rows, key=lambda item: item[1].judged.rms)
    plain = [item for item in ordered if item[1].stretch.controller == "open_loop"]
    return ordered[:1] if len(ordered) == 1 or plain == ordered[:1] else [(plain or ordered)[-1], ordered[0]]


def last_cycle(stretch: Stretch, data: RunData) -> slice:
    """The samples of the last whole cycle that was recorded of a scan; all of another phase, or of a shorter scan."""
    part = span(stretch.begin, stretch.end, data)
    if not isinstance(stretch.phase, Scan):
        return part
    recorded = part.start + np.flatnonzero(np.isfinite((data.reference - data.displacement)[part]))
    cycle = 1.0 / stretch.phase.frequency
    whole = math.floor((data.time[recorded[-1]] + 1.5 * _step(data) - stretch.begin) / cycle) if recorded.size else 0
    return span(stretch.begin + (whole - 1) * cycle, stretch.begin + whole * cycle, data) if whole else part


def span(begin: float, end: float, data: RunData) -> slice:
    """The samples from `begin` up to, but not including, `end` [s]."""
    half = 0.5 * _step(data)
    first, last = np.searchsorted(data.time, (begin - half, end - half))
    return slice(int(first), int(last))


def thin(x: Array, y: Array) -> tuple[Array, Array]:
    """The least and the largest `y` of each of `POINTS` parts, so that no spike is lost [shape (m,) each]."""
    size = -(-len(y) // POINTS)
    if size <= 2:
        return x, y
    whole = len(y) // size * size
    parts = y[:whole].reshape(-1, size)
    filled = np.where(np.isfinite(parts), parts, np.inf)
    low = np.argmin(filled, axis=1)
    high = np.argmax(np.where(np.isfinite(parts), parts, -np.inf), axis=1)
    places = np.sort(np.stack([low, high], axis=1), axis=1) + size * np.arange(len(parts))[:, None]
    chosen = np.concatenate([places.ravel(), np.arange(whole, len(y))])
    return x[chosen], y[chosen]


def _figure(picture: Picture, width: float, height: float) -> Figure:
    """A new figure [inches] that says of itself whether it was simulated, wherever it may be pasted."""
    figure = Figure(figsize=(width, height), dpi=140)
    kind = "SIMULATED" if picture.data.simulated else "measured"
    text = f"{kind}  ·  scenario {picture.data.name}"
    figure.suptitle(text, x=0.995, ha="right", fontsize=8.5, color=picture.theme.muted)
    return figure


def _step(data: RunData) -> float:
    return 1.0 / data.scenario.sample_rate


def _length(part: slice, data: RunData) -> float:
    """Of a part of the run [s]."""
    return (part.stop - part.start) * _step(data)


def _line(
    axis: Axes,
    x: Array,
    y: Array,
    colour: str,
    label: str = "",
    *,
    style: Any = "-",
    width: float = 1.5,
    stride: bool = False,
) -> None:
    """A curve; `stride` for one that is no function of x, which is thinned by taking every so many samples."""
    if stride:
        every = max(1, len(x) // (2 * POINTS))
        x, y = x[::every], y[::every]
    else:
        x, y = thin(x, y)
    axis.plot(x, y, color=colour, label=label or None, linestyle=style, linewidth=width)


def _loop_over_reference(axis: Axes, picture: Picture, rows: Sequence[tuple[str, PhaseTracking]]) -> None:
    data = picture.data
    for label, row in rows:
        part = last_cycle(row.stretch, data)
        reference, displacement = 1e6 * data.reference[part], 1e6 * data.displacement[part]
        _line(axis, reference, displacement, picture.colour(row), label, stride=True)
    axis.axline((reference[0], reference[0]), slope=1.0, color=picture.theme.muted, lw=0.9, ls=(0, (4, 3)), zorder=1)
    axis.set(xlabel="reference [µm]", ylabel=f"{picture.judged} [µm]")


def _error_dots(axis: Axes, picture: Picture) -> None:
    """RMS as a dot and the maximum as a tick, for each phase, on a logarithmic axis."""
    for place, (_, row) in enumerate(picture.rows):
        rms, largest = (max(1e9 * value, 1e-3) for value in (row.judged.rms, row.judged.maximum))
        colour = picture.colour(row)
        axis.plot((rms, largest), (place, place), color=colour, lw=2.0, alpha=0.55)
        axis.plot(rms, place, "o", ms=9, color=colour)
        axis.plot(largest, place, "|", ms=13, mew=2.2, color=colour)
        axis.annotate(
            f"{_three_digits(rms)} nm",
            (rms, place),
            xytext=(0, 9),
            textcoords="offset points",
            ha="center",
            fontsize=9.5,
        )
    axis.set(title="RMS error (dot), largest (tick)", xscale="log", xlabel="error [nm]")
    axis.xaxis.set_major_formatter("{x:g}")
    figures = [1e9 * value for _, row in picture.rows for value in (row.judged.rms, row.judged.maximum)]
    low, high = math.log10(max(0.7 * min(figures), 1e-3)), math.log10(max(1.05 * max(figures), 1e-2))
    axis.set_xlim(10 ** math.floor(low), 10 ** math.ceil(high))
    axis.set_ylim(len(picture.rows) - 0.5, -0.75)
    axis.set_yticks(range(len(picture.rows)), [label for label, _ in picture.rows])
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")


def _track_column(axes: Any, picture: Picture, label: str, row: PhaseTracking) -> None:
    top, common, own = axes
    data, stretch = picture.data, row.stretch
    part = span(stretch.begin, stretch.end, data)
    time = data.time[part] - stretch.begin
    error = 1e9 * (data.reference - data.displacement)[part]
    _line(top, time, 1e6 * data.displacement[part], picture.colour(row))
    _line(top, time, 1e6 * data.reference[part], picture.theme.ink, style=(0, (4, 3)), width=0.9)
    for axis in (common, own):
        _line(axis, time, error, picture.colour(row), width=1.2)
        axis.axhline(0.0, color=picture.theme.muted, lw=0.8, zorder=1)
    if stretch.settled > stretch.begin:
        for axis in axes:
            axis.axvspan(0.0, stretch.settled - stretch.begin, color=picture.theme.grid, alpha=0.55, lw=0, zorder=0)
    settled = error[time >= stretch.settled - stretch.begin - 0.5 * _step(data)]
    shown = settled[np.isfinite(settled)] if np.any(np.isfinite(settled)) else error[np.isfinite(error)]
    reach = 1.25 * float(np.max(np.abs(shown))) or 1.0
    own.set_ylim(-reach, reach)
    own.set(xlabel="time in the phase [s]", xlim=(0.0, stretch.end - stretch.begin))
    counted = row.judged
    top.set_title(label, color=picture.colour(row))
    own.set_title(f"RMS {_three_digits(1e9 * counted.rms)} nm", fontsize=9, weight="normal", loc="right", pad=3)


def _same_limits(axes: Any) -> None:
    low = min(axis.get_ylim()[0] for axis in axes)
    high = max(axis.get_ylim()[1] for axis in axes)
    for axis in axes:
        axis.set_ylim(low, high)
    for axis in axes[1:]:
        axis.tick_params(labelleft=False)


def _limits(axis: Axes, theme: Theme, limits: tuple[float, float], unit: str) -> None:
    """Lines at the amplifier's limits, or a word on them where the signal stays so far inside that it would vanish."""
    low, high = axis.get_ylim()
    if high - low < 0.25 * (limits[1] - limits[0]):
        _headroom(axis, 0.25)
        text = f"limits {limits[0]:g} and {limits[1]:g} {unit}, far off this scale"
        axis.text(0.995, 0.95, text, transform=axis.transAxes, ha="right", va="top", fontsize=8.5, color=theme.muted)
        return
    for limit in limits:
        axis.axhline(limit, color=theme.muted, lw=1.0, ls=(0, (1, 1.5)), zorder=1)
    span = limits[1] - limits[0]
    axis.set_ylim(limits[0] - 0.07 * span, limits[1] + 0.2 * span)
    text = f"dotted: limits {limits[0]:g} and {limits[1]:g} {unit}"
    axis.text(0.995, 0.985, text, transform=axis.transAxes, ha="right", va="top", fontsize=8.5, color=theme.muted)


def _headroom(axis: Axes, share: float) -> None:
    low, high = axis.get_ylim()
    axis.set_ylim(low, high + share * (high - low))


def _bands(axes: Sequence[Axes], picture: Picture) -> None:
    """Shade where a controller is in charge, and write its name at the top."""
    span = picture.data.time[-1] - picture.data.time[0]
    joined: list[tuple[str, float, float]] = []
    for stretch in picture.data.stretches:
        if not stretch.controller or stretch.begin >= picture.data.time[-1]:
            continue
        if joined and joined[-1][0] == stretch.controller and abs(joined[-1][2] - stretch.begin) < 1e-9:
            joined[-1] = (stretch.controller, joined[-1][1], stretch.end)
        else:
            joined.append((stretch.controller, stretch.begin, stretch.end))
    for controller, begin, end in joined:
        colour = picture.theme.colour(controller)
        for axis in axes:
            axis.axvspan(begin, end, color=colour, alpha=0.10, lw=0, zorder=0)
        if end - begin > 0.06 * span:
            middle = 0.5 * (begin + min(end, picture.data.time[-1]))
            axes[0].annotate(
                controller, (middle, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 4),
                textcoords="offset points", ha="center", va="bottom", color=colour, weight="bold", fontsize=9.5,
            )  # fmt: skip


def _three_digits(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"
