"""Figures 4.2 to 4.5: the thesis' two cases of optimal control, solved anew, with what the thesis says of them."""

from __future__ import annotations

import functools

import numpy as np

from pzt_ros.figures.optimal_solution import over_loops, over_time
from pzt_ros.figures.thesis_figure import Drawing, Finding, near
from pzt_ros.optimal.problem import load_problem
from pzt_ros.optimal.solution import Solution
from pzt_ros.optimal.solve import solve

_NOTE = "Solved by collocation (Radau IIA) and IPOPT; the set-point's hold times in case 2 are not printed."


@functools.cache
def solution(case: str) -> Solution:
    """Of `case1` or `case2`."""
    return solve(load_problem(case), "collocation")


def case_1_over_time(_samples: int) -> Drawing:
    """Figure 4.2."""
    found = solution("case1")
    x = found.phase_fraction
    findings = (
        near("the field rises to a peak of 3.3 MV/m", 1e-6 * float(np.max(found.field)), 3.3, 0.02, "MV/m"),
        near("then it decreases to about 1.9 MV/m", 1e-6 * float(found.field[-1]), 1.9, 0.02, "MV/m"),
        near("the phase fraction increases from 0.5 to 0.83", float(x[-1]), 0.83, 0.005, ""),
        Finding("monotonously", f"its smallest step is {np.min(np.diff(x)):.1e}", bool(np.min(np.diff(x)) > -1e-9)),
    )
    return Drawing(over_time(found), findings, _NOTE)


def case_1_over_loops(_samples: int) -> Drawing:
    """Figure 4.3."""
    return Drawing(over_loops(solution("case1")), (_ends_on_the_slow_loop("case1", "ascending"),), _NOTE)


def case_2_over_time(_samples: int) -> Drawing:
    """Figure 4.4."""
    found, grid = solution("case2"), solution("case2").problem.grid
    first, last = found.field[(grid > 0.2e-3) & (grid < 1.3e-3)], found.field[grid > 2.9e-3]
    second = 1e-6 * float(np.max(found.field[(grid > 1.3e-3) & (grid < 2.6e-3)]))
    first_case = 1e-6 * float(np.max(solution("case1").field))
    findings = (
        Finding(
            "the first 0.1 C/m² takes a positive field, the second a negative one",
            f"{1e-6 * np.min(first):.2f} MV/m at least, and {1e-6 * np.max(last):.2f} MV/m at most",
            bool(np.min(first) > 0.0 > np.max(last)),
        ),
        Finding(
            "the largest field for 0.2 C/m² is almost that of case 1",
            f"{second:.3f} and {first_case:.3f} MV/m; taken as agreeing within 5 %",
            bool(abs(second / first_case - 1.0) < 0.05),
        ),
    )
    return Drawing(over_time(found), findings, _NOTE)


def case_2_over_loops(_samples: int) -> Drawing:
    """Figure 4.5."""
    return Drawing(over_loops(solution("case2")), (_ends_on_the_slow_loop("case2", "descending"),), _NOTE)


def _ends_on_the_slow_loop(case: str, branch: str) -> Finding:
    """The last point against the outer loop of low frequency, in its field."""
    from pzt_ros.figures.optimal_control import SLOW_FREQUENCY, loop

    found = solution(case)
    load, p = loop(6.0, SLOW_FREQUENCY, 2000)
    leg = load.leg(1 if branch == "ascending" else 0)
    order = np.argsort(p[leg])
    quasistatic = float(np.interp(found.polarization[-1], p[leg][order], load.field[leg][order]))
    off = 1e-6 * float(found.field[-1]) - quasistatic
    return Finding(
        "it comes back to a point on the quasistatic loop",
        f"at the end the field is {off:+.2f} kV/mm off the {branch} branch at 0.125 Hz; taken as agreeing within 0.15",
        bool(abs(off) < 0.15),
    )
