"""Specimens drawn at random: the families by name, their parameters within what real ceramics show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .drives import poled
from .families import STROKE, OperatorTruth, RelayTruth, StrainLaw, Truth

RIGHT = "gaussian"
"""The family that the library can represent."""

WRONG = (
    "two_component", "correlated", "skewed", "tilted", "boxy", "heavy_tailed", "strain_law",
    "play_sum", "bouc_wen", "maxwell_slip", "wedge_preisach", "leaning", "factorised",
)  # fmt: skip
"""Families that a Gaussian density cannot: other densities, a strain law, and four operators that are no energy model.

For those up to `heavy_tailed` the library has a formula that comes near, for `leaning` and `factorised` none.
"""


def specimen(family: str, rng: np.random.Generator) -> Truth:
    """A truth of the family, scaled to the stroke of the court."""
    truth = _operator(family, rng) if family in _OPERATORS else _relays(family, rng)
    program = poled(4.0, 0.5).to(-30.0, 1.0).hold(0.2)
    drive = program.drive()
    p, _ = truth.polarization(drive.time, drive.command, 0.0, np.inf)
    y = truth.displacement(p[4000:])
    scale = STROKE / float(np.ptp(y))
    if isinstance(truth, RelayTruth):
        return replace(truth, law=replace(truth.law, gain=truth.law.gain * scale))
    return replace(truth, gain=truth.gain * scale)


def _relays(family: str, rng: np.random.Generator) -> RelayTruth:
    parameters = {
        "coercive_field": rng.uniform(0.42, 0.62),
        "coercive_sigma": rng.uniform(0.35, 0.55),
        "interaction_sigma": rng.uniform(0.38, 0.55),
    }
    more = {
        "two_component": {
            "hard_field": rng.uniform(0.9, 1.1),
            "hard_sigma": rng.uniform(0.1, 0.2),
            "hard_share": rng.uniform(0.15, 0.35),
        },
        "correlated": {"correlation": rng.uniform(0.3, 0.6)},
        "skewed": {"log_sigma": rng.uniform(0.5, 0.8)},
        "tilted": {"tilt": rng.choice((-1, 1)) * rng.uniform(0.2, 0.4)},
        "leaning": {"lean": rng.choice((-1, 1)) * rng.uniform(0.15, 0.35)},
        "factorised": {
            "least": rng.uniform(-0.9, -0.7),
            "up_sigma": rng.uniform(0.3, 0.5),
            "down_sigma": rng.uniform(0.3, 0.5),
        },
    }.get(family, {})  # fmt: skip
    for needless in {"skewed": ["coercive_sigma"], "factorised": ["coercive_sigma", "interaction_sigma"]}.get(
        family, []
    ):
        del parameters[needless]
    kinetics = {
        "relaxation_time": 1e-3 * np.exp(rng.uniform(np.log(0.5), np.log(3.0))),
        "thermal_width": rng.uniform(0.058, 0.08),
        "susceptibility": rng.uniform(0.014, 0.022),
    }
    law = StrainLaw()
    if family == "strain_law":
        law = StrainLaw(
            cubic=rng.choice((-1, 1)) * rng.uniform(0.03, 0.08), quartic=rng.choice((-1, 1)) * rng.uniform(0.03, 0.08)
        )
    density = RIGHT if family == "strain_law" else family
    return RelayTruth(family, density, {**parameters, **more, **kinetics}, law)


_NOT_GAUSSIAN = {"skewed": ("coercive_sigma",), "factorised": ("coercive_sigma", "interaction_sigma")}
_OPERATORS = ("play_sum", "bouc_wen", "maxwell_slip", "wedge_preisach")


def _operator(family: str, rng: np.random.Generator) -> OperatorTruth:
    curvature = {"curvature": rng.uniform(-0.1, 0.1)}
    shape = {
        "play_sum": {"loop": rng.uniform(0.5, 0.8), "memory": rng.uniform(0.1, 0.2)},
        "bouc_wen": {
            "loop": _way(rng) * rng.uniform(0.1, 0.2),
            "beta": rng.uniform(1.5, 3.0),
            "gamma": rng.uniform(-0.8, 0.3),
        },
        "maxwell_slip": {"loop": _way(rng) * rng.uniform(0.4, 0.7), "slip": rng.uniform(0.05, 0.1)},
        "wedge_preisach": {
            "loop": rng.uniform(0.4, 0.7),
            "low": rng.uniform(-0.5, -0.4),
            "high": rng.uniform(1.1, 1.3),
        },
    }[family]
    return OperatorTruth(family, {**shape, **curvature})


def _way(rng: np.random.Generator) -> float:
    """Friction leads its displacement; what lags must be less, or the output would fall after each turn."""
    return float(rng.choice((1.0, -0.3)))
