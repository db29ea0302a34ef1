"""Chain files: the shipped ones carry the printed numbers, and every mistake in one is a line of text."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml

from pzt_ros.chains import chain_as_data, chain_summary, load_chain, parse_chain, save_chain, shipped_chains
from pzt_ros.errors import BenchError
from pzt_ros.physics.link import SECTIONS
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.strain import Electrostriction

SHIPPED = sorted(shipped_chains())

# model-notes.md, "Parameters that the thesis prints", in SI: s, B_e, tau, P_T, E1 of both branches
PRINTED: dict[str, dict[str, float]] = {
    "thesis-p1": {
        "shape_ascending": 0.9,
        "barrier_ascending": 0.5e6,
        "shape_descending": 0.9,
        "barrier_descending": 0.5e6,
        "temperature": 293.0,
        "domain_volume": 1e-22,
        "relaxation_time": 5e-2,
        "domain_polarization": 0.215,
        "reciprocal_permittivity": 2.8e7,
        "saturation_barrier": 2.0e6,
    },
    "thesis-p2": {
        "shape_ascending": 2.5,
        "barrier_ascending": 0.25e6,
        "shape_descending": 1.1,
        "barrier_descending": 1.0e6,
        "relaxation_time": 8e-2,
        "domain_polarization": 0.210,
        "reciprocal_permittivity": 2.5e7,
        "saturation_barrier": 2.0e6,
    },
    "thesis-p3": {
        "shape_ascending": 1.3,
        "barrier_ascending": 0.5e6,
        "shape_descending": 1.3,
        "barrier_descending": 0.5e6,
        "domain_volume": 1e-22,
        "relaxation_time": 1e-3,
        "domain_polarization": 0.26,
        "reciprocal_permittivity": 6e7,
    },
}

GOOD: dict[str, Any] = {
    "chain": "good",
    "links": [
        {"link": "amplifier", "gain": 10},
        {"link": "electrostriction", "active_length": "8 mm"},
        {"link": "displacement_sensor", "noise_rms": "20 nm"},
    ],
}


def refusal(data: Any) -> str:
    """The one line with which a chain is refused."""
    with pytest.raises(BenchError) as caught:
        parse_chain(data, "my.yaml")
    said = str(caught.value)
    assert "\n" not in said
    assert said.startswith("my.yaml")
    return said


def changed(number: int, **values: Any) -> dict[str, Any]:
    """The good chain with some keys of one link replaced; None removes a key."""
    data = copy.deepcopy(GOOD)
    entry = {**data["links"][number], **values}
    data["links"][number] = {key: value for key, value in entry.items() if value is not None}
    return data


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_chain_is_complete(name: str) -> None:
    chain = load_chain(name)
    assert chain.name == name
    assert chain.notes["description"].strip()
    assert chain.notes["source"].strip()
    assert chain_summary(name) == chain.notes["description"].strip()


@pytest.mark.parametrize("name", SHIPPED)
def test_saved_chain_reads_back_the_same(name: str, tmp_path: Path) -> None:
    chain = load_chain(name)
    save_chain(chain, tmp_path / "new folder" / "saved.yaml")
    assert load_chain(tmp_path / "new folder" / "saved.yaml") == chain


@pytest.mark.parametrize("name", sorted(PRINTED))
def test_printed_parameters(name: str) -> None:
    model, strain = (link for link in load_chain(name).links if link.section == "actuator")
    for key, value in PRINTED[name].items():
        assert getattr(model, key) == pytest.approx(value, rel=1e-12), key
    assert isinstance(model, Parametrized)
    assert model.layer_thickness == pytest.approx(0.1e-3)
    assert isinstance(strain, Electrostriction)
    assert strain.coefficient == pytest.approx(0.02293), "0.02293 m^4/C^2 is the thesis' 2.293 in percent"
    assert strain.active_length == pytest.approx(80 * 0.1e-3)


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (None, "not a chain"),
        ([], "not a chain"),
        ("chain", "not a chain"),
        ({"chain": "a"}, "not a chain"),
        ({"chain": "a", "links": []}, "not a chain"),
        ({"chain": "a", "links": {"link": "amplifier"}}, "not a chain"),
        ({**GOOD, "colour": "red"}, "unknown key 'colour'; known are chain, links, description"),
        ({"links": ["amplifier"]}, "link 1: expected 'link: kind' and its parameters, found 'amplifier'"),
        ({"links": [{"gain": 1}]}, "link 1: expected 'link: kind'"),
        (changed(1, link="piezo"), "link 2: unknown link 'piezo'; known are amplifier"),
        (changed(1, link=["piezo"]), "link 2: unknown link ['piezo']"),
        (changed(1, link=5), "link 2: unknown link 5"),
        (changed(0, gain=1e9), "link 1 (amplifier).gain: 1e+09 is outside 0.001 to 10000"),
        (changed(0, gian=1), "link 1 (amplifier): unknown parameter 'gian'; known are gain"),
        (changed(1, active_length="8 V"), "link 2 (electrostriction).active_length: '8 V' cannot be read as m"),
        (changed(1, active_length=8e-3), "link 2 (electrostriction).active_length: 0.008 has no unit"),
        (changed(1, active_length="8 nowhere"), "'8 nowhere' has no known unit"),
        (changed(1, active_length=[8]), "[8] is not a number"),
        ({"links": [{"link": "parametrized"}]}, "link 1 (parametrized): parameter 'shape_ascending' is missing"),
    ],
)
def test_mistakes_in_a_chain_are_named(data: Any, found: str) -> None:
    assert found in refusal(data)


@pytest.mark.parametrize(("early", "late"), [(0, 1), (0, 2), (1, 2)])
def test_sections_stand_in_the_order_of_the_signal(early: int, late: int) -> None:
    data = copy.deepcopy(GOOD)
    links = data["links"]
    links[early], links[late] = links[late], links[early]
    said = refusal(data)
    assert "stands too early" in said
    assert ", ".join(SECTIONS) in said


def write(folder: Path, content: bytes) -> Path:
    path = folder / "broken.yaml"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"links: [}", "broken.yaml: line 1: not valid YAML"),
        (b"a: 1\n\tb: 2\n", "broken.yaml: line 2: not valid YAML"),
        (b"chain: a\x00b\n", "broken.yaml: not valid YAML"),
        (b"chain: 2026-13-01\n", "broken.yaml: not valid YAML"),
        (b"chain: \xff\n", "is not UTF-8 text"),
        (b"", "broken.yaml: not a chain"),
        (b"- 1\n- 2\n", "broken.yaml: not a chain"),
    ],
)
def test_a_file_that_is_no_yaml(tmp_path: Path, content: bytes, found: str) -> None:
    with pytest.raises(BenchError) as caught:
        load_chain(write(tmp_path, content))
    assert found in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_such_chain_names_the_shipped_ones(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match=r"chain 'thesis-p9': no such file; shipped are .*thesis-p1") as caught:
        load_chain("thesis-p9")
    assert caught.value.exit_code == 2
    with pytest.raises(BenchError, match="cannot be read: Is a directory"):
        load_chain(tmp_path)


def test_a_chain_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    with pytest.raises(BenchError, match="cannot be written"):
        save_chain(load_chain("thesis-p1"), tmp_path / "file" / "chain.yaml")


def test_the_file_says_units_and_keeps_the_notes(tmp_path: Path) -> None:
    data = {**GOOD, "description": "mine", "free": ["electrostriction.coefficient"]}
    chain = parse_chain(data, "my.yaml")
    save_chain(chain, tmp_path / "chain.yaml")
    written = yaml.safe_load((tmp_path / "chain.yaml").read_text(encoding="utf-8"))
    assert written == chain_as_data(chain)
    assert written["description"] == "mine"
    assert written["free"] == ["electrostriction.coefficient"]
    assert written["links"][0]["gain"] == 10.0
    assert written["links"][2]["noise_rms"] == "2e-08 m"
