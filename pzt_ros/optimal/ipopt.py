"""IPOPT on a programme."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from pzt_ros.optimal.transcription import Programme
from pzt_ros.physics.signals import Array

TOLERANCE = 1e-9
QUIET: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": TOLERANCE,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 500,
}


@dataclass(frozen=True)
class Point:
    """A solution of a programme: unknowns, multipliers of the bounds and of the constraints, the cost.

    A multiplier is negative where the lower bound holds, positive where the upper one does.
    """

    z: Array
    of_bounds: Array
    of_constraints: Array
    cost: float
    iterations: int
    converged: bool
    status: str


class Ipopt:
    """A programme made ready for IPOPT, with exact second derivatives and MUMPS."""

    def __init__(self, programme: Programme, **options: Any) -> None:
        self.programme = programme
        nlp = {"x": programme.z, "p": programme.p, "f": programme.cost, "g": programme.constraints}
        self._solver = ca.nlpsol("solver", "ipopt", nlp, {**QUIET, **options})

    def solve(self, start: Array, parameters: Array | None = None) -> Point:
        """From a first guess of the unknowns; `parameters` are the programme's own by default."""
        programme = self.programme
        found = self._solver(
            x0=start,
            p=programme.parameters if parameters is None else parameters,
            lbx=programme.z_low,
            ubx=programme.z_high,
            lbg=programme.g_low,
            ubg=programme.g_high,
        )
        stats = self._solver.stats()
        return Point(
            z=np.array(found["x"]).ravel(),
            of_bounds=np.array(found["lam_x"]).ravel(),
            of_constraints=np.array(found["lam_g"]).ravel(),
            cost=float(found["f"]) * programme.cost_scale,
            iterations=int(stats["iter_count"]),
            converged=bool(stats["success"]),
            status=str(stats["return_status"]),
        )
