"""The report of a run: one self-contained HTML file, its figures as PNG, its numbers as JSON."""

from __future__ import annotations

import base64
import io
import json
import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pzt_ros.errors import BenchError
from pzt_ros.experiments.phases import FromFile, Phase, Scan
from pzt_ros.quantities import parameters_of
from pzt_ros.records import write_text
from pzt_ros.report.health import NodeHealth, node_health
from pzt_ros.report.rundata import RunData, read_run
from pzt_ros.report.tracking import TrackingError
from pzt_ros.report.verdict import Rows, completeness, gaps, verdict


@dataclass(frozen=True)
class Shown:
    """A figure in the page: the two themes as base64 PNG, its caption and the name of its file."""

    name: str
    light: str
    dark: str
    caption: str


def write_run_report(folder: str | Path) -> Path:
    """Write `report.html`, `report.json` and `figures/*.png` into a run folder; returns the path of the page.

    Raises:
        BenchError: no run folder, nothing measured in it, or it cannot be written.
    """
    data = read_run(folder)
    rows = compared(data)
    health = node_health(data.bag)
    summary = summarize(data, rows, health)
    figures = _draw(data, rows)
    page = _page(data, rows, health, summary, figures)
    write_text(data.folder / "report.json", [json.dumps(_plain(summary), indent=1)])
    write_text(data.folder / "report.html", [page])
    return data.folder / "report.html"


def read_summary(folder: str | Path) -> dict[str, Any]:
    """The numbers of a report that was written."""
    found: dict[str, Any] = json.loads((Path(folder) / "report.json").read_text(encoding="utf-8"))
    return found


def compared(data: RunData) -> Rows:
    """The phases that are compared, with their labels: the scans, or the moves where nothing is scanned."""
    tracked = data.tracked()
    rows = [row for row in tracked if isinstance(row.stretch.phase, Scan)] or tracked
    names = [row.stretch.controller for row in rows]
    return [
        (name if names.count(name) == 1 else f"{name}, phase {row.stretch.number}", row)
        for name, row in zip(names, rows, strict=True)
    ]


def summarize(data: RunData, rows: Rows, health: list[NodeHealth]) -> dict[str, Any]:
    """The numbers of a run, ready for JSON [m, s, %, 1]."""
    line = next((row for _, row in rows if row.stretch.controller == "open_loop"), None)
    return {
        "scenario": data.name,
        "simulated": data.simulated,
        "verdict": verdict(data, rows),
        "incomplete": completeness(data),
        "missing_samples": dict(data.missing),
        "gaps": gaps(data),
        "tracking": [
            {
                "name": name,
                "controller": row.stretch.controller,
                "phase": row.stretch.number,
                "recorded": row.done,
                "better_than_open_loop": line.judged.rms / row.judged.rms if line and row.judged.rms > 0.0 else None,
                "against": {
                    key: {**_error(row.settled.get(key, error)), "with_first_cycle": _error(error)}
                    for key, error in row.whole.items()
                },
            }
            for name, row in rows
        ],
        "recorded_s": data.recorded,
        "asked_s": data.duration,
        "wall_s": data.wall_time,
        "real_time_factor": data.recorded / data.wall_time if data.wall_time > 0.0 else None,
        "pace": next((node.pace for node in health if node.pace.get("paced_ticks")), None),
        "counts": {node.node: node.counts for node in health if node.counts},
    }


def _error(error: TrackingError) -> dict[str, float]:
    return {
        "rms_m": error.rms,
        "max_m": error.maximum,
        "mean_m": error.mean,
        "rms_percent_of_stroke": error.rms_percent,
        "max_percent_of_stroke": error.maximum_percent,
        "stroke_m": error.stroke,
    }


def _draw(data: RunData, rows: Rows) -> list[Shown]:
    """Draw every figure in both themes, save the PNGs beside the page."""
    import matplotlib

    from pzt_ros.report.figures import CAPTIONS, Picture
    from pzt_ros.report.style import THEMES

    folder = data.folder / "figures"
    shown = []
    for name, (draw, needs_rows, caption) in CAPTIONS.items():
        if needs_rows and not rows:
            continue
        encoded = {}
        for theme in THEMES:
            stream = io.BytesIO()
            with matplotlib.rc_context(theme.settings()):
                draw(Picture(data, rows, theme)).savefig(stream, format="png")
            suffix = "" if theme.name == "light" else f"-{theme.name}"
            _write_png(folder / f"{name}{suffix}.png", stream.getvalue())
            encoded[theme.name] = base64.b64encode(stream.getvalue()).decode("ascii")
        shown.append(Shown(name, encoded["light"], encoded["dark"], caption))
    return shown


def _write_png(path: Path, data: bytes) -> None:
    try:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise BenchError(f"{path}: cannot write: {error.strerror}; choose another place or make room") from None


def _page(data: RunData, rows: Rows, health: list[NodeHealth], summary: Mapping[str, Any], figures: list[Shown]) -> str:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pzt_ros", "templates"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters.update(nm=_nm, percent=_percent, short=_short)
    return environment.get_template("run.html.j2").render(
        data=data,
        rows=rows,
        tracked={row.stretch.number: row for row in data.tracked()},
        summary=summary,
        figures=figures,
        health=health,
        asked=_asked,
        gains=_gains(data, rows),
        command=shlex.join(str(word) for word in data.provenance.get("command", ())),
    )


def _asked(phase: Phase) -> str:
    """What a phase asks, for the table of phases."""
    if isinstance(phase, Scan):
        low, high = 1e6 * phase.low, 1e6 * (phase.low + phase.peak_to_peak)
        return f"{phase.shape}, {low:g} to {high:g} µm, {phase.frequency:g} Hz, {phase.cycles:g} cycles"
    if isinstance(phase, FromFile):
        return Path(phase.path).name
    unit, scale = ("V", 1.0) if phase.quantity == "voltage" else ("µm", 1e6)
    return f"to {scale * getattr(phase, 'to', math.nan):g} {unit}"


def _gains(data: RunData, rows: Rows) -> dict[str, str]:
    """The parameters of every controller in the table, as text."""
    out = {}
    for _, row in rows:
        controller = data.scenario.controllers[row.stretch.controller]
        declared = parameters_of(controller)
        words = [
            f"{name} {getattr(controller, name):.4g}{'' if p.unit == '1' else ' ' + p.unit}"
            for name, p in declared.items()
        ]
        out[row.stretch.controller] = ", ".join(words) or "none"
    return out


def _nm(value: float) -> str:
    return f"{1e9 * value:.0f}" if abs(value) >= 1e-7 else f"{1e9 * value:.1f}"


def _percent(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}" if value < 1.0 else f"{value:.2f}"


def _short(value: float) -> str:
    return f"{value:.3g}"


def _plain(value: Any) -> Any:
    """The same with null in place of NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
