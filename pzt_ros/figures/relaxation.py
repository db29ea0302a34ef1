"""Figures 2.17 and 3.29 to 3.31: what a constant field of -0.2 kV/mm does after slow and fast drives."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pzt_ros.chains import load_chain
from pzt_ros.figures.canvas import DASHED, FAST, HOLD_TIME, SLOW, STRAIN, curve, legend_below, over_field, sheet
from pzt_ros.figures.experiments import ACTUATOR_CHAIN, Record, experiment
from pzt_ros.figures.thesis_figure import Drawing, Finding, below
from pzt_ros.physics.signals import Array

HELD = -0.2
"""The constant field [kV/mm]."""

_LINEAR, _HALF_SINE = ("0.1 kV/mm/s", "100 kV/mm/s"), ("0.1 Hz", "100 Hz")


def over_time(samples: int) -> Drawing:
    """Figure 2.17."""
    figure = sheet(9.6, 4.0, f"actuator chain {ACTUATOR_CHAIN}")
    axes = figure.subplots(1, 2, sharey=True)
    findings: list[Finding] = []
    for axis, drives, name in zip(axes, (_HALF_SINE, _LINEAR), ("half-sine", "linear"), strict=True):
        pair = _pair(drives, ACTUATOR_CHAIN, samples)
        _relaxation(axis, pair, drives)
        letter = "a" if name == "half-sine" else "b"
        axis.set_title(f"({letter}) after {name} drives")
        axis.legend(loc="upper right")
        findings += _to_one_level(pair, f"{name}: ")
        findings.append(_takes_time(pair, f"{name}: "))
    axes[1].set_ylabel("")
    return Drawing(figure, tuple(findings), _TYPE3)


def measured(samples: int) -> Drawing:
    """Figure 3.29, with the simulated actuator in place of the measured one."""
    figure, pair = _both_panels(ACTUATOR_CHAIN, f"actuator chain {ACTUATOR_CHAIN} in place of the experiment", samples)
    return Drawing(figure, (*_to_one_level(pair), _takes_time(pair)), _TYPE3)


def parametrized(samples: int) -> Drawing:
    """Figure 3.30."""
    figure, pair = _both_panels("thesis-p2", "parametrized model, chain thesis-p2", samples)
    share = _time_to(pair[1], 0.9)
    findings = (
        _rate_shows(pair),
        *_to_one_level(pair),
        Finding(
            "but the drop takes place almost immediately, as in a crystal with one barrier",
            f"after the fast drive 90 % of it take {1e3 * share:.3g} ms; taken as agreeing below 0.1 s",
            bool(share < 0.1),
        ),
    )
    return Drawing(figure, findings, _TYPE3)


def quadrature(samples: int) -> Drawing:
    """Figure 3.31."""
    figure, pair = _both_panels("thesis-q3", "quadrature model, chain thesis-q3", samples)
    slow, fast = (_time_to(record, 0.9) for record in pair)
    times = (_time_to(record, 0.9) for record in _pair(_LINEAR, "thesis-p2", samples))
    findings = (
        *_to_one_level(pair),
        Finding(
            "both relax slowly and asymptotically, as in the experiment",
            f"90 % of the drop take {slow:.2g} s after the slow and {fast:.2g} s after the fast drive, with the"
            f" parametrized model {' and '.join(f'{value:.2g} s' for value in times)}; taken as agreeing above 0.1 s",
            bool(min(slow, fast) > 0.1),
        ),
        _same_kinetics(),
    )
    return Drawing(figure, findings, f"{_TYPE3} The thesis prints no b1 and b2 for it; those of figure 3.6 are taken.")


_TYPE3 = (
    "Drive: minor loop type 3, 1.5 to -0.2 to 0.3 to -0.2 kV/mm, then held for 10 s; strain itself, not its reading."
)


def _pair(drives: tuple[str, str], chain: str, samples: int) -> tuple[Record, Record]:
    slow, fast = (experiment("type3", drive, HELD, chain, samples) for drive in drives)
    return slow, fast


def _both_panels(chain: str, source: str, samples: int) -> tuple[Figure, tuple[Record, Record]]:
    """Strain over field and over the time of the hold, after linear drives."""
    pair = _pair(_LINEAR, chain, samples)
    figure = sheet(9.6, 4.3, source)
    loop, hold = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    for record, colour, style, drive in zip(pair, (SLOW, FAST), ("-", DASHED), _LINEAR, strict=True):
        curve(loop, record.field, record.strain, colour, drive, linestyle=style)
    over_field(loop, STRAIN, "strain over field")
    _relaxation(hold, pair, _LINEAR)
    hold.set_title(f"relaxation at {HELD:g} kV/mm")
    legend_below(figure, loop)
    return figure, pair


def _relaxation(axis: Axes, pair: tuple[Record, Record], drives: tuple[str, str]) -> None:
    for record, colour, style, drive in zip(pair, (SLOW, FAST), ("-", DASHED), drives, strict=True):
        since, strain = _hold(record)
        curve(axis, since, strain, colour, f"after {drive}", linestyle=style)
    axis.set(xlabel=HOLD_TIME, ylabel=STRAIN, xlim=(-0.2, 10.0))


def _hold(record: Record) -> tuple[Array, Array]:
    part = record.hold
    return record.time[part] - record.time[part][0], record.strain[part]


def _time_to(record: Record, share: float) -> float:
    """When a share of the drop over the hold is done [s]."""
    since, strain = _hold(record)
    done = (strain[0] - strain) / (strain[0] - strain[-1])
    return float(since[np.argmax(done >= share)])


def _to_one_level(pair: tuple[Record, Record], name: str = "") -> tuple[Finding, Finding]:
    (_, slow), (_, fast) = (_hold(record) for record in pair)
    begin, end = fast[0] - slow[0], abs(fast[-1] - slow[-1])
    return (
        Finding(
            f"{name}the faster drive starts its relaxation from a higher strain",
            f"from {fast[0]:.4f} against {slow[0]:.4f} %",
            bool(begin > 0),
        ),
        below(
            f"{name}both end at the same level",
            f"{slow[-1]:.4f} and {fast[-1]:.4f} %; distance over that at the beginning",
            float(100 * end / abs(begin)),
            5.0,
        ),
    )


def _takes_time(pair: tuple[Record, Record], name: str = "") -> Finding:
    shares = []
    for record in pair:
        since, strain = _hold(record)
        later = np.interp(1.0, since, strain)
        shares.append(100 * (later - strain[-1]) / (strain[0] - strain[-1]))
    return Finding(
        f"{name}the relaxation is slow and asymptotic over the 10 s",
        f"after 1 s {shares[0]:.0f} % of the drop are still to come after the slow drive, {shares[1]:.0f} % after the"
        " fast one; taken as agreeing above 10 % for the slow one",
        bool(shares[0] > 10.0),
    )


def _rate_shows(pair: tuple[Record, Record]) -> Finding:
    slow, fast = (record.strain[record.ends[0]] for record in pair)
    return Finding(
        "strain over field shows the dependence on rate",
        f"at the first reversal {fast:.4f} % at the high rate against {slow:.4f} %",
        bool(fast > slow),
    )


def _same_kinetics() -> Finding:
    links = [load_chain(name).links[0] for name in ("thesis-p2", "thesis-q3")]
    pairs = [(getattr(link, "domain_volume", None), getattr(link, "relaxation_time", None)) for link in links]
    return Finding(
        "figures 3.30 and 3.31 have the same V_D and τ",
        f"V_D {pairs[0][0]:g} and {pairs[1][0]:g} m³, τ {pairs[0][1]:g} and {pairs[1][1]:g} s",
        pairs[0] == pairs[1],
    )
