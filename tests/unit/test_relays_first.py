"""A stage of relays with two humps of thresholds, poled before each run, of which nothing was declared: relays tell."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import norm, qmc

from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.data import FIT, RunData, split
from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.diagnosis.flexible import fit_rate_independent
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.outcome import model_of
from pzt_ros.diagnosis.report import Report
from pzt_ros.diagnosis.undeclared import default_chain
from pzt_ros.effects.slow_relaxation import SlowRelaxation
from pzt_ros.parallel import IN_THIS_PROCESS, one_blas_thread
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.records import Record
from pzt_ros.sysid.predict import predict

NOISE, RATE = 10e-9, 200.0
CREEPS = ((0.3, 0.02), (4.0, 0.03))  # seconds, shares

_drawn = qmc.Sobol(3, seed=1).random(2**14)
_one = _drawn[:, 2] < 0.45
_wide = np.abs(np.where(_one, 9.0 + 3.5 * norm.ppf(_drawn[:, 0]), 38.0 + 8.0 * norm.ppf(_drawn[:, 0])))
_middle = np.where(_one, 62.0 + 17.0 * norm.ppf(_drawn[:, 1]), 21.0 * norm.ppf(_drawn[:, 1]))
UP, DOWN = _middle + _wide, _middle - _wide


def path(turns: list[float]) -> Array:
    """Straight from one voltage to the next, at some 150 V/s [V]."""
    legs = [np.linspace(a, b, max(int(abs(b - a) / 150.0 * RATE), 2))[:-1] for a, b in pairwise(turns)]
    return np.concatenate([*legs, [turns[-1]]])


def switched(voltage: Array) -> Array:
    """Polarization of the relays, each up or down [1, shape (n,)]."""
    state = np.where(UP + DOWN > 0.0, -1.0, 1.0)
    found = np.empty(voltage.size)
    for k, volts in enumerate(voltage):
        state[volts > UP], state[volts < DOWN] = 1.0, -1.0
        found[k] = state.mean()
    return found


def run(seed: int, creeps: bool = True) -> Record:
    """Turns and holds, behind a sweep to 150 V and a second at rest that nobody recorded."""
    rng = np.random.default_rng(seed)
    hidden = np.concatenate((path([0.0, 150.0, 0.0]), np.zeros(int(RATE))))
    legs = [path([a, b]) for a, b in pairwise([0.0, 148.0, 5.0, *rng.uniform(0.0, 148.0, 18)])]
    shown = np.concatenate([np.concatenate((leg, np.full(int(h * RATE), leg[-1]))) for leg, h in holds(legs, rng)])
    p = switched(np.concatenate((hidden, shown)))
    moved = 6e-6 * p + 3e-6 * p**2
    for time, share in CREEPS if creeps else ():
        step = 1.0 - np.exp(-1.0 / (RATE * time))
        moved = moved + share * (lfilter([step], [1.0, step - 1.0], moved - moved[0]) + moved[0])
    read = moved[hidden.size :] + NOISE * rng.standard_normal(shown.size)
    return Record(f"run-{seed}", {"time_s": np.arange(shown.size) / RATE, "voltage_V": shown, "displacement_m": read})


def holds(legs: list[Array], rng: np.random.Generator) -> list[tuple[Array, float]]:
    """Every third leg is held for a second or two."""
    return [(leg, float(rng.uniform(1.0, 2.0)) if k % 3 == 2 else 0.0) for k, leg in enumerate(legs)]


@pytest.fixture(scope="module")
def found() -> Report:
    """What is said of it with a creep."""
    return diagnose([run(1), run(2)], [run(3)], workers=IN_THIS_PROCESS)


@pytest.mark.long
def test_the_creep_is_named_beside_relays_and_nothing_is_left(found: Report) -> None:
    """Beside a polycrystal two such stages were "something is missing" after 300 s."""
    assert [effect.name for effect in found.effects] == ["slow_relaxation"]
    assert found.base == {"model": "preisach", "density": "identified"}
    assert max(found.after.train, found.after.selection) < 1.1 * NOISE
    assert found.before.train > 3.0 * NOISE
    assert not found.remains.present


def test_a_model_says_that_its_runs_were_driven_before(model: Hypothesis) -> None:
    """Relays that begin up say so without a reversal, which nothing in the file would tell otherwise."""
    poled = [replace(each, poled=True) for each in model.staged.runs]
    told = [model, replace(model, staged=replace(model.staged, runs=poled))]
    notes = [model_of(each, "model", "").notes["start"]["other"] for each in told]
    assert [each.get("driven_before", False) for each in notes] == [False, True]


def test_what_a_creep_remembers_of_a_poling_is_looked_for_where_the_model_says_so() -> None:
    """Creeping stages of relays were predicted to 95 nm, 13.5 where it is, with 12 nm of noise."""
    creeps = Chain("creeps", (Preisach(), Electrostriction(), SlowRelaxation(share=0.2, longest_time=5.0)))
    turns = [0.0, 145.0, 5.0, *np.random.default_rng(1).uniform(0.0, 145.0, 40)]
    hidden, shown = np.concatenate((path([0.0, 150.0]), np.full(3 * int(RATE), 150.0), path([150.0, 0.0]))), path(turns)
    voltage = np.concatenate((hidden, shown))
    signals = Signals(time=np.arange(voltage.size) / RATE, voltage=voltage)
    read = creeps.step(creeps.init(Rest()), signals)[1].displacement[hidden.size :]
    columns = {"time_s": np.arange(shown.size) / RATE, "voltage_V": shown, "displacement_m": read}
    up = creeps.with_links(lambda link: replace(link, initial="up") if isinstance(link, Preisach) else link)

    def late(driven_before: bool) -> float:
        """What is left of the second half [m]."""
        other = {"settle_s": 1.0, "driven_before": driven_before}
        error = predict(replace(up, notes={"start": {"other": other}}), Record("poled", columns)).error
        return float(np.sqrt(np.mean(error[error.size // 2 :] ** 2)))

    assert late(True) < 0.25 * late(False)


@pytest.fixture(scope="module")
def model() -> Hypothesis:
    """A polycrystal fitted to the same stage without a creep."""
    runs = with_floors([run(seed, creeps=False) for seed in (5, 6, 7)])
    split_runs = split(runs[:2], runs[2:])
    return begun(default_chain(split_runs), split_runs)


def test_two_humps_show_once_the_grid_is_fine(model: Hypothesis) -> None:
    """A prior that was chosen on a coarse grid, which is even anyway, left 1.5 x the noise of such a stage."""
    with one_blas_thread():
        relays = fit_rate_independent(model, lambda text: None, IN_THIS_PROCESS)
    assert max(relays.ratios) < 1.1


def test_a_search_begins_on_fewer_samples_of_every_run(model: Hypothesis) -> None:
    staged = model.staged
    sparse, again = staged.sparse(500), staged.sparse(500)
    assert 500 <= sum(samples_of(each).size for each in sparse.runs[:2]) <= 502
    for few, same, all_of_it in zip(sparse.runs[:2], again.runs[:2], staged.runs[:2], strict=True):
        assert np.array_equal(samples_of(few), samples_of(same))
        assert np.isin(samples_of(few), samples_of(all_of_it)).all()
        assert np.unique(np.diff(samples_of(few))).size > 3  # at no pace that a hum could keep
    assert sparse.runs[2] is staged.runs[2]
    assert staged.sparse(10**6) is staged


def samples_of(data: RunData) -> NDArray[np.intp]:
    return np.asarray(data.picks[FIT])
