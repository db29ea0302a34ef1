"""`pzt chains`, `pzt simulate`, `pzt fit`, `pzt predict`: models without the graph."""

from __future__ import annotations

import json
import math
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from pzt_ros.bags import load_run
from pzt_ros.chains import chain_summary, load_chain, save_chain, shipped_chains
from pzt_ros.errors import BenchError
from pzt_ros.experiments.procedures import FAMILIES, procedure
from pzt_ros.parallel import processes
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record, write_table

From = Annotated[float | None, typer.Option("--from", help="first time that counts, in s; the run's start by default")]
Until = Annotated[float | None, typer.Option("--until", help="last time that counts, in s; the run's end by default")]
AsJson = Annotated[bool, typer.Option("--json", help="for programs")]
Jobs = Annotated[int, typer.Option(help="processes that share the work; 0 or 1: this one alone", min=0)]


def add_to(app: typer.Typer) -> None:
    """Add the commands to the program."""
    app.command()(simulate)
    app.command()(fit)
    app.command()(predict)
    app.command()(chains)


def chains(name: Annotated[str | None, typer.Argument(help="print this one's file")] = None) -> None:
    """List the shipped chains, or print the file of one as a start for your own.

    Example: pzt chains thesis-p2 > mine.yaml
    """
    shipped = shipped_chains()
    if name is None:
        table = Table(box=None)
        table.add_column("chain", no_wrap=True)
        table.add_column("description")
        for known in shipped:
            table.add_row(known, chain_summary(known))
        Console().print(table)
    elif name in shipped:
        typer.echo(shipped[name].read_text(encoding="utf-8"), nl=False)
    else:
        raise BenchError(f"no shipped chain '{name}'; there are {', '.join(shipped)}")


def simulate(
    drive: Annotated[
        str, typer.Argument(help="named experiment, or CSV with time_s, voltage_V; linear between its rows")
    ],
    model: Annotated[str, typer.Option(help="chain: shipped name or path of a YAML file")],
    out: Annotated[Path, typer.Option(help="CSV file to write")],
    accuracy: Annotated[float, typer.Option(help="error of the integration allowed in the phase fraction")] = 1e-8,
    rate: Annotated[str | None, typer.Option(help="of an experiment: '0.1 Hz' or '1 kV/mm/s' or '100 V/s'")] = None,
    form: Annotated[str | None, typer.Option(help="of an experiment: half-sine or linear")] = None,
    reversal: Annotated[str | None, typer.Option(help="of an experiment: reversal voltage, '-20 V'")] = None,
    sample_rate: Annotated[str | None, typer.Option(help="of an experiment: '20 kHz'")] = None,
) -> None:
    """Run a chain over a drive, without the graph; a row for each row of the drive.

    Named experiments are the thesis': full-loop, type1, type2, type3, type4, relaxation.

    Example: pzt simulate type3 --rate "10 Hz" --reversal "-20 V" --model p802 --out run.csv
    """
    from pzt_ros.sysid.simulate import simulate_csv, with_accuracy

    source = _drive(drive, rate, form, reversal, sample_rate)
    chain = with_accuracy(load_chain(model), accuracy)
    with _busy(f"simulating {chain.name}"):
        rows = simulate_csv(chain, source, out)
    typer.echo(f"{out}: {rows} rows")


def _drive(
    name: str, rate: str | None, form: str | None, reversal: str | None, sample_rate: str | None
) -> Path | Iterator[tuple[Array, Array]]:
    """A CSV file, or the blocks of a named experiment."""
    if name not in FAMILIES:
        if not Path(name).exists():
            raise BenchError(
                f"drive '{name}': no such file or experiment; give a CSV file with the columns time_s,voltage_V or one"
                f" of {', '.join(FAMILIES)}"
            )
        given = {"--rate": rate, "--form": form, "--reversal": reversal, "--sample-rate": sample_rate}
        extra = [option for option, value in given.items() if value is not None]
        if extra:
            raise BenchError(f"drive '{name}': {', '.join(extra)} belongs to a named experiment; leave it out")
        return Path(name)
    chosen = procedure(name, rate, form, reversal)
    if chosen.warning:
        typer.echo(f"warning: {chosen.warning}", err=True)
    return chosen.drive(chosen.sampling(sample_rate))


def fit(
    runs: Annotated[list[Path], typer.Argument(help="CSV files or bags")],
    model: Annotated[str, typer.Option(help="chain to start from: shipped name or path of a YAML file")],
    out: Annotated[Path, typer.Option(help="YAML file to write the fitted chain to")],
    start: From = None,
    until: Until = None,
    profile: Annotated[
        bool, typer.Option("--profile", help="95 % intervals that may be lopsided, by refits along each parameter")
    ] = False,
    jobs: Jobs = 1,
    as_json: AsJson = False,
) -> None:
    """Fit the parameters of a chain to one run or many, each with its own unknown offset and history.

    The chain's `free:` list says which parameters may move. The model runs from the first sample of each run;
    --from and --until say what counts.

    Example: pzt fit run.csv --model thesis-p2 --out model.yaml --until 10
    """
    from pzt_ros.sysid.fit import Fit
    from pzt_ros.sysid.run import Span

    chain = load_chain(model)
    records = [_load(run) for run in runs]
    with _busy(f"fitting {chain.name}") as tell, processes(jobs) as pool:
        result = Fit(chain, Span(start, until), profile=profile, progress=tell, workers=pool).fit(records)
    fitted = result.model(_command_line())
    save_chain(fitted, out)
    if as_json:
        found = {"out": str(out), **fitted.notes["fit"], "start": fitted.notes["start"]}
        typer.echo(json.dumps(_finite(found), indent=1))
    else:
        Console().print(result)
        typer.echo(f"model: {out}")


def predict(
    run: Annotated[Path, typer.Argument(help="CSV file or bag")],
    model: Annotated[str, typer.Option(help="chain: shipped name or path of a YAML file, such as pzt fit writes")],
    out: Annotated[Path, typer.Option(help="CSV file to write")],
    start: From = None,
    until: Until = None,
    as_json: AsJson = False,
) -> None:
    """Free-run prediction over the recorded voltage: the measurement of the predicted part is never used.

    A run that the model was fitted to starts as fitted. Any other: offset and history come from the part before
    --from, or from the first second. What only this run has, the past of one that begins driven or the course of its
    drift, comes from its first half, and the error is then that of the second.

    Example: pzt predict run.csv --model model.yaml --from 10 --out prediction.csv
    """
    from pzt_ros.sysid.predict import predict as predict_run
    from pzt_ros.sysid.run import Span

    chain = load_chain(model)
    with _busy(f"predicting with {chain.name}"):
        found = predict_run(chain, _load(run, ("time_s", "voltage_V")), Span(start, until))
        signals = found.signals
        columns = {
            "time_s": signals.time,
            "displacement_m": signals.displacement,
            "polarization_C_per_m2": signals.polarization,
        }
        present = {name: values for name, values in columns.items() if values.size}
        write_table(out, list(present), list(present.values()))
    if as_json:
        typer.echo(json.dumps(_finite({"out": str(out), **found.as_data()}), indent=1))
    else:
        typer.echo(f"{found}\nprediction: {out}")


def _load(run: Path, required: tuple[str, ...] = ("time_s", "voltage_V", "displacement_m")) -> Record:
    from pzt_ros.sysid.spikes import told, without_spikes

    record, spikes = without_spikes(load_run(run, required))
    for warning in (*record.warnings, *told(record, spikes)):
        typer.echo(f"warning: {warning}", err=True)
    return record


@contextmanager
def _busy(what: str) -> Iterator[Callable[[str], None]]:
    """A line on the terminal while something takes long; nothing where the output is no terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status(what) as status:
        yield lambda text: status.update(f"{what}: {text}")


def _command_line() -> str:
    return shlex.join(["pzt", *sys.argv[1:]])


def _finite(data: Any) -> Any:
    """The same with null for numbers that JSON has not."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
