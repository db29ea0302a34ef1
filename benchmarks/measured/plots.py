"""The pictures of the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from pzt_benchmarks.measured import ring
from pzt_benchmarks.measured.ceramic import Part
from pzt_benchmarks.measured.judged import DECLARED, IDENTIFIED, Judged
from pzt_ros.diagnosis.data import SCORE, SELECTION, RunData
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.report.style import THEMES, Theme

_DPI = 110
_GAP = 0.1
_ROOM = 1.4
_AROUND = 0.03  # of the record after switch-on that is drawn [s]


def draw(judged: Judged, folder: Path) -> None:
    """Loop, and residual of the test run over time and over the drive."""
    for theme in THEMES:
        with plt.rc_context(theme.settings()):
            figure, (loop, time, drive) = plt.subplots(
                1, 3, figsize=(11.5, 3.6), gridspec_kw={"width_ratios": [0.8, 1.4, 1.0]}
            )
            run, score = judged.test, judged.test.picks[SCORE]
            counted = np.concatenate((run.picks[SELECTION], score))
            voltage = run.record.voltage
            loop.plot(voltage, 1e6 * run.record.displacement, color=theme.ink, linewidth=0.8)
            loop.set(title="Test run", xlabel="voltage, V", ylabel="displacement, µm")
            for name, colour in ((DECLARED, theme.before), (IDENTIFIED, theme.after)):
                residual = 1e9 * judged.residuals[name]
                time.plot(run.record.time, residual, color=colour, linewidth=0.8, label=name)
                drive.plot(voltage[score], residual[score], color=colour, linewidth=0.5)
            # of the identified base; the declared one may go beyond
            reach = _ROOM * float(np.max(np.abs(residual[counted])))
            time.set_ylim(-reach, reach)
            drive.set_ylim(-reach, reach)
            _mark(time, run, theme)
            time.set(title="Measurement minus prediction", xlabel="time, s", ylabel="nm")
            drive.set(title="On the score part, over the drive", xlabel="voltage, V", ylabel="nm")
            figure.legend(*time.get_legend_handles_labels(), loc="outside lower center", ncols=3)
            _save(figure, judged.which.key, theme, folder)


def draw_onset(judged: Judged, whole: Record, folder: Path) -> None:
    """The ring after switch-on, what the base leaves of it, and its frequency."""
    after, frequency, _ = ring.frequencies(whole)
    begin = ring.switch_on(whole)
    for theme in THEMES:
        with plt.rc_context(theme.settings()):
            figure, (reading, left, rise) = plt.subplots(1, 3, figsize=(11.5, 3.6))
            time = 1e3 * (whole.time - whole.time[begin])
            part = (time > -2.0) & (time < 1e3 * _AROUND)
            reading.plot(time[part], 1e6 * whole.displacement[part], color=theme.ink, marker=".", markersize=3.0)
            reading.set(title="Reading", xlabel="ms after switch-on", ylabel="displacement, µm")
            record = judged.test.record
            left.plot(record.time, 1e9 * judged.residuals[IDENTIFIED], color=theme.after, linewidth=0.6)
            left.set(title="What the identified base leaves", xlabel="time, s", ylabel="nm")
            rise.plot(1e3 * after, frequency, color=theme.ink, marker="o", markersize=4.5)
            rise.set(title="Frequency, in windows of 4 ms", xlabel="ms after switch-on", ylabel="Hz")
            _save(figure, judged.which.key, theme, folder)


def draw_parts(parts: Sequence[Part], folder: Path) -> None:
    """Measured and predicted, one panel for each."""
    for theme in THEMES:
        with plt.rc_context(theme.settings()):
            figure, axes = plt.subplots(2, 2, figsize=(11.5, 6.6))
            for axis, part in zip(axes.flat, [part for part in parts if part.is_scored], strict=True):
                axis.plot(part.time, part.scale * part.measured, color=theme.ink, linewidth=1.8, label="measured")
                both = len(part.predicted) == 2
                colours = (theme.before, theme.after) if both else (theme.before, theme.falling, theme.after)
                for (name, values), colour in zip(part.predicted.items(), colours, strict=True):
                    axis.plot(part.time, part.scale * values, color=colour, linewidth=1.0, label=name)
                _shade(axis, part.time[~part.scored], theme)
                axis.set(title=part.what, xlabel="time, s", ylabel=part.unit)
                axis.legend(loc="best")
            _save(figure, "ceramic", theme, folder)


def _mark(axes: Axes, run: RunData, theme: Theme) -> None:
    """The part that chose."""
    _shade(axes, run.record.time[run.picks[SELECTION]], theme)
    axes.annotate(
        "chose",
        (run.record.time[0], 0.02),
        xycoords=("data", "axes fraction"),
        va="bottom",
        color=theme.muted,
        fontsize=9,
    )


def _shade(axes: Axes, times: Array, theme: Theme) -> None:
    """Where these samples lie, in pieces where there are gaps [s]."""
    gaps = np.flatnonzero(np.diff(times) > _GAP * (times[-1] - times[0])) + 1
    for piece in np.split(times, gaps):
        axes.axvspan(float(piece[0]), float(piece[-1]), color=theme.shade, alpha=0.25, linewidth=0.0)


def _save(figure: plt.Figure, key: str, theme: Theme, folder: Path) -> None:
    figure.savefig(folder / f"{key}{_suffix(theme)}.png", dpi=_DPI)
    plt.close(figure)


def _suffix(theme: Theme) -> str:
    return "" if theme.name == "light" else f"-{theme.name}"


def picture(key: str, words: str) -> str:
    """A picture in either theme, for the page beside its folder."""
    return (
        f'<picture>\n  <source media="(prefers-color-scheme: dark)" srcset="measured/{key}-dark.png">\n'
        f'  <img alt="{words}" src="measured/{key}.png">\n</picture>'
    )
