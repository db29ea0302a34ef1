"""`python -m pzt_benchmarks.optimal_control`: optimal control against IPOPT, do-mpc and solving anew; a page.

Everything in one run, on one core, as processor time, the best of several. do-mpc is no dependency: give
`--do-mpc PYTHON`, an interpreter that has it, or its rows stay empty.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pzt_benchmarks import optimal_updates
from pzt_benchmarks.__main__ import ONE_THREAD
from pzt_benchmarks.report import Provenance, provenance, show
from pzt_benchmarks.stopwatch import best, one_core
from pzt_benchmarks.table import Figure, Table, Target, figures_table, number
from pzt_ros.errors import RunFailedError
from pzt_ros.optimal.inverse import inverse_field
from pzt_ros.optimal.ipopt import Ipopt
from pzt_ros.optimal.memory import law_without_history, material_of
from pzt_ros.optimal.problem import Problem, load_problem
from pzt_ros.optimal.solution import simulate
from pzt_ros.optimal.solve import solve
from pzt_ros.optimal.structured import Structured
from pzt_ros.optimal.transcription import collocation
from pzt_ros.physics.kinetics import _C

START = 1.5e6
"""Constant field of every cold start [V/m]."""

TITLE = "Optimal control against its targets (issue 5)"
BOUNDS = (3.0e6, 2.5e6, 2.2e6)
REPEATS = 20
Tell = Callable[[str], None]


def thesis_table() -> tuple[list[Figure], Table]:
    """Cases 1 and 2 by every solver."""
    figures, rows = [], []
    for case in ("case1", "case2"):
        for solver in ("collocation", "shooting", "riccati", "simulation"):
            found = solve(load_problem(case), solver)
            data = found.as_data()
            rows.append(
                (
                    case, solver, f"{1e-6 * data['peak_field_V_per_m']:.4f}", f"{1e-6 * data['end_field_V_per_m']:.4f}",
                    f"{data['end_phase_fraction']:.4f}", f"{found.cost:.3g}", f"{found.simulated.cost:.3g}",
                    str(found.iterations),
                )
            )  # fmt: skip
            if case == "case1":
                off = max(
                    abs(data["peak_field_V_per_m"] - 3.325e6) / 0.01e6,
                    abs(data["end_field_V_per_m"] - 1.922e6) / 0.005e6,
                    abs(data["end_phase_fraction"] - 0.829) / 0.001,
                )
                figures.append(
                    Figure(f"case 1 by {solver}: largest miss of the three values", off, "tolerances", Target(1))
                )
            elif solver == "collocation":
                half = 0.5 * found.problem.horizon
                first, last = found.problem.grid < half, found.problem.grid > 0.75 * found.problem.horizon
                lowest, highest = np.min(found.field[first][1:]), np.max(found.field[last])
                figures.append(
                    Figure("case 2: lowest field on the first 0.1 C/m²", 1e-6 * lowest, "MV/m", Target(0, True))
                )
                figures.append(
                    Figure("case 2: highest field on the second 0.1 C/m²", 1e-6 * highest, "MV/m", Target(0))
                )
    heads = ("case", "solver", "peak [MV/m]", "end [MV/m]", "x₊ at the end", "cost", "cost, simulated", "iterations")
    note = (
        "Cost in C² s/m⁴, by the solver's own quadrature, and in the ceramic's own simulation under the same field. The"
        " set-point has kinks that a field linear over 50 µs cannot follow: that is the cost without active limits."
    )
    return figures, Table("The thesis' two cases", heads, rows, note)


def bounds_table(repeats: int, tell: Tell) -> tuple[list[Figure], Table]:
    """Cost and time of the structured solver and of IPOPT, from the same start, with limits that hold."""
    figures, rows = [], []
    current, slew = {"current": 0.8}, {"slew_rate": 8e9, "initial_field": 0.0}
    limits: list[tuple[str, dict[str, float]]] = [("none (6 MV/m)", {})]
    limits += [(f"{1e-6 * bound:g} MV/m", {"field_max": bound}) for bound in BOUNDS]
    limits += [
        ("0.8 A", current),
        ("8 GV/m/s from 0", slew),
        ("2.5 MV/m, 0.8 A, 8 GV/m/s", {**current, **slew, "field_max": 2.5e6}),
    ]
    for name, changes in limits:
        tell(f"limit {name}")
        problem = dataclasses.replace(load_problem("case1"), **changes)
        structured, programme = Structured(problem), collocation(problem)
        ipopt, guess = Ipopt(programme), collocation(problem).start(START)

        def cold(structured: Structured = structured) -> tuple[float, int, bool]:
            structured.begin(START)
            return structured.solve()

        theirs = ipopt.solve(guess)
        cost, iterations, _ = cold()
        ours, seconds = (
            best(cold, repeats),
            best(lambda ipopt=ipopt, guess=guess: ipopt.solve(guess), max(3, repeats // 4)),
        )
        clipped = simulate(problem, inverse_field(problem)).cost
        better = simulate(problem, structured.field).cost / clipped if "current" not in changes else float("nan")
        share = "" if np.isnan(better) else f"{100 * better:.3g} %"
        rows.append(
            (name, f"{cost:.4g}", f"{theirs.cost:.4g}", f"{100 * (cost / theirs.cost - 1):+.3f} %", share,
             f"{iterations} / {theirs.iterations}", f"{1e3 * ours:.3f}", f"{1e3 * seconds:.1f}", number(seconds / ours))
        )  # fmt: skip
        if changes.get("field_max") in BOUNDS and "current" not in changes:
            off = 100 * abs(cost / theirs.cost - 1)
            figures.append(Figure(f"limit {name}: cost against IPOPT's", off, "% apart", Target(1)))
        if not changes or name == "2.5 MV/m":
            what = f"cold solve, N = 80, limit {name}: IPOPT's time over ours"
            figures.append(Figure(what, seconds / ours, "times", Target(40, True, aim=200)))
    heads = ("limit", "cost", "IPOPT's", "apart", "of clipped inverse", "iterations", "ms", "IPOPT ms", "times faster")
    note = (
        "Case 1. Both solve the same programme (Radau IIA collocation, N = 80) from a constant 1.5 MV/m; IPOPT with"
        " exact second derivatives as CasADi expressions (SX) and MUMPS. Of clipped inverse: simulated cost over that"
        " of the exact inverse held in window and slew. With a slew limit there are several optima, up to 0.3 % apart"
        " (tests check that ours meets the optimality conditions)."
    )
    return figures, Table("With limits: the structured solver against IPOPT", heads, rows, note)


def inverse_table() -> tuple[list[Figure], Table]:
    """The exact inverse without active limits, on finer and finer grids."""
    rows = []
    for intervals in (80, 800, 8000):
        problem = dataclasses.replace(load_problem("case1"), intervals=float(intervals))
        cost = simulate(problem, inverse_field(problem)).cost
        rows.append((f"{intervals:,}", f"{cost:.2e}", f"{cost / (0.2**2 * problem.horizon):.1e}"))
    figure = Figure("exact inverse without active limits, 8,000 points: cost", cost, "C² s/m⁴", Target(1e-15))
    note = "Its only miss lies between its points; the last column is over that of staying at P = 0 by 0.2 C/m²."
    return [figure], Table("The exact inverse", ("points", "cost [C² s/m⁴]", "relative"), rows, note)


def speed_figures(repeats: int, do_mpc: Path | None, tell: Tell) -> list[Figure]:
    """Real-time iterations, and do-mpc on the same problem."""
    figures = []
    for intervals, limit, aim in ((20.0, 15.0, 3.0), (80.0, 50.0, 12.0)):
        for name, changes in (("no limit", {}), ("2.5 MV/m", {"field_max": 2.5e6})):
            problem = dataclasses.replace(load_problem("case1"), intervals=intervals, **changes)
            structured = Structured(problem)
            structured.begin(START)
            structured.solve()

            def iterations(structured: Structured = structured) -> None:
                for k in range(100):
                    structured.iterate(0.5 + 1e-4 * (k % 3))

            seconds = best(iterations, repeats) / 100
            what = f"one real-time iteration, N = {intervals:g}, {name}"
            figures.append(Figure(what, 1e6 * seconds, "µs", Target(limit, aim=aim)))
    if do_mpc is not None:
        tell("do-mpc")
        problem = dataclasses.replace(load_problem("case1"), initial_field=0.0)
        structured = Structured(problem)

        def cold() -> None:
            structured.begin(START)
            structured.solve()

        ours, theirs = best(cold, repeats), by_do_mpc(problem, do_mpc)
        what = f"cold solve, N = 80, E(0) = 0: time of do-mpc {theirs['version']} over ours"
        figures.append(Figure(what, theirs["seconds"] / ours, "times", Target(100, True, aim=500)))
        figures.append(Figure("... its time", 1e3 * theirs["seconds"], "ms"))
        figures.append(Figure("... its peak field", 1e-6 * theirs["peak"], "MV/m"))
    return figures


def by_do_mpc(problem: Problem, python: Path) -> dict[str, float]:
    """The case by do-mpc's default in another interpreter.

    Raises:
        RunFailedError: it did not run.
    """
    m = material_of(problem)
    given = {
        **m._asdict(),
        "law": law_without_history(problem.ceramic),
        "coefficients": _C,
        "scale": float(np.max(np.abs(problem.set_point))) ** 2,
        "intervals": problem.steps,
        "step": problem.step,
        "field_min": problem.field_min,
        "field_max": problem.field_max,
        "set_point": problem.set_point_at(problem.grid).tolist(),
        "phase_fraction": problem.initial_phase_fraction,
        "start_field": START,
        "initial_field": problem.initial_field,
        "repeats": 6,
    }
    script = Path(__file__).with_name("do_mpc_case.py")
    done = subprocess.run(
        [str(python), "-W", "ignore", str(script)], input=json.dumps(given), capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise RunFailedError(f"do-mpc under {python} failed: {done.stderr.strip().splitlines()[-1:]}")
    found: dict[str, float] = json.loads(done.stdout)
    return found


def history_table() -> tuple[list[Figure], Table]:
    """The complete model, with a fixed sequence of branches and a free one."""
    rows, costs = [], []
    for solver, sequence in (("collocation", "fixed"), ("simulation", "free")):
        found = solve(load_problem("history"), solver)
        costs.append(found.simulated.cost)
        rows.append(
            (solver, sequence, f"{found.cost:.5g}", f"{found.simulated.cost:.5g}", f"{found.model_error:.1e}",
             f"{1e-6 * found.field[-1]:.4f}", str(found.iterations), f"{1e3 * found.solve_time:.0f}")
        )  # fmt: skip
    problem = load_problem("history")
    clipped = simulate(problem, inverse_field(problem)).cost
    rows.append(("clipped inverse", "", "", f"{clipped:.5g}", "", f"{1e-6 * inverse_field(problem)[-1]:.4f}", "", ""))
    apart = 100 * abs(costs[0] / costs[1] - 1)
    heads = ("solver", "reversals", "cost", "cost, simulated", "error in P", "end [MV/m]", "iterations", "ms (wall)")
    note = (
        "Both distributions and return-point memory (thesis 3.34) from the virgin state: nested loops are closed on the"
        " way up, the branch turns once. Error in P: the solver's trajectory against the ceramic's own [C/m²]."
    )
    return [
        Figure("complete model: cost of the fixed sequence against the free one", apart, "% apart", Target(1))
    ], Table("The complete model (problem `history`)", heads, rows, note)


def measure(quick: bool, tell: Tell, do_mpc: Path | None = None) -> list[Table]:
    """A table of figures and targets, then the tables they come from."""
    repeats = 5 if quick else REPEATS
    figures: list[Figure] = []
    tables: list[Table] = []
    with one_core():
        tell("the thesis' cases")
        parts = [thesis_table, lambda: bounds_table(repeats, tell), inverse_table, history_table]
        parts.append(lambda: optimal_updates.measure(100 if quick else 1000, tell))
        for part in parts:
            found, table = part()
            figures += found
            tables.append(table)
        tell("iterations")
        figures += speed_figures(repeats, do_mpc, tell)
    note = (
        "Everything is simulated. Times are processor time on one core with Python's calls in them, the best of"
        " several. A target is that of issue 5; an aim is the stretch of methods.md."
    )
    if do_mpc is None:
        note += " do-mpc was not at hand (`--do-mpc PYTHON`)."
    return [figures_table(TITLE, figures, note), *tables]


def page(origin: Provenance, tables: list[Table]) -> str:
    """The page."""
    head = f"""# Optimal control

{origin.line()}

`pzt optimal case1 --out DIR` solves the thesis' first case, `case2` the second, `history` one with the complete model;
a problem of one's own is a YAML file like those in `msgs_config/problems`. Everything on this page is simulated.

| solver | what it does | for |
| --- | --- | --- |
| `collocation` | Radau IIA collocation in CasADi, IPOPT with exact second derivatives | any parametrized ceramic; with history a fixed sequence of branches (`segments:`), closures of loops on the way included |
| `shooting` | multiple shooting, classical Runge-Kutta steps, IPOPT: the independent check | ceramics with one distribution |
| `riccati` | the same programme as `collocation` by our structured Gauss-Newton iteration, bounds handled inside the Riccati recursion | ceramics without history; what a controller runs in real time |
| `simulation` | Gauss-Newton through the compiled ceramic itself; reversals come as they like | any parametrized ceramic |

Limits: window of the field, slew rate, current (the mean one of an interval), and weights on the field's rate and on the
end. After every solver the ceramic itself is driven with the field that was found; `pzt optimal` shows both costs.

In the control loop (`receding_horizon`) each tick is answered at once, by the exact inverse where no limit is active,
else by real-time iterations that start from a plan solved in the background since the last tick; that plan looks some
blocks ahead. Where there is none (late, infeasible, no number), the answer is the plan before it as far as it reaches,
then the inverse within its limits, then the last voltage, and after `hold_time` a ramp to 0 V; /diagnostics says which.
In lock-step the tick waits for the background, so that a run repeats to the bit; `patience` ends the wait.

"""  # noqa: E501 - rows of a table
    pictures = [
        f"![{case} {name.replace('-', ' ')}](images/optimal/{case}-{name}.png)"
        for case in ("case1", "case2")
        for name in ("over-time", "over-loops")
    ]
    return head + "\n\n".join([*pictures, *(table.markdown() for table in tables)])


def draw(folder: Path) -> None:
    """The pictures of the page."""
    import matplotlib

    from pzt_ros.figures.optimal_solution import over_loops, over_time
    from pzt_ros.report.style import LIGHT

    folder.mkdir(parents=True, exist_ok=True)
    for case in ("case1", "case2"):
        found = solve(load_problem(case))
        with matplotlib.rc_context(LIGHT.settings()):
            for name, picture in (("over-time", over_time), ("over-loops", over_loops)):
                picture(found).savefig(folder / f"{case}-{name}.png", dpi=90)


def main() -> None:
    """Measure; write the page and its pictures into a folder."""
    if any(os.environ.get(name) != "1" for name in ONE_THREAD):  # they have to be set before NumPy is imported
        os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
        os.execv(sys.executable, [sys.executable, "-m", "pzt_benchmarks.optimal_control", *sys.argv[1:]])
    from rich.console import Console

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder for optimal.md and its images/, such as docs")
    parser.add_argument("--do-mpc", type=Path, help="Python with do-mpc, to measure it in the same run")
    parser.add_argument("--quick", action="store_true", help="fewer repeats; the figures are less sure")
    given = parser.parse_args()
    origin = provenance(shlex.join(["python", "-m", "pzt_benchmarks.optimal_control", *sys.argv[1:]]))
    with Console(stderr=True).status("optimal control") as status:
        tables = measure(given.quick, status.update, given.do_mpc)
    for table in tables:
        show(table)
    if given.out is not None:
        draw(given.out / "images" / "optimal")
        (given.out / "optimal.md").write_text(page(origin, tables), encoding="utf-8")


if __name__ == "__main__":
    main()
