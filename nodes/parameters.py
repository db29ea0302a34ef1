"""ROS parameters out of the library's own declarations: description, unit and range are said once."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from pzt_ros.errors import BenchError
from pzt_ros.quantities import choices_of, parameters_of
from pzt_ros.scenario import AS_FAST_AS_POSSIBLE, RATES

Owner = TypeVar("Owner")
Settings = TypeVar("Settings")


def declare_text(node: Node, name: str, default: str, description: str) -> str:
    """A read-only text parameter; returns its value."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    return str(node.declare_parameter(name, default, descriptor).value)


def declare_rate(node: Node) -> str:
    """The pace of the run, by the read-only parameter `rate`.

    Raises:
        BenchError: there is no such pace.
    """
    rate = declare_text(node, "rate", AS_FAST_AS_POSSIBLE, f"pace: one of {', '.join(RATES)}")
    if rate not in RATES:
        raise BenchError(f"{node.get_name()}: rate '{rate}' is not one of {', '.join(RATES)}")
    return rate


def declare_all(node: Node, prefix: str, owner: Owner, *, read_only: bool = False) -> Owner:
    """Declare every field of a parameter dataclass as `prefix.field`; returns it with the values that were given.

    A value outside its range is refused by rclpy with a reason, at start and later.
    """
    given = {}
    for name, declared in parameters_of(owner).items():
        full = f"{prefix}.{name}" if prefix else name
        descriptor = ParameterDescriptor(
            description=f"{declared.description} [{declared.unit}]",
            additional_constraints=f"SI unit {declared.unit}",
            read_only=read_only,
            floating_point_range=_range(declared.lower, declared.upper),
        )
        given[name] = float(node.declare_parameter(full, float(getattr(owner, name)), descriptor).value)
    return dataclasses.replace(owner, **given)  # type: ignore[type-var]


def declare_driver(node: Node, table: Mapping[str, type[Settings]], find: Callable[[str], type[Settings]]) -> Settings:
    """The settings of the driver that the parameter `driver` names, each a read-only parameter `kind.field`.

    Raises:
        BenchError: there is no such driver.
    """
    kind = declare_text(node, "driver", "simulated", f"the instrument behind this node: one of {', '.join(table)}")
    settings = declare_all(node, kind, find(kind)(), read_only=True)
    words = {
        name: declare_text(node, f"{kind}.{name}", getattr(settings, name), declared.description)
        for name, declared in choices_of(settings).items()
    }
    return dataclasses.replace(settings, **words)  # type: ignore[type-var]


def _range(lower: float, upper: float) -> list[FloatingPointRange]:
    if math.isinf(lower) or math.isinf(upper):
        return []
    return [FloatingPointRange(from_value=lower, to_value=upper, step=0.0)]


def changed(owner: Any, prefix: str, parameters: list[Parameter]) -> Any:
    """The dataclass with those of its fields replaced that are among `parameters`."""
    fields = parameters_of(owner)
    start = f"{prefix}." if prefix else ""
    new = {
        p.name[len(start) :]: p.value for p in parameters if p.name.startswith(start) and p.name[len(start) :] in fields
    }
    return dataclasses.replace(owner, **new) if new else owner


def on_change(node: Node, apply: Callable[[list[Parameter]], str]) -> None:
    """Call `apply` on every accepted set of parameters; the text it returns refuses them with that reason."""

    def callback(parameters: list[Parameter]) -> SetParametersResult:
        reason = apply(parameters)
        return SetParametersResult(successful=not reason, reason=reason)

    node.add_on_set_parameters_callback(callback)
