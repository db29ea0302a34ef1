"""The gallery: every figure as SVG and PNG, and one self-contained page with what the thesis says beside it."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from pzt_ros.errors import BenchError
from pzt_ros.figures.canvas import for_dark_ground
from pzt_ros.figures.table import FIGURES
from pzt_ros.figures.thesis_figure import AGREES, DIFFERS, NOT_SHOWN, Drawing, ThesisFigure
from pzt_ros.records import write_text
from pzt_ros.report.style import LIGHT

SAMPLES = 200
"""Per leg of a drive."""

CHAPTERS = {"2": "Experiments on the actuator", "3": "Modeling of hysteresis", "4": "Optimal control"}


@dataclass(frozen=True)
class Shown:
    """A figure in the page: what the thesis says, what was drawn, and the picture as SVG for light and dark ground."""

    entry: ThesisFigure
    drawing: Drawing
    light: str
    dark: str

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels of the screen."""
        width, height = self.drawing.figure.get_size_inches()
        return round(96 * width), round(96 * height)

    @property
    def wide(self) -> bool:
        """Whether it has so many panels that it needs the page's whole width, with the text below."""
        return self.size[0] > 1050

    @property
    def data_of_light(self) -> str:
        """For a data URI."""
        return base64.b64encode(self.light.encode()).decode("ascii")

    @property
    def data_of_dark(self) -> str:
        """For a data URI."""
        return base64.b64encode(self.dark.encode()).decode("ascii")


def write_gallery(
    folder: str | Path, samples: int = SAMPLES, tell: Callable[[str], None] = lambda number: None
) -> Path:
    """Draw every figure into a folder: `index.html`, and `figure-2.4.svg` and `.png` for each.

    Args:
        folder: is made; what is there of the same names is replaced.
        samples: per leg of the drives.
        tell: called with each figure's number before it is drawn.

    Raises:
        BenchError: the folder cannot be written.
    """
    folder = Path(folder)
    shown = []
    for entry in FIGURES:
        tell(entry.number)
        drawing = draw(entry, samples)
        light, png = rendered(drawing.figure, entry.number)
        _write_png(folder / f"figure-{entry.number}.png", png)
        write_text(folder / f"figure-{entry.number}.svg", [light])
        shown.append(Shown(entry, drawing, light, for_dark_ground(light)))
    write_text(folder / "index.html", [page(shown)])
    return folder / "index.html"


def draw(entry: ThesisFigure, samples: int = SAMPLES) -> Drawing:
    """One figure, in the colours of the light theme."""
    with matplotlib.rc_context(LIGHT.settings()):
        return entry.draw(samples)


def rendered(figure: Figure, number: str) -> tuple[str, bytes]:
    """A figure as SVG text and as PNG; the same figure gives the same SVG to the byte."""
    vector, raster = io.StringIO(), io.BytesIO()
    with matplotlib.rc_context({**LIGHT.settings(), "svg.hashsalt": number}):
        figure.savefig(raster, format="png")
        figure.set_layout_engine("none")  # laid out already, and that takes most of the time
        figure.savefig(vector, format="svg", metadata={"Date": None})
    return _shorter(vector.getvalue()), raster.getvalue()


def _shorter(svg: str) -> str:
    """The SVG with its coordinates to a hundredth of a point; scales keep their digits."""
    places = r' (?:d|x|y|points)="[^"]*"|translate\([^)]*\)'
    return re.sub(places, lambda found: re.sub(r"(\.\d\d)\d+", r"\1", found[0]), svg)


def _write_png(path: Path, data: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise BenchError(f"{path}: cannot write: {error.strerror}; choose another place or make room") from None


def page(shown: list[Shown]) -> str:
    """The page of the gallery."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pzt_ros", "templates"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["symbols"] = symbols
    findings = [finding for item in shown for finding in item.drawing.findings]
    counts = {word: sum(finding.verdict == word for finding in findings) for word in (AGREES, DIFFERS, NOT_SHOWN)}
    chapters = {
        title: [item for item in shown if item.entry.number.split(".")[0] == number]
        for number, title in CHAPTERS.items()
    }
    return environment.get_template("figures.html.j2").render(chapters=chapters, counts=counts, total=len(findings))


def symbols(text: str) -> str:
    """Text as HTML: E_c and x+ set as symbols, minus signs as such, numbers not torn from their units."""
    import markupsafe

    html = str(markupsafe.escape(text))
    html = re.sub(r"\b([A-Za-z])_([A-Za-z0-9])\b", r"<i>\1</i><sub>\2</sub>", html)
    html = re.sub(r"\bx([+-])(?=[\s,;.]|$)", r"<i>x</i><sub>\1</sub>", html)
    html = re.sub(r"(?<![\w.])-(?=\d)|(?<=<sub>)-(?=</sub>)|(?<= )-(?= )", "\N{MINUS SIGN}", html)
    return markupsafe.Markup(re.sub(r"(?<=\d) (?=%|kV|C/m|µm|mA|Hz|V|s\b|ms\b)", "\N{NO-BREAK SPACE}", html))
