"""The figures of a run. Each draws onto a new figure in the colours of a theme; micrometres, nanometres, volts, milliamperes."""

from __future__ import annotations

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
    figure = _figure(12.6, 4.1)
    loop, error, bars = figure.subplots(1, 3, width_ratios=(1.0, 1.25, 1.0))
    worst, best = extremes(picture.rows)
    pair = [worst, best] if worst is not best else [worst]
    _loop_over_reference(loop, picture, pair)
    loop.set_title("Displacement over reference")
    for label, row in picture.rows:
        part = last_cycle(row.stretch, picture.data)
        time, difference = picture.data.time[part], (picture.data.reference - picture.data.displacement)[part]
        _line(error, 1e3 * (time - time[0]), 1e9 * difference, picture.colour(row), label)
    error.set(title="Tracking error over one cycle", xlabel="time in the cycle [ms]", ylabel="error [nm]")
    _legend_below(error, min(4, len(picture.rows)))
    _error_bars(bars, picture)
    return figure


def loops(picture: Picture) -> Figure:
    """Displacement over voltage, where hysteresis lives, and over the reference, where it should be gone."""
    figure = _figure(11.0, 4.6)
    voltage, reference = figure.subplots(1, 2)
    if not picture.rows:
        _line(voltage, picture.data.voltage, 1e6 * picture.data.displacement, picture.theme.ink, stride=True)
        reference.remove()
    for label, row in picture.rows:
        part = last_cycle(row.stretch, picture.data)
        _line(
            voltage,
            picture.data.voltage[part],
            1e6 * picture.data.displacement[part],
            picture.colour(row),
            label,
            stride=True,
        )
    voltage.set(title="Over the voltage", xlabel="voltage across the ceramic [V]", ylabel=f"{picture.judged} [µm]")
    if picture.rows:
        _loop_over_reference(reference, picture, picture.rows)
        reference.set_title("Over the reference")
        figure.legend(
            *voltage.get_legend_handles_labels(), loc="outside lower center", ncols=min(6, len(picture.rows))
        )
    return figure


def tracking(picture: Picture) -> Figure:
    """A column for each phase: what was asked and done, the error on a common scale, the error on its own scale."""
    count = len(picture.rows)
    figure = _figure(max(5.0, 3.15 * count), 6.6)
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
    figure = _figure(11.0, 6.6)
    place, voltage, current = figure.subplots(3, 1, sharex=True, height_ratios=(1.3, 1.0, 0.8))
    _line(place, data.time, 1e6 * data.displacement, theme.ink, picture.judged)
    _line(place, data.time, 1e6 * data.reference, theme.colour("open_loop"), "reference", style=(0, (4, 2)), width=1.1)
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
        "The run in one picture. Left: the worst and the best phase, last cycle; a perfect stage would draw the dashed line. "
        "Middle: error over the last cycle. Right: RMS (bar) and largest error (tick), logarithmic.",
    ),
    "loops": (loops, False, "The last cycle of each phase. What is open on the right is error."),
    "tracking": (
        tracking,
        True,
        "Top: reference (dashed) and displacement. Below: reference minus displacement, first on the same scale for all, "
        "then each on its own. Shaded: the first cycle, which is left out of the errors as settling.",
    ),
    "course": (
        course,
        False,
        "The whole run; shaded where a controller is in charge, white where the voltage itself is asked.",
    ),
}
"""Every figure: how it is drawn, whether it needs a phase with a reference, what is written below it."""


def extremes(rows: Sequence[tuple[str, PhaseTracking]]) -> tuple[Any, Any]:
    """The phases with the largest and with the least RMS error."""
    ordered = sorted(rows, key=lambda item: item[1].judged.rms)
    return ordered[-1], ordered[0]


def last_cycle(stretch: Stretch, data: RunData) -> slice:
    """The samples of the last whole cycle of a scan; all that was recorded of any other phase, or of a scan cut short."""
    begin, end = stretch.begin, stretch.end
    if isinstance(stretch.phase, Scan) and stretch.phase.cycles >= 1.0 and data.time[-1] > end - 1.5 * _step(data):
        begin = end - 1.0 / stretch.phase.frequency
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


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), dpi=110)


def _step(data: RunData) -> float:
    return 1.0 / data.scenario.sample_rate


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
    if len(rows) <= 2:
        axis.legend(loc="upper left")


def _error_bars(axis: Axes, picture: Picture) -> None:
    """RMS as a bar and the maximum as a tick, for each phase, on a logarithmic axis."""
    errors = [row.judged for _, row in picture.rows]
    place = np.arange(len(errors))[::-1]
    rms = np.array([max(1e9 * error.rms, 1e-3) for error in errors])
    largest = np.array([max(1e9 * error.maximum, 1e-3) for error in errors])
    colours = [picture.colour(row) for _, row in picture.rows]
    axis.barh(place, rms, height=0.5, color=colours, left=0.0)
    axis.scatter(largest, place, marker="|", s=190, color=colours, linewidths=2.2)
    for y, value, edge in zip(place, rms, largest, strict=True):
        axis.text(edge * 1.18, y, _three_digits(value), va="center", ha="left", fontsize=9.5)
    axis.set(xscale="log", xlim=(0.4 * rms.min(), 4.5 * largest.max()), xlabel="RMS error [nm], tick: largest")
    axis.set_yticks(place, [label for label, _ in picture.rows])
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")
    axis.set_title("Tracking error")


def _track_column(axes: Any, picture: Picture, label: str, row: PhaseTracking) -> None:
    top, common, own = axes
    data, stretch = picture.data, row.stretch
    half = 0.5 * _step(data)
    first, last = np.searchsorted(data.time, (stretch.begin - half, stretch.end - half))
    part = slice(int(first), int(last))
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
    settled = error[time >= stretch.settled - stretch.begin - half]
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


def _legend_below(axis: Axes, columns: int) -> None:
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=columns, columnspacing=1.1, handlelength=1.3)


def _three_digits(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"
