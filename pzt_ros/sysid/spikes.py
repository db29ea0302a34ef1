"""Readings that stand alone, as a bad contact or a lost bit makes them: no motion does, and a fit must not follow them.

One to three of them lie far off what was before and off what comes after, these two agree, and the drive does nothing
of the kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.noise import NORMAL, noise_floor

_UNITS = {"displacement_m": (1e9, "nm"), "polarization_C_per_m2": (1.0, "C/m^2")}  # of what is measured
_LONGEST, _BESIDE = 3, 2  # samples, and those on either side that they are judged by
_FAR = 5.5  # standard deviations of what such a look makes of noise
_LEAST = 1e-5  # of the span: where a simulated reading has no noise, its last digits stand alone
_AROUND = 41  # samples that tell how far fast motion is off all the time
_BOTH = 0.5  # of that: so far it is at least off the line from either side, and at most these off each other
_DRIVEN = 0.25  # of its share of the span: then the drive did it
_MOST = 0.02  # of the samples: what is more frequent is noise, and stays
_FEWEST = 64  # samples


@dataclass(frozen=True)
class Spikes:
    """Readings of one column that stand alone.

    Attributes:
        places: their samples [shape (n,)].
        heights: by how much each is off its neighbours [unit of the column, shape (n,)].
    """

    places: NDArray[np.intp]
    heights: Array

    @property
    def farthest(self) -> tuple[int, float]:
        """The sample that is farthest off, and by how much [unit of the column]."""
        highest = int(np.argmax(np.abs(self.heights)))
        return int(self.places[highest]), float(abs(self.heights[highest]))


def without_spikes(record: Record) -> tuple[Record, dict[str, Spikes]]:
    """The run with curves through their neighbours in place of readings that stand alone, and these, by column.

    Where a row was lost as a whole, all zeros, the voltage is mended, too. The run keeps its fingerprint; one that was
    looked at before comes back as it is.
    """
    measured = {column: record[column] for column in _UNITS if column in record.columns}
    if record.fingerprint or not measured or "voltage_V" not in record.columns:
        return record, {}
    drive = _without_lost_rows(record.voltage, list(measured.values()))
    looked_at = {column: spikes_of(values, drive) for column, values in measured.items()}
    found = {column: spikes for column, spikes in looked_at.items() if spikes.places.size}
    if not found:
        return record, {}
    columns = {**record.columns, "voltage_V": record.voltage.copy()}
    for column, spikes in found.items():
        columns[column] = columns[column].copy()
        columns[column][spikes.places] -= spikes.heights
        columns["voltage_V"][spikes.places] = drive[spikes.places]
    return Record(record.name, columns, record.warnings, fingerprint=record.sha256), found


def _without_lost_rows(voltage: Array, measured: Sequence[Array]) -> Array:
    """The voltage, straight across rows that are all zeros and no more than stand alone together."""
    lost = np.all([values == 0.0 for values in (voltage, *measured)], axis=0)
    if not np.any(lost) or np.all(lost):
        return voltage
    lost &= ~ndimage.binary_opening(lost, np.ones(_LONGEST + 1, dtype=bool))
    place, mended = np.arange(voltage.size), voltage.copy()
    mended[lost] = np.interp(place[lost], place[~lost], voltage[~lost])
    return mended


def told(record: Record, found: Mapping[str, Spikes]) -> list[str]:
    """Of each column with readings that stand alone, how many, and which of them is farthest off."""
    sentences = []
    for column, spikes in found.items():
        (scale, unit), (place, height) = _UNITS[column], spikes.farthest
        farthest = f"{height * scale:.3g} {unit} at {record.time[place]:.6g} s"
        counted = not_counted(spikes.places.size)
        sentences.append(f"{Path(record.name).name}: {counted} in {column}, farthest off is {farthest}")
    return sentences


def not_counted(count: int) -> str:
    """So many readings, in words."""
    return f"{count} {'reading stands alone and does' if count == 1 else 'readings stand alone and do'} not count"


def spikes_of(measured: Array, drive: Array) -> Spikes:
    """The readings of a measurement that stand alone; none where they are too many to be that.

    Args:
        measured: shape (n,).
        drive: at the same samples [V].
    """
    smooth = measured.copy()
    if measured.size >= _FEWEST and np.ptp(measured) > 0.0:
        noise = max(noise_floor(measured).rms, _LEAST * float(np.ptp(measured)))
        for length in range(1, _LONGEST + 1):
            inside, across = _standing_alone(smooth, drive, noise, length)
            smooth[inside] = across
    places = np.flatnonzero(smooth != measured)
    if places.size > _MOST * measured.size:
        places = places[:0]
    return Spikes(places, (measured - smooth)[places])


def _standing_alone(values: Array, drive: Array, noise: float, length: int) -> tuple[NDArray[np.intp], Array]:
    """Samples of stretches of so many with both ends off, and what a curve across each says instead."""
    seen, driven = _seen_across(values, length), _seen_across(drive, length)
    size, sign = np.abs(seen.off), np.sign(seen.off)
    usual = NORMAL * ndimage.median_filter(size, size=(1, _AROUND), mode="nearest")
    far = size > _FAR * np.maximum(usual, noise * seen.spread[:, None])
    beyond = np.minimum(seen.off_before * sign, seen.off_after * sign) > _BOTH * size
    agree = np.abs(seen.off_before - seen.off_after) < _BOTH * size
    undriven = np.abs(driven.off) * float(np.ptp(values)) <= _DRIVEN * size * float(np.ptp(drive))
    alone = far & beyond & agree & undriven
    first = np.flatnonzero(alone[0] & alone[-1])
    return (first + _BESIDE + np.arange(length)[:, None]).ravel(), seen.across[:, first].ravel()


class _Across(NamedTuple):
    """Stretches of so many samples against their two neighbours on either side [each shape (length, m)].

    Attributes:
        across: the cubic through the four.
        off: from it; `off_before`, `off_after`: from the lines through the two before and the two after.
        spread: of `off` for noise of unit spread [shape (length,)].
    """

    across: Array
    off: Array
    off_before: Array
    off_after: Array
    spread: Array


def _seen_across(values: Array, length: int) -> _Across:
    """Every stretch of so many samples; the m-th begins at sample m + _BESIDE."""
    windows = np.lib.stride_tricks.sliding_window_view(values, length + 2 * _BESIDE).T
    before, inside, after = np.split(windows, [_BESIDE, _BESIDE + length])
    place = np.arange(length)[:, None]
    nodes = np.array([-2.0, -1.0, length, length + 1.0])
    weights = np.stack([np.prod([(place[:, 0] - b) / (a - b) for b in nodes if b != a], axis=0) for a in nodes], axis=1)
    across = weights @ np.concatenate((before, after))
    return _Across(
        across,
        inside - across,
        inside - (before[1] + (place + 1) * (before[1] - before[0])),
        inside - (after[0] + (length - place) * (after[0] - after[1])),
        np.sqrt(1.0 + np.sum(weights**2, axis=1)),
    )
