"""Parameters that carry a unit, and the way from text with a unit to SI and back.

Inside the library every number is SI; the only place where `0.5 MV/m` becomes `5e5` is here.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from pzt_ros.errors import BenchError

BOLTZMANN: Final = 1.3806503e-23
"""Boltzmann constant [J/K] as the thesis' programs have it; CODATA 2019 differs by 1e-6 relative."""


@dataclass(frozen=True)
class Parameter:
    """What a parameter is: unit in SI, bounds in SI, the symbol of the thesis, one sentence."""

    unit: str
    symbol: str
    lower: float
    upper: float
    description: str


@dataclass(frozen=True)
class Choice:
    """A parameter that is one word out of a few; with no options given, any word."""

    options: tuple[str, ...]
    description: str


@dataclass(frozen=True)
class Table:
    """A row of numbers of one unit: unit and bounds of each in SI, one sentence."""

    unit: str
    lower: float
    upper: float
    description: str


@dataclass(frozen=True)
class Form:
    """An optional object with a YAML form of its own: how to read it (content, name in errors) and to write it."""

    read: Callable[[Any, str], Any]
    write: Callable[[Any], Any]
    description: str


def parameter(
    default: float | None,
    unit: str,
    description: str,
    *,
    symbol: str = "",
    bounds: tuple[float, float] = (-math.inf, math.inf),
) -> Any:
    """A dataclass field with a unit; `default` None makes it required [default and bounds in SI]."""
    declared = Parameter(unit, symbol, *bounds, description)
    value: Any = dataclasses.MISSING if default is None else default
    return field(default=value, metadata={"parameter": declared})


def choice(default: str, options: tuple[str, ...], description: str) -> Any:
    """A dataclass field that takes one of a few words; any word where `options` is empty."""
    return field(default=default, metadata={"choice": Choice(options, description)})


def table(
    default: tuple[float, ...] | None,
    unit: str,
    description: str,
    *,
    bounds: tuple[float, float] = (-math.inf, math.inf),
) -> Any:
    """A dataclass field that holds a tuple of numbers; `default` None makes it required [default and bounds in SI]."""
    value: Any = dataclasses.MISSING if default is None else default
    return field(default=value, metadata={"table": Table(unit, *bounds, description)})


def form(read: Callable[[Any, str], Any], write: Callable[[Any], Any], description: str) -> Any:
    """A dataclass field that holds None, or an object that `read` makes of YAML content and `write` turns into it."""
    return field(default=None, metadata={"form": Form(read, write, description)})


def parameters_of(owner: Any) -> dict[str, Parameter]:
    """The declared parameters of a dataclass or of one of its instances, by name."""
    return {f.name: f.metadata["parameter"] for f in dataclasses.fields(owner) if "parameter" in f.metadata}


def choices_of(owner: Any) -> dict[str, Choice]:
    """The declared choices of a dataclass or of one of its instances, by name."""
    return {f.name: f.metadata["choice"] for f in dataclasses.fields(owner) if "choice" in f.metadata}


def tables_of(owner: Any) -> dict[str, Table]:
    """The declared tables of a dataclass or of one of its instances, by name."""
    return {f.name: f.metadata["table"] for f in dataclasses.fields(owner) if "table" in f.metadata}


def forms_of(owner: Any) -> dict[str, Form]:
    """The declared objects with a YAML form of their own, by name."""
    return {f.name: f.metadata["form"] for f in dataclasses.fields(owner) if "form" in f.metadata}


@functools.cache
def _registry() -> Any:
    import pint  # 0.3 s to import: only those who read units pay for it

    return pint.UnitRegistry()


_NUMBER_AND_UNIT = re.compile(
    r"(?P<number>[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|inf))\s*(?P<unit>(?:1\s*/)?[^\d\s,.+*/^-][^,]*|)"
)
"""One number, then a unit. Left to itself pint takes `1,5 V` for 15 V, `V` for 1 V, and calculates `3 V + 2 V`."""


def to_si(value: Any, unit: str, where: str) -> float:
    """A number in SI from text with a unit, such as `0.5 MV/m`.

    Args:
        value: text with a unit; a bare number only where `unit` is "1".
        unit: the SI unit expected, "1" for a pure number.
        where: how to name the value in an error, such as `p1.yaml: parametrized.temperature`.

    Raises:
        BenchError: unit missing, unknown or of another dimension; not a finite number.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise BenchError(f"{where}: {value!r} is not a number{_with_unit(unit)}; write it like {_example(unit)}")
    if isinstance(value, (int, float)):
        if unit != "1":
            raise BenchError(f"{where}: {value} has no unit; write '{value} {unit}' or another unit of that kind")
        number = float(value) if abs(value) <= sys.float_info.max else math.inf  # an integer in YAML has no limit
    else:
        number = _parse(value, unit, where)
    if not math.isfinite(number):
        raise BenchError(f"{where}: {value} is not a finite number")
    return number


def _parse(text: str, unit: str, where: str) -> float:
    import pint

    advice = f"write it like {_example(unit)}"
    found = _NUMBER_AND_UNIT.fullmatch(text.strip())
    if found is None:
        raise BenchError(f"{where}: {text!r} is not a number{_with_unit(unit)}; {advice}")
    if unit != "1" and not found["unit"]:
        raise BenchError(f"{where}: {text!r} has no unit; write it in {unit} or another unit of that kind")
    try:
        quantity = _registry().Quantity(float(found["number"]), found["unit"])
        return float(quantity.to("dimensionless" if unit == "1" else unit).magnitude)
    except pint.DimensionalityError:
        kind = "a pure number" if unit == "1" else unit
        raise BenchError(f"{where}: {text!r} cannot be read as {kind}; {advice}") from None
    except Exception:  # pint raises a dozen kinds for malformed units; to the reader they are one
        raise BenchError(f"{where}: {text!r} has no known unit; {advice}") from None


def _with_unit(unit: str) -> str:
    return "" if unit == "1" else " with a unit"


def _example(unit: str) -> str:
    return "1.5" if unit == "1" else f"'1.5 {unit}'"


def to_text(value: float, unit: str) -> str | float:
    """The YAML form of an SI value: text with its unit, or the bare number where the unit is "1"."""
    return float(value) if unit == "1" else f"{float(value)!r} {unit}"


def build(cls: type, values: Mapping[str, Any], where: str) -> Any:
    """An instance of a parameter dataclass from a mapping as YAML gives it.

    Raises:
        BenchError: unknown or missing key, bad unit, value outside its bounds, word that is no option.
    """
    if not isinstance(values, Mapping):
        raise BenchError(f"{where}: expected 'name: value' lines, found {values!r}")
    parameters, choices, tables, forms = parameters_of(cls), choices_of(cls), tables_of(cls), forms_of(cls)
    known: dict[str, Parameter | Choice | Table | Form] = {**parameters, **choices, **tables, **forms}
    for key in values:
        if key not in known:
            raise BenchError(f"{where}: unknown parameter {key!r}; known are {', '.join(known)}")
    required = [f.name for f in dataclasses.fields(cls) if f.name in known and f.default is dataclasses.MISSING]
    for name in required:
        if name not in values:
            raise BenchError(f"{where}: parameter '{name}' is missing ({known[name].description})")
    read: dict[str, Any] = {}
    for key, value in values.items():
        if key in parameters:
            read[key] = to_si(value, parameters[key].unit, f"{where}.{key}")
            check_bounds(read[key], parameters[key], f"{where}.{key}")
        elif key in tables:
            read[key] = table_from_data(value, tables[key], f"{where}.{key}")
        elif key in forms:
            read[key] = forms[key].read(value, f"{where}.{key}")
        else:
            read[key] = _option(value, choices[key], f"{where}.{key}")
    return cls(**read)


def table_to_data(values: tuple[float, ...], unit: str) -> dict[str, Any]:
    """The YAML form of a row of SI values."""
    return {"unit": unit, "values": [float(value) for value in values]}


def table_from_data(data: Any, declared: Table, where: str) -> tuple[float, ...]:
    """A row of SI values from its YAML form `{unit: MV/m, values: [0.1, 0.2]}`.

    Raises:
        BenchError: another form, a bad unit, what is no number or lies outside the bounds.
    """
    if not isinstance(data, Mapping) or set(data) != {"unit", "values"} or not isinstance(data["values"], list):
        raise BenchError(f"{where}: expected {{unit: {declared.unit}, values: [...]}}; write the row of numbers so")
    row = []
    for number, value in enumerate(data["values"], start=1):
        place = f"{where}, value {number}"
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise BenchError(f"{place}: {value!r} is not a number; the unit stands once, beside the values")
        row.append(to_si(f"{float(value)!r} {data['unit']}" if declared.unit != "1" else value, declared.unit, place))
        check_bounds(row[-1], declared, place)
    return tuple(row)


def check_bounds(value: float, declared: Parameter | Table, where: str) -> None:
    """Raise BenchError unless the SI `value` lies within the declared bounds."""
    if not declared.lower <= value <= declared.upper:
        unit = "" if declared.unit == "1" else f" {declared.unit}"
        limits = f"{declared.lower:.6g} to {declared.upper:.6g}{unit}"
        raise BenchError(f"{where}: {value:.6g}{unit} is outside {limits} ({declared.description})")


def _option(value: Any, declared: Choice, where: str) -> str:
    if not isinstance(value, str) or (declared.options and value not in declared.options):
        expected = f"one of {', '.join(declared.options)}" if declared.options else "a word"
        raise BenchError(f"{where}: {value!r} is not {expected} ({declared.description})")
    return str(value)
