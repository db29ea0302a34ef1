"""The layouts for Foxglove and PlotJuggler name topics and fields that our bags have, and panels that are there."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from pzt_config.topics import JOINT_STATE, TOPICS
from pzt_ros.bags.writer import typestore

LAYOUTS = Path(__file__).parents[2] / "docs" / "layouts"
FOXGLOVE = json.loads((LAYOUTS / "foxglove.json").read_text(encoding="utf-8"))
PANELS = ("Plot", "DiagnosticSummary", "DiagnosticStatusPanel")
AXIS = "stage"


def topic_of(name: str) -> Any:
    """The row of the topic table behind a name in a bag of the axis `/stage`."""
    return TOPICS[name.removeprefix(f"/{AXIS}/")]


def fields_of(type_name: str) -> dict[str, Any]:
    return {name: kind for name, kind in typestore().fielddefs[type_name][1]}


def foxglove_paths() -> list[str]:
    plots = [config for name, config in FOXGLOVE["configById"].items() if name.startswith("Plot!")]
    found = [path["value"] for plot in plots for path in plot["paths"]]
    return found + [plot["xAxisPath"]["value"] for plot in plots if plot["xAxisVal"] == "custom"]


@pytest.mark.parametrize("path", foxglove_paths())
def test_foxglove_message_paths_exist(path: str) -> None:
    found = re.fullmatch(r"(/[a-z_/]+)\.([a-z_]+)(?:\[(\d+)\])?", path)
    assert found, path
    topic, field, index = found.groups()
    row = topic_of(topic)
    assert field in fields_of(row.type)
    if row.is_block:
        assert int(index) < len(row.columns)  # within the first sample, whatever the size of a block
        assert int(index) > 0  # 0 is the time
    elif row.type == JOINT_STATE:
        assert index == "0"
    else:
        assert index is None


def leaves(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    else:
        yield from leaves(node["first"])
        yield from leaves(node["second"])


def test_foxglove_shows_every_panel_once() -> None:
    assert sorted(leaves(FOXGLOVE["layout"])) == sorted(FOXGLOVE["configById"])
    assert {name.split("!")[0] for name in FOXGLOVE["configById"]} == set(PANELS)


def test_foxglove_diagnostics_are_ours() -> None:
    shown = FOXGLOVE["configById"]["DiagnosticStatusPanel!amplifier"]
    assert shown["topicToRender"] == FOXGLOVE["configById"]["DiagnosticSummary!nodes"]["topicToRender"]
    assert TOPICS[shown["topicToRender"]].publisher == "*"
    assert shown["selectedName"] == f"/{AXIS}/amplifier"
    messages = (Path(__file__).parents[2] / "nodes" / "messages.py").read_text(encoding="utf-8")
    assert f'hardware_id="{shown["selectedHardwareId"]}"' in messages


def test_loops_share_a_sender_rhythm() -> None:
    """Foxglove pairs the two sides of such a plot by their number: both come once per block."""
    for name, plot in FOXGLOVE["configById"].items():
        if plot.get("xAxisVal") == "custom":
            sides = [plot["xAxisPath"]["value"], *(path["value"] for path in plot["paths"])]
            assert all(topic_of(side.split(".")[0]).rate == "one per block" for side in sides), name


@pytest.mark.parametrize(
    "curve", [c.get("name") for c in ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot().iter("curve")]
)
def test_plotjuggler_curves_exist(curve: str) -> None:
    *topic, field = curve.split("/")
    if topic[-1] == AXIS and len(topic) > 3:  # it names joint states /TOPIC/JOINT/FIELD
        row = topic_of("/".join(topic[:-1]))
        assert row.type == JOINT_STATE
    else:
        row = topic_of("/".join(topic))
        assert not row.is_block
    assert field in fields_of(row.type)


def test_plotjuggler_splitters_say_what_they_hold() -> None:
    for splitter in ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot().iter("DockSplitter"):
        assert int(splitter.get("count", "0")) == len(list(splitter)) == len(splitter.get("sizes", "").split(";"))
