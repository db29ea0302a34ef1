"""The noise floor of a run from the run itself: from neighbouring samples, and from holds where noise is coloured."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pzt_ros.diagnosis.data import RunData
from pzt_ros.diagnosis.lines import without_lines
from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.noise import noise_floor, spread_of
from pzt_ros.sysid.spikes import without_spikes

_LEAST_SHARE = 1e-5  # of the span: a record without noise is still no better than this
_SHORTEST_HOLD = 60  # samples
_SKIPPED = 0.3  # of a hold, from its start: what rings or creeps fast
_FIFTHS = 5  # parts of a hold whose means are compared: what is slower may be creep
_COLOURED = 1.12  # scatter in holds over what neighbouring samples say
_DIES_AWAY = 0.75  # of the scatter in whole holds: less in their second halves is not chance
_PERIODS = 16.0  # of a tone in a hold, so that it stands out

Stretch = tuple[Array, Array]
"""Time [s] and displacement [m] of consecutive samples."""


def with_floors(records: Sequence[Record]) -> list[RunData]:
    """The runs without readings that stand alone, and with the noise of their measurements.

    Raises:
        BenchError: a displacement that does not move.
    """
    looked_at = [without_spikes(record) for record in records]
    floors = displacement_floors([record for record, _ in looked_at])
    spans = [float(np.ptp(record.displacement)) for record, _ in looked_at]
    relative = [floor / span for floor, span in zip(floors, spans, strict=True)]
    found = []
    for (record, spikes), floor in zip(looked_at, floors, strict=True):
        polarization = record.polarization
        weight = 0.0
        if polarization is not None:
            span = float(np.ptp(polarization))
            weight = max(noise_floor(polarization).rms, max(relative) * span)
        found.append(RunData(record, {}, floor, weight, spikes))
    return found


def displacement_floors(records: Sequence[Record]) -> list[float]:
    """Noise of each displacement [m, rms]: third differences, as much larger as holds show slower noise to be.

    One sensor read at one rate has noise of one colour, and a few short holds tell it badly: so by how much is asked of
    all holds of such runs together.

    Raises:
        BenchError: a displacement that does not move.
    """
    singles = [_of_neighbours(record) for record in records]
    stretches = quiet_stretches(records)
    rates = [sampling_class(record) for record in records]
    colours = {}
    for rate in set(rates):
        runs = zip(stretches, singles, rates, strict=True)
        colours[rate] = _colour([hold / single for holds, single, own in runs if own == rate for hold in holds])
    return [single * colours[rate] for single, rate in zip(singles, rates, strict=True)]


def sampling_class(record: Record) -> int:
    """The same for records that are sampled alike, within a fifth."""
    return round(2.0 * math.log2(float(np.median(np.diff(record.time)))))


def quiet_stretches(records: Sequence[Record]) -> list[list[Array]]:
    """Displacement of each record's holds, once what rings or creeps fast is over, without tones [m]."""
    return _without_tones([_settled(record) for record in records])


def _without_tones(runs: Sequence[Sequence[Stretch]]) -> list[list[Array]]:
    """What holds of runs show without tones, which are no noise; nothing of holds too short to tell them apart."""
    clean = [[(time, *without_lines(time, values)) for time, values in holds] for holds in runs]
    frequencies = [frequency for holds in clean for _, _, found in holds for frequency in found]
    shortest = _PERIODS / min(frequencies, default=math.inf)
    return [[left for time, left, _ in holds if time[-1] - time[0] > shortest] for holds in clean]


def _colour(stretches: Sequence[Array]) -> float:
    """Noise as slow as a fifth of a hold over that of neighbouring samples; 1 where that is no more than chance.

    What dies away within a hold is ringing, so where their second halves show far less, those tell.
    """
    colour = spread_of(stretches, _FIFTHS)
    late = spread_of([stretch[stretch.size // 2 :] for stretch in stretches], _FIFTHS)
    colour = late if late < _DIES_AWAY * colour else colour
    return colour if colour > _COLOURED else 1.0


def _of_neighbours(record: Record) -> float:
    span = float(np.ptp(record.displacement))
    if span == 0.0:
        raise BenchError(f"{record.name}: displacement_m stays at {record.displacement[0]:.6g} m; check the sensor")
    return max(noise_floor(record.displacement).rms, _LEAST_SHARE * span)


def _settled(record: Record) -> list[Stretch]:
    """Time and displacement of holds without their beginning."""
    late = [slice(first + int(_SKIPPED * (after - first)), after) for first, after in holds(record.voltage)]
    return [(record.time[hold], record.displacement[hold]) for hold in late if hold.stop - hold.start >= _SHORTEST_HOLD]


def holds(voltage: Array) -> list[tuple[int, int]]:
    """First and after-last sample of stretches of constant voltage."""
    still = np.abs(np.diff(voltage)) <= 1e-6 * float(np.ptp(voltage))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False])).astype(int)))
    return [(int(a), int(b) + 1) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _SHORTEST_HOLD]
