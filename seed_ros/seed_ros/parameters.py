# SPDX-License-Identifier: Apache-2.0
"""ROS parameters from one typed dataclass: declared, described, bounded and checked by the core's own rules."""

import contextlib
import copy
import dataclasses
import difflib
import math
import sys
import typing
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from seed_core.config import RENAMED, ConfigError, from_mapping
from seed_core.errors import SeedError
from seed_ros.parameter_files import check_files
from seed_ros.private_rclpy import given_parameters

T = TypeVar("T")


def _leaves(value: Any, prefix: str = "") -> Iterator[tuple[str, Any, Any]]:
    """(dotted name, default, field) of every scalar or list below a dataclass instance."""
    for spec in dataclasses.fields(value):
        name, item = f"{prefix}{spec.name}", getattr(value, spec.name)
        if dataclasses.is_dataclass(item):
            yield from _leaves(item, f"{name}.")
        else:
            yield name, item, spec


def _descriptor(spec: dataclasses.Field[Any], read_only: bool) -> ParameterDescriptor:
    """Any type is let in: the check of the whole says what would have been right, and takes 1 for 1.0."""
    meta = spec.metadata
    low, high = meta.get("low", -math.inf), meta.get("high", math.inf)
    unit = f" [{meta['unit']}]" if meta.get("unit") else ""
    bounds = "" if math.isinf(low) and math.isinf(high) else f", {low:g} to {high:g}"
    choices = meta.get("choices") or ()
    return ParameterDescriptor(
        description=f"{meta.get('doc', '')}{unit}{bounds}",
        additional_constraints=f"one of: {', '.join(choices)}" if choices else "",
        read_only=read_only,
        dynamic_typing=True,
    )


def with_range(descriptor: ParameterDescriptor, spec: dataclasses.Field[Any]) -> ParameterDescriptor:
    """The descriptor with the field's bounds as a range, for tools that show one; a side without bound is the largest.

    Only those who ask get it: rclpy would refuse a value out of range before our own check can say which and why.
    """
    low, high = spec.metadata.get("low", -math.inf), spec.metadata.get("high", math.inf)
    if math.isinf(low) and math.isinf(high):
        return descriptor
    out = copy.deepcopy(descriptor)
    if isinstance(spec.default, int) and not isinstance(spec.default, bool):
        bounds = (max(low, -(2**63)), min(high, 2**63 - 1))
        out.integer_range = [IntegerRange(from_value=int(bounds[0]), to_value=int(bounds[1]))]
    else:
        most = sys.float_info.max
        bounds = (max(low, -most), min(high, most))
        out.floating_point_range = [FloatingPointRange(from_value=float(bounds[0]), to_value=float(bounds[1]))]
    return out


def _ros_value(item: Any) -> Any:
    return [_ros_value(v) for v in item] if isinstance(item, tuple | list) else item


def _nested(values: dict[str, Any]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, value in values.items():
        *path, last = name.split(".")
        place = out
        for part in path:
            place = place.setdefault(part, {})
        place[last] = list(value) if isinstance(value, typing.Sequence) and not isinstance(value, str) else value
    return out


class Declared(Generic[T]):
    """The ROS parameters of one dataclass: a parameter per field, whose names are dotted below a prefix."""

    def __init__(self, node: Node, defaults: T, prefix: str = "", live: Collection[str] = ()) -> None:
        """Declare all; those of fields in `live` may be changed while the node runs, all others are read-only."""
        self._node, self._kind = node, type(defaults)
        ranges: dict[str, Any] = getattr(node, "ranges", {})
        self._fields: dict[str, str] = {}  # by name of the parameter
        for name, item, spec in _leaves(defaults):
            if item is None:
                continue
            parameter = f"{prefix}.{name}" if prefix else name
            self._fields[parameter] = name
            ranges[parameter] = spec
            descriptor = _descriptor(spec, name.split(".")[0] not in live)
            if node.declare_parameter(parameter, _ros_value(item), descriptor).value is None:
                raise ConfigError(f"parameter '{parameter}' of {node.get_name()} has no value; default: {item!r}")

    def among(self, parameters: Iterable[Parameter]) -> dict[str, Any]:
        """Values of those that are of this dataclass."""
        return {p.name: p.value for p in parameters if p.name in self._fields}

    def read(self, changes: Iterable[Parameter] = ()) -> T:
        """The dataclass of the present values, or of what they would be with changes.

        Raises:
            ConfigError: a value is of the wrong type or out of bounds.
        """
        values = {p.name: p.value for p in self._node.get_parameters(list(self._fields))} | self.among(changes)
        nested = _nested({self._fields[name]: value for name, value in values.items()})
        return from_mapping(nested, self._kind, f"parameters of {self._node.get_name()}")


def declare(
    node: Node,
    defaults: T,
    prefix: str = "",
    *,
    on_change: Callable[[T], None] | None = None,
    live: Collection[str] = (),
) -> T:
    """Declare one ROS parameter per field of the dataclass instance `defaults`, and read it back.

    Names are dotted below `prefix`. Fields named in `live` may be changed while the node runs: the whole is
    checked first, then `on_change` gets the new instance. All others are read-only.

    Raises:
        ConfigError: a value given from outside is of the wrong type or out of bounds.
    """
    declared = Declared(node, defaults, prefix, live)

    def apply(parameters: list[Parameter]) -> None:
        if on_change and declared.among(parameters):
            on_change(declared.read())

    value = declared.read()
    if live:
        node.add_on_set_parameters_callback(checking(declared.read))
        node.add_post_set_parameters_callback(apply)
    return value


def checking(check: Callable[[list[Parameter]], Any]) -> Callable[[list[Parameter]], SetParametersResult]:
    """A callback of rclpy that refuses changes for which `check` raises SeedError."""

    def callback(parameters: list[Parameter]) -> SetParametersResult:
        try:
            check(parameters)
        except SeedError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    return callback


def refuse_unknown(node: Node, shared: tuple[str, ...] = ()) -> None:
    """Called once everything is declared: a parameter given from outside that nobody declared is a mistake.

    So is a file of parameters that would not be used. Names that start with one of `shared` are passed over: files for
    several nodes hold them. A value of `parameter_files` that another one replaces, as a launch argument does, is told.

    Raises:
        ConfigError: naming the file; or the parameter, and the nearest known ones.
    """
    for name, (value, file) in check_files(node).items():
        if node.has_parameter(name) and not _alike(value, has := node.get_parameter(name).value):
            node.get_logger().warning(f"{name} = {has} replaces the {value} of {file}: it is given at the start, too")
    for name in given_parameters(node):
        if not node.has_parameter(name) and not name.startswith(shared or ("\0",)):
            raise ConfigError(no_such_parameter(node, name))


def _alike(a: Any, b: Any) -> bool:
    """Whether a file's value a of a parameter is the node's; lists may be arrays."""
    if isinstance(a, str) and isinstance(b, float):
        with contextlib.suppress(ValueError):
            a = float(a)  # 1e-3 is a text in YAML 1.1
    if isinstance(a, str) or isinstance(b, str) or not isinstance(a, typing.Iterable):
        return bool(a == b)
    return isinstance(b, typing.Iterable) and list(a) == list(b)


def no_such_parameter(node: Node, name: str) -> str:
    """That a node has none of this name, and which ones may be meant."""
    known = node.get_parameters_by_prefix("")
    near = ", ".join(difflib.get_close_matches(name, known, n=3))
    hint = f"did you mean {near}?" if near else "docs/interfaces.md lists those that there are"
    hint = f"it is called {RENAMED[name]} now" if name in RENAMED else hint
    return f"{node.get_name()} has no parameter '{name:.60}'; {hint}"
