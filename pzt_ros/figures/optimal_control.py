"""Figure 4.1: the simplified model of chapter 4 at two frequencies."""

from __future__ import annotations

from functools import cache

import numpy as np

from pzt_ros.figures.canvas import LADDER, POLARIZATION, curve, legend_below, over_field, sheet
from pzt_ros.figures.loads import Load, ramps, respond
from pzt_ros.figures.thesis_figure import Drawing, Finding, below
from pzt_ros.physics.parametrized_single import ParametrizedSingle
from pzt_ros.physics.signals import Array

MODEL = ParametrizedSingle(
    distribution="coercive_without_history",
    coercive_field=1e6,
    spread=2.0e12,
    relaxation_time=1e-2,
    domain_polarization=0.26,
    reciprocal_permittivity=6.67e7,
    temperature=273.0,
    domain_volume=1e-22,
)
"""Section 4.2; b_1 is printed 2.0e22, with which no domain would ever switch."""

SLOW_FREQUENCY, FAST_FREQUENCY = 0.125, 125.0
_AMPLITUDES = (6.0, 4.0, 2.5, 1.5)  # [kV/mm]; the largest is E_max of 4.3


def two_frequencies(samples: int) -> Drawing:
    """Figure 4.1."""
    figure = sheet(9.8, 4.7, "model of chapter 4: coercive fields only, no history")
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    widths: dict[float, list[float]] = {}
    for axis, frequency in zip(axes, (SLOW_FREQUENCY, FAST_FREQUENCY), strict=True):
        widths[frequency] = []
        for amplitude, colour in zip(_AMPLITUDES, LADDER[::2] + LADDER[-1:], strict=True):
            load, p = loop(amplitude, frequency, samples)
            curve(axis, load.field, p, colour, f"±{amplitude:g}")
            widths[frequency].append(_coercive(load, p))
        over_field(axis, POLARIZATION, f"{frequency:g} Hz")
    axes[1].set_ylabel("")
    legend_below(figure, axes[0], "amplitude of a triangle [kV/mm]")
    slow, fast = widths[SLOW_FREQUENCY], widths[FAST_FREQUENCY]
    findings = (
        Finding(
            "the frequency has a dramatic effect on the outer loop",
            f"its coercive field is {slow[0]:.2f} kV/mm at 0.125 Hz and {fast[0]:.2f} kV/mm at 125 Hz",
            bool(fast[0] > 1.3 * slow[0]),
        ),
        Finding(
            "and on the inner loops",
            f"their largest P at 125 Hz over that at 0.125 Hz is {_inner(samples)}, largest amplitude first",
            bool(_inner_ratio(samples, _AMPLITUDES[-1]) < 0.8),
        ),
        below(
            "at 0.125 Hz the relaxation time is negligible (4.3)",
            "the loop's x+ differs from that at a tenth of the frequency by at most",
            _still_relaxing(samples),
            5.0,
        ),
    )
    note = "b₁ is printed 2.0e22 V²/m² and read 2.0e12. The thesis prints neither amplitudes nor the form of the drive."
    return Drawing(figure, findings, note)


@cache
def loop(amplitude: float, frequency: float, samples: int) -> tuple[Load, Array]:
    """The second cycle of a triangle from the depolarised state: field [kV/mm] and P [C/m^2]."""
    load = ramps([amplitude, -amplitude, amplitude, -amplitude, amplitude], samples, 4 * amplitude * frequency)
    p = respond(MODEL, load).polarization
    begin = load.ends[2]
    ends = tuple(end - begin for end in load.ends[3:])
    return Load(load.time[begin:] - load.time[begin], load.field[begin:], ends), p[begin:]


def _coercive(load: Load, p: Array) -> float:
    """The field at which the ascending branch passes P = 0 [kV/mm]."""
    up = load.leg(1)
    return float(np.interp(0.0, p[up], load.field[up]))


def _inner_ratio(samples: int, amplitude: float) -> float:
    _, slow = loop(amplitude, SLOW_FREQUENCY, samples)
    _, fast = loop(amplitude, FAST_FREQUENCY, samples)
    return float(np.max(fast) / np.max(slow))


def _inner(samples: int) -> str:
    return ", ".join(f"{_inner_ratio(samples, amplitude):.2f}" for amplitude in _AMPLITUDES[1:])


def _still_relaxing(samples: int) -> float:
    """The largest difference in x+ between the outer loops at 0.125 and 0.0125 Hz [%]."""
    p, slower = (loop(_AMPLITUDES[0], SLOW_FREQUENCY / factor, samples)[1] for factor in (1.0, 10.0))
    return float(100 * np.max(np.abs(p - slower)) / (2 * MODEL.domain_polarization))
