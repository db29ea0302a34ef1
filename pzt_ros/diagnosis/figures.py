"""The figures of a diagnosis. Each draws onto a new figure in the colours of a theme."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pzt_ros.diagnosis.data import SCORE, RunData
from pzt_ros.diagnosis.outcome import Errors
from pzt_ros.diagnosis.report import Report
from pzt_ros.diagnosis.views import OverHold, by_band, centred, evenly, over_hold, over_voltage, scored
from pzt_ros.physics.signals import Array
from pzt_ros.report.figures import thin
from pzt_ros.report.style import Theme

MOST_RUNS = 6
"""So many runs are drawn each by itself; of more the numbers stand in the table."""

_MOST_DOTS = 2500
_MOST_HOLDS = 24
_COLUMNS = 3
_SPIKES = 0.1  # percent of the samples at either end that a scale may leave off


@dataclass(frozen=True)
class Picture:
    """What a figure is drawn from."""

    report: Report
    theme: Theme

    @property
    def models(self) -> list[tuple[str, Errors, str]]:
        """Label, errors and colour of the declared model and of the repaired one; of one where nothing was added."""
        before = ("before", self.report.before, self.theme.before)
        return (
            [before, ("after", self.report.after, self.theme.after)]
            if self.report.repaired
            else [("model", self.report.before, self.theme.after)]
        )

    @property
    def shown(self) -> list[int]:
        """Indices of the runs that are drawn each by itself: test runs first."""
        order = sorted(range(len(self.report.runs)), key=lambda number: SCORE not in self.report.runs[number].picks)
        return order[:MOST_RUNS]


def short_name(run: RunData) -> str:
    """Of a run, for a title."""
    name = Path(run.record.name).name or run.record.name
    return name if len(name) <= 34 else "…" + name[-33:]


def errors(picture: Picture) -> Figure:
    """Every model's error where nothing was fitted or chosen, over the noise floor."""
    report, theme = picture.report, picture.theme
    figure = Figure(figsize=(11.0, 0.62 * (len(report.baselines) + len(picture.models)) + 1.25), dpi=140)
    axis = figure.subplots()
    rows = [(name, found, theme.muted) for name, found in report.baselines.items()] + picture.models
    for place, (_, found, colour) in enumerate(rows):
        score = 1e9 * found.score
        low, high = (1e9 * limit for limit in found.interval)
        axis.plot((max(low, 1e-3 * score), high), (place, place), color=colour, lw=6, alpha=0.3, solid_capstyle="butt")
        axis.plot(score, place, "o", ms=10, color=colour)
        axis.annotate(
            f"{_digits(score)} nm", (max(high, score), place), xytext=(11, 0), textcoords="offset points", va="center",
            fontsize=11, weight="bold" if colour != theme.muted else "normal",
        )  # fmt: skip
    floor = 1e9 * report.noise
    axis.axvline(floor, color=theme.ink, lw=1.1, ls=(0, (4, 3)), zorder=1)
    largest = max(max(found.score, found.interval[1]) for _, found, _ in rows) * 1e9
    axis.set_xlim(0.6 * min(floor, *(1e9 * found.score for _, found, _ in rows)), 2.2 * largest)
    axis.set(xscale="log", xlabel=f"rms error on {_what_scores(report)} [nm]")
    axis.xaxis.set_major_formatter("{x:g}")
    axis.set_ylim(len(rows) - 0.55, -0.75)
    axis.annotate(
        f"noise floor {_digits(floor)} nm",
        (floor, -0.72),
        xytext=(6, 0),
        textcoords="offset points",
        va="top",
        fontsize=9,
    )
    axis.set_yticks(range(len(rows)), [_LABELS.get(name, name) for name, _, _ in rows])
    axis.tick_params(axis="y", length=0, labelsize=11)
    axis.grid(False, axis="y")
    axis.spines["left"].set_visible(False)
    return figure


def runs(picture: Picture) -> Figure:
    """What was measured: displacement over voltage, and the drive over time."""
    chosen = picture.shown
    columns = min(len(chosen), _COLUMNS)
    lines = -(-len(chosen) // columns)
    figure = Figure(figsize=(12.6, 5.4 * lines), dpi=_dpi(len(chosen)))
    axes = figure.subplots(2 * lines, columns, squeeze=False, height_ratios=(1.7, 1.0) * lines)
    for axis in axes.flat:
        axis.set_visible(False)
    for place, number in enumerate(chosen):
        run = picture.report.runs[number]
        line, column = divmod(place, columns)
        loop, drive = axes[2 * line : 2 * line + 2, column]
        for axis in (loop, drive):
            axis.set_visible(True)
        places = evenly(len(run.record), 8000)
        loop.plot(run.record.voltage[places], 1e6 * run.record.displacement[places], color=picture.theme.after, lw=0.9)
        loop.set_title(f"{short_name(run)}  ({_role(run)})")
        loop.set_xlabel("voltage [V]")
        drive.plot(*thin(run.record.time, run.record.voltage), color=picture.theme.ink, lw=0.9)
        drive.set_xlabel("time [s]")
        drive.set_xlim(run.record.time[0], run.record.time[-1])
    for loop, drive in zip(axes[::2, 0], axes[1::2, 0], strict=True):
        loop.set_ylabel("displacement [µm]")
        drive.set_ylabel("voltage [V]")
    figure.align_ylabels(axes[:, 0])
    return figure


def over_time(picture: Picture) -> Figure:
    """Residual of each run: both models on one scale, then the last one on its own."""
    chosen, models = picture.shown, picture.models
    figure = Figure(figsize=(12.6, 2.15 * len(chosen) + 0.7), dpi=_dpi(len(chosen)))
    axes = figure.subplots(len(chosen), len(models), squeeze=False, sharex="row")
    for row, number in enumerate(chosen):
        run = picture.report.runs[number]
        for column in range(len(models)):
            axis = axes[row, column]
            drawn = models if column == 0 else models[-1:]
            for label, found, colour in drawn:
                left = 1e9 * centred(run, found.residuals[number])
                axis.plot(*thin(run.record.time, left), color=colour, lw=0.7, label=label, rasterized=True)
            _limit(axis, picture.theme, np.concatenate([1e9 * centred(run, e.residuals[number]) for _, e, _ in drawn]))
            _noise_band(axis, picture.theme, run)
            _halves(axis, picture.theme, run)
            axis.set_xlim(run.record.time[0], run.record.time[-1])
        axes[row, 0].set_ylabel("residual [nm]")
        axes[row, 0].set_title(f"{short_name(run)}  ({_role(run)})")
        if len(models) > 1:
            axes[row, 1].set_title("after, on its own scale", weight="normal")
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    legend = figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    for handle in legend.get_lines()[: len(models)]:
        handle.set_linewidth(3.0)
    return figure


def voltage(picture: Picture) -> Figure:
    """Residual over drive voltage, rising and falling apart."""
    theme, chosen = picture.theme, scored(picture.report.runs)
    of = [picture.report.runs[number] for number in chosen]
    panels = [(label, found, "one scale") for label, found, _ in picture.models]
    panels += [("after", picture.report.after, "own scale")] if len(panels) > 1 else []
    figure = Figure(figsize=(12.6, 4.1), dpi=140)
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axis, (label, found, scale) in zip(axes, panels, strict=True):
        seen = over_voltage(of, [found.residuals[number] for number in chosen])
        for sign, colour in ((0.0, theme.shade), (1.0, theme.rising), (-1.0, theme.falling)):
            _cloud(axis, seen.voltage, 1e9 * seen.residual, seen.direction == sign, colour)
        lines = ((seen.rising, theme.rising, "drive rising"), (seen.falling, theme.falling, "drive falling"))
        for mean, colour, name in lines:
            axis.plot(seen.centres, 1e9 * mean, color=theme.ground, lw=4.5)
            axis.plot(seen.centres, 1e9 * mean, color=colour, lw=2.4, label=name)
        axis.set(xlabel="drive voltage [V]", title=f"{label}, own scale" if scale == "own scale" else label)
        _limit(axis, theme, 1e9 * seen.residual)
    limits = axes[0].get_ylim()
    for axis, (_, _, scale) in zip(axes, panels, strict=True):
        for level in (-2.0, 2.0):
            axis.axhline(1e9 * level * picture.report.noise, color=theme.ink, lw=0.9, ls=(0, (4, 3)))
        if scale == "one scale":
            axis.set_ylim(limits)
    axes[0].set_ylabel("residual [nm]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def bands(picture: Picture) -> Figure:
    """Residual by frequency band, and over the time since a hold began."""
    theme, report = picture.theme, picture.report
    chosen = scored(report.runs)
    resting = next((n for n in (chosen, range(len(report.runs))) if _holds(report, n, report.before)), None)
    figure = Figure(figsize=(12.6, 4.2), dpi=140)
    axes = figure.subplots(1, 2 if resting else 1, squeeze=False)[0]
    for label, found, colour in picture.models:
        seen = by_band([report.runs[n] for n in chosen], [found.residuals[n] for n in chosen])
        axes[0].stairs(1e9 * seen.rms, seen.edges, color=colour, lw=2.2, label=label, baseline=None)
    axes[0].stairs(
        1e9 * seen.noise, seen.edges, color=theme.ink, lw=1.1, ls=(0, (4, 3)), label="white noise", baseline=None
    )
    axes[0].set(
        xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="rms in the band [nm]", title="By frequency"
    )
    for name in ("xaxis", "yaxis"):
        getattr(axes[0], name).set_major_formatter("{x:g}")
    axes[0].legend(loc="best")
    if resting:
        _draw_holds(axes[1], picture, resting)
    return figure


def _draw_holds(axis: Axes, picture: Picture, numbers: Sequence[int]) -> None:
    found = [(label, colour, _holds(picture.report, numbers, errors)) for label, errors, colour in picture.models]
    told = [(label, colour, seen) for label, colour, seen in found if seen is not None]
    for label, colour, seen in told:
        for each in seen.each[evenly(len(seen.each), _MOST_HOLDS)]:
            axis.plot(seen.time, 1e9 * each, color=colour, lw=0.8, alpha=0.4)
        axis.plot(seen.time, 1e9 * seen.mean, color=picture.theme.ground, lw=4.5)
        axis.plot(seen.time, 1e9 * seen.mean, color=colour, lw=2.4, label=f"{label}, mean")
    last = told[-1][2]
    band = 2e9 * np.where(np.isnan(last.mean), np.nan, last.noise)
    axis.fill_between(last.time, -band, band, color=picture.theme.shade, alpha=0.4, lw=0, label="noise of the mean")
    axis.axhline(0.0, color=picture.theme.muted, lw=0.8, zorder=1)
    axis.set(xscale="log", xlabel="time since the hold began [s]", ylabel="residual along the last step [nm]")
    axis.set_title(f"In {len(last.each)} holds" if len(last.each) > 1 else "In the hold")
    axis.xaxis.set_major_formatter("{x:g}")
    axis.legend(loc="best")


def _holds(report: Report, numbers: Sequence[int], found: Errors) -> OverHold | None:
    return over_hold([report.runs[n] for n in numbers], [found.residuals[n] for n in numbers])


Draw = Callable[[Picture], Figure]

CAPTIONS: dict[str, tuple[Draw, str]] = {
    "errors": (
        errors,
        "The error of every model on the samples that the axis names; bars are 95 % intervals, the dashed "
        "line is the noise of the measurement, below which no model can get.",
    ),
    "runs": (runs, "What was measured: displacement over the recorded drive voltage, and the drive over time."),
    "over_time": (
        over_time,
        "Measurement minus free-run prediction. Dashed: two times the noise floor of the run. In a test run the first "
        "half chose among candidates, the second was used for nothing but the score.",
    ),
    "voltage": (
        voltage,
        "Residual over the drive voltage: samples (grey at rest) and their means for a rising and a falling drive. "
        "Two branches that part are hysteresis or lag, one curve is a nonlinearity. Dashed: two times the noise floor.",
    ),
    "bands": (
        bands,
        "Residual by frequency, dashed what white noise of the measured floor has in each band. In holds, the residual "
        "is counted along the last step of the drive, less its first five samples; thin lines are single holds. Creep "
        "that a model lacks goes on rising, lag that it lacks is over in the beginning.",
    ),
}
"""Every figure: how it is drawn, what is written below it."""


def _what_scores(report: Report) -> str:
    return "the second half of the test runs" if report.test else "the train runs, which were fitted"


def _role(run: RunData) -> str:
    return "test" if SCORE in run.picks else "train"


def _dpi(count: int) -> int:
    """So that a page of many runs stays small."""
    return 140 if count <= 3 else 100


def _limit(axis: Axes, theme: Theme, values: Array) -> None:
    """Leave a few extreme samples off the scale, and say how far they go."""
    low, high = (float(v) for v in np.percentile(values, (_SPIKES, 100.0 - _SPIKES)))
    room = 0.35 * (high - low)
    bottom, top = max(low - room, float(values.min())), min(high + room, float(values.max()))
    axis.set_ylim(bottom - 0.05 * (top - bottom), top + 0.18 * (top - bottom))
    if max(float(values.max()) - top, bottom - float(values.min())) > 0.5 * (top - bottom):
        largest = _digits(float(np.max(np.abs(values))))
        axis.annotate(
            f"off this scale: up to {largest} nm", (0.995, 0.03), xycoords="axes fraction", ha="right", fontsize=8.5,
            color=theme.muted,
        )  # fmt: skip


def _noise_band(axis: Axes, theme: Theme, run: RunData) -> None:
    for level, label in ((2e9 * run.noise, "2 x noise floor"), (-2e9 * run.noise, None)):
        axis.axhline(level, color=theme.ink, lw=0.9, ls=(0, (4, 3)), label=label)


def _halves(axis: Axes, theme: Theme, run: RunData) -> None:
    """A line between the half that chooses and the half that scores."""
    if SCORE not in run.picks:
        return
    middle = float(run.record.time[run.picks[SCORE][0]])
    axis.axvline(middle, color=theme.muted, lw=1.2)
    for text, side, shift in (("chooses", "right", -5), ("scores", "left", 5)):
        axis.annotate(
            text, (middle, 0.97), xycoords=("data", "axes fraction"), xytext=(shift, 0), textcoords="offset points",
            ha=side, va="top", fontsize=8.5, color=theme.ink,
            bbox={"facecolor": theme.ground, "edgecolor": "none", "alpha": 0.75, "pad": 1.5},
        )  # fmt: skip


def _cloud(axis: Axes, x: Array, y: Array, inside: NDArray[np.bool_], colour: str) -> None:
    x, y = x[inside], y[inside]
    places = evenly(x.size, _MOST_DOTS)
    if places.size:
        axis.plot(x[places], y[places], ".", ms=4, color=colour, alpha=0.3, mew=0)


_LABELS = {
    "before": "the model as declared",
    "model": "the model as declared",
    "after": "with what was found",
    "last cycle": "last cycle (sees the run)",
}


def _digits(value: float) -> str:
    return f"{value:#.3g}".rstrip(".") if value < 1000 else f"{value:.0f}" if math.isfinite(value) else "-"
