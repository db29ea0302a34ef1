"""The story of the demo through the real graph: both errors fall, and the page's figures are those of the bags.

About a minute on an idle machine: four runs of the graph and one diagnosis.
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

from pzt_ros.bags import load_run
from pzt_ros.bags.reader import open_bag
from pzt_ros.chains import load_chain
from pzt_ros.cli.demo import SEED, tell
from pzt_ros.effects.insert import effects_in
from pzt_ros.story.outcome import NAMED, Story
from pzt_ros.story.page import write_page
from pzt_ros.story.runs import FITTED, REPAIRED
from pzt_ros.sysid.predict import predict

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
pytestmark = pytest.mark.timeout(900)


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Story:
    return tell(tmp_path_factory.mktemp("demo"), SEED, {}, time.monotonic())


def test_the_hidden_effect_is_named_and_both_errors_fall(story: Story) -> None:
    assert story.answer == NAMED
    assert story.controllers == ["inverse", "inverse_pi"]
    assert story.prediction_gain() > 5.0
    for controller in story.controllers:
        assert story.tracking_gain(controller) > 5.0, controller


def test_the_repaired_model_has_the_effect_and_the_fitted_one_has_not(story: Story) -> None:
    found = [link.kind for link in effects_in(load_chain(story.folder / "diagnosis" / "model.yaml"))]
    assert found == [story.hidden.kind]
    assert effects_in(load_chain(story.folder / "diagnosis" / "baseline.yaml")) == []


def test_the_nodes_were_given_the_repaired_model(story: Story) -> None:
    provenance = json.loads((story.folder / REPAIRED / "run.json").read_text(encoding="utf-8"))
    assert Path(provenance["model"]).read_text(encoding="utf-8") == (
        story.folder / "diagnosis" / "model.yaml"
    ).read_text(encoding="utf-8")


def test_figures_are_those_of_the_bags(story: Story) -> None:
    data = json.loads((write_page(story).parent / "report.json").read_text(encoding="utf-8"))
    for run in (FITTED, REPAIRED):
        bag = open_bag(story.folder / run / "bag")
        asked, truth = bag.blocks("/stage/reference"), bag.blocks("/stage/truth")
        places = np.searchsorted(truth.time, asked.time)
        np.testing.assert_array_equal(truth.time[places], asked.time)
        error = asked["displacement_m"] - truth["displacement_m"][places]
        begins = {"inverse": 3.05, "inverse_pi": 7.05}  # first block, poling, move; then the same once more
        for controller, begin in begins.items():
            counted = (asked.time > begin + 0.45) & (asked.time < begin + 2.5 - 0.06)  # from the second cycle on
            rms = float(np.sqrt(np.mean(error[counted] ** 2)))
            assert data["tracking"][run][controller]["rms_m"] == pytest.approx(rms, rel=0.1), (run, controller)
    again = predict(load_chain(story.folder / "diagnosis" / "model.yaml"), load_run(story.folder / REPAIRED / "bag"))
    assert data["prediction"][REPAIRED]["rms_m"] == pytest.approx(again.rms, rel=1e-9)


def test_the_page_reveals_the_effect_and_says_that_all_is_simulated(story: Story) -> None:
    page = write_page(story).read_text(encoding="utf-8")
    assert "SIMULATED" in page
    assert "is what the stage hid" in page
    for link in ("diagnosis/report.html", "diagnosis/model.yaml", "characterise/scenario.yaml"):
        assert f'href="{link}"' in page
        assert (story.folder / link).is_file()
    assert not [word for word in ('src="http', 'href="http', "<script") if word in page], "self-contained"
