"""`pzt diagnose`: what a model lacks to describe measured runs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from typer.core import TyperCommand

from pzt_ros.chains import load_chain
from pzt_ros.cli.model import AsJson, _busy, _command_line, _finite, _load
from pzt_ros.diagnosis.time_limit import SECONDS
from pzt_ros.errors import BenchError
from pzt_ros.parallel import dask_workers, threads

if TYPE_CHECKING:
    from pzt_ros.diagnosis.report import Report


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command(cls=_ManyTests)(diagnose)


class _ManyTests(TyperCommand):
    """`--test A B` means both: a run that was meant for a test must never slip among those that are fitted."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # the context is click's or Typer's own copy of it
        """Put `--test` before every word that follows one, up to the next option."""
        return super().parse_args(ctx, list(_spread(args)))


def _spread(words: list[str]) -> Iterator[str]:
    testing = named = False
    for word in words:
        if word.startswith("-"):
            testing = named = word == "--test"
        elif testing and not named:
            yield "--test"
        else:
            named = False
        yield word


def diagnose(
    runs: Annotated[list[Path], typer.Argument(help="CSV files or bags to fit")],
    out: Annotated[Path, typer.Option(help="folder to write the report and the models to")],
    test: Annotated[
        list[Path] | None,
        typer.Option(help="CSV files or bags that are never fitted, one or more", show_default=False),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="declared chain: shipped name or YAML file; a polycrystal or the parametrized model by default",
            show_default=False,
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(help="candidates refitted at once, in threads; as many as there are cores by default", min=0),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(help="scheduler whose workers refit the candidates instead: tcp://HOST:PORT", show_default=False),
    ] = None,
    profile: Annotated[
        bool, typer.Option("--profile", help="95 % intervals of what was found, by refits along each parameter")
    ] = False,
    time_limit: Annotated[
        float,
        typer.Option(help="seconds after which nothing new is tried, and what was found until then reported", min=0),
    ] = SECONDS,
    as_json: AsJson = False,
) -> None:
    """Find the effect that a model lacks, add it, and state the error before and after.

    The declared model is fitted to the runs; effects are added one after another as long as the first half of each
    test run agrees; the second half scores. Writes report.html, report.json, baseline.yaml (the declared one, fitted),
    model.yaml (with what was found) and, where a further run would decide, next_experiment.csv with its drive.

    Example: pzt diagnose train.csv --test test1.csv test2.csv --model p802 --out found
    """
    from pzt_ros.diagnosis.diagnose import diagnose as diagnose_runs

    if jobs is not None and dask is not None:
        raise BenchError("--jobs counts threads of this machine, --dask uses those of a cluster; give one of them")
    chain = load_chain(model) if model is not None else None
    train, tests = [_load(run) for run in runs], [_load(run) for run in test or ()]
    _prepare(out)
    if not tests:
        typer.echo("warning: no --test runs: nothing is checked on data that was not fitted", err=True)
    with _busy("diagnosing") as tell, threads(jobs) if dask is None else dask_workers(dask) as pool:
        report = diagnose_runs(
            train,
            tests,
            chain,
            progress=tell,
            command=_command_line(),
            workers=pool,
            profile=profile,
            time_limit=time_limit,
        )
        tell("writing the report")
        report.save(out)
    if as_json:
        typer.echo(json.dumps(_finite({"out": str(out), **report.as_data()}), indent=1))
    else:
        _print(report, out)


def _prepare(out: Path) -> None:
    """Make the folder now: to learn of a mistake in its name after a minute of work is too late."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        probe = out / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise BenchError(f"--out {out}: cannot be written: {error.strerror}; choose another folder") from None


def _print(report: Report, out: Path) -> None:
    console = Console()
    console.print(report.verdict, style="bold", markup=False, highlight=False)
    part = "score half of test" if report.test else "train"
    table = Table(box=None, pad_edge=False)
    table.add_column("model")
    for heading in ("train [nm]", f"{part} [nm]", "95 % interval", "x noise"):
        table.add_column(heading, justify="right")
    named = [*report.baselines.items(), ("as declared", report.before), ("with what was found", report.after)]
    for name, errors in named if report.repaired else named[:-1]:
        low, high = (1e9 * limit for limit in errors.interval)
        table.add_row(
            name,
            f"{1e9 * errors.train:.4g}",
            f"{1e9 * errors.score:.4g}",
            f"{low:.4g} to {high:.4g}",
            f"{errors.score / report.noise:.3g}",
        )
    console.print(table)
    for effect in report.effects:
        typer.echo(f"{effect.name}: probability {effect.probability:.3g}")
    typer.echo(f"noise floor: {1e9 * report.noise:.4g} nm")
    typer.echo(f"next: {report.next_experiment}")
    typer.echo(f"report: {out / 'report.html'}")
