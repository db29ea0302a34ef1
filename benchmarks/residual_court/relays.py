"""Thermally activated relays on the half plane of their switching fields: the court's own polycrystal.

Other coordinates and another integration than the library's lattice: nodes lie on a grid of upward field a = Ec - Ee
and downward field b = -Ec - Ee; domains that the drive never brings to switch one way are gathered in a rim; where
rates are nil or a domain has arrived nothing is computed. Rates are the Boltzmann ratios of thesis (3.9) and (3.10) in
logarithms. Units inside: field MV/m, time s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import special

from .densities import DENSITIES, Parameters

Array = NDArray[np.float64]

_CACHE = __name__.startswith("pzt_benchmarks.")  # on disk Numba knows a file by one name only

SPACING = 0.35
"""Distance of nodes over the thermal width; x+ is then good to 1e-5."""

COARSE_SPACING = 0.42
"""Good enough for tangents."""

_REACH = 6.0  # thermal widths beyond the drive within which a domain still may switch
_TAIL = 5.0  # of the fields beyond the drive that are gathered in the rim [MV/m]
_TABLE_LOW, _TABLE_HIGH, _TABLE_STEP = -8.0, 90.0, 1.0 / 256.0
_NIL = 1e-14  # share that switches within a step: nothing
_STILL = 0.02  # change of field over thermal width within which the rate in the middle stands for all
_SUBSTEP = 0.08  # change of field over thermal width that one substep may bring


def rate_table() -> Array:
    """Rate times tau over (field - barrier)/d: exp(-z^2)/erfc(z), by way of the logarithm of the normal integral."""
    z = np.arange(_TABLE_LOW, _TABLE_HIGH + _TABLE_STEP, _TABLE_STEP)
    return np.exp(-(z**2) - np.log(2.0) - special.log_ndtr(-np.sqrt(2.0) * z))


_RATES = rate_table()


@dataclass(frozen=True)
class Grid:
    """Nodes and what each weighs.

    Attributes:
        fields: switching fields of both axes [MV/m], shape (n,).
        weights: shape (sets, n + 1, n + 1): rows upward fields and a last one never reached, columns first one never
            reached and then downward fields; zero where a < b.
        virgin: x+ before anything was driven: 1 where the interaction field is positive, same shape without sets.
        fixed: weight of what is always up, and of all, for each set.
    """

    fields: Array
    weights: Array
    virgin: Array
    fixed: Array


def grid_for(
    density: str, variants: list[Parameters], low: float, high: float, width: float, spacing: float = SPACING
) -> Grid:
    """Nodes for a drive between `low` and `high` [MV/m]; a set of weights for each variant of the parameters."""
    step = spacing * width
    # 0 is a node: then the edges Ec = 0 and Ee = 0 run through nodes, and the trapezoidal rule is of second order
    inner = step * np.arange(np.floor((low - _REACH * width) / step), np.ceil((high + _REACH * width) / step) + 1)
    rim = int(np.ceil((_TAIL + high - low) / step))
    fields = np.concatenate([inner[0] + step * np.arange(-rim, 0), inner, inner[-1] + step * np.arange(1, rim + 1)])
    upward, downward = np.meshgrid(fields, fields, indexing="ij")
    ec, ee = 0.5 * (upward - downward), -0.5 * (upward + downward)
    first, after = rim, rim + inner.size
    virgin_all = np.where(ee > 1e-9, 1.0, np.where(ee < -1e-9, 0.0, 0.5))
    edge = np.where(ec > 1e-9, 1.0, np.where(ec > -1e-9, 0.5, 0.0))  # trapezoidal rule along the line Ec = 0
    weights, fixed, virgin = [], [], None
    for parameters in variants:
        share = edge * DENSITIES[density](np.maximum(ec, 0.0), ee, parameters)
        share /= share.sum()
        table = _gathered(share, first, after)
        fixed.append(share[:first, :first].sum())
        if virgin is None:
            up = _gathered(share * virgin_all, first, after)
            virgin = np.divide(up, table, out=np.zeros_like(up), where=table > 0)
        weights.append(table)
    return Grid(inner, np.array(weights), np.asarray(virgin), np.array(fixed))


def _gathered(share: Array, first: int, after: int) -> Array:
    """Sum the columns below the range into a first one and the rows above it into a last one."""
    rows = np.vstack([share[first:after], share[after:].sum(axis=0)])
    return np.hstack([rows[:, :first].sum(axis=1, keepdims=True), rows[:, first:after]])


def respond(
    grid: Grid,
    time: Array,
    field: Array,
    width: float,
    relaxation_time: float,
    limit: tuple[float, float] = (0.0, np.inf),
) -> tuple[Array, Array]:
    """Share of domains that point up for each set of weights, and the field that was reached [MV/m].

    Args:
        limit: susceptibility in units of the polarization of all domains [m/MV], and the largest rate [1/s] at which
            x+ + susceptibility * field / 2 may change: the current limit.

    Returns:
        x+ [shape (sets, n)], field [shape (n,)].
    """
    x = grid.virgin.copy()
    reached = field.copy()
    out = np.empty((grid.weights.shape[0], time.size))
    start = np.einsum("kij,ij->k", grid.weights, x) + grid.fixed
    _run(time, reached, x, grid.fields, grid.weights, start, width, relaxation_time, _RATES, *limit, out)
    return out, reached


@njit(cache=_CACHE, error_model="numpy")
def _rate(z, table):  # type: ignore[no-untyped-def]
    place = (z - _TABLE_LOW) / _TABLE_STEP
    if place <= 0.0:
        return 0.0
    k = min(int(place), table.size - 2)
    return table[k] + (place - k) * (table[k + 1] - table[k])


@njit(cache=_CACHE, error_model="numpy")
def _rates(field, fields, width, table, up, down):  # type: ignore[no-untyped-def]
    for k in range(fields.size):
        up[k] = _rate((field - fields[k]) / width, table)
        down[k] = _rate((fields[k] - field) / width, table)


@njit(cache=_CACHE, fastmath=True, error_model="numpy")
def _row(x, low, switch, stay, p, q, decay_q, changed):  # type: ignore[no-untyped-def]
    """One row over one substep, columns low to switch with upward switching only, from there to stay with both."""
    decay_p = np.exp(-p)
    for j in range(low, switch):
        new = 1.0 - (1.0 - x[j]) * decay_p
        changed[j] = new - x[j]
        x[j] = new
    for j in range(switch, stay):
        balance = p / (p + q[j])
        new = balance + (x[j] - balance) * decay_p * decay_q[j]
        changed[j] = new - x[j]
        x[j] = new


@njit(cache=_CACHE, fastmath=True, error_model="numpy")
def _dot(weights, changed, low, high):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(low, high):
        total += weights[j] * changed[j]
    return total


@njit(cache=_CACHE, error_model="numpy")
def _advance(x, full, empty, total, weights, up, down, decay_q, changed):  # type: ignore[no-untyped-def]
    """All rows over one substep; `up` and `down` are rates times its length.

    full[i]: columns below it are at 1, empty[i]: columns from it on are at 0; both to rounding.
    """
    n = up.size
    switch = n + 1
    for j in range(n):
        decay_q[j + 1] = np.exp(-down[j])
        if down[j] > _NIL and j + 1 < switch:
            switch = j + 1
    shifted = changed[1]
    shifted[0] = 0.0
    shifted[1 : n + 1] = down
    for i in range(n + 1):
        end = min(i + 2, n + 1)
        p = up[i] if i < n else 0.0
        full[i] = min(full[i], switch)
        if p > _NIL:
            low, high, both = full[i], end, min(switch, end)
            empty[i] = end
        else:
            p = 0.0
            low, high, both = min(switch, end), min(empty[i], end), min(switch, end)
        if low >= high:
            continue
        if both < low:
            both = low
        _row(x[i], low, both, high, p, shifted, decay_q, changed[0])
        for k in range(total.size):
            total[k] += _dot(weights[k, i], changed[0], low, high)
        if p > 0.0:
            while full[i] < both and x[i, full[i]] > 1.0 - 1e-13:
                full[i] += 1
        else:
            while empty[i] > low and x[i, empty[i] - 1] < 1e-13:
                empty[i] -= 1


@njit(cache=_CACHE, error_model="numpy")
def _step(x, full, empty, total, fields, weights, start, end, span, width, table, work, again):  # type: ignore[no-untyped-def]
    """All domains over one sample; `span` is its length over tau, the field linear from `start` to `end`.

    Rates are averaged by Simpson's rule; where the field hardly moves that in the middle will do, and in a hold
    (`again`) those of the sample before.
    """
    n = fields.size
    up0, down0, up1, down1, up2, down2 = work[2, :n], work[3, :n], work[4, :n], work[5, :n], work[6, :n], work[7, :n]
    way = abs(end - start) / width
    pieces = max(1, int(np.ceil(way / _SUBSTEP)))
    share = span / pieces
    if again:
        _advance(x, full, empty, total, weights, up1, down1, work[8], work)
        return
    if way > _STILL:
        _rates(start, fields, width, table, up0, down0)
    for m in range(pieces):
        _rates(start + (end - start) * (m + 0.5) / pieces, fields, width, table, up1, down1)
        if way <= _STILL:
            up1 *= share
            down1 *= share
        else:
            _rates(start + (end - start) * (m + 1.0) / pieces, fields, width, table, up2, down2)
            for k in range(n):
                up1[k] = share * (up0[k] + 4 * up1[k] + up2[k]) / 6
                down1[k] = share * (down0[k] + 4 * down1[k] + down2[k]) / 6
            up0[:], down0[:] = up2, down2
        _advance(x, full, empty, total, weights, up1, down1, work[8], work)


@njit(cache=_CACHE, error_model="numpy")
def _run(time, field, x, fields, weights, total, width, tau, table, chi, fastest, out):  # type: ignore[no-untyped-def]
    n = fields.size
    full = np.zeros(n + 1, dtype=np.int64)
    empty = np.full(n + 1, n + 1, dtype=np.int64)
    work = np.zeros((9, n + 1))
    limited = np.isfinite(fastest)
    before = 0.0
    x0, full0, empty0, total0 = x.copy(), full.copy(), empty.copy(), total.copy()
    out[:, 0] = total
    for s in range(1, time.size):
        span, start, wanted = time[s] - time[s - 1], field[s - 1], field[s]
        most = fastest * span
        if limited:
            x0[:], full0[:], empty0[:], total0[:] = x, full, empty, total
        held = s > 1 and start == wanted and start == field[s - 2] and abs(span - before) < 1e-9 * span
        _step(x, full, empty, total, fields, weights, start, wanted, span / tau, width, table, work, held)
        before = span
        change = total[0] - total0[0] + 0.5 * chi * (wanted - start)
        if limited and abs(change) > most:
            last, last_ratio, middle = 1.0, abs(change) / most, most / abs(change)
            for _ in range(6):  # secant rule on how far the field may go within the current limit
                x[:], full[:], empty[:], total[:] = x0, full0, empty0, total0
                field[s] = start + middle * (wanted - start)
                _step(x, full, empty, total, fields, weights, start, field[s], span / tau, width, table, work, False)
                ratio = abs(total[0] - total0[0] + 0.5 * chi * (field[s] - start)) / most
                if abs(ratio - 1.0) < 1e-3 or ratio == last_ratio:
                    break
                following = middle + (1.0 - ratio) * (middle - last) / (ratio - last_ratio)
                last, last_ratio, middle = middle, ratio, min(max(following, 0.0), 1.0)
                if middle == last:  # domains on their way draw more than the limit even while the voltage rests
                    break
        for k in range(total.size):
            out[k, s] = total[k]
