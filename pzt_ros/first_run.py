"""Compiles what the nodes of a scenario need, before they are started.

Started with an empty cache, every node would compile the same at the same time as the others: on two cores that takes
three times as long as once, and longer than the experiment waits for them.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from pzt_ros.chains import load_chain, load_model
from pzt_ros.loop import InProcessLoop
from pzt_ros.scenario import Scenario, load_scenario

SHIPPED = ("scan", "manual")
"""What `pzt run` and `pzt panel` do where nothing else is said; compiled when the project is installed."""


def compile_once(scenario: Scenario, tell: Callable[[str], None]) -> None:
    """Compile for a scenario what was not compiled on this machine before; says so, because it takes a while.

    Raises:
        BenchError: bad chain, or a model that cannot be evaluated.
    """
    done = _stamp(scenario)
    if done.exists():
        return
    tell(f"compiling {scenario.name}; only the first run on this machine has to wait for that")
    InProcessLoop(scenario).warm_up()
    with contextlib.suppress(OSError):  # where nothing can be remembered, the next run waits again
        done.parent.mkdir(parents=True, exist_ok=True)
        done.touch()


def rehearse() -> None:
    """Load the compiled code of what is shipped, where there is some."""
    for name in SHIPPED:
        scenario = load_scenario(name)
        if _stamp(scenario).exists():
            InProcessLoop(scenario).warm_up()


def _stamp(scenario: Scenario) -> Path:
    """A file that is there once everything has been compiled for a scenario."""
    return Path(os.environ["NUMBA_CACHE_DIR"]) / f"compiled-{_digest(scenario)}"


def _digest(scenario: Scenario) -> str:
    """Of all that decides which functions are called, and of where they stand: Numba goes by the path, too."""
    parts = load_chain(scenario.plant).links, load_model(scenario.model).links, scenario.observer, scenario.controllers
    return hashlib.sha256(repr((__file__, parts)).encode()).hexdigest()[:16]


def main() -> None:
    """Compile what a newcomer tries first."""
    for name in SHIPPED:
        compile_once(load_scenario(name), print)


if __name__ == "__main__":
    main()
