"""What the nodes need is compiled before they start, once for a set of models."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from pzt_ros import first_run
from pzt_ros.first_run import compile_once
from pzt_ros.loop import InProcessLoop
from pzt_ros.scenario import load_scenario


def test_models_are_compiled_once_and_again_when_they_are_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))  # Numba itself has looked already
    compiled: list[str] = []
    monkeypatch.setattr(InProcessLoop, "warm_up", lambda loop: compiled.append(loop.model.name))
    scenario = load_scenario("scan")
    told: list[str] = []
    for model in ("thesis-p2", "thesis-p2", "p802", "thesis-p2"):
        compile_once(replace(scenario, model=model), told.append)
    assert len(compiled) == len(told) == 2
    assert compiled[0] != compiled[1]


def test_a_compilation_that_fails_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    def fail(_: InProcessLoop) -> None:
        raise KeyboardInterrupt

    told: list[str] = []
    monkeypatch.setattr(InProcessLoop, "warm_up", fail)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            compile_once(load_scenario("scan"), told.append)
    assert len(told) == 2


def test_warming_up_moves_nothing() -> None:
    fresh, warm = InProcessLoop(load_scenario("scan")), InProcessLoop(load_scenario("scan"))
    warm.warm_up()
    first, second = fresh.start(), warm.start()
    for _ in range(3):
        assert (first.measurement == second.measurement).all()
        assert (first.estimate.displacement == second.estimate.displacement).all()
        after = fresh.step(first), warm.step(second)
        assert after[0] is not None
        assert after[1] is not None
        first, second = after


def test_another_checkout_of_the_same_sources_compiles_for_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numba's folder is named by what the sources are, and within it code is kept by where they stand."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(InProcessLoop, "warm_up", lambda _: None)
    told: list[str] = []
    compile_once(load_scenario("scan"), told.append)
    monkeypatch.setattr(first_run, "__file__", "/elsewhere/pzt_ros/first_run.py")
    compile_once(load_scenario("scan"), told.append)
    assert len(told) == 2


def test_code_of_older_sources_is_not_used_whoever_imports_numba_first() -> None:
    """It once gave NaN for a bandwidth, in tests that import the court first."""
    ask = "import numba, os; import pzt_ros; print(numba.config.CACHE_DIR == os.environ['NUMBA_CACHE_DIR'] != '')"
    done = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True)
    assert (done.stdout.strip(), done.stderr) == ("True", "")
