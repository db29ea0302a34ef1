"""The picture of the tracking benchmark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from pzt_benchmarks.tracking_rig import RATE, STROKE, Tracked
from pzt_ros.report.style import Theme

COLOURS = {
    "linear open loop": "open_loop",
    "best PI": "pi",
    "inverse alone, front": "inverse",
    "observer-based, front": "inverse_pi",
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
        best = shown["observer-based, front"]
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
