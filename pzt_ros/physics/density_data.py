"""Densities as they stand in a chain file.

    coercive_density: {unit: MV/m, field: [0.1, 0.5, 2.0], density: [0, 1, 0]}
    threshold_density: {unit: MV/m, up: [0, 1, 2], down: [-2, -1, 0], density: [[0, 1, 0], [2, 3, 0], [1, 0, 0]]}

The density is to any scale; that of thresholds has a row for each field of up-switching.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pzt_ros import quantities
from pzt_ros.errors import BenchError
from pzt_ros.physics.density import Table, ThresholdDensity

_FIELD = quantities.Table("V/m", -1e9, 1e9, "fields of a density")
_DENSITY = quantities.Table("1", 0.0, 1e300, "density to any scale, not below 0")


def table_from_data(data: Any, where: str) -> Table:
    """A density of one field from its YAML form.

    Raises:
        BenchError: another form, a bad unit or number, or what no density can be.
    """
    unit, fields, weights = _parts(data, ("unit", "field", "density"), where)
    return _made(Table, where, _fields(fields, unit, f"{where}.field"), _densities(weights, f"{where}.density"))


def table_to_data(table: Table) -> dict[str, Any]:
    """The YAML form of a density of one field."""
    return {"unit": "V/m", "field": _plain(table.field), "density": _plain(table.weight)}


def thresholds_from_data(data: Any, where: str) -> ThresholdDensity:
    """A density of thresholds from its YAML form; raises as `table_from_data`."""
    unit, up, down, rows = _parts(data, ("unit", "up", "down", "density"), where)
    if not isinstance(rows, list):
        raise BenchError(f"{where}.density: expected a list of rows, one for each up field, found {rows!r}")
    weights = tuple(_densities(row, f"{where}.density, row {number}") for number, row in enumerate(rows, start=1))
    return _made(
        ThresholdDensity, where, _fields(up, unit, f"{where}.up"), _fields(down, unit, f"{where}.down"), weights
    )


def thresholds_to_data(density: ThresholdDensity) -> dict[str, Any]:
    """The YAML form of a density of thresholds."""
    return {
        "unit": "V/m",
        "up": _plain(density.up_fields),
        "down": _plain(density.down_fields),
        "density": [_plain(row) for row in density.weights],
    }


def _plain(values: tuple[float, ...]) -> list[float]:
    return [float(value) for value in values]


def _parts(data: Any, keys: tuple[str, ...], where: str) -> tuple[Any, ...]:
    if not isinstance(data, Mapping) or set(data) != set(keys):
        found = ", ".join(map(str, data)) if isinstance(data, Mapping) else repr(data)
        raise BenchError(f"{where}: a density has {', '.join(keys)}, found {found}; write just these")
    return tuple(data[key] for key in keys)


def _fields(values: Any, unit: Any, where: str) -> tuple[float, ...]:
    return quantities.table_from_data({"unit": unit, "values": _list(values, where)}, _FIELD, where)


def _densities(values: Any, where: str) -> tuple[float, ...]:
    return quantities.table_from_data({"unit": "1", "values": _list(values, where)}, _DENSITY, where)


def _list(values: Any, where: str) -> list[Any]:
    if not isinstance(values, list):
        raise BenchError(f"{where}: expected a list of numbers, found {values!r}")
    return values


def _made(density: type, where: str, *parts: Any) -> Any:
    try:
        return density(*parts)
    except BenchError as error:
        raise BenchError(f"{where}: {error}") from None
