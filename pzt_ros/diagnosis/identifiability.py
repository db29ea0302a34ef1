"""Experiments that cannot tell some effects apart, however their runs are fitted (diagnosis-methods.md 3.4).

Steady cycles of one frequency and amplitude show a delay as an angle, and every effect that is late makes one. Where
the drive only ever went one way, what moves on afterwards may belong to the drive or to the clock. A way back tells.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.strain_laws import STRAIN_LAW
from pzt_ros.effects.load_stiffness import LoadStiffness
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.records import Record
from pzt_ros.sysid.turning_points import turning_points

_LEVEL = 0.03  # of the span: turns at one level
_BACK = 0.01  # of the span: way back that counts as none
_TURN = 0.1  # of the span: way back from which on a turn is one
_EVEN = 0.05  # of a half cycle: scatter of its duration
_FEWEST_TURNS = 4


class Alike(NamedTuple):
    """Effects that runs of a kind cannot tell from one another.

    Attributes:
        is_so: whether runs are of that kind.
        effects: their names.
        remark: why, in words.
        takes_all: whether the hysteresis can take up all of any, so that no refit beside it says more.
    """

    is_so: Callable[[Sequence[Record]], bool]
    effects: frozenset[str]
    remark: str
    takes_all: bool = False


def alike_by_design(records: Sequence[Record]) -> list[Alike]:
    """What runs cannot tell apart, whatever is found in them."""
    return [each for each in _ALIKE if each.is_so(records)]


def stood_in_for(
    declared: Hypothesis, identified: Hypothesis, blind: Sequence[Alike], asked: Thresholds
) -> tuple[tuple[str, ...], ...]:
    """What an identified density may stand in for on runs whose design hides it: one group of names, or none.

    The declared density leaves something that the identified one explains. So either that density is another than
    declared, or there is one of the effects that such runs cannot tell from a density.

    Args:
        declared: the fitted declared model.
        identified: the fitted model with an identified density, without an effect.
        blind: what the runs cannot tell apart by their design.
        asked: what counts as something and as nothing.
    """
    left = max(declared.ratios) > asked.floor and identified.fit.ratio <= asked.floor
    return taken_up(blind)[:1] if left else ()


def taken_up(blind: Sequence[Alike]) -> tuple[tuple[str, ...], ...]:
    """What the hysteresis may have taken up on runs whose design hides it, though nothing is left: groups of names."""
    return tuple((DENSITY, *sorted(each.effects)) for each in blind)


def with_loads(groups: Iterable[tuple[str, ...]], records: Sequence[Record]) -> tuple[tuple[str, ...], ...]:
    """Groups of names, a load beside a sensor's curve and a strain law that tie where no force was recorded.

    A load that does not yield in proportion bends the displacement as they do: of a contact that was lost below half
    the stroke the two left the noise, and it was in no group.
    """
    is_seen = all(record.force is not None for record in records)
    return tuple(group if is_seen or not set(group) >= _CURVES else (*group, LoadStiffness.kind) for group in groups)


_CURVES = frozenset({SensorNonlinearity.kind, STRAIN_LAW})

DENSITY = "hysteresis_density"
"""In the place of an effect, see effects/confounded.py."""


def _one_way(records: Sequence[Record]) -> bool:
    return not any(turning_points(record.voltage, _BACK * float(np.ptp(record.voltage))).size for record in records)


def _one_cycle(records: Sequence[Record]) -> bool:
    span = max(float(np.ptp(record.voltage)) for record in records)
    found = [turning_points(record.voltage, _TURN * span) for record in records]
    if any(places.size < _FEWEST_TURNS for places in found):
        return False
    levels = np.concatenate([record.voltage[places] for record, places in zip(records, found, strict=True)])
    upper = levels > 0.5 * (np.min(levels) + np.max(levels))
    if max(np.ptp(levels[upper]), np.ptp(levels[~upper])) > _LEVEL * span:
        return False
    halves = np.concatenate([np.diff(record.time[places]) for record, places in zip(records, found, strict=True)])
    return bool(np.ptp(halves) <= 2.0 * _EVEN * np.mean(halves))


_ALIKE = (
    Alike(
        _one_cycle,
        frozenset(
            {
                "sensor_lag",
                "amplifier_bandwidth",
                "mechanical_resonance",
                "slow_relaxation",
                "sensor_nonlinearity",
                "strain_polarization_hysteresis",
            }
        ),
        "All runs are cycles of one frequency and amplitude: a lag, a bandwidth, a mode and a relaxation look alike"
        " there, the curve of a sensor and a loop of the strain law bend the one loop as they do, and the hysteresis"
        " may take up much of any.",
        takes_all=True,
    ),
    Alike(
        _one_way,
        frozenset({"slow_relaxation", "thermal_drift", "bias_field"}),
        "The drive only went one way: slow relaxation, drift and a bias field that builds up look alike there, and the"
        " hysteresis may take up much of any.",
    ),
)
