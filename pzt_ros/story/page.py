"""The page of a story: one self-contained HTML file, its picture as PNG, its numbers as JSON."""

from __future__ import annotations

import base64
import io
import json
import math
from pathlib import Path
from typing import Any

from pzt_ros.diagnosis.page import quantity
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.errors import BenchError
from pzt_ros.experiments.phases import Scan
from pzt_ros.quantities import parameters_of
from pzt_ros.records import write_text
from pzt_ros.report.run import Shown
from pzt_ros.report.verdict import describe
from pzt_ros.story.hidden import NOISE_RMS, RESOLUTION
from pzt_ros.story.outcome import NAMED, Story
from pzt_ros.story.runs import FITTED, REPAIRED, SCANS
from pzt_ros.story.words import gain, headline, outcome, plain, prose

CAPTION = (
    "Left: what was measured in the last run minus what each model predicts over its voltage. Middle: reference minus"
    " true displacement over the last cycle of the scan. Right: RMS of these errors."
)


def write_page(story: Story) -> Path:
    """Write `report.html`, `report.json` and `figures/story*.png` into the story's folder; returns the page's path.

    Raises:
        BenchError: the folder cannot be written.
    """
    import jinja2

    from pzt_ros.story.figures import LABELS

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pzt_ros", "templates"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters.update(nm=_nm, gain=gain, plain=plain, prose=prose)
    page = environment.get_template("story.html.j2").render(
        story=story,
        headline=headline(story),
        outcome=outcome(story),
        right=story.answer == NAMED,
        shown=_drawn(story),
        rows=_rows(story, LABELS),
        parameters=_parameters(story),
        seen=EFFECT_OF[story.hidden.kind].absence,
        sensor=(NOISE_RMS, RESOLUTION),
        scan=_scan(story),
        repaired=REPAIRED,
    )
    write_text(story.folder / "report.json", [json.dumps(_finite(story.as_data()), indent=1) + "\n"])
    write_text(story.folder / "report.html", [page])
    return story.folder / "report.html"


def _scan(story: Story) -> str:
    """What was tracked, in words."""
    return next(describe(row) for row in story.scans[REPAIRED].tracked() if isinstance(row.stretch.phase, Scan))


def _rows(story: Story, labels: dict[str, str]) -> list[dict[str, Any]]:
    """A row for each error: its RMS [m] by run, and how many times it fell."""
    kinds: dict[str, tuple[dict[str, float], dict[str, float]]] = {
        "prediction, last run": ({run: found.rms for run, found in story.predictions.items()}, {})
    }
    for name in story.controllers:
        errors = {run: story.tracking[run][name] for run in SCANS}
        kinds[f"tracking, {name}"] = (
            {run: error.rms for run, error in errors.items()},
            {run: error.maximum for run, error in errors.items()},
        )
    return [
        {
            "name": name,
            "rms": rms,
            "max": largest,
            "labels": labels,
            "gain": rms[FITTED] / rms[REPAIRED] if rms[REPAIRED] > 0.0 else math.inf,
        }
        for name, (rms, largest) in kinds.items()
    ]


def _parameters(story: Story) -> list[dict[str, str]]:
    """Of the hidden effect: as it was, and as it was found where it was named."""
    fit = story.report.model.notes.get("fit", {}).get("parameters", {})
    rows = []
    for name, declared in parameters_of(story.hidden).items():
        hidden = {"value": getattr(story.hidden, name), "unit": declared.unit}
        found = fit.get(f"{story.hidden.kind}.{name}")
        told = quantity(found, hidden) if found else ""
        rows.append({"name": name, "text": declared.description, "hidden": quantity(hidden), "found": told})
    return rows


def _drawn(story: Story) -> Shown:
    """The picture in both themes, saved beside the page."""
    import matplotlib

    from pzt_ros.report.style import THEMES
    from pzt_ros.story.figures import Picture, story_figure

    encoded = {}
    for theme in THEMES:
        stream = io.BytesIO()
        with matplotlib.rc_context(theme.settings()):
            story_figure(Picture(story, theme)).savefig(stream, format="png")
        suffix = "" if theme.name == "light" else f"-{theme.name}"
        _write_png(story.folder / "figures" / f"story{suffix}.png", stream.getvalue())
        encoded[theme.name] = base64.b64encode(stream.getvalue()).decode("ascii")
    return Shown("story", encoded["light"], encoded["dark"], CAPTION)


def _write_png(path: Path, data: bytes) -> None:
    try:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise BenchError(f"{path}: cannot write: {error.strerror}; choose another place or make room") from None


def _nm(value: float) -> str:
    return f"{1e9 * value:.0f}" if abs(value) >= 1e-7 else f"{1e9 * value:.3g}"


def _finite(value: Any) -> Any:
    """The same with null for numbers that JSON has not."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
