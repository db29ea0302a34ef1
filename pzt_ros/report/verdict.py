"""What a run comes to, in a sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pzt_ros.experiments.phases import Scan
from pzt_ros.report.rundata import RunData
from pzt_ros.report.tracking import PhaseTracking, tracking_error

Rows = Sequence[tuple[str, PhaseTracking]]


def verdict(data: RunData, rows: Rows) -> str:
    """One sentence for somebody who reads nothing else."""
    where = "In simulation, " if data.simulated else "On the stage, "
    if not rows:
        v, y = data.voltage[np.isfinite(data.voltage)], data.displacement[np.isfinite(data.displacement)]
        voltage = f"the voltage ran from {v.min():.1f} to {v.max():.1f} V" if v.size else "no voltage was recorded"
        displacement = f"the displacement from {1e6 * y.min():.3f} to {1e6 * y.max():.3f} µm"
        error = tracking_error(data.reference, data.displacement, 0.0) if data.scenario.manual else None
        if error is not None:
            return (
                f"{where}{voltage} and {displacement}; while an operator had the stage, it followed the reference with"
                f" an RMS error of {nanometres(error.rms)}, {nanometres(error.maximum)} at most."
            )
        return (
            f"{where}{voltage} and {displacement}; no displacement was recorded as asked for, so nothing was tracked."
        )
    label, best = min(rows, key=lambda item: item[1].judged.rms)
    error = best.judged
    text = (
        f"{where}{label} follows {describe(best)} with an RMS error of {nanometres(error.rms)} "
        f"({error.rms_percent:.2g} % of the stroke)"
    )
    compared = [
        f"{other.judged.rms / error.rms:.3g} times better than {name}"
        for name, other in rows
        if other.stretch.controller != best.stretch.controller and other.stretch.phase.kind == best.stretch.phase.kind
    ]
    return text + (": " + listed(compared) if compared else "") + "."


def completeness(data: RunData) -> str:
    """What is missing from the run, in a sentence; empty where it ran to its end."""
    outcome = data.outcome
    if outcome is None:
        what = "This run did not end properly: its supervisor was killed, or is still at work."
    elif outcome.get("exit_code", 1) != 0:
        what = f"This run failed: {outcome.get('sentence', 'no reason given')}."
    elif data.recorded < data.duration - 2.0 * data.scenario.block_size / data.scenario.sample_rate:
        what = f"This run was cut short: {outcome.get('sentence', 'no reason given')}."
    else:
        return ""
    return f"{what} {data.recorded:.2f} of {data.duration:.2f} s were recorded; what follows shows what there is."


def gaps(data: RunData) -> str:
    """What the bag lacks between its first sample and its last, in a sentence; empty where it lacks nothing."""
    lacking = [f"{count} samples of {leaf}" for leaf, count in data.missing.items() if count]
    if not lacking:
        return ""
    return (
        f"The bag lacks {listed(lacking)} between the first and the last: either a node did not publish them (see the"
        " table of the nodes), or the system threw them away before the recorder could read them (`pzt doctor` looks at"
        " its buffers). They count nowhere here."
    )


def describe(row: PhaseTracking) -> str:
    """What was asked in a phase, in words."""
    phase = row.stretch.phase
    if isinstance(phase, Scan):
        return f"the {1e6 * phase.peak_to_peak:g} µm {phase.shape} at {phase.frequency:g} Hz"
    return f"the {phase.kind} of phase {row.stretch.number}"


def nanometres(value: float) -> str:
    """A length [m] as text in nm, three digits."""
    return f"{1e9 * value:.3g} nm" if value < 1e-6 else f"{1e9 * value:.0f} nm"


def listed(parts: Sequence[str]) -> str:
    """a, b and c."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
