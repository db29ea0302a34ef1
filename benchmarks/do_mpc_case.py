"""`python do_mpc_case.py`: one thesis case by do-mpc with its default transcription, timed; JSON in, JSON out.

A program of its own that imports nothing of ours: do-mpc is no dependency, and may live in another environment.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import casadi as ca
import do_mpc
import numpy as np

POLYNOMIAL_CENTRE = 3.75


def erfcx(a: Any, coefficients: list[float]) -> Any:
    """exp(a^2) erfc(a) for a >= 0, from coefficients of the polynomial in (a - c)/(a + c), lowest first."""
    y = (a - POLYNOMIAL_CENTRE) / (a + POLYNOMIAL_CENTRE)
    total = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        total = total * y + c
    return total / (1.0 + 2.0 * a)


def rate(z: Any, coefficients: list[float]) -> Any:
    """1/erfcx(z)."""
    a = ca.fabs(z)
    g, e = erfcx(a, coefficients), ca.exp(-a * a)
    return ca.if_else(z >= 0.0, 1.0 / g, e / (2.0 - e * g))


def controller(given: dict[str, Any]) -> Any:
    """The case in do-mpc: x+ and the field are states, the field's rate is the input; time in ms, field in MV/m."""
    model = do_mpc.model.Model("continuous", "SX")
    x, field = model.set_variable("_x", "x"), model.set_variable("_x", "field")
    slope = model.set_variable("_u", "slope")
    asked = model.set_variable("_tvp", "asked")
    law, width = given["law"], given["thermal_width"]
    places = [ca.erfinv(ca.fmin(ca.fmax(law[k + 2] * x + law[k + 3] - 1.0, -1 + 2e-12), 1 - 2e-12)) for k in (0, 4)]
    up, down = (law[k] + law[k + 1] * place for k, place in zip((0, 4), places, strict=True))
    c = given["coefficients"]
    f = rate((1e6 * field - up) / width, c) * (1.0 - x) - rate((down - 1e6 * field) / width, c) * x
    model.set_rhs("x", 1e-3 * f / given["relaxation_time"])
    model.set_rhs("field", slope)
    p = 1e6 * field / given["reciprocal_permittivity"] + (2.0 * x - 1.0) * given["domain_polarization"]
    model.set_expression("miss", (p - asked) ** 2 / given["scale"])
    model.setup()

    mpc = do_mpc.controller.MPC(model)
    mpc.settings.n_horizon = given["intervals"]
    mpc.settings.t_step = 1e3 * given["step"]
    mpc.settings.store_full_solution = False
    mpc.settings.supress_ipopt_output()
    mpc.set_objective(mterm=model.aux["miss"], lterm=model.aux["miss"])
    mpc.set_rterm(slope=0.0)
    for side, value in (("lower", given["field_min"]), ("upper", given["field_max"])):
        mpc.bounds[side, "_x", "field"] = 1e-6 * value
    template = mpc.get_tvp_template()

    def asked_at(_: float) -> Any:
        template["_tvp", :, "asked"] = given["set_point"]
        return template

    mpc.set_tvp_fun(asked_at)
    mpc.setup()
    return mpc


def main() -> None:
    """Read the case from stdin, solve it cold several times, print times [s] and what was found."""
    given = json.load(sys.stdin)
    mpc = controller(given)
    first = np.array([given["phase_fraction"], 1e-6 * given["start_field"]])
    times = []
    for _ in range(given["repeats"]):
        mpc.reset_history()
        mpc.x0 = first
        mpc.set_initial_guess()
        begin = np.array([given["phase_fraction"], 1e-6 * given["initial_field"]])
        began = time.process_time()
        mpc.make_step(begin)
        times.append(time.process_time() - began)
    fields = [1e6 * float(mpc.opt_x_num_unscaled["_x", k, 0, -1, "field"]) for k in range(given["intervals"] + 1)]
    stats = mpc.solver_stats
    json.dump(
        {
            "seconds": min(times[1:]),
            "iterations": stats["iter_count"],
            "success": bool(stats["success"]),
            "peak": max(fields),
            "end": fields[-1],
            "version": do_mpc.__version__,
        },
        sys.stdout,
    )


if __name__ == "__main__":
    main()
