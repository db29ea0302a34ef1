"""Work in threads, in processes and on a Dask cluster is that of this process, to the bit; mistakes are one line."""

from __future__ import annotations

import dataclasses
import importlib
import os
import pickle
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from pzt_ros import parallel
from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.base import fit_declared
from pzt_ros.diagnosis.data import split
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.many import Job, diagnose_many
from pzt_ros.diagnosis.report import Report
from pzt_ros.diagnosis.search import Search
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.errors import BenchError
from pzt_ros.parallel import IN_THIS_PROCESS, Workers, dask_workers, own_threads, processes, threads
from pzt_ros.physics.chain import Chain
from pzt_ros.records import Record
from pzt_ros.sysid.fit import Fit
from pzt_ros.sysid.run import Start, free_run


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """Address of a Dask scheduler with one worker, both in this process."""
    distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    before = parallel._alone
    settings = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(**settings, host="127.0.0.1", protocol="tcp") as running:
        yield running.scheduler_address
    parallel._alone = before


@pytest.fixture(scope="module")
def two_processes() -> Iterator[Workers]:
    with processes(2) as found:
        yield found


@pytest.fixture(scope="module", params=["threads", "processes", "dask"])
def pool(request: pytest.FixtureRequest) -> Iterator[Workers]:
    """Each kind of workers."""
    if request.param == "processes":
        yield request.getfixturevalue("two_processes")
    elif request.param == "threads":
        with threads(2) as found:
            yield found
    else:
        with dask_workers(request.getfixturevalue("cluster")) as found:
            yield found


def test_results_come_in_order_and_mistakes_come_through(pool: Workers) -> None:
    values = [np.arange(3.0) + k for k in range(5)]
    found = list(pool.map(np.multiply, values, [2.0] * 5))
    np.testing.assert_array_equal(found, [2.0 * v for v in values])
    with pytest.raises(BenchError, match="chain 'nosuch'"):
        list(pool.map(load_chain, ["thesis-p2", "nosuch"]))


def test_one_job_is_this_process() -> None:
    for count in (0, 1):
        with processes(count) as pool:
            assert pool is IN_THIS_PROCESS
        with threads(count) as pool:
            assert pool is IN_THIS_PROCESS


def test_a_process_among_others_starts_no_threads(two_processes: Workers, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "_alone", False)
    assert own_threads(4) == 4
    assert list(two_processes.map(own_threads, [4])) == [1]
    with parallel.on_one_core():
        assert own_threads(4) == 1
    assert own_threads(4) == 4


def test_a_process_that_dies_is_one_line() -> None:
    with pytest.raises(BenchError, match="one of 2 processes died"), processes(2) as pool:
        list(pool.map(os._exit, [1]))


@pytest.mark.parametrize("address", ["nonsense", "127.0.0.1:8786", "tcp://127.0.0.1", "tcp://:x"])
def test_what_is_no_address_is_said(address: str) -> None:
    with pytest.raises(BenchError, match="is no address of a scheduler"), dask_workers(address):
        pass


def test_a_scheduler_that_does_not_answer_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(parallel, "PATIENCE", 0.3)
    with (
        pytest.raises(BenchError, match=r"no scheduler answers there within 0.3 s") as said,
        dask_workers("tcp://127.0.0.1:1"),
    ):
        pass
    assert "\n" not in str(said.value)


def test_a_scheduler_without_workers_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(parallel, "PATIENCE", 0.5)
    settings = {"n_workers": 0, "processes": False, "dashboard_address": "127.0.0.1:0", "protocol": "tcp"}
    with (
        distributed.LocalCluster(**settings, host="127.0.0.1") as empty,
        pytest.raises(BenchError, match=r"has no worker after 0\.5 s"),
        dask_workers(empty.scheduler_address),
    ):
        pass


def test_a_worker_with_another_version_is_refused(cluster: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "_stay_on_one_core", lambda: dict.fromkeys(parallel._MATTERS, "0.0"))
    with (
        pytest.raises(BenchError, match=r"has pzt_ros 0\.0, numpy 0\.0, .* install the same versions"),
        dask_workers(cluster),
    ):
        pass


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.import_module

    def refused(name: str, *rest: Any) -> Any:
        if name == "distributed":
            raise ModuleNotFoundError(name)
        return found(name, *rest)

    monkeypatch.setattr(importlib, "import_module", refused)
    with pytest.raises(BenchError, match=r"pip install 'pzt_ros\[dask\]'"), dask_workers("tcp://127.0.0.1:8786"):
        pass


NOISE = 10e-9


def stage() -> Chain:
    """Thesis set P2, from a start that costs nothing, with two free parameters."""
    free = [f"parametrized.{name}" for name in ("shape_ascending", "relaxation_time")]
    chain = load_chain("thesis-p2")
    links = [
        dataclasses.replace(link, **({"start": "negative"} if link.kind == "parametrized" else {}))
        for link in chain.links
    ]
    return dataclasses.replace(chain, links=tuple(links), notes={"free": free})


def lagging(seed: int) -> Record:
    """A run of the stage through a sensor that is 8 ms late."""
    time = np.arange(0.0, 2.0, 0.005)
    voltage = 60.0 - 60.0 * np.cos(2.0 * np.pi * 0.5 * time) + 12.0 * np.sin(2.0 * np.pi * (3.0 + seed) * time)
    blank = Record("blank", {"time_s": time, "voltage_V": voltage, "displacement_m": time})
    y = free_run(stage(), blank, Start(), slice(None), time.size).displacement
    y = np.interp(time - 8e-3, time, y) + NOISE * np.random.default_rng(seed).standard_normal(time.size)
    return Record(f"run-{seed}", {**blank.columns, "displacement_m": y})


@pytest.fixture(scope="module")
def fitted() -> Hypothesis:
    return fit_declared(stage(), split(with_floors([lagging(1)]), with_floors([lagging(2)])), lambda text: None)


def refits(fitted: Hypothesis, workers: Workers) -> list[tuple[str, list[float]]]:
    search = Search(effects=[EFFECT_OF[name] for name in ("sensor_lag", "amplifier_bandwidth")], workers=workers)
    return [(c.name, c.after.vector.tolist()) for c in search.step(fitted).candidates]


def test_candidates_are_the_same_wherever_they_are_refitted(pool: Workers, fitted: Hypothesis) -> None:
    here = refits(fitted, IN_THIS_PROCESS)
    assert {name for name, _ in here} == {"sensor_lag", "amplifier_bandwidth"}
    assert refits(fitted, pool) == here


def test_a_fit_is_the_same_wherever_the_chain_runs(two_processes: Workers) -> None:
    records = [lagging(3), lagging(4)]
    here = Fit(stage(), profile=True).fit(records)
    there = Fit(stage(), profile=True, workers=two_processes).fit(records)
    assert there.estimates == here.estimates
    assert all(estimate.interval is not None for estimate in here.estimates)
    assert there.runs == here.runs


def test_a_bad_set_of_many_does_not_stop_the_others() -> None:
    still = lagging(5)
    flat = Record("flat", {**still.columns, "voltage_V": np.full(len(still), 3.0)})
    jobs = [Job([flat], [lagging(6)], stage()), Job([lagging(7)], [lagging(8)], stage(), "a command")]
    bad, good = pickle.loads(pickle.dumps(list(diagnose_many(pickle.loads(pickle.dumps(jobs)), IN_THIS_PROCESS))))
    assert isinstance(bad, BenchError)
    assert "voltage_V stays at 3 V" in str(bad)
    assert isinstance(good, Report)
    assert good.command == "a command"
    named = {effect.name for effect in good.effects} | {name for group in good.not_identifiable for name in group}
    assert "sensor_lag" in named
