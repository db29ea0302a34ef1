"""The `pzt` program: gathers the commands, and turns errors into one line and an exit code."""

from __future__ import annotations

import os
import sys

import typer

from pzt_ros.cli import bag, bench, demo, diagnose, doctor, figures, graph, model, optimal, panel
from pzt_ros.errors import BenchError


def build() -> typer.Typer:
    """The program with all its commands."""
    app = typer.Typer(
        name="pzt",
        help="Piezo nanopositioning stages: models, measured runs, and a ROS 2 graph that drives them.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    graph.add_to(app)
    panel.add_to(app)
    demo.add_to(app)
    model.add_to(app)
    optimal.add_to(app)
    diagnose.add_to(app)
    bag.add_to(app)
    figures.add_to(app)
    bench.add_to(app)
    doctor.add_to(app)
    return app


def main() -> None:
    """Entry point of `pzt`: bad input ends with one line on stderr and exit code 2, never with a traceback."""
    try:
        build()(standalone_mode=True)
    except BenchError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
