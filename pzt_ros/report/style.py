"""How figures look: a light and a dark theme, one colour per controller that colour-blind readers can tell apart."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Theme:
    """Colours of a figure; `controllers` after Okabe and Ito (2008), darkened or lightened for the ground."""

    name: str
    ground: str
    ink: str
    muted: str
    grid: str
    shade: str
    controllers: dict[str, str] = field(default_factory=dict)
    before: str = ""
    after: str = ""
    rising: str = ""
    falling: str = ""

    def colour(self, controller: str) -> str:
        """Of a controller; ink for one that has none."""
        return self.controllers.get(controller, self.ink)

    def settings(self) -> Any:
        """What matplotlib is told, by the names of its settings."""
        return {
            "figure.facecolor": self.ground,
            "savefig.facecolor": self.ground,
            "axes.facecolor": self.ground,
            "axes.edgecolor": self.muted,
            "axes.labelcolor": self.ink,
            "axes.titlecolor": self.ink,
            "text.color": self.ink,
            "xtick.color": self.muted,
            "ytick.color": self.muted,
            "xtick.labelcolor": self.ink,
            "ytick.labelcolor": self.ink,
            "grid.color": self.grid,
            "grid.linewidth": 0.8,
            "axes.grid": True,
            "axes.axisbelow": True,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.linewidth": 0.8,
            "axes.titlesize": 10.5,
            "axes.titlelocation": "left",
            "axes.titleweight": "bold",
            "axes.labelsize": 10,
            "xtick.labelsize": 9,
            "ytick.labelsize": 9,
            "legend.fontsize": 9,
            "legend.frameon": False,
            "lines.linewidth": 1.5,
            "lines.solid_capstyle": "round",
            "path.simplify_threshold": 0.5,
            "font.family": "DejaVu Sans",  # comes with matplotlib: the same figure on every machine
            "figure.constrained_layout.use": True,
            "figure.constrained_layout.w_pad": 0.09,
        }


LIGHT = Theme(
    "light",
    ground="#ffffff",
    ink="#1c2024",
    muted="#6b7580",
    grid="#e6e9ec",
    shade="#b9c2cb",
    controllers={"open_loop": "#d55e00", "pi": "#0072b2", "inverse": "#009e73", "inverse_pi": "#9b2f8f"},
    before="#d55e00",
    after="#0072b2",
    rising="#009e73",
    falling="#9b2f8f",
)
DARK = Theme(
    "dark",
    ground="#14181d",
    ink="#e8ebee",
    muted="#98a2ad",
    grid="#2a3138",
    shade="#5b6672",
    controllers={"open_loop": "#ff8c42", "pi": "#5ab4f0", "inverse": "#35c99a", "inverse_pi": "#e08ad8"},
    before="#ff8c42",
    after="#5ab4f0",
    rising="#35c99a",
    falling="#e08ad8",
)
THEMES = (LIGHT, DARK)
