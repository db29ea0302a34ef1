"""Every solver by name."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable

import numpy as np

from pzt_ros.errors import BenchError, RunFailedError
from pzt_ros.optimal.inverse import inverse_field
from pzt_ros.optimal.ipopt import Ipopt
from pzt_ros.optimal.memory import has_history
from pzt_ros.optimal.problem import Problem
from pzt_ros.optimal.solution import Solution
from pzt_ros.optimal.structured import solve_structured
from pzt_ros.optimal.through_model import solve_through_model
from pzt_ros.optimal.transcription import FIELD_SCALE, Programme, collocation, multiple_shooting

_SLACK = 1e-3
"""By which a solution may leave a limit, over its size: the model of the solver is not that of the check."""


def start_field(problem: Problem) -> float:
    """The constant field of a first guess [V/m]: a quarter of the way up the window, or 1.5 MV/m where it is open."""
    low, high = max(problem.field_min, -6e6), min(problem.field_max, 6e6)
    return float(np.clip(0.25 * high, low, high))


def solve_ipopt(problem: Problem, transcribe: Callable[[Problem], Programme], name: str) -> Solution:
    """Transcribe a problem and solve it by IPOPT, from a constant field, or from the inverse's with history."""
    programme = transcribe(problem)
    ipopt = Ipopt(programme)
    guess = programme.start(start_field(problem))
    if has_history(problem):
        guess[: problem.steps + 1] = inverse_field(problem) / FIELD_SCALE
    began = time.perf_counter()
    point = ipopt.solve(guess)
    taken = time.perf_counter() - began
    fraction = np.concatenate([programme.parameters[:1], point.z[programme.nodes]])
    return Solution(
        problem, FIELD_SCALE * point.z[: problem.steps + 1], fraction, point.cost, name, point.iterations,
        point.converged, point.status, taken,
    )  # fmt: skip


SOLVERS: dict[str, Callable[[Problem], Solution]] = {
    "collocation": lambda problem: solve_ipopt(problem, collocation, "collocation"),
    "shooting": lambda problem: solve_ipopt(problem, multiple_shooting, "shooting"),
    "riccati": lambda problem: solve_structured(problem, start_field(problem)),
    "simulation": solve_through_model,
}
"""collocation, shooting: CasADi and IPOPT. riccati: the structured solver. simulation: through the ceramic itself."""


def _broken(found: Solution) -> str:
    """The limit that a solution does not keep, or nothing."""
    problem, slack = found.problem, 1.0 + _SLACK
    window = max(abs(problem.field_min), abs(problem.field_max)) if math.isfinite(problem.field_max) else 0.0
    beyond = max(np.max(found.field) - problem.field_max, problem.field_min - np.min(found.field))
    if beyond > _SLACK * window:
        return "the field"
    if np.max(np.abs(np.diff(found.field))) > slack * problem.field_step:
        return "slew"
    return "current" if np.max(np.abs(np.diff(found.polarization))) > slack * problem.charge_step else ""


def solve(problem: Problem, solver: str = "auto") -> Solution:
    """Solve a problem; `auto` takes collocation, or simulation for a ceramic with history and no segments.

    Raises:
        BenchError: no such solver, or it cannot solve such a problem.
        RunFailedError: it found no solution.
    """
    if solver == "auto":
        solver = "simulation" if has_history(problem) and problem.segments is None else "collocation"
    if solver not in SOLVERS:
        raise BenchError(f"solver '{solver}' is unknown; known are auto, {', '.join(SOLVERS)}")
    found = SOLVERS[solver](problem)
    broken = _broken(found)
    if broken:
        found = dataclasses.replace(found, converged=False, status=f"no field keeps the limit of {broken}")
    if not np.all(np.isfinite(found.field)):
        raise RunFailedError(f"{problem.name}: {solver} ended with '{found.status}' and no field; try another solver")
    return found
