"""Densities of coercive field Ec and interaction field Ee over the domains: one right, the others wrong on purpose.

All take Ec, Ee [MV/m] and a mapping of parameters [MV/m or -] and need not be normalised; nothing lies below Ec = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Parameters = Mapping[str, float]
Density = Callable[[Array, Array, Parameters], Array]


def _bell(values: Array, centre: float | Array, sigma: float | Array) -> Array:
    return np.exp(-0.5 * ((values - centre) / sigma) ** 2) / sigma


def gaussian(ec: Array, ee: Array, p: Parameters) -> Array:
    """Independent Gaussians (thesis 3.12, 3.14): what the library's polycrystal declares."""
    return _bell(ec, p["coercive_field"], p["coercive_sigma"]) * _bell(ee, 0.0, p["interaction_sigma"])


def two_component(ec: Array, ee: Array, p: Parameters) -> Array:
    """A second, harder phase beside the first."""
    hard = _bell(ec, p["hard_field"], p["hard_sigma"]) * _bell(ee, 0.0, 0.6 * p["interaction_sigma"])
    return (1 - p["hard_share"]) * gaussian(ec, ee, p) + p["hard_share"] * hard


def correlated(ec: Array, ee: Array, p: Parameters) -> Array:
    """Interaction fields spread the more, the harder a domain is."""
    spread = p["interaction_sigma"] * (1 + p["correlation"] * (ec / p["coercive_field"] - 1))
    return _bell(ec, p["coercive_field"], p["coercive_sigma"]) * _bell(ee, 0.0, np.maximum(spread, 0.1))


def skewed(ec: Array, ee: Array, p: Parameters) -> Array:
    """Lognormal coercive and logistic interaction fields."""
    safe = np.maximum(ec, 1e-9)
    lognormal = np.exp(-0.5 * (np.log(safe / p["coercive_field"]) / p["log_sigma"]) ** 2) / safe
    return lognormal / np.cosh(ee * 0.9069 / p["interaction_sigma"]) ** 2


def tilted(ec: Array, ee: Array, p: Parameters) -> Array:
    """Interaction fields not symmetric around zero: split normal, a specimen with a built-in direction."""
    sigma = np.where(ee > 0, p["interaction_sigma"] * (1 + p["tilt"]), p["interaction_sigma"] * (1 - p["tilt"]))
    bell = np.exp(-0.5 * (ee / sigma) ** 2)
    return _bell(ec, p["coercive_field"], p["coercive_sigma"]) * bell


def boxy(ec: Array, ee: Array, p: Parameters) -> Array:
    """Flat-topped: Gaussians of the fourth power."""
    flat = np.exp(-(np.abs((ec - p["coercive_field"]) / (1.5 * p["coercive_sigma"])) ** 4))
    return flat * np.exp(-(np.abs(ee / (1.5 * p["interaction_sigma"])) ** 4))


def heavy_tailed(ec: Array, ee: Array, p: Parameters) -> Array:
    """Student's t with three degrees of freedom in both fields."""
    u, w = (ec - p["coercive_field"]) / p["coercive_sigma"], ee / p["interaction_sigma"]
    return (1 + u**2 / 3) ** -2 * (1 + w**2 / 3) ** -2


def leaning(ec: Array, ee: Array, p: Parameters) -> Array:
    """Interaction fields that point the more to one side, the harder a domain is."""
    centre = p["lean"] * (ec - p["coercive_field"])
    return _bell(ec, p["coercive_field"], p["coercive_sigma"]) * _bell(ee, centre, p["interaction_sigma"])


def factorised(ec: Array, ee: Array, p: Parameters) -> Array:
    """Lognormal switching fields up and down that do not know of one another, from `least` on."""
    both = np.ones_like(ec)
    for field, sigma in ((ec - ee, p["up_sigma"]), (ec + ee, p["down_sigma"])):
        safe = np.maximum(field - p["least"], 1e-9)
        bell = np.exp(-0.5 * (np.log(safe / (p["coercive_field"] - p["least"])) / sigma) ** 2) / safe
        both = both * np.where(field > p["least"], bell, 0.0)
    return both


DENSITIES: dict[str, Density] = {
    "gaussian": gaussian,
    "two_component": two_component,
    "correlated": correlated,
    "skewed": skewed,
    "tilted": tilted,
    "boxy": boxy,
    "heavy_tailed": heavy_tailed,
    "leaning": leaning,
    "factorised": factorised,
}
