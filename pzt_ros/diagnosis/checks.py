"""What runs have to be before anything is fitted to them: long enough, driven, moving, different, of one actuator."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.noise import noise_floor
from pzt_ros.sysid.turning_points import turning_points

_FEWEST = 200  # samples of a run
_BEYOND_NOISE = 1.5  # standard deviation over noise floor; white noise alone gives 1
_TURN = 0.05  # of the drive's span: a smaller reversal is no turning point
_COVERED = 0.8  # of a range of voltage: what a leg has to cross to be counted

_LARGEST_RATIO = ((0.7, 3.0), (0.3, 5.0), (0.0, 10.0))
"""Share of the ranges of voltage that two runs have in common -> largest ratio of their static gains.

A ferroelectric's gain is no constant: loops of one PNZT ceramic at 1 and 0.1 Hz, full and partial, differ by up to 2.3
(shared/data), a small loop moves by several times less per volt than one that switches, and a first rise three times as
far as the fall after it.
"""
_FIRST_RISE, _RISE, _FALL = "first rise", "rise", "fall"
_VIRGIN = 1.25  # times that limit between first rises: one run may begin virgin, the other where that one ended


def check_runs(train: Sequence[Record], test: Sequence[Record]) -> None:
    """Refuse what cannot be diagnosed.

    Raises:
        BenchError: no runs, one too short, not driven, not moving or given twice, or runs of different actuators.
    """
    if not train:
        raise BenchError("no runs to fit; name at least one CSV file or bag")
    records = (*train, *test)
    for record in records:
        _check_one(record)
    _check_disjoint(records)
    _check_one_actuator(records)


def _check_one(record: Record) -> None:
    if len(record) < _FEWEST:
        raise BenchError(
            f"{record.name}: {len(record)} samples, a diagnosis needs at least {_FEWEST} of each run; give a longer run"
        )
    voltage, displacement = record.voltage, record.displacement
    for column, values in (("voltage_V", voltage), ("displacement_m", displacement)):
        if _ends_outside(values):
            raise BenchError(
                f"{record.name}: {column} ends with {values[-1]:.6g}, all samples before lie between"
                f" {values[:-1].min():.6g} and {values[:-1].max():.6g}; the file seems cut off, copy it anew or remove"
                " its last row"
            )
    if _is_still(voltage):
        raise BenchError(
            f"{record.name}: voltage_V stays at {np.mean(voltage):.6g} V (peak to peak {np.ptp(voltage):.3g} V);"
            " a diagnosis needs a run that is driven"
        )
    if _is_still(displacement):
        raise BenchError(
            f"{record.name}: displacement_m stays at {np.mean(displacement):.6g} m (peak to peak"
            f" {np.ptp(displacement):.3g} m, no more than its noise) while the voltage moves by"
            f" {np.ptp(voltage):.4g} V; check the sensor"
        )


def _ends_outside(values: Array) -> bool:
    """Whether the last sample is off by more than the span of all others: a number that was cut off."""
    low, high = float(values[:-1].min()), float(values[:-1].max())
    return high > low and max(values[-1] - high, low - values[-1]) > high - low


def _is_still(values: Array) -> bool:
    """Constant, or no more than the noise between neighbours."""
    deviation = float(np.std(values))
    return float(np.ptp(values)) == 0.0 or deviation < _BEYOND_NOISE * noise_floor(values).rms


def _check_disjoint(records: Sequence[Record]) -> None:
    seen: dict[str, str] = {}
    for record in records:
        if record.sha256 in seen:
            first = seen[record.sha256]
            same = "is given twice" if first == record.name else f"holds the same data as {first}"
            raise BenchError(f"{record.name}: {same}; give each run once, train and test have to be disjoint")
        seen[record.sha256] = record.name


def _check_one_actuator(records: Sequence[Record]) -> None:
    """Compare static gains of every two runs, where their voltages overlap if they do, rises with rises.

    The first rise of a run is no rise like others: from a virgin state it goes three times as far.
    """
    legs = [_legs(record) for record in records]
    for (a, legs_a), (b, legs_b) in itertools.combinations(zip(records, legs, strict=True), 2):
        low = max(float(a.voltage.min()), float(b.voltage.min()))
        high = min(float(a.voltage.max()), float(b.voltage.max()))
        shared = max(high - low, 0.0) / max(float(np.ptp(a.voltage)), float(np.ptp(b.voltage)))
        limit = next(ratio for least, ratio in _LARGEST_RATIO if shared >= least)
        overlaps = shared >= _LARGEST_RATIO[-2][0]
        spans = [(low, high) if overlaps else (float(run.voltage.min()), float(run.voltage.max())) for run in (a, b)]
        first, second = _static_gains(a, legs_a, *spans[0]), _static_gains(b, legs_b, *spans[1])
        limits = {way: limit * (_VIRGIN if way == _FIRST_RISE else 1.0) for way in first if way in second}
        if limits and all(_ratio(first[way], second[way]) > limits[way] for way in limits):
            way = min(limits, key=lambda way: _ratio(first[way], second[way]) / limits[way])
            where = f"both between {low:.4g} and {high:.4g} V" if overlaps else "each over its own range of voltage"
            raise BenchError(
                f"{b.name}: moves by {second[way] * 1e9:.3g} nm/V where {a.name} moves by {first[way] * 1e9:.3g} nm/V"
                f" ({where}), a ratio of {_ratio(first[way], second[way]):.3g}, at most {limits[way]:g} is believed of"
                " one actuator;"
                " diagnose the runs of each actuator by themselves, or mend the units"
            )


def _legs(record: Record) -> list[tuple[int, int]]:
    """First and after-last sample of each stretch between two turning points of the drive."""
    turns = turning_points(record.voltage, _TURN * float(np.ptp(record.voltage)))
    edges = [0, *turns.tolist(), len(record) - 1]
    return [(first, last + 1) for first, last in itertools.pairwise(edges) if last > first]


def _ratio(one: float, other: float) -> float:
    return max(one, other) / min(one, other)


def _static_gains(record: Record, legs: Sequence[tuple[int, int]], low: float, high: float) -> dict[str, float]:
    """Travel of the displacement over that of the voltage between two voltages [m/V], of rises and of falls.

    The median over legs that cross them, weighted by how long each takes: slow legs are near to static, and drift
    within one is small. Where none goes that way, or nothing moves, that way is missing.
    """
    found: dict[str, list[tuple[float, float]]] = {}
    for first, after in legs:
        voltage = record.voltage[first:after]
        inside = (voltage >= low) & (voltage <= high)
        travel = float(np.ptp(voltage[inside])) if np.any(inside) else 0.0
        moved = float(np.ptp(record.displacement[first:after][inside])) if travel > 0.0 else 0.0
        if travel >= _COVERED * (high - low) and moved > 0.0:
            way = _FALL if voltage[-1] <= voltage[0] else _RISE if first else _FIRST_RISE
            found.setdefault(way, []).append((moved / travel, float(record.time[after - 1] - record.time[first])))
    return {way: _weighted_median(*zip(*legs_of, strict=True)) for way, legs_of in found.items()}


def _weighted_median(values: Sequence[float], weights: Sequence[float]) -> float:
    order = np.argsort(values)
    passed = np.cumsum(np.array(weights)[order])
    return float(values[int(order[np.searchsorted(passed, 0.5 * passed[-1])])])
