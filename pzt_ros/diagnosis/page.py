"""The page of a diagnosis: one self-contained HTML file, readable by someone who did not run it."""

from __future__ import annotations

import base64
import io
import itertools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pzt_ros.diagnosis.data import FIT, SCORE, SELECTION, RunData
from pzt_ros.diagnosis.outcome import Errors, interval_95
from pzt_ros.diagnosis.report import Report, Tried
from pzt_ros.diagnosis.views import centred, picked, share_of_span
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import Parameter, parameters_of
from pzt_ros.records import write_text
from pzt_ros.report.run import Shown
from pzt_ros.sysid.result import versions
from pzt_ros.sysid.run import rms

_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_PREFIXED = re.compile(r"(V|m|s|Hz|A|N|K|C)(/[A-Za-z]+)?")  # units whose first factor may take a prefix
_GREEK = {"tau": "τ", "zeta": "ζ", "delta": "δ"}
_COLOURS = 128
_PLACES = {
    "amplifier": "between the command and the voltage at the ceramic",
    "ferroelectric": "at the field in the ceramic",
    "strain": "between polarization and strain",
    "structure": "in the structure that the ceramic moves",
    "sensor": "in the sensor",
}


@dataclass(frozen=True)
class Cell:
    """An error: rms [m], its 95 % interval [m], over the span [-], over the noise floor [-]."""

    rms: float
    interval: tuple[float, float]
    share: float
    times: float


@dataclass(frozen=True)
class Row:
    """Errors of one kind of samples before and after, and what those samples were for."""

    name: str
    use: str
    before: Cell
    after: Cell


def write_page(report: Report, path: Path) -> None:
    """Write the page.

    Raises:
        BenchError: it cannot be written.
    """
    import jinja2

    from pzt_ros.diagnosis.figures import MOST_RUNS

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pzt_ros", "templates"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters.update(
        nm=_nm, percent=_percent, gain=_gain, words=_words, prose=_prose, times=_times, whole=_whole
    )
    page = environment.get_template("diagnosis.html.j2").render(
        report=report,
        headline=tuple(_brief(part, report) for part in _headline(report)),
        seen=_brief(report.remains.what_is_seen, report),
        repaired=report.repaired,
        rows=error_rows(report),
        models=model_rows(report),
        figures={shown.name: shown for shown in _draw(report)},
        effects=EFFECT_OF,
        places=_PLACES,
        steps=_steps(report.tried),
        tied={name for group in report.not_identifiable for name in group},
        links=_links(report),
        parameters=parameter_rows(report),
        quantity=quantity,
        runs=[_run_row(report, number) for number in range(len(report.runs))],
        versions=versions(),
        shown_runs=MOST_RUNS,
    )
    write_text(path, [page])


def error_rows(report: Report) -> list[Row]:
    """The table of errors: train, test, and the halves of the test runs."""
    whole = "all"
    kinds: list[tuple[str, str, Callable[[Errors], list[Array]], Sequence[RunData], str]] = [
        ("train", "fitted", lambda e: picked(report.runs, e.residuals, FIT), report.train, FIT),
    ]
    if report.test:
        tested = slice(len(report.train), None)
        kinds += [
            ("test", "never fitted", lambda e: list(e.residuals[tested]), report.test, whole),
            (
                "test, first half",
                "chooses among effects",
                lambda e: picked(report.runs, e.residuals, SELECTION),
                (),
                SELECTION,
            ),
            (
                "test, second half",
                "scores; looked at once",
                lambda e: picked(report.runs, e.residuals, SCORE),
                (),
                SCORE,
            ),
        ]
    rows = []
    for name, use, of, _, part in kinds:
        cells = [_cell(report, of(found), _share(report, found, part)) for found in (report.before, report.after)]
        rows.append(Row(name, use, *cells))
    return rows


def _share(report: Report, found: Errors, part: str) -> float:
    return found.nrmse if part == "all" else share_of_span(report.runs, found.residuals, part)


def _cell(report: Report, residuals: Sequence[Array], share: float) -> Cell:
    total = math.sqrt(sum(float(r @ r) for r in residuals) / sum(r.size for r in residuals))
    return Cell(total, interval_95(residuals), share, total / report.noise)


def model_rows(report: Report) -> list[tuple[str, Errors, float]]:
    """Name, errors and share of the span where it counts, of the generic models and of ours."""
    named = [*report.baselines.items(), ("the model as declared", report.before)]
    if report.repaired:
        named.append(("with what was found", report.after))
    part = SCORE if report.test else FIT
    return [(name, found, share_of_span(report.runs, found.residuals, part)) for name, found in named]


def parameter_rows(report: Report) -> list[dict[str, Any]]:
    """Every parameter of the stage: what it is, as declared and fitted, and with what was found."""
    before = report.baseline.notes.get("fit", {}).get("parameters", {})
    after = report.model.notes.get("fit", {}).get("parameters", {})
    rows = []
    for name in after:
        kind, field = name.split(".", 1)
        declared = _declared(report.model, kind, field)
        row = {"kind": kind, "field": field, "before": before.get(name), "after": after[name]}
        symbol, text = (declared.symbol, declared.description) if declared else ("", "")
        rows.append({**row, "symbol": _symbol(symbol), "text": text})
    return rows


def _symbol(symbol: str) -> tuple[str, str] | None:
    """Letter and index of a symbol as the thesis writes it."""
    letter, _, index = symbol.partition("_")
    return (_GREEK.get(letter, letter), _GREEK.get(index, index)) if symbol else None


def _declared(chain: Chain, kind: str, field: str) -> Parameter | None:
    for link in chain.links:
        if link.kind == kind:
            found = parameters_of(link).get(field)
            return found if isinstance(found, Parameter) else None
    return None


def quantity(entry: dict[str, Any] | None, beside: dict[str, Any] | None = None) -> str:
    """Value, standard error and unit of a parameter as text, to two digits of the error; scaled as the one beside."""
    if entry is None:
        return "-"
    value, std, unit = float(entry["value"]), entry.get("std"), str(entry.get("unit", "1"))
    exponent = _exponent(value if beside is None else float(beside["value"]), unit)
    scaled, error = value / 10.0**exponent, (std or 0.0) / 10.0**exponent
    told = std is not None and std > 0.0 and math.isfinite(std)
    digits = max(0, 1 - math.floor(math.log10(error))) if told else max(0, 3 - _magnitude(scaled))
    digits = min(digits, 8)
    text = f"{scaled:.{digits}f}" + (f" ± {error:.{digits}f}" if told else "")
    suffix = _unit(unit, exponent)
    if told and suffix:
        text = f"({text})" if suffix.startswith("·") else text
    return text + suffix + _interval(entry, exponent, digits)


def _interval(entry: dict[str, Any], exponent: int, digits: int) -> str:
    """The 95 % interval in the unit and to the digits of the value; empty where none was asked for."""
    if "interval_95" not in entry:
        return ""
    lower, upper = (None if end is None else f"{end / 10.0**exponent:.{digits}f}" for end in entry["interval_95"])
    if lower is None or upper is None:
        return ", 95 %: " + (f"at least {lower}" if lower else f"at most {upper}" if upper else "anything")
    return f", 95 %: {lower} to {upper}"


def _magnitude(value: float) -> int:
    return math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0


def _exponent(value: float, unit: str) -> int:
    """Power of ten that is written apart."""
    magnitude = _magnitude(value)
    if _PREFIXED.fullmatch(unit):
        return min(max(3 * math.floor(magnitude / 3), -12), 9)
    return magnitude if magnitude < -2 or magnitude > 4 else 0


def _unit(unit: str, exponent: int) -> str:
    if _PREFIXED.fullmatch(unit):
        return f" {_PREFIXES[exponent]}{unit}"
    unit = unit.replace("*", "·").replace("^2", "²").replace("^3", "³").replace("^4", "⁴")
    power = "" if exponent == 0 else "·10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return power + ("" if unit == "1" else f" {unit}")


def _brief(text: str, report: Report) -> str:
    """Text with the names of runs without their folders; the table of runs has them whole."""
    for run in report.runs:
        text = text.replace(run.record.name, Path(run.record.name).name or run.record.name)
    return text


def _headline(report: Report) -> tuple[str, str]:
    """The first sentence of the verdict, and the rest."""
    first, _, rest = report.verdict.partition(". ")
    return (first if not rest else f"{first}."), rest


def _steps(tried: Sequence[Tried]) -> list[tuple[str, list[Tried], list[Tried]]]:
    """By step of the search: what was refitted and what was not, with the base named where there were several."""
    bases = {each.base for each in tried}
    found = []
    for (base, step), group in itertools.groupby(tried, key=lambda each: (each.base, each.step)):
        title = f"Step {step}" + (f", {base} density" if len(bases) > 1 else "")
        members = list(group)
        refitted = [each for each in members if math.isfinite(each.test_rms)]
        found.append((title, refitted, [each for each in members if each not in refitted]))
    return found


def _links(report: Report) -> list[tuple[str, bool]]:
    """The links of the repaired chain in the order of the signal, and whether each was added."""
    own = [link.kind for link in report.baseline.links]
    return [(link.kind, link.kind not in own) for link in report.model.links]


def _run_row(report: Report, number: int) -> dict[str, Any]:
    run = report.runs[number]
    record = run.record
    left = [rms(centred(run, found.residuals[number])) for found in (report.before, report.after)]
    return {
        "name": record.name,
        "file": Path(record.name).name or record.name,
        "role": "test" if SCORE in run.picks else "train",
        "samples": len(record),
        "duration": float(record.time[-1] - record.time[0]),
        "drive": " … ".join(f"{volts:.4g}" for volts in _rounded(record.voltage)),
        "span": float(record.displacement.max() - record.displacement.min()),
        "noise": run.noise,
        "before": left[0],
        "after": left[1],
        "sha256": record.sha256,
        "warnings": record.warnings,
    }


def _rounded(voltage: Array) -> tuple[float, float]:
    """Lowest and highest voltage to a thousandth of the span [V]."""
    digits = 3 - _magnitude(float(voltage.max() - voltage.min()))
    return round(float(voltage.min()), digits) + 0.0, round(float(voltage.max()), digits) + 0.0


def _draw(report: Report) -> list[Shown]:
    """Every figure in both themes."""
    import matplotlib

    from pzt_ros.diagnosis.figures import CAPTIONS, Picture
    from pzt_ros.report.style import THEMES

    shown = []
    for name, (draw, caption) in CAPTIONS.items():
        encoded = {}
        for theme in THEMES:
            stream = io.BytesIO()
            with matplotlib.rc_context(theme.settings()):
                draw(Picture(report, theme)).savefig(stream, format="png")
            encoded[theme.name] = base64.b64encode(_with_palette(stream)).decode("ascii")
        shown.append(Shown(name, encoded["light"], encoded["dark"], caption))
    return shown


def _with_palette(stream: io.BytesIO) -> bytes:
    """The same picture in a palette of colours, a third of the size."""
    from PIL import Image  # comes with matplotlib

    small = io.BytesIO()
    Image.open(stream).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE).save(small, "png", optimize=True)
    return small.getvalue()


def _nm(value: float) -> str:
    value *= 1e9
    return "-" if not math.isfinite(value) else f"{value:.4g}" if abs(value) < 1000 else _grouped(value)


def _percent(share: float) -> str:
    return "-" if not math.isfinite(share) else f"{100 * share:.3g}"


def _times(value: float) -> str:
    return "-" if not math.isfinite(value) else f"{value:.2f}" if value < 100 else f"{value:.0f}"


def _gain(value: float) -> str:
    return (
        "-"
        if not math.isfinite(value)
        else _grouped(value)
        if abs(value) >= 1000
        else f"{value:.1f}".replace("-0.0", "0.0")
    )


def _grouped(value: float) -> str:
    """With narrow spaces between groups of three digits."""
    return f"{value:,.0f}".replace(",", "\u202f")


def _whole(share: float) -> str:
    """A share as a percentage for a table; none where it is unknown."""
    return "-" if not math.isfinite(share) else f"{100 * share + 0.0:.0f} %".replace("-0 %", "0 %")


def _prose(text: str) -> str:
    """Text with the names of effects as words."""
    return re.sub("|".join(EFFECT_OF), lambda found: _words(found.group()), text)


def _words(name: str) -> str:
    return name.replace("_", " ")
