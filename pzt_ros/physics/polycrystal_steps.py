"""One step of domains next to each other in a row: the formulas of both integrators that polycrystal_kernel describes.

`r` is x of each [-], p and q the rates up and down [1/s], a decay what they leave over the step [-]; all of shape (n,).
"""

from __future__ import annotations

from numba import njit

from pzt_ros.physics.compiling import WITHIN


@njit(**WITHIN, fastmath=True)
def fall(r, decay):  # type: ignore[no-untyped-def]
    """One step of domains that only switch down, in place."""
    for j in range(r.size):
        r[j] *= decay[j]


@njit(**WITHIN, fastmath=True)
def rise(r, decay):  # type: ignore[no-untyped-def]
    """One step of domains that only switch up, in place."""
    for j in range(r.size):
        r[j] = 1.0 - (1.0 - r[j]) * decay[j]


@njit(**WITHIN, error_model="numpy", fastmath=True)
def midpoint(r, p, p_decay, q, q_decay):  # type: ignore[no-untyped-def]
    """One step towards the equilibrium at mid-step, in place."""
    for j in range(r.size):
        xe = p[j] / (p[j] + q[j])
        moved = xe + (r[j] - xe) * (p_decay[j] * q_decay[j])
        r[j] = min(max(moved, 0.0), 1.0)


@njit(**WITHIN, error_model="numpy", fastmath=True)
def collocate(r, h, p0, pm, p1, q0, qm, q1, p_decay, q_decay):  # type: ignore[no-untyped-def]
    """One step with the rates at its start, middle and end, in place."""
    for j in range(r.size):
        s0 = p0[j] + q0[j]
        sm = pm[j] + qm[j]
        s1 = p1[j] + q1[j]
        x0, xm, x1 = p0[j] / s0, pm[j] / sm, p1[j] / s1
        clock = h / 6.0 * (s0 + 4.0 * sm + s1)
        decay = p_decay[j] * q_decay[j]
        # phi_2 = (exp(-clock) - 1 + clock)/clock^2: Taylor where this cancels; then phi_1 = (1 - exp(-clock))/clock
        c = min(clock, 0.5)
        taylor = 1 / 5040 - c * (1 / 40320 - c * (1 / 362880 - c * (1 / 3628800 - c * (1 / 39916800 - c / 479001600))))
        taylor = 1 / 2 - c * (1 / 6 - c * (1 / 24 - c * (1 / 120 - c * (1 / 720 - c * taylor))))
        direct = (1.0 - (1.0 - decay) / clock) / clock
        phi2 = taylor if clock < 0.5 else direct
        phi1 = 1.0 - clock * phi2
        # where on the inner clock the middle of the step lies; far from 1/2 only where nothing moves
        theta = min(max(h / 24.0 * (5.0 * s0 + 8.0 * sm - s1) / clock, 0.25), 0.75)
        curvature = (xm - x0 - theta * (x1 - x0)) / (theta * (theta - 1.0))
        slope = x1 - x0 - curvature
        moved = x1 + decay * (r[j] - x0) - slope * phi1 - 2.0 * curvature * phi2
        r[j] = min(max(moved, 0.0), 1.0)
