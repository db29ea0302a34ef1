"""A root between two bounds, step by step: what the inverses share that know how steep their model is."""

from __future__ import annotations

from numba import njit

NEWTON = 20
"""Trials that may follow the slope; from then on brackets are halved, so that every search ends."""


@njit(cache=True, error_model="numpy")
def narrowed(low, high, field, miss, steepness, halve):  # type: ignore[no-untyped-def]
    """The bracket after a trial, and what to try next: Newton's step, or the middle where it leaves the bracket.

    Args:
        low, high: bounds of the root [V/m].
        field: what was tried [V/m].
        miss: how much higher the model came out there than it should [C/m^2].
        steepness: how the model changes with the field there [C/(V m)]; none is known at 0 and below.
        halve: whether to try the middle anyhow, so that the bracket shrinks whatever the model's curve.

    Returns:
        Bounds and next trial [V/m].
    """
    if miss < 0.0:
        low = field
    else:
        high = field
    step = field - miss / steepness if steepness > 0.0 else low
    return low, high, 0.5 * (low + high) if halve or not low < step < high else step
