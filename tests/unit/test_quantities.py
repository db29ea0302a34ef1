"""Units: what is read, what is refused and how, and that nothing is lost on the way to text and back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from pzt_ros.errors import BenchError
from pzt_ros.quantities import build, choice, choices_of, parameter, parameters_of, to_si, to_text


@dataclass(frozen=True, kw_only=True)
class Stage:
    stroke: float = parameter(None, "m", "how far it goes", bounds=(0.0, 1e-3))
    gain: float = parameter(2.0, "1", "output over input", bounds=(0.5, 4.0))
    field: float = parameter(1e6, "V/m", "field in the ceramic", symbol="E")
    shape: str = choice("sine", ("sine", "triangle"), "wave form")
    label: str = choice("", (), "any word")


def refusal(call: Any, *arguments: Any) -> str:
    """The one line with which a call refuses its arguments."""
    with pytest.raises(BenchError) as caught:
        call(*arguments)
    said = str(caught.value)
    assert "\n" not in said
    return said


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("150 V", "V", 150.0),
        ("-40 V", "V", -40.0),
        ("0.5 MV/m", "V/m", 0.5e6),
        ("1.5 kV/mm", "V/m", 1.5e6),
        ("0.1um", "m", 1e-7),
        ("0.1 µm", "m", 1e-7),
        (".5e-3 s", "s", 5e-4),
        ("2. ms", "s", 2e-3),
        (" 20 kHz\n", "Hz", 2e4),
        ("3 1/s", "1/s", 3.0),
        ("0.02293 m^4/C^2", "m^4/C^2", 0.02293),
        ("2.5e7 V*m/C", "V*m/C", 2.5e7),
        ("20 degC", "K", 293.15),
        ("5 %", "1", 0.05),
        ("1e-3", "1", 1e-3),  # YAML 1.1 gives this as text
        (7, "1", 7.0),
        (0.25, "1", 0.25),
    ],
)
def test_units_are_read(text: Any, unit: str, expected: float) -> None:
    assert to_si(text, unit, "here") == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("value", "unit", "found"),
    [
        (5, "V", "5 has no unit; write '5 V'"),
        (5.0, "V", "5.0 has no unit; write '5.0 V'"),
        ("5", "V", "'5' has no unit"),
        ("5 furlongish", "V", "'5 furlongish' has no known unit; write it like '1.5 V'"),
        ("5 m", "V", "'5 m' cannot be read as V"),
        ("5 V", "1", "'5 V' cannot be read as a pure number; write it like 1.5"),
        ("V", "V", "'V' is not a number with a unit"),
        ("", "V", "'' is not a number with a unit"),
        ("five V", "V", "is not a number"),
        ("nan V", "V", "nan V is not a finite number"),
        ("-inf V", "V", "-inf V is not a finite number"),
        ("1e999 V", "V", "1e999 V is not a finite number"),
        (math.nan, "1", "nan is not a finite number"),
        (-math.inf, "1", "-inf is not a finite number"),
        (10**400, "1", "is not a finite number"),
        (True, "1", "True is not a number; write it like 1.5"),
        (True, "V", "True is not a number with a unit; write it like '1.5 V'"),
        ([1.0], "V", "[1.0] is not a number"),
        (None, "V", "None is not a number"),
        ({"value": 1}, "1", "is not a number"),
        ("5\nV\nV", "V", "cannot be read as V"),
    ],
)
def test_what_is_no_quantity_is_refused(value: Any, unit: str, found: str) -> None:
    said = refusal(to_si, value, unit, "p1.yaml: here")
    assert said.startswith("p1.yaml: here: ")
    assert found in said


@pytest.mark.parametrize(
    "text", ["1,5 V", "1,500 V", "1 000 V", "3 V + 2 V", "2**3 V", "2 * 3 V", "1_0 V", "5 1 V", "V 5", "15 V,"]
)
def test_text_that_pint_would_calculate_with_is_refused(text: str) -> None:
    """Pint drops commas and does sums: a German 1,5 V would put 15 V on the stack."""
    assert repr(text) in refusal(to_si, text, "V", "here")


UNITS = (
    "1",
    "V",
    "V/s",
    "m",
    "m/V",
    "V/m",
    "V/m/s",
    "s",
    "Hz",
    "1/s",
    "K",
    "A",
    "m^2",
    "m^3",
    "C/m^2",
    "V*m/C",
    "m^4/C^2",
)


@pytest.mark.parametrize("unit", UNITS)
def test_text_and_back_is_exact_to_the_bit(unit: str) -> None:
    bits = np.random.default_rng(5).integers(0, 2**64, size=400, dtype=np.uint64)
    numbers = bits.view(np.float64)
    numbers = np.concatenate((numbers[np.isfinite(numbers)], [0.0, -0.0, 5e-324, 1.7e308, 0.1, 1 / 3]))
    back = np.array([to_si(to_text(float(x), unit), unit, "here") for x in numbers])
    np.testing.assert_array_equal(back.view(np.uint64), numbers.view(np.uint64))


def test_build_reads_every_kind_of_field() -> None:
    stage = build(Stage, {"stroke": "10 um", "field": "1.5 kV/mm", "shape": "triangle", "label": "left"}, "s.yaml")
    assert stage == Stage(stroke=pytest.approx(10e-6, rel=1e-14), gain=2.0, field=1.5e6, shape="triangle", label="left")


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ({}, "parameter 'stroke' is missing (how far it goes)"),
        (
            {"stroke": "1 um", "colour": "red"},
            "unknown parameter 'colour'; known are stroke, gain, field, shape, label",
        ),
        ({"stroke": "1 um", 5: "red"}, "unknown parameter 5"),
        ({"stroke": "2 mm"}, ".stroke: 0.002 m is outside 0 to 0.001 m (how far it goes)"),
        ({"stroke": "-1 nm"}, ".stroke: -1e-09 m is outside 0 to 0.001 m"),
        ({"stroke": "1 um", "gain": 5}, ".gain: 5 is outside 0.5 to 4 (output over input)"),
        ({"stroke": "1 V"}, ".stroke: '1 V' cannot be read as m"),
        ({"stroke": 1e-6}, ".stroke: 1e-06 has no unit"),
        ({"stroke": "1 um", "shape": "square"}, ".shape: 'square' is not one of sine, triangle (wave form)"),
        ({"stroke": "1 um", "shape": True}, ".shape: True is not one of sine, triangle"),
        ({"stroke": "1 um", "label": 5}, ".label: 5 is not a word (any word)"),
        ("stroke", "expected 'name: value' lines, found 'stroke'"),
        (None, "expected 'name: value' lines, found None"),
        ([1], "expected 'name: value' lines, found [1]"),
    ],
)
def test_build_says_where_and_what(values: Any, found: str) -> None:
    said = refusal(build, Stage, values, "stage.yaml: link 3 (stage)")
    assert said.startswith("stage.yaml: link 3 (stage)")
    assert found in said


def test_bounds_are_inclusive() -> None:
    assert build(Stage, {"stroke": "1 mm", "gain": 0.5}, "here").stroke == 1e-3
    assert build(Stage, {"stroke": "0 mm", "gain": 4.0}, "here").gain == 4.0


def test_declarations_can_be_asked_for() -> None:
    declared = parameters_of(Stage)
    assert list(declared) == ["stroke", "gain", "field"]
    assert (declared["field"].unit, declared["field"].symbol) == ("V/m", "E")
    assert (declared["field"].lower, declared["field"].upper) == (-math.inf, math.inf)
    assert parameters_of(Stage(stroke=1e-6)) == declared
    assert choices_of(Stage)["shape"].options == ("sine", "triangle")
