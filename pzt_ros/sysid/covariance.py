"""Uncertainty of fitted parameters when residuals are correlated in time.

Least squares leaves parameter errors H r with H = (J'J)^-1 J', so their covariance is H C H' with C the covariance of
the residuals. White noise would make C = sigma^2 I; a model that is not quite right leaves slow residuals, and counting
each sample as a fact of its own would make the errors many times too small. C is taken as stationary within a run, from
the residuals' own autocovariance under a Bartlett window (Newey and West 1987).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy import linalg

from pzt_ros.physics.signals import Array

_matmul_toeplitz: Any = linalg.matmul_toeplitz  # SciPy carries no types

_WINDOW = 5.0  # correlation times over which the autocovariance is believed (Sokal's rule)
_LARGEST_SHARE = 0.1  # of a run: longer lags have too few pairs
INDISTINCT = 1e-6  # singular value, relative, below which a direction is not determined


def autocovariance(residual: Array) -> Array:
    """Autocovariance at all lags, biased estimate [m^2, shape (n,)]; the residual's mean is taken as 0."""
    n = residual.size
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(residual, size)) ** 2
    values: Array = np.fft.irfft(spectrum, size)[:n] / n
    return values


def window_length(residual: Array) -> int:
    """Lag beyond which the autocovariance is taken as 0: five correlation times, at most a tenth of the run."""
    covariance = autocovariance(residual)
    if covariance[0] <= 0.0:
        return 1
    longest = max(2, int(_LARGEST_SHARE * residual.size))
    correlation = np.abs(covariance[1:longest]) / covariance[0]
    correlation[correlation < 2.0 / np.sqrt(residual.size)] = 0.0  # what white noise would show, too
    times = 1.0 + 2.0 * np.cumsum(correlation)
    enough = np.flatnonzero(np.arange(1, longest) >= _WINDOW * times)
    return int(enough[0]) + 1 if enough.size else longest


def windowed_autocovariance(residual: Array) -> Array:
    """Autocovariance under the window [m^2, shape (lags,)]."""
    length = window_length(residual)
    taper: Array = 1.0 - np.arange(length) / length
    return autocovariance(residual)[:length] * taper


def correlation_length(residual: Array) -> float:
    """Samples that count as one: 1 + twice the sum of the autocorrelation's magnitude."""
    covariance = windowed_autocovariance(residual)
    if covariance[0] <= 0.0:
        return 1.0
    correlation = np.abs(covariance[1:]) / covariance[0]
    correlation[correlation < 2.0 / np.sqrt(residual.size)] = 0.0
    return 1.0 + 2.0 * float(np.sum(correlation))


def effective_samples(residual: Array) -> float:
    """Independent samples that hold as much as the residual [-]."""
    return residual.size / correlation_length(residual)


def remembered(residual: Array, columns: Array) -> Array:
    """C times columns [m^2, shape (n,) or (n, p)], C the covariance matrix of a stationary residual."""
    first_row = np.zeros(residual.size)
    known = windowed_autocovariance(residual)
    first_row[: known.size] = known
    product: Array = _matmul_toeplitz(first_row, columns)
    return product


def triangle_of(parts: Iterable[Array]) -> Array:
    """R of the QR decomposition of parts that stand upon one another [each shape (n, p); shape (p, p)].

    Its SVD has the singular values and right vectors of the whole in a tenth of the time, and the whole, which is
    hundreds of megabytes, need not be there at once.
    """
    triangle: Array | None = None
    for part in parts:
        stacked = part if triangle is None else np.vstack((triangle, part))
        triangle = np.asarray(np.linalg.qr(stacked, mode="r"))
    assert triangle is not None
    return triangle


def parameter_covariance(
    jacobians: Sequence[Array], residuals: Sequence[Array], places: slice | Sequence[int] = slice(None)
) -> tuple[Array, Array]:
    """Covariance of the parameters, and which of them the data do not determine.

    Args:
        jacobians: of each run, d(residual)/d(parameter), offset already taken out [each shape (n, p)].
        residuals: of each run [each shape (n,)].
        places: the q parameters that are asked for; the others are free beside them.

    Returns:
        Covariance [shape (q, q)], and True where a parameter is not determined [shape (q,)].
    """
    size = np.sqrt(sum(np.einsum("ij,ij->j", jacobian, jacobian, dtype=float) for jacobian in jacobians))
    size[size == 0.0] = 1.0
    n, p = sum(len(jacobian) for jacobian in jacobians), size.size
    _, s, vt = np.linalg.svd(triangle_of(jacobian / size for jacobian in jacobians))
    sound = s > INDISTINCT * s[0]
    undetermined: Array = np.any(np.abs(vt[~sound][:, places]) > 0.1, axis=0)
    gain = (vt[sound][:, places].T / s[sound] ** 2) @ vt[sound] / size / size[places][:, None]
    covariance = np.zeros((len(gain), len(gain)))
    for jacobian, residual in zip(jacobians, residuals, strict=True):
        part = gain @ jacobian.T
        covariance += part @ remembered(residual, part.T)
    spent = p + len(residuals)  # the offsets were fitted, too
    symmetric = 0.5 * (covariance + covariance.T)
    return symmetric * (n / max(1, n - spent)), undetermined
