"""What is unknown of a history as numbers of order 1, which a search or a fit may move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.run import Start

USUAL, WIDE = (0.0, 1.0), (-0.25, 1.25)
"""Shares of prior reversals: half, or all, of a run's range beyond it on each side."""

_ROUNDING = 1e-9  # beyond a bound, what counts as at it
_SOONEST, _LATEST = -2.0, 6.0  # decades of the approach over a usual leg: a jump, and a night's wait


def voltage_bounds(record: Record) -> tuple[float, float]:
    """Where prior reversals are usually looked for [V]: half the run's range beyond it on each side."""
    low, high = float(record.voltage.min()), float(record.voltage.max())
    return low - 0.5 * (high - low), high + 0.5 * (high - low)


def shares_of(record: Record, start: Start) -> list[float]:
    """What is unknown of a history as shares of where it is looked for [-]: its reversals, and its approach."""
    low, high = voltage_bounds(record)
    found = [(voltage - low) / (high - low) for voltage in start.prior_voltages]
    if start.approach is None:
        return found
    return [*found, (math.log10(start.approach / start.leg) - _SOONEST) / (_LATEST - _SOONEST)]


def with_shares(start: Start, record: Record, shares: Sequence[float] | Array) -> Start:
    """A start with what is unknown of its history at shares of where that is looked for."""
    count = len(start.prior_voltages)
    found = replace(start, prior_voltages=voltages_at(record, shares[:count]))
    if start.approach is None:
        return found
    return replace(found, approach=start.leg * 10.0 ** (_SOONEST + (_LATEST - _SOONEST) * float(shares[count])))


def share_bounds(record: Record, start: Start) -> list[tuple[float, float]]:
    """Within which each share of a start may move [-]; wider where a thorough search took reversals beyond."""
    low, high = USUAL
    shares = shares_of(record, start)
    usual = all(low - _ROUNDING <= share <= high + _ROUNDING for share in shares[: len(start.prior_voltages)])
    reversals = [USUAL if usual else WIDE] * len(start.prior_voltages)
    return reversals + [USUAL] * (len(shares) - len(reversals))


def voltages_at(record: Record, shares: Sequence[float] | Array) -> tuple[float, ...]:
    """Of reversals at shares of where they are looked for [V]."""
    low, high = voltage_bounds(record)
    return tuple(low + (high - low) * float(share) for share in shares)
