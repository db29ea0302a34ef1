"""The picture of a story: what the models predict, and how the stage tracks, before and after the repair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pzt_ros.experiments.phases import Scan
from pzt_ros.report.figures import last_cycle, thin
from pzt_ros.report.style import Theme
from pzt_ros.story.outcome import Story
from pzt_ros.story.runs import AS_KNOWN, FITTED, REPAIRED

LABELS = {AS_KNOWN: "model as known", FITTED: "fitted, effect missing", REPAIRED: "repaired"}
"""The three models in words."""


@dataclass(frozen=True)
class Picture:
    """A story and the colours to draw it in."""

    story: Story
    theme: Theme

    def colour(self, run: str) -> str:
        """Of a model."""
        return {AS_KNOWN: self.theme.muted, FITTED: self.theme.before, REPAIRED: self.theme.after}[run]


def story_figure(picture: Picture) -> Figure:
    """Error of prediction over the last run, tracking error over one cycle, all errors in numbers."""
    controllers = picture.story.controllers
    figure = Figure(figsize=(13.4, 4.6), dpi=140)
    figure.suptitle(
        f"SIMULATED  ·  pzt demo, seed {picture.story.seed}", x=0.995, ha="right", fontsize=8.5,
        color=picture.theme.muted,
    )  # fmt: skip
    axes = figure.subplots(1, len(controllers) + 2, width_ratios=(1.25, *[1.0] * len(controllers), 1.1))
    _prediction(axes[0], picture)
    for axis, controller in zip(axes[1:], controllers, strict=False):
        _cycle(axis, picture, controller)
    _dots(axes[-1], picture)
    handles = axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=len(LABELS))
    return figure


def _prediction(axis: Axes, picture: Picture) -> None:
    for run in LABELS:
        found = picture.story.predictions[run]
        time, error = thin(found.signals.time, 1e9 * found.error)
        axis.plot(time, error, color=picture.colour(run), lw=1.2, label=LABELS[run])
    axis.set(title="Error of prediction, last run", xlabel="time [s]", ylabel="measured less predicted [nm]")


def _cycle(axis: Axes, picture: Picture, controller: str) -> None:
    for run, data in picture.story.scans.items():
        rows = [r for r in data.tracked() if r.stretch.controller == controller and isinstance(r.stretch.phase, Scan)]
        part = last_cycle(rows[-1].stretch, data)
        time = data.time[part]
        error = 1e9 * (data.reference - data.displacement)[part]
        axis.plot(*thin(1e3 * (time - time[0]), error), color=picture.colour(run), lw=1.5)
    axis.set(title=f"Tracking, {controller}", xlabel="time in the last cycle [ms]", ylabel="error [nm]")


def _dots(axis: Axes, picture: Picture) -> None:
    """The RMS of every error, from before to after, on a logarithmic axis."""
    story = picture.story
    rows: dict[str, dict[str, float]] = {"prediction": {run: found.rms for run, found in story.predictions.items()}}
    for controller in story.controllers:
        rows[controller] = {run: errors[controller].rms for run, errors in story.tracking.items()}
    for place, found in enumerate(rows.values()):
        values: Any = [1e9 * found[run] for run in (FITTED, REPAIRED)]
        axis.plot(values, (place, place), color=picture.theme.shade, lw=2.5, zorder=1)
        for run in LABELS:
            nanometres = 1e9 * found[run]
            axis.plot(nanometres, place, "o", ms=6 if run == AS_KNOWN else 9, color=picture.colour(run))
            if run != AS_KNOWN:
                axis.annotate(
                    f"{nanometres:.3g}", (nanometres, place), xytext=(0, 9), textcoords="offset points", ha="center",
                    fontsize=9.5,
                )  # fmt: skip
    axis.set(title="RMS error", xscale="log", xlabel="error [nm]")
    axis.xaxis.set_major_formatter("{x:g}")
    everything = np.array([1e9 * value for found in rows.values() for value in found.values()])
    axis.set_xlim(0.5 * everything.min(), 2.0 * everything.max())
    axis.set_ylim(len(rows) - 0.5, -0.6)
    axis.set_yticks(range(len(rows)), list(rows))
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")
