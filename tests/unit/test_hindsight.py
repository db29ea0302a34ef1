"""What test runs leave because half of each told its past is not something missing: simulated by a lattice."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest

from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.data import SCORE, SELECTION, RunData, split
from pzt_ros.diagnosis.hindsight import is_of_pasts
from pzt_ros.diagnosis.histories import refitted_from
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.remains import remains_of
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.records import Record
from pzt_ros.sysid.run import Start

RATE, SWEEP, NOISE, FLOORS = 200.0, 100.0, 12e-9, (1.15, math.inf)
CHAIN = Chain(
    "stage",
    (
        Lattice(coercive_field=4.9e5, coercive_field_spread=4e11, interaction_field_spread=6e11, domain_volume=1.2e-22),
        Electrostriction(coefficient=0.022, active_length=8e-3),
    ),
    {"free": ["lattice.coercive_field", "electrostriction.coefficient"]},
)
WIDE = (130.0, -10.0, 110.0, 20.0, 128.0, -10.0, 90.0, 0.0)
NARROW = (70.0, 55.0, 68.0, 57.0, 72.0, 54.0, 69.0, 56.0, 71.0, 55.0, 70.0, 58.0, 68.0, 56.0, 70.0, 55.0, 69.0, 57.0)
LATER = (*NARROW, 120.0, 30.0, 100.0)
"""A run whose first half stays within a narrow loop, so that hardly more than its last reversal is told there."""


def record(hidden: tuple[float, ...], shown: tuple[float, ...], seed: int, hum: float = 0.0) -> Record:
    """What is recorded of a stage after turns that nobody recorded; its sensor hums so much in the end [m]."""
    turns = (0.0, *hidden, *shown)
    steps = [np.linspace(a, b, max(int(abs(b - a) / SWEEP * RATE), 2))[1:] for a, b in pairwise(turns)]
    voltage = np.concatenate(([0.0], *steps))
    first = sum(piece.size for piece in steps[: len(hidden)])
    time = np.arange(voltage.size) / RATE
    _, out = CHAIN.step(CHAIN.init(Rest()), Signals(time=time, voltage=voltage))
    reading = out.displacement + NOISE * np.random.default_rng(seed).standard_normal(time.size)
    reading += hum * np.sin(2 * np.pi * 50.0 * 0.83 * time)
    columns = {"time_s": time[first:] - time[first], "voltage_V": voltage[first:], "displacement_m": reading[first:]}
    return Record(f"run-{seed}", columns)


def told_badly(hum: float) -> tuple[Hypothesis, list[RunData], list[Array]]:
    """A model that is right, a past that is not, what was given, and what the prediction of every run leaves [m]."""
    hidden = (150.0, 30.0)
    runs = split([RunData(record((), WIDE, 1), {}, NOISE)], [RunData(record(hidden, LATER, 2, hum), {}, NOISE)])
    found = refitted_from(begun(CHAIN, runs), {1: Start((95.0, 40.0), 1.0)}, 0)
    outputs = found.staged.outputs(found.vector, [0, 1])
    left = [run.record.displacement - out for run, (out, _) in zip(runs, outputs, strict=True)]
    early = runs[1].picks[SELECTION]
    return found, runs, [left[0] - left[0].mean(), left[1] - left[1][early].mean()]


@pytest.mark.parametrize(("hum", "is_past"), [(0.0, True), (40e-9, False)])
def test_what_is_left_in_hindsight_is_missing(hum: float, is_past: bool) -> None:
    found, runs, left = told_badly(hum)
    late = left[1][runs[1].picks[SCORE]]
    assert np.sqrt(np.mean(late**2)) > 1.5 * NOISE
    assert remains_of(runs, left, *FLOORS).present
    assert is_of_pasts(found, runs, left, FLOORS) is is_past


def test_runs_without_a_past_have_no_hindsight() -> None:
    found, runs, left = told_badly(0.0)
    bare = refitted_from(found, {0: Start(), 1: Start()}, 0)
    assert not is_of_pasts(bare, runs, left, FLOORS)
    trained = [
        dataclasses.replace(run, picks={SELECTION: run.picks[SELECTION]}) if SCORE in run.picks else run for run in runs
    ]
    assert not is_of_pasts(found, trained, left, FLOORS)
