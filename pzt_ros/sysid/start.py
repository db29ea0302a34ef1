"""Samples of a run that count, and what its start adds to them: the offset, and what dies out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.fading import fading_curves
from pzt_ros.sysid.reach import first_unreached
from pzt_ros.sysid.run import FIRST, Span, Start, free_run
from pzt_ros.sysid.run_in import fades, running_in
from pzt_ros.sysid.thinning import thinned
from pzt_ros.sysid.turning_points import turning_points

_LIVES = 0.05  # of its size at first, of what dies out, in the first sample that counts
_TOLD = 2.0  # times as long as it is seen may take what dies out


@dataclass(frozen=True)
class CountedPart:
    """The samples of a run that count.

    Attributes:
        record: the whole run; the chain runs from its first sample.
        picks: indices of the counted samples.
        end: index after the last sample that the chain has to reach.
        poled: whether the stage was driven before, though the run begins at rest.
    """

    record: Record
    picks: NDArray[np.intp]
    end: int
    poled: bool = False

    @property
    def displacement(self) -> Array:
        """Measured at the counted samples [m]."""
        return self.record.displacement[self.picks]


def counted_part(record: Record, span: Span, most: int, poled: bool = False) -> CountedPart:
    """At most `most` evenly chosen samples of a span that a chain can know; it still runs over all of them."""
    first, after = span.of(record)
    stride = math.ceil((after - first) / most)
    picks = np.arange(first, after, stride)
    known = picks[~running_in(record)[picks]]
    return CountedPart(record, known if known.size else picks, after, poled)


def turning_part(part: CountedPart) -> CountedPart:
    """The same samples, and of the others only those at which the drive turns: a chain without a rate passes them by.

    The first samples stay, too, for they say whether the run begins driven.
    """
    return _passing(part, turning_points(part.record.voltage[: part.end], 0.0))


def thinned_part(part: CountedPart) -> CountedPart:
    """The same samples, and of the others only those between which the drive goes straight."""
    early, voltage = slice(part.end), part.record.voltage
    ends = np.array([np.argmin(voltage), np.argmax(voltage)])  # by which bounds of reversals go
    return _passing(part, np.append(thinned(part.record.time[early], voltage[early]), ends))


def _passing(part: CountedPart, others: NDArray[np.intp]) -> CountedPart:
    """The samples that count, the first ones, and some others."""
    kept = np.unique(np.concatenate((np.arange(min(FIRST, part.end)), others, part.picks)))
    columns = {name: column[kept] for name, column in part.record.columns.items()}
    record = replace(part.record, columns=columns)
    return replace(
        part, record=record, picks=np.searchsorted(kept, part.picks), end=int(np.searchsorted(kept, part.end))
    )


def unreached_part(part: CountedPart) -> CountedPart:
    """The same without the samples that a past reaches."""
    since = first_unreached(part.record.voltage, part.picks)
    return replace(part, picks=part.picks[part.picks >= since])


def displacement_of(chain: Chain, part: CountedPart, start: Start) -> Array:
    """Of a chain at the counted samples [m]."""
    return free_run(chain, part.record, start, part.picks, part.end).displacement


def misfit_at(chain: Chain, part: CountedPart, start: Start) -> Array:
    """Measurement minus model at the counted samples [m]."""
    return part.displacement - displacement_of(chain, part, start)


def with_offset(chain: Chain, part: CountedPart, start: Start) -> Start:
    """The same history with the offset that fits the counted samples best, and with what dies out in them."""
    offset, fading = reading_beyond(misfit_at(chain, part, start.without_reading), dying_out(chain, part))
    return replace(start, offset=offset, fading=fading)


def reading_beyond(left: Array, fading: Array) -> tuple[float, tuple[float, ...]]:
    """Offset and sizes of fading curves [1, shape (n, k)] that fit best what a model leaves [m, (n,)] [m].

    Of a curve that has died out before nothing is told.
    """
    lives = np.max(fading, axis=0, initial=0.0) > _LIVES
    columns, sizes = np.column_stack((np.ones(left.size), fading[:, lives])), np.zeros(lives.size)
    offset, *sizes[lives] = np.linalg.lstsq(columns, left, rcond=None)[0]
    return float(offset), tuple(float(size) for size in sizes)


def dying_out(chain: Chain, part: CountedPart) -> Array:
    """What a link of the chain may remember of an unrecorded past in the counted samples [1, shape (n, k)].

    Only as long as an offset can be told from it: of a run of five seconds up to 6 s.
    """
    time = part.record.time
    if not fades(chain, part.record, part.poled):
        return np.zeros((part.picks.size, 0))
    return fading_curves(time, _TOLD * float(time[part.end - 1] - time[part.picks[0]]))[part.picks]
