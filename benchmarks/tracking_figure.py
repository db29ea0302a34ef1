"""The pictures of the tracking benchmark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from pzt_benchmarks.full_plant import PUBLISHED, Followed
from pzt_benchmarks.tracking_rig import RATE, STROKE, Tracked
from pzt_ros.report.style import Theme

COLOURS = {
    "linear open loop": "open_loop",
    "best PI": "pi",
    "inverse alone, front": "inverse",
    "observer-based, lattice": "inverse_pi",
}
"""The runs that are shown, and whose colour they have."""


def draw(shown: Mapping[str, Tracked], learned: Sequence[np.ndarray], theme: Theme, path: Path) -> None:
    """Three panels: the loop, the error over the last cycle at 10 Hz, learning from cycle to cycle."""
    count = round(RATE / 10.0)
    with plt.rc_context(theme.settings()):
        figure, (loop, error, cycles) = plt.subplots(
            1, 3, figsize=(11.5, 4.2), gridspec_kw={"width_ratios": [0.8, 1.3, 1.0]}, layout="constrained"
        )
        last = slice(-count, None)
        best = shown["observer-based, lattice"]
        loop.plot(best.voltage[last], 1e6 * best.truth[last], color=theme.ink, linewidth=1.0)
        loop.set(title="The stage at 10 Hz", xlabel="voltage, V", ylabel="displacement, um")
        time = 1e3 * np.arange(1, count + 1) / RATE
        for name, colour in COLOURS.items():
            if name == "linear open loop":
                continue  # it is off by 15 %, and would hide the others
            error.plot(time, shown[name].error[last], color=theme.colour(colour), linewidth=1.0, label=name)
        error.set(title="Error over a cycle", xlabel="time, ms", ylabel=f"error, % of {1e6 * STROKE:.0f} um")
        error.legend(loc="upper center", fontsize=8)
        low, high = error.get_ylim()
        error.set_ylim(low, high + 0.35 * (high - low))
        for errors in learned:
            cycles.semilogy(np.arange(errors.size), errors, color=theme.colour("inverse"), marker="o", markersize=3.5)
        cycles.axhline(learned[0][0] / 50.0, color=theme.muted, linewidth=1.0, linestyle=(0, (4, 3)))
        cycles.annotate(
            "a fiftieth of the first cycle", (0.02, learned[0][0] / 50.0), xycoords=("axes fraction", "data"),
            xytext=(0, -11), textcoords="offset points", ha="left", color=theme.muted, fontsize=9,
        )  # fmt: skip
        cycles.set(title="Learning control, wrong model", xlabel="cycles learned from", ylabel="rms error, %")
        cycles.set_ylim(0.02, 5.0)
        figure.savefig(path, dpi=160)
        plt.close(figure)


FULL_COLOURS = {"linear open loop": "open_loop", "inverse": "inverse", "observer-based": "inverse_pi"}


def draw_full(runs: Sequence[Followed], theme: Theme, path: Path) -> None:
    """Two panels: rms error over frequency beside the published one, and the error over a cycle at the fastest."""
    with plt.rc_context(theme.settings()):
        figure, (over, cycle) = plt.subplots(
            1, 2, figsize=(11.5, 4.2), gridspec_kw={"width_ratios": [1.2, 1.0]}, layout="constrained"
        )
        for run in runs:
            colour = theme.colour(FULL_COLOURS[run.name])
            over.loglog(list(run.rms), list(run.rms.values()), "o-", color=colour, markersize=5, label=run.name)
        over.loglog(list(PUBLISHED), list(PUBLISHED.values()), "D", color=theme.ink, markersize=6)
        first = next(iter(PUBLISHED))
        over.annotate(
            "published experiment,\ninversion feed-forward", (first, PUBLISHED[first]), xytext=(0, 9),
            textcoords="offset points", color=theme.muted, fontsize=9,
        )  # fmt: skip
        over.set(title="Full plant, identified model", xlabel="frequency, Hz", ylabel="rms error, % of stroke")
        over.set_xticks(list(PUBLISHED), [f"{f:g}" for f in PUBLISHED])
        over.minorticks_off()
        over.set_yticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
        over.set_ylim(0.03, 100.0)
        over.legend(loc="upper right", bbox_to_anchor=(1.0, 0.8))
        fastest = max(runs[0].cycle)
        for run in runs[1:]:
            error = run.cycle[fastest]
            time = 1e3 * np.arange(1, error.size + 1) / RATE
            cycle.plot(time, error, color=theme.colour(FULL_COLOURS[run.name]), linewidth=1.2, label=run.name)
        cycle.set(title=f"Error over a cycle at {fastest:g} Hz", xlabel="time, ms", ylabel="error, % of stroke")
        cycle.legend(loc="best")
        figure.suptitle("SIMULATED", x=0.995, ha="right", fontsize=8.5, color=theme.muted)
        figure.savefig(path, dpi=160)
        plt.close(figure)
