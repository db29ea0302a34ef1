"""Runs as the identification of a density sees them: which samples count, and where the drive had been before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pzt_ros.diagnosis.data import FIT, SELECTION, RunData
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.identified_problem import MeasuredRun
from pzt_ros.sysid.reach import first_unreached
from pzt_ros.sysid.run import Start, drive_before

Past = tuple[Array, Array]
"""Of a run: when the drive went where, over the first sample [s], and across the ceramic [V] [each shape (n,)]."""

_NO_PAST = np.empty(0), np.empty(0)

Parts = tuple[list[MeasuredRun], list[MeasuredRun]]
"""Runs that are fitted, and runs that choose."""


def parts_of(
    runs: Sequence[RunData],
    voltages: Sequence[Array],
    unknown: Sequence[bool],
    pasts: Sequence[Past] = (),
) -> Parts:
    """Runs with a part to fit, to be fitted, and those with a part that chooses, to choose.

    A start is free only where the run has a past. Free starts everywhere describe runs better, whatever is missing, and
    hide it; and the density beside them need not know what switches on the way up from rest.
    """
    each = list(zip(runs, voltages, unknown, pasts or [_NO_PAST] * len(runs), strict=True))
    fitted_runs = [_after(past, _measured(run, v, free)) for run, v, free, past in each if FIT in run.picks]
    return fitted_runs, [_after(past, _choosing(run, v, free)) for run, v, free, past in each if SELECTION in run.picks]


def driven_before(start: Start, gain: float) -> Past:
    """The drive before a run that begins at 0 V, from where it rested at first."""
    if not start.prior_voltages:
        return _NO_PAST
    rest, before = drive_before(0.0, 0.0, start, gain)
    return np.append(rest.time, before.time), np.append(rest.voltage, before.voltage)


def reversed_before(start: Start, gain: float) -> Past:
    """The reversals before a run; where it rested before these, and when they were, relays do not know."""
    count = len(start.prior_voltages)
    return -start.leg * np.arange(count, 0, -1.0), gain * np.asarray(start.prior_voltages)


def _after(past: Past, run: MeasuredRun) -> MeasuredRun:
    """A run with its past as samples that do not count."""
    time, voltage = past
    return replace(
        run,
        time=np.append(run.time[0] + time, run.time),
        voltage=np.append(voltage, run.voltage),
        measured=np.append(np.full(time.size, run.measured[0]), run.measured),
        counted=np.append(np.zeros(time.size, dtype=bool), run.counted),
        polarization=np.append(np.repeat(run.polarization[:1], time.size), run.polarization),
    )


def _measured(run: RunData, voltage: Array, unknown: bool) -> MeasuredRun:
    record = run.record
    found = MeasuredRun(record.time, voltage, record.displacement, run.noise, run.clear, unknown)
    return _with_polarization(found, run)


def _choosing(run: RunData, voltage: Array, unknown: bool) -> MeasuredRun:
    """A test run as far as its part that chooses goes."""
    record, picks = run.record, run.picks[SELECTION]
    early = slice(int(picks[-1]) + 1)
    counted = np.zeros(len(record), dtype=bool)
    counted[picks] = True
    found = MeasuredRun(
        record.time[early], voltage[early], record.displacement[early], run.noise, counted[early], unknown
    )
    return _with_polarization(found, run)


def _with_polarization(found: MeasuredRun, run: RunData) -> MeasuredRun:
    """With the polarization that was recorded, where it takes part."""
    recorded = run.record.polarization
    if not run.has_polarization or recorded is None:
        return found
    return replace(found, polarization=recorded[: found.time.size], polarization_noise=run.polarization_noise)


def wiped_out(parts: Parts) -> Parts:
    """The same without the samples that a past reaches."""
    fitted_runs, choosing = parts
    return [_wiped_out(run) for run in fitted_runs], [_wiped_out(run) for run in choosing]


def _wiped_out(run: MeasuredRun) -> MeasuredRun:
    """The run without the samples before its drive has been at both its ends: what was before acts no more after that.

    As it is where few would be left.
    """
    since = first_unreached(run.voltage, np.flatnonzero(run.counted), close=0.0)
    return run.part(run.counted & (np.arange(run.time.size) >= since))
