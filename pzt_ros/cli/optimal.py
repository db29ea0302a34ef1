"""`pzt optimal`: optimal control problems, the thesis' two or one's own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pzt_ros.cli.graph import AsJson, Overwrite
from pzt_ros.cli.model import _busy
from pzt_ros.errors import BenchError, RunFailedError

if TYPE_CHECKING:
    from pzt_ros.optimal.solution import Solution

RESULT, TABLE = "solution.json", "solution.csv"
PICTURES = ("over-time", "over-loops")


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(optimal)


def optimal(
    problem: Annotated[str, typer.Argument(help="shipped problem (case1, case2, history) or path of a YAML file")],
    out: Annotated[Path, typer.Option(help="folder for the solution and its figures")],
    solver: Annotated[
        str, typer.Option(help="collocation, shooting, riccati, simulation; auto: collocation if it can")
    ] = "auto",
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Solve an optimal control problem: the field that makes the polarization follow its set-point, within limits.

    Writes solution.csv (a drive for `pzt simulate`, and what it does), solution.json, and figures as the thesis' 4.2 to
    4.5. What is called simulated is the ceramic's own response to the field, integrated apart from the solver.

    Example: pzt optimal case1 --out case1
    """
    from pzt_ros.optimal.problem import load_problem
    from pzt_ros.optimal.solve import solve

    asked = load_problem(problem)
    if (out / RESULT).exists() and not overwrite:
        raise BenchError(f"{out} holds a solution already; choose another --out, or say --overwrite")
    with _busy(f"solving {asked.name}"):
        found = solve(asked, solver)
        if not found.converged:
            raise RunFailedError(
                f"{asked.name}: {found.solver} stopped after {found.iterations} iterations with '{found.status}';"
                " nothing was written; loosen the limits or try another --solver"
            )
        write(found, out)
    if as_json:
        typer.echo(json.dumps({**found.as_data(), "out": str(out)}, indent=1))
    else:
        _print(found, out)


def write(found: Solution, out: Path) -> None:
    """The solution as numbers and pictures, into a folder.

    Raises:
        BenchError: it cannot be written.
    """
    import matplotlib

    from pzt_ros.figures.gallery import _write_png, rendered
    from pzt_ros.figures.optimal_solution import over_loops, over_time
    from pzt_ros.records import write_table, write_text
    from pzt_ros.report.style import LIGHT

    simulated, thickness = found.simulated, found.problem.ceramic.layer_thickness
    columns = {
        "time_s": simulated.time,
        "voltage_V": simulated.field * thickness,
        "electric_field_V_per_m": simulated.field,
        "polarization_C_per_m2": simulated.polarization,
        "set_point_C_per_m2": found.problem.set_point_at(simulated.time),
        "phase_fraction": simulated.phase_fraction,
    }
    write_table(out / TABLE, list(columns), list(columns.values()))
    write_text(out / RESULT, [json.dumps(found.as_data(), indent=1), "\n"])
    with matplotlib.rc_context(LIGHT.settings()):
        for name, draw in zip(PICTURES, (over_time, over_loops), strict=True):
            svg, png = rendered(draw(found), name)
            _write_png(out / f"{name}.png", png)
            write_text(out / f"{name}.svg", [svg])


def _print(found: Solution, out: Path) -> None:
    data = found.as_data()
    typer.echo(
        f"{found.problem.name}: {found.solver}, {found.iterations} iterations, {1e3 * found.solve_time:.3g} ms\n"
        f"peak field {1e-6 * data['peak_field_V_per_m']:.4f} MV/m at {1e3 * data['peak_time_s']:.3g} ms,"
        f" end {1e-6 * found.field[-1]:.4f} MV/m, x+ at the end {found.phase_fraction[-1]:.4f}\n"
        f"cost {found.cost:.4g} C^2 s/m^4; in the ceramic's own simulation {found.simulated.cost:.4g}\n"
        f"solution: {out}"
    )
