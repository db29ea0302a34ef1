"""The plots of the page: what is drawn where, and the element that draws them."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from pzt_ros.panel.board import WINDOW, Board
from pzt_ros.panel.frames import COLUMNS, Row

OBSERVED = [
    {"column": "estimate_m", "label": "observer: y", "scale": 1e6, "digits": 3, "unit": "µm", "spread": "innovation_m"},
    {"column": "polarization_C_per_m2", "label": "P", "scale": 1e3, "digits": 1, "unit": "mC/m²"},
    {"column": "phase_fraction", "label": "x₊", "scale": 1.0, "digits": 3, "unit": ""},
    {"column": "disturbance_m", "label": "disturbance", "scale": 1e9, "digits": 0, "unit": "nm"},
]
"""The observer's state as numbers; `spread` names what twice the rms is taken of, as the width of its band."""


def _trace(column: str, label: str, colour: str, *, dashed: bool = False) -> dict[str, Any]:
    return {"column": column, "label": label, "colour": colour, "dashed": dashed}


def _time(name: str, title: str, unit: str, scale: float, least: float, digits: int, *traces: Any, **more: Any) -> Any:
    plot = {"name": name, "title": title, "unit": unit, "scale": scale, "least": least, "digits": digits}
    return {**plot, "kind": "time", "x": "time_s", "scale_x": 1.0, "traces": traces, **more}


def time_plots() -> list[dict[str, Any]]:
    """Over the last seconds. `least` is the smallest span of the axis, so that noise at rest does not fill it."""
    return [
        _time(
            "displacement", "Displacement", "µm", 1e6, 0.5, 3,
            _trace("displacement_m", "measured", "measured"), _trace("reference_m", "reference", "asked", dashed=True),
            readouts=OBSERVED,
        ),
        _time("error", "Tracking error", "nm", 1e9, 50.0, 1, _trace("error_m", "", "error")),
        _time("voltage", "Voltage", "V", 1.0, 2.0, 2, _trace("voltage_V", "", "voltage")),
        _time("observer", "Innovation", "nm", 1e9, 50.0, 1, _trace("innovation_m", "", "observed"), band=True),
    ]  # fmt: skip


def loop_plots(about: dict[str, Any]) -> list[dict[str, Any]]:
    """Polarization and strain over the field, displacement over voltage; over the voltage where no one knows the stack.

    The strain is that of the whole stack: displacement over its active length.
    """
    thickness, length = about.get("layer_thickness_m"), about.get("active_length_m")
    over_field = {"unit_x": "E in MV/m", "scale_x": 1e-6 / thickness, "least_x": 0.02} if thickness else None
    over_voltage = {"unit_x": "U in V", "scale_x": 1.0, "least_x": 2.0}
    strain = {"unit": "‰", "scale": 1e3 / length, "least": 0.05, "digits": 3} if length else None
    micron = {"unit": "µm", "scale": 1e6, "least": 0.5, "digits": 3}
    polarization = {"unit": "mC/m²", "scale": 1e3, "least": 5.0, "digits": 1}
    p_title = "Polarization / field" if thickness else "Polarization / voltage"
    rows = [
        ("pe", p_title, polarization, over_field or over_voltage, _trace("polarization_C_per_m2", "", "observed")),
        ("yu", "Displacement / voltage", micron, over_voltage, _trace("displacement_m", "", "measured")),
    ]
    if strain and over_field:
        rows.insert(1, ("se", "Strain / field", strain, over_field, _trace("displacement_m", "", "measured")))
    return [
        {"name": name, "title": title, "kind": "loop", "x": "voltage_V", "traces": [trace], **y, **x}
        for name, title, y, x, trace in rows
    ]


class Scope(ui.element, component="scope.js"):
    """A group of plots of the board's rows."""

    def __init__(self, board: Board, plots: list[dict[str, Any]]) -> None:
        super().__init__()
        self._props["plots"] = plots
        self._props["columns"] = list(COLUMNS)
        self._props["window"] = WINDOW
        self._props["history"] = list(board.rows)

    def redefine(self, plots: list[dict[str, Any]]) -> None:
        """Other plots of the same rows."""
        self._props["plots"] = plots
        self._props["history"] = []  # is there already
        self.update()

    def show(self, rows: list[Row]) -> None:
        """Draw rows that are new."""
        self.run_method("push", rows)
