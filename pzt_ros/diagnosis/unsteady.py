"""Whether a hum that was foretold is there, though at another phase: the mains keep no time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pzt_ros.diagnosis.data import SCORE, RunData
from pzt_ros.effects.mains_hum import MainsHum
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array

_STEADY = 1.0  # s over which a phase is taken to stay
_THERE = 0.5  # of the energy that was foretold


def is_unsteady(model: Chain, runs: Sequence[RunData], without: Sequence[Array], told: Sequence[Array]) -> bool:
    """Whether what scores holds half of a foretold hum's energy at whatever phase it has there, second by second.

    Predictions with it and without differ by more than the hum, for the density beside it was fitted with it: only what
    has its frequency counts.

    Args:
        model: with the hum.
        runs: as they were divided.
        without, told: residuals of the predictions without the hum and with it, of every run [m, each shape (n,)].
    """
    hum = next(link for link in model.links if isinstance(link, MainsHum))
    foretold = found = 0.0
    for run, left, beside in zip(runs, without, told, strict=True):
        if SCORE not in run.picks:
            continue
        picks = run.picks[SCORE]
        turns = 2.0 * np.pi * (hum.frequency + hum.detuning) * run.record.time[picks]
        waves = np.column_stack((np.ones(picks.size), np.sin(turns), np.cos(turns)))
        pieces = max(int(np.ptp(run.record.time[picks]) / _STEADY), 1)
        for part in np.array_split(np.arange(picks.size), pieces):
            both = np.column_stack((left[picks][part], (left - beside)[picks][part]))
            sizes = np.linalg.lstsq(waves[part], both, rcond=None)[0][1:]
            here, said = part.size * np.sum(sizes**2, axis=0)
            found, foretold = found + float(here), foretold + float(said)
    return found >= _THERE * foretold > 0.0
