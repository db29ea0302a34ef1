"""The noise floor of a run from the run itself: from neighbouring samples, and from holds where noise is coloured."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pzt_ros.diagnosis.data import RunData
from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.noise import noise_floor

_LEAST_SHARE = 1e-5  # of the span: a record without noise is still no better than this
_SHORTEST_HOLD = 60  # samples
_SKIPPED = 0.3  # of a hold, from its start: what rings or creeps fast
_COLOURED = 1.12  # scatter in holds over what neighbouring samples say


def with_floors(records: Sequence[Record]) -> list[RunData]:
    """The runs with the noise of their measurements.

    Raises:
        BenchError: a displacement that does not move.
    """
    floors = [displacement_floor(record) for record in records]
    relative = [floor / float(np.ptp(record.displacement)) for floor, record in zip(floors, records, strict=True)]
    found = []
    for record, floor in zip(records, floors, strict=True):
        polarization = record.polarization
        weight = 0.0
        if polarization is not None:
            span = float(np.ptp(polarization))
            weight = max(noise_floor(polarization).rms, max(relative) * span)
        found.append(RunData(record, {}, floor, weight))
    return found


def displacement_floor(record: Record) -> float:
    """Noise of the displacement [m, rms]: third differences, or the scatter in holds where that is much larger."""
    span = float(np.ptp(record.displacement))
    if span == 0.0:
        raise BenchError(f"{record.name}: displacement_m stays at {record.displacement[0]:.6g} m; check the sensor")
    single = max(noise_floor(record.displacement).rms, _LEAST_SHARE * span)
    holds = _scatter_in_holds(record)
    return holds if holds > _COLOURED * single else single


def _scatter_in_holds(record: Record) -> float:
    """Median over holds of the scatter about a parabola [m]; 0 where there are none."""
    scatters = []
    for first, after in holds(record.voltage):
        first += int(_SKIPPED * (after - first))
        if after - first >= _SHORTEST_HOLD:
            scatters.append(_about_parabola(record.time[first:after], record.displacement[first:after]))
    return float(np.median(scatters)) if scatters else 0.0


def holds(voltage: Array) -> list[tuple[int, int]]:
    """First and after-last sample of stretches of constant voltage."""
    still = np.abs(np.diff(voltage)) <= 1e-6 * float(np.ptp(voltage))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False])).astype(int)))
    return [(int(a), int(b) + 1) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _SHORTEST_HOLD]


def _about_parabola(time: Array, values: Array) -> float:
    u = (time - time.mean()) / max(float(np.ptp(time)), 1e-300)
    columns = np.column_stack((np.ones_like(u), u, u**2))
    left = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return math.sqrt(float(left @ left) / max(values.size - 3, 1))
