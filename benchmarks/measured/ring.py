"""How fast the bender rings after it is switched on, over time."""

from __future__ import annotations

import numpy as np

from pzt_ros.physics.signals import Array
from pzt_ros.records import Record

WINDOW = 0.004
"""Of the record for one frequency [s]."""

FREQUENCIES = np.arange(600.0, 1400.0, 2.0)
"""Tried [Hz]."""

_STEP = 0.002
_COUNT = 10
_JUMP = 0.2  # of the drive's span: switched on


def switch_on(record: Record) -> int:
    """The first sample after the drive has jumped."""
    jumps = np.abs(np.diff(record.voltage))
    return int(np.argmax(jumps > _JUMP * float(np.ptp(record.voltage)))) + 1


def frequencies(record: Record) -> tuple[Array, Array, Array]:
    """Time after switch-on [s], frequency of the ring [Hz] and its amplitude [m], window by window."""
    begin = float(record.time[switch_on(record)])
    rows = []
    for start in begin + _STEP * np.arange(_COUNT):
        part = (record.time >= start) & (record.time < start + WINDOW)
        time, values = record.time[part] - start, record.displacement[part]
        best = min((_fitted(time, values, f) for f in FREQUENCIES), key=lambda found: found[0])
        rows.append((start + 0.5 * WINDOW - begin, best[1], best[2]))
    found = np.array(rows)
    return found[:, 0], found[:, 1], found[:, 2]


def _fitted(time: Array, values: Array, frequency: float) -> tuple[float, float, float]:
    """Sum of squares left by a parabola and a line of one frequency; the frequency; its amplitude."""
    phase, u = 2.0 * np.pi * frequency * time, time / time[-1]
    columns = np.column_stack((np.ones_like(u), u, u**2, np.cos(phase), np.sin(phase)))
    factors = np.linalg.lstsq(columns, values, rcond=None)[0]
    left = values - columns @ factors
    return float(left @ left), frequency, float(np.hypot(factors[3], factors[4]))
