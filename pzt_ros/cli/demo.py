"""`pzt demo`: the whole story in one go. ROS is started in processes of its own; this file does not import it."""

from __future__ import annotations

import json
import shutil
import time
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pzt_ros.cli.graph import AsJson, Out, Overwrite, bring_up, show
from pzt_ros.cli.model import _busy, _command_line, _finite
from pzt_ros.errors import BenchError

if TYPE_CHECKING:
    from pzt_ros.story.outcome import Story

SEED = 1
"""What a demo hides unless it is told otherwise; the same run every time."""

CONTROLLERS, MARK = "controllers", "stage.yaml"
_RUN_FILES = ("bag", "log", "run.json", "scenario.yaml", "parameters.yaml")  # of a demo of version 0.1.0, at the top


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(demo)


def demo(
    out: Out = None,
    seed: Annotated[int, typer.Option(help="draws the hidden effect, its size and the noise", min=0)] = SEED,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """The whole story: four controllers on one stage, then a stage with an effect that its model lacks.

    That one is characterised, scanned, diagnosed, and scanned again with the repaired model; every run through the node
    graph. Writes bags, reports, the models and report.html, all simulated.

    Example: pzt demo --seed 7 --out demo
    """
    began = time.monotonic()
    folder = demo_folder(out, overwrite)
    four = four_controllers(folder, as_json)
    story = tell(folder, seed, four, began)
    from pzt_ros.story.page import write_page

    page = write_page(story)
    if as_json:
        typer.echo(json.dumps(_finite({**story.as_data(), "report": str(page)}), indent=1))
    else:
        _print(story, page)


def demo_folder(out: Path | None, overwrite: bool) -> Path:
    """Where a demo goes; one that is there already is removed if it may be.

    Raises:
        BenchError: the folder holds a demo and may not be overwritten, or what is to be overwritten is no demo.
    """
    from pzt_ros.story.runs import DIAGNOSIS, SCENARIO_OF

    if out is None:
        return Path("runs") / f"demo-{datetime.now():%Y%m%d-%H%M%S}"
    earlier = (out / "bag").exists()
    if not earlier and not (out / MARK).exists() and not (out / CONTROLLERS).exists():
        return out
    if not overwrite:
        raise BenchError(f"{out} holds a demo already; choose another --out, or say --overwrite")
    if not (out / ("run.json" if earlier else f"{CONTROLLERS}/run.json")).is_file():
        raise BenchError(f"{out} holds no run of a demo, so nothing there is overwritten; choose another --out")
    files = [MARK, CONTROLLERS, DIAGNOSIS, "figures", "report.html", "report.json", *_RUN_FILES]
    files += [name for run in SCENARIO_OF for name in (run, f"{run}.yaml")]
    for name in files:
        path = out / name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    return out


def four_controllers(folder: Path, as_json: bool) -> dict[str, Any]:
    """The first part: poling, then a 10 um triangle at 1 Hz with each of the four controllers; its numbers."""
    from pzt_ros.report.run import read_summary, write_run_report

    _say("1/6 four controllers on one stage")
    with _busy("compiling"):
        _compile("demo")
    page = _graph("demo", folder / CONTROLLERS, write_run_report)
    summary = read_summary(folder / CONTROLLERS)
    if not as_json:
        show(summary, page)
    return summary


def _compile(scenario: str) -> None:
    """Compile here, once, what every node would compile for itself on a new machine, at the same time as the others."""
    from pzt_ros.loop import InProcessLoop
    from pzt_ros.scenario import load_scenario

    loop = InProcessLoop(load_scenario(scenario))
    loop.stage.warm_up()
    loop.sensor.warm_up()
    loop.control.warm_up()
    loop.step(loop.start())


def tell(folder: Path, seed: int, four: dict[str, Any], began: float) -> Story:
    """The second part: a stage with a hidden effect, from characterising it to the scan with the repaired model.

    Raises:
        typer.Exit: a run failed; the graph has said why.
        BenchError: a run cannot be diagnosed, or the folder cannot be written.
    """
    from pzt_ros.chains import load_chain, save_chain
    from pzt_ros.diagnosis import diagnose
    from pzt_ros.story import runs
    from pzt_ros.story.hidden import hidden_link, stage_with
    from pzt_ros.story.outcome import told

    hidden = hidden_link(seed)
    save_chain(stage_with(hidden), folder / runs.STAGE_FILE)

    def run(name: str, what: str) -> None:
        _say(what)
        _graph(str(runs.write_scenario(folder, name, seed)), folder / name)

    run(runs.CHARACTERISE, "2/6 a stage with a hidden effect: characterising it, open loop")
    run(runs.AS_KNOWN, "3/6 a scan with the model that lacks the effect")
    _say("4/6 what does the model lack? (half a minute)")
    with _busy("diagnosing") as progress:
        report = diagnose(
            [runs.record_of(folder, runs.CHARACTERISE)],
            [runs.record_of(folder, runs.AS_KNOWN)],
            load_chain(runs.MODEL_OF[runs.AS_KNOWN]),
            progress=progress,
            command=_command_line(),
        )
        progress("writing the report")
        report.save(folder / runs.DIAGNOSIS)
    run(runs.FITTED, "5/6 the scan with that model, fitted, the effect still missing")
    run(runs.REPAIRED, "6/6 the scan with the repaired model")
    return told(folder, seed, hidden, report, four, _command_line(), time.monotonic() - began)


def _graph(scenario: str, folder: Path, then: Any = None) -> Any:
    """Run the graph to its end, or end as it ended."""
    code = bring_up(scenario, folder, {}, {})
    if code != 0:
        raise typer.Exit(code)
    return then(folder) if then is not None else None


def _say(text: str) -> None:
    typer.echo(text, err=True)


def _print(story: Story, page: Path) -> None:
    """The numbers of the story in the terminal."""
    from rich.console import Console
    from rich.table import Table

    from pzt_ros.story.figures import LABELS
    from pzt_ros.story.words import gain, headline, outcome

    console = Console()
    table = Table(title="RMS error in nm, SIMULATED, an effect missing from the model", title_justify="left")
    table.add_column("error of")
    for label in (*LABELS.values(), "fell by the repair"):
        table.add_column(label, justify="right")
    rows = {"prediction": ({run: found.rms for run, found in story.predictions.items()}, story.prediction_gain())}
    for name in story.controllers:
        found = {run: errors[name].rms for run, errors in story.tracking.items()}
        rows[f"tracking, {name}"] = (found, story.tracking_gain(name))
    for name, (errors, fell) in rows.items():
        table.add_row(name, *(f"{1e9 * errors[run]:.3g}" for run in LABELS), f"{gain(fell)} x")
    console.print(table)
    console.print(headline(story), highlight=False)
    console.print(outcome(story), highlight=False)
    console.print(f"report: {page}", highlight=False, soft_wrap=True)
