"""What a demo may hide, how it judges the answer of the diagnosis, and which folders it may overwrite."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pzt_ros.chains import load_chain, save_chain, shipped
from pzt_ros.cli.demo import demo_folder
from pzt_ros.effects.insert import effects_in, without_effect
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.errors import BenchError
from pzt_ros.loop import Tick, run_in_process
from pzt_ros.physics.link import ACTUATOR
from pzt_ros.scenario import load_scenario
from pzt_ros.story.hidden import HIDDEN, LEFT_OUT, NOISE_RMS, STAGE, hidden_link, stage_with
from pzt_ros.story.outcome import AMONG, NAMED, NOTHING, PAIR, SOMETHING, WRONG, Story
from pzt_ros.story.runs import SCANS, write_scenario
from pzt_ros.story.words import headline, outcome

SEEDS = range(30)


def test_every_effect_is_hidden_or_said_why_not() -> None:
    hidden = [each.name for each in HIDDEN]
    assert len(set(hidden)) == len(hidden) >= 3
    assert {*hidden, *LEFT_OUT} == set(EFFECT_OF)
    assert not set(hidden) & set(LEFT_OUT)


def test_a_seed_draws_the_same_effect_and_seeds_draw_all() -> None:
    drawn = [hidden_link(seed) for seed in SEEDS]
    assert drawn == [hidden_link(seed) for seed in SEEDS]
    assert {link.kind for link in drawn} == {each.name for each in HIDDEN}
    assert len(set(map(repr, drawn))) == len(drawn)
    ranges = {each.name: each.ranges for each in HIDDEN}
    for link in drawn:
        for name, (low, high) in ranges[link.kind].items():
            assert low <= getattr(link, name) <= high


@pytest.mark.parametrize("hidden", HIDDEN, ids=lambda each: each.name)
def test_stage_has_one_effect_more_and_controllers_can_undo_it(hidden: Any) -> None:
    link = EFFECT_OF[hidden.name].link(**{name: high for name, (_, high) in hidden.ranges.items()})
    assert link.section == ACTUATOR, "only what moves the true displacement can be tracked away"
    stage = stage_with(link)
    assert effects_in(stage) == [link]
    plain = without_effect(stage, hidden.name)
    assert [each.kind for each in plain.links] == [each.kind for each in load_chain(STAGE).links]


@pytest.mark.parametrize("hidden", HIDDEN, ids=lambda each: each.name)
def test_effect_spoils_the_tracking_and_a_model_that_has_it_takes_it_away(hidden: Any, tmp_path: Path) -> None:
    middle = {name: (low * high) ** 0.5 for name, (low, high) in hidden.ranges.items()}
    stage = stage_with(EFFECT_OF[hidden.name].link(**middle))
    save_chain(stage, tmp_path / "stage.yaml")
    save_chain(without_effect(stage, hidden.name), tmp_path / "without.yaml")
    sound = scan_error(tmp_path, "without.yaml", "without.yaml")
    hurt = scan_error(tmp_path, "stage.yaml", "without.yaml")
    undone = scan_error(tmp_path, "stage.yaml", "stage.yaml")
    assert hurt > 2.0 * sound
    assert hurt > 2.0 * NOISE_RMS
    assert undone < 0.1 * hurt


def scan_error(folder: Path, plant: str, model: str) -> float:
    """RMS of reference minus true displacement in the second cycle of a short scan by the inverse [m]."""
    path = folder / "scan.yaml"
    path.write_text(
        f"""
plant: {plant}
model: {model}
sample_rate: 2 kHz
block_size: 10
phases:
  - {{phase: voltage, to: 150 V, duration: 0.5 s}}
  - {{phase: voltage, to: 0 V, duration: 0.5 s}}
  - {{phase: move, to: 3 um, duration: 0.3 s, controller: inverse}}
  - {{phase: scan, low: 3 um, peak_to_peak: 8 um, frequency: 2 Hz, cycles: 2}}
""",
        encoding="utf-8",
    )
    errors: list[Any] = []

    def watch(tick: Tick) -> None:
        if tick.reference is not None and tick.reference.quantity == "displacement" and tick.reference.time[0] >= 1.8:
            errors.append(tick.reference.values - tick.truth.displacement)

    run_in_process(load_scenario(path), watch)
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))


def test_scenarios_of_a_story_are_the_shipped_ones_with_its_stage_and_model(tmp_path: Path) -> None:
    save_chain(stage_with(hidden_link(3)), tmp_path / "stage.yaml")
    for name in ("baseline.yaml", "model.yaml"):
        save_chain(load_chain("bench-model"), tmp_path / "diagnosis" / name)
    track = load_scenario(shipped("scenarios")["story-track"])
    models = []
    for run in SCANS:
        loaded = load_scenario(write_scenario(tmp_path, run, 3))
        assert loaded.phases == track.phases
        assert loaded.controllers == track.controllers
        assert loaded.seed == 3
        assert Path(loaded.plant) == tmp_path / "stage.yaml"
        models.append(Path(loaded.model).name)
    assert models == ["bench-model", "baseline.yaml", "model.yaml"]


def story(effects: tuple[str, ...], tied: tuple[tuple[str, ...], ...] = (), remains: bool = False) -> Story:
    """A story that hid slow relaxation, with an answer to judge."""
    report: Any = SimpleNamespace(
        effects=[SimpleNamespace(name=name) for name in effects],
        not_identifiable=tied,
        remains=SimpleNamespace(present=remains),
    )
    hidden = EFFECT_OF["slow_relaxation"].link(share=0.1)
    return Story(Path(), 1, hidden, report, {}, {}, {}, "", 0.0)


ANSWERS = {
    NAMED: story(("slow_relaxation",)),
    AMONG: story(("slow_relaxation", "bias_field")),
    PAIR: story((), (("sensor_lag", "slow_relaxation"),)),
    SOMETHING: story((), remains=True),
    NOTHING: story(()),
    WRONG: story(("bias_field",)),
}


@pytest.mark.parametrize("answer", ANSWERS)
def test_answers_are_judged_and_said_as_they_are(answer: str) -> None:
    told = ANSWERS[answer]
    assert told.answer == answer
    said = headline(told)
    assert "slow relaxation" in said, "what was hidden is always revealed"
    assert ("is what the stage hid" in said) == (answer in (NAMED, AMONG))
    assert ("wrong" in said) == (answer == WRONG)
    assert ("bias field" in said) == (answer in (AMONG, WRONG))


def test_named_with_something_left_is_not_all_that_was_asked() -> None:
    told = story(("slow_relaxation",), remains=True)
    assert told.answer == AMONG
    assert "could not explain" in headline(told)


def test_a_false_suspicion_beside_the_right_name_is_admitted() -> None:
    told = story(("slow_relaxation",), (("bias_field", "sensor_lag"),))
    assert told.answer == AMONG
    assert "also suspected bias field or sensor lag, which was not hidden" in headline(told)


def test_an_error_that_rises_is_said_to_rise() -> None:
    errors = {run: SimpleNamespace(rms=rms) for run, rms in zip(SCANS, (3e-9, 2e-9, 4e-9), strict=True)}
    told = dataclasses.replace(story(()), predictions=errors)  # type: ignore[arg-type]
    told.__dict__["tracking"] = {run: {"inverse": error} for run, error in errors.items()}
    assert outcome(told).count("did not fall: 2 nm before, 4 nm after") == 2


def test_folder_of_a_demo_is_kept_unless_told(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    assert demo_folder(out, overwrite=False) == out
    (out / "controllers").mkdir(parents=True)
    (out / "controllers" / "run.json").write_text("{}", encoding="utf-8")
    (out / "stage.yaml").touch()
    (out / "mine.txt").touch()
    with pytest.raises(BenchError, match="holds a demo already"):
        demo_folder(out, overwrite=False)
    assert demo_folder(out, overwrite=True) == out
    assert [path.name for path in out.iterdir()] == ["mine.txt"]


def test_folder_of_something_else_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(BenchError, match="nothing there is overwritten"):
        demo_folder(tmp_path, overwrite=True)
    assert (tmp_path / "bag").is_dir()
