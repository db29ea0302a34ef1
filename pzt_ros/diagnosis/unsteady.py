"""Whether a tone that was foretold is there, though at another phase: mains and fans keep no time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import signal as scipy_signal

from pzt_ros.diagnosis.data import SCORE, RunData
from pzt_ros.physics.signals import Array

_signal: Any = scipy_signal  # SciPy carries no types

_STEADY = 1.0  # s over which a phase is taken to stay
_THERE = 0.5  # of the energy that was foretold


def is_unsteady(runs: Sequence[RunData], without: Sequence[Array], told: Sequence[Array]) -> bool:
    """Whether what scores holds half of a foretold tone's energy at whatever phase it has there, second by second.

    Args:
        runs: as they were divided.
        without, told: residuals of the predictions without the tone and with it, of every run [m, each shape (n,)].
    """
    foretold = found = 0.0
    for run, left, beside in zip(runs, without, told, strict=True):
        if SCORE not in run.picks:
            continue
        picks = run.picks[SCORE]
        tone = left[picks] - beside[picks]
        tone = tone - tone.mean()
        phases = np.column_stack((tone, np.imag(_signal.hilbert(tone))))
        time = run.record.time[picks]
        pieces = max(int((time[-1] - time[0]) / _STEADY), 1)
        for part in np.array_split(np.arange(picks.size), pieces):
            seen = left[picks][part] - left[picks][part].mean()
            found += float(np.sum((phases[part] @ np.linalg.lstsq(phases[part], seen, rcond=None)[0]) ** 2))
        foretold += float(tone @ tone)
    return found >= _THERE * foretold > 0.0
