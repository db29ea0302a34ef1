"""An element that leads its drive, behind a slew limit: elements that were fitted without that say little of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
import pytest

from pzt_benchmarks.residual_court.operators import bouc_wen
from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.bouc_wen_base import elements_beside, fit_bouc_wen
from pzt_ros.diagnosis.data import split
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.screen import Screen
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.undeclared import default_chain
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record

RATE, NOISE, LIMIT = 1000.0, 15e-9, 500.0  # Hz, m, V/s
HIDDEN = "amplifier_current_limit"


def quiet(text: str) -> None:
    """Says nothing."""


def ramps(turns: Sequence[float], rates: Sequence[float]) -> Array:
    """Straight from one voltage to the next [V]."""
    legs = zip(turns[:-1], turns[1:], rates, strict=True)
    return np.concatenate([np.linspace(a, b, max(int(abs(b - a) / r * RATE), 2))[:-1] for a, b, r in legs])


def drive(rng: np.random.Generator) -> Array:
    """A hold at 50 V, triangles that grow smaller, then ramps to anywhere at 40 to 560 V/s [V]."""
    turns = [50.0, 0.0, 120.0, 0.0, 90.0, 0.0, 60.0, 0.0, *rng.uniform(0.0, 120.0, 40)]
    rates = [120.0] * 7 + list(rng.uniform(40.0, 560.0, 40))
    return np.concatenate((np.full(300, 50.0), ramps(turns, rates)))


def slewed(command: Array) -> Array:
    """No faster than the limit [V]."""
    found, here = np.empty_like(command), command[0]
    for k, volts in enumerate(command):
        here += np.clip(volts - here, -LIMIT / RATE, LIMIT / RATE)
        found[k] = here
    return found


def led(voltage: Array) -> Array:
    """Displacement by a straight line, a bend, and an element that is added to them [m]."""
    u = voltage / 120.0
    return 27e-6 * (u + 0.45 * bouc_wen(u, 1.0, 2.6, 0.9) - 0.07 * u**2)


def run(seed: int) -> Record:
    """A run of a stage that was driven before, and left at 50 V."""
    rng = np.random.default_rng(seed)
    before, command = ramps([0.0, 120.0, 10.0, 50.0], [200.0] * 3), drive(rng)
    read = led(slewed(np.concatenate((before, command))))[before.size :] + NOISE * rng.standard_normal(command.size)
    columns = {"time_s": np.arange(command.size) / RATE, "voltage_V": command, "displacement_m": read}
    return Record(f"run-{seed}", columns)


@pytest.fixture(scope="module")
def bent() -> Hypothesis:
    """Elements without the limit, which slip over three times the field."""
    runs = split(with_floors([run(1), run(2)]), with_floors([run(3)]))
    base = fit_bouc_wen(begun(default_chain(runs), runs), quiet)
    vector = base.vector.copy()
    for place, each in enumerate(base.staged.ceramic.coordinates):
        vector[place] += math.log(3.0) if each.field.startswith("field_") else 0.0
    return fitted(base.staged, vector, most_steps=0)


def test_a_limit_is_sought_beside_elements_that_are_far_off(bent: Hypothesis) -> None:
    """What a screen promises there is too little for a refit, and elements fitted beside the limit leave the noise."""
    asked = Thresholds().on_elements()
    promised = Screen(bent).best(EFFECT_OF[HIDDEN])
    assert promised is not None
    assert promised.total > bent.total_at(asked.flexible_hopeless)
    identify = partial(elements_beside, progress=quiet, settled=asked.settled)
    search = Search(asked, workers=IN_THIS_PROCESS, effects=(EFFECT_OF[HIDDEN],), identify=identify)
    found = search.step(bent)
    assert [each.name for each in found.accepted] == [HIDDEN]
    assert found.after.fit.ratio < 1.2
