"""The runs of a story: their scenario files and folders, and what they give to a diagnosis and to the page."""

from __future__ import annotations

from pathlib import Path

import yaml

from pzt_ros.bags import load_run
from pzt_ros.chains import read_yaml, shipped
from pzt_ros.records import Record, write_text
from pzt_ros.report.rundata import RunData, read_run

CHARACTERISE, AS_KNOWN, FITTED, REPAIRED = "characterise", "as-known", "fitted", "repaired"
SCANS = (AS_KNOWN, FITTED, REPAIRED)
"""The scan is run three times: by the model as known, by that model fitted, and by the repaired one."""

SCENARIO_OF = {CHARACTERISE: "story-characterise", **dict.fromkeys(SCANS, "story-track")}
DIAGNOSIS, STAGE_FILE = "diagnosis", "stage.yaml"
MODEL_OF = {
    CHARACTERISE: "bench-model",
    AS_KNOWN: "bench-model",
    FITTED: f"{DIAGNOSIS}/baseline.yaml",
    REPAIRED: f"{DIAGNOSIS}/model.yaml",
}
"""What observer and controllers load in each run: a shipped chain, or a file in the story's folder."""


def write_scenario(folder: Path, run: str, seed: int) -> Path:
    """The scenario of a run in the story's folder: a shipped one with the stage, the model and the seed of the story.

    Raises:
        BenchError: the folder cannot be written.
    """
    data, _ = read_yaml(SCENARIO_OF[run], shipped("scenarios"), "scenario")
    path = folder / f"{run}.yaml"
    changed = {**data, "plant": STAGE_FILE, "model": MODEL_OF[run], "seed": seed}
    write_text(path, [yaml.safe_dump(changed, sort_keys=False, allow_unicode=True)])
    return path


def record_of(folder: Path, run: str) -> Record:
    """Voltage across the ceramic and measured displacement out of a run's bag."""
    return load_run(folder / run / "bag")


def data_of(folder: Path, run: str) -> RunData:
    """Everything that was recorded in a run."""
    return read_run(folder / run)
