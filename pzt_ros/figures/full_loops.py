"""Figures 2.4 to 2.8: everything that is recorded of a full loop and of the largest actuator loop."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pzt_ros.figures.canvas import (
    CURRENT,
    DASHED,
    FAST,
    FIELD,
    HOLD_TIME,
    INK,
    POLARIZATION,
    SHADE,
    SLOW,
    STRAIN,
    TIME,
    curve,
    legend_below,
    over_field,
    sheet,
)
from pzt_ros.figures.experiments import ACTUATOR_CHAIN, Record, crossing, experiment, rms_apart, steepest
from pzt_ros.figures.thesis_figure import Drawing, Finding, below, near
from pzt_ros.physics.signals import Array

LOWEST = -0.4
"""Lowest field of the actuator range [kV/mm]."""

_SOURCE = f"actuator chain {ACTUATOR_CHAIN} with all its instruments"


def full_half_sine(samples: int) -> Drawing:
    """Figure 2.4."""
    record = experiment("full-loop", "0.1 Hz", samples=samples)
    gap, _ = strain_gap(record)
    begin, turn = 0, record.ends[0]
    p, s = record.polarization, record.strain
    findings = (
        near("the actuator extends by 13.3 µm at 1.5 kV/mm (2.1.2)", 80 * s[0], 13.3, 0.03, "µm"),
        Finding(
            "|P| and S are slightly lower at -1.5 than at +1.5 kV/mm",
            f"|P| {-p[turn]:.4f} against {p[begin]:.4f} C/m², S {s[turn]:.4f} against {s[begin]:.4f} %",
            bool(0.9 < -p[turn] / p[begin] < 1.0 and 0.85 < s[turn] / s[begin] < 1.0),
        ),
        Finding(
            "strain over polarization is a loop, no parabola",
            f"branches up to {gap:.4f} % apart at the same P, {100 * gap / np.ptp(s):.0f} % of the strain's span",
            bool(gap > 0.05 * np.ptp(s)),
        ),
        _little_growth(record),
        Finding(
            "the current peaks at about 0.6 mA",
            f"{np.max(np.abs(record.current)):.2f} mA; taken as agreeing within a factor 1.5",
            bool(0.4 <= np.max(np.abs(record.current)) <= 0.9),
        ),
    )
    return Drawing(_everything(record), findings, f"{_read_off(record)} {_READING}")


def full_linear(samples: int) -> Drawing:
    """Figure 2.5."""
    record, other = (experiment("full-loop", rate, samples=samples) for rate in ("0.1 kV/mm/s", "0.1 Hz"))
    down = record.leg(0)
    least = float(record.field[down][np.argmin(record.strain[down])])
    findings = (
        *_alike(record, other, 2),
        near("below -0.5 kV/mm strain grows again, (f) (2.2.3)", least, -0.5, 0.2, "kV/mm"),
        _little_growth(record),
    )
    return Drawing(_everything(record), findings, f"{_read_off(record)} {_READING} {_RIPPLE}")


def actuator_half_sine(samples: int) -> Drawing:
    """Figure 2.7."""
    record = experiment("type1", "0.1 Hz", LOWEST, samples=samples)
    whole = experiment("full-loop", "0.1 Hz", samples=samples)
    turn, up = record.ends[0], steepest(record, 1)
    (gap, _), (whole_gap, _) = strain_gap(record), strain_gap(whole)
    branch = whole.leg(0)
    outer = np.interp(-record.field[record.leg(0)], -whole.field[branch], whole.polarization[branch])
    findings = (
        near("P has come down to 0.12 C/m² at -0.4 kV/mm (2.2.3)", record.polarization[turn], 0.12, 0.1, "C/m²"),
        near("and S to 0.02 %", record.strain[turn], 0.02, 0.1, "%"),
        near("on the way up the transformation is most prominent at 0.4 kV/mm", up, 0.4, 0.25, "kV/mm"),
        near(
            "the range doubles the stroke of the usual 0 to 1 kV/mm: it grows by 100 % (2.2.3)",
            100 * (float(np.ptp(record.strain)) / _usual_stroke(record) - 1),
            100.0,
            0.5,
            "%",
        ),
        below(
            "the descending branch is part of the full outer loop",
            "rms distance from that of figure 2.4 over the span",
            rms_apart(record.polarization[record.leg(0)], outer),
            5.0,
        ),
        Finding(
            "strain over polarization is less of a loop than in the full range, but still one",
            f"branches up to {gap:.4f} % apart, in the full loop {whole_gap:.4f} %",
            bool(0.1 * whole_gap < gap < whole_gap),
        ),
    )
    return Drawing(_everything(record), findings, f"{_READING} {_crossing_note(record)} {_RIPPLE}")


def actuator_linear(samples: int) -> Drawing:
    """Figure 2.8."""
    record, other = (experiment("type1", rate, LOWEST, samples=samples) for rate in ("0.1 kV/mm/s", "0.1 Hz"))
    noise = Finding(
        "the current is so low that it is almost buried in the noise",
        f"it peaks at {np.max(np.abs(record.current)):.2f} mA, but this chain's current monitor has no noise",
        None,
    )
    return Drawing(
        _everything(record), (*_alike(record, other, 2), noise), f"{_READING} {_crossing_note(record)} {_RIPPLE}"
    )


def rates(samples: int) -> Drawing:
    """Figure 2.6."""
    figure = sheet(9.0, 6.6, _SOURCE)
    axes = figure.subplots(2, 2, sharex=True)
    findings: list[Finding] = []
    forms = (("half-sine", "0.1 Hz", "1 Hz", "ab"), ("linear", "0.1 kV/mm/s", "1 kV/mm/s", "cd"))
    for row, (form, slow, fast, letters) in zip(axes, forms, strict=True):
        records = [experiment("full-loop", rate, samples=samples) for rate in (slow, fast)]
        for record, colour, style, name in zip(records, (SLOW, FAST), ("-", DASHED), ("slow", "fast"), strict=True):
            label = f"{name}: 0.1 Hz or 0.1 kV/mm/s" if name == "slow" else f"{name}: 1 Hz or 1 kV/mm/s"
            curve(row[0], record.field, record.polarization, colour, label, linestyle=style)
            curve(row[1], record.field, record.strain, colour, linestyle=style)
        over_field(row[0], POLARIZATION, f"({letters[0]}) {form}")
        over_field(row[1], STRAIN, f"({letters[1]}) {form}")
        findings += _faster(form, *records)
    for axis in axes[0]:
        axis.set_xlabel("")
    legend_below(figure, axes[0, 0])
    return Drawing(figure, tuple(findings))


def _faster(form: str, slow: Record, fast: Record) -> list[Finding]:
    """What the higher rate does to the full loop."""
    (down_slow, up_slow), (down_fast, up_fast) = coercive(slow), coercive(fast)
    turn = slow.ends[0]
    found = [
        Finding(
            f"{form}: the faster loop is wider",
            f"coercive fields {down_fast:.2f} and {up_fast:.2f} against {down_slow:.2f} and {up_slow:.2f} kV/mm",
            bool(down_fast < down_slow and up_fast > up_slow),
        ),
        Finding(
            f"{form}: the faster loop has smaller polarization and strain at -1.5 kV/mm",
            f"{-fast.polarization[turn]:.3f} against {-slow.polarization[turn]:.3f} C/m²,"
            f" {fast.strain[turn]:.3f} against {slow.strain[turn]:.3f} %",
            bool(fast.strain[turn] < slow.strain[turn] and -fast.polarization[turn] < -slow.polarization[turn]),
        ),
    ]
    if form == "half-sine":
        (_, wide), (_, narrow) = strain_gap(slow), strain_gap(fast)
        found.append(
            below(
                "strain over polarization is almost exactly the same at 0.1 and 1 Hz (2.2.2)",
                "rms difference of the branches' distance over its largest value",
                float(100 * np.sqrt(np.mean((wide - narrow) ** 2)) / np.max(wide)),
                10.0,
            )
        )
    return found


_RIPPLE = "The ripple of (g) is the model's: its ceramic switches row by row of a lattice 0.7 thermal widths apart."
_READING = "Strain is what the sensor reads, in steps of 0.1 µm with 20 nm of noise; numbers are of the strain itself."


def _everything(record: Record) -> Figure:
    """The eight panels of a complete record, lettered as in the thesis."""
    figure = sheet(12.4, 5.7, _SOURCE)
    upper, lower = figure.subplots(2, 4)
    for axis, letter, values, label in zip(
        upper,
        "aceg",
        (record.field, record.polarization, record.reading, record.current),
        (FIELD, POLARIZATION, STRAIN, CURRENT),
        strict=True,
    ):
        curve(axis, record.time, values, SLOW, linewidth=1.1)
        axis.set(title=f"({letter})", xlabel=TIME, ylabel=label, xlim=(0.0, record.time[-1]))
    pairs = (
        (record.polarization, record.reading, "b", POLARIZATION, STRAIN),
        (record.field, record.polarization, "d", FIELD, POLARIZATION),
        (record.field, record.reading, "f", FIELD, STRAIN),
    )
    for axis, (x, y, letter, across, up) in zip(lower, pairs, strict=False):
        curve(axis, x, y, SLOW, linewidth=1.1)
        axis.set(title=f"({letter})", xlabel=across, ylabel=up)
    _hold(lower[3], record)
    return figure


def _hold(axis: Axes, record: Record) -> None:
    part = record.hold
    since = record.time[part] - record.time[part][0]
    curve(axis, since, record.reading[part], SHADE, "reading", linewidth=0.9)
    curve(axis, since, record.strain[part], INK, "strain")
    middle = float(np.mean(record.strain[part]))
    half = max(0.6 * float(np.ptp(record.strain[part])), 0.004)
    axis.set(title="(h)", xlabel=HOLD_TIME, ylabel=STRAIN, ylim=(middle - 1.5 * half, middle + 1.5 * half))
    axis.legend(loc="lower right")


def strain_gap(record: Record) -> tuple[float, Array]:
    """How far strain on the second leg lies above the first at the same P: the largest, and at 40 P [%]."""
    down, up = record.leg(0), record.leg(1)
    low = max(record.polarization[down].min(), record.polarization[up].min(), 0.0)
    high = min(record.polarization[down].max(), record.polarization[up].max())
    p = np.linspace(low + 0.05 * (high - low), high - 0.05 * (high - low), 40)
    first = np.interp(-p, -record.polarization[down], record.strain[down])
    gap = np.interp(p, record.polarization[up], record.strain[up]) - first
    return float(np.max(gap)), gap


def coercive(record: Record) -> tuple[float, float]:
    """The fields at which the polarization passes 0, downwards and upwards [kV/mm]."""
    down, up = record.leg(0), record.leg(1)
    fields = (crossing(record.field[part], record.polarization[part]) for part in (down, up))
    first, second = fields
    return first, second


def _read_off(record: Record) -> str:
    down, up = coercive(record)
    part = record.leg(0)
    remnant = np.interp(0.0, -record.field[part], record.polarization[part])
    return f"Read off: remnant polarization {remnant:.3f} C/m², coercive fields {down:.2f} and {up:.2f} kV/mm."


def _usual_stroke(record: Record) -> float:
    """Strain from 0 to 1 kV/mm, on the descending branch [%]."""
    part = record.leg(0)
    low, high = np.interp((0.0, -1.0), -record.field[part], record.strain[part])
    return float(high - low)


def _crossing_note(record: Record) -> str:
    """Where the way up crosses the way down in strain over field, if it does."""
    down, up = record.leg(0), record.leg(1)
    above = record.strain[up] - np.interp(-record.field[up], -record.field[down], record.strain[down])
    inner = slice(len(above) // 10, -len(above) // 10)
    place = crossing(record.field[up][inner], above[inner])
    if np.isnan(place):
        return ""
    return f"In (f) the way up crosses the way down at {place:.2f} kV/mm, of which the thesis says nothing."


def _little_growth(record: Record) -> Finding:
    part = record.hold
    growth = 100 * (record.strain[part][-1] - record.strain[part][0]) / float(np.ptp(record.strain))
    return below(
        "over the hold at 1.5 kV/mm strain grows only very little", "growth over the loop's span", float(growth), 5.0
    )


def _alike(linear: Record, half_sine: Record, legs: int) -> tuple[Finding, ...]:
    """How much a linear drive's loop differs from the half-sine one."""
    differences = []
    for name in ("polarization", "strain"):
        parts = []
        for leg in range(legs):
            one, two = linear.leg(leg), half_sine.leg(leg)
            sign = 1.0 if linear.field[one][-1] > linear.field[one][0] else -1.0
            order = np.interp(sign * linear.field[one], sign * half_sine.field[two], getattr(half_sine, name)[two])
            parts.append(order - getattr(linear, name)[one])
        span = float(np.ptp(getattr(linear, name)))
        differences.append(float(100 * np.sqrt(np.mean(np.concatenate(parts) ** 2)) / span))
    return (
        below(
            "its loops are very similar to those of the half-sine",
            f"rms difference over the span: P {differences[0]:.2g} %, S",
            max(differences),
            10.0,
        ),
    )
