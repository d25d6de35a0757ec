# SPDX-License-Identifier: Apache-2.0
"""Frozen dataclasses with units and bounds, and a strict loader from YAML that names file, line, value and bound.

A parameter is declared once, with `field(default, unit=..., low=..., high=..., doc=...)`; files, command lines and ROS
parameters are all checked against that one declaration. Unknown keys, wrong types, NaN and values out of bounds
are refused; nothing is evaluated or unpickled.
"""

import dataclasses
import math
import re
import sys
import types
import typing
import unicodedata
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from seed_core.errors import SeedError
from seed_core.program.files import write_text
from seed_core.program.suggestions import did_you_mean, no_such_file

T = TypeVar("T")
RENAMED = {  # parameters of former releases, refused with the name that they have now
    "max_turning": "max_angular_speed",
    "max_turning_acceleration": "max_angular_acceleration",
    "max_turning_step": "max_angular_step",
}
MAX_BYTES = 10_000_000  # a configuration file larger than this is not one
_OTHER_BASE = re.compile(r"[-+]?(0[0-7_]+$|[0-9].*:)")  # octal 010 and sexagesimal 1:30 of YAML 1.1
SPARE_VALUES = 100_000  # that aliases may add to a text, which has at most one value for each of its characters


class ConfigError(SeedError):
    """A configuration value that cannot be used.

    Attributes:
        key: of a dataclass's own check: the field on whose line the mistake stands; '' for the whole.
    """

    def __init__(self, message: str, key: str = "") -> None:
        super().__init__(message)
        self.key = key


def field(
    default: Any = dataclasses.MISSING,
    *,
    unit: str = "",
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
    doc: str = "",
    quantity: bool = False,
    span: bool = False,
) -> Any:
    """A dataclass field whose value is checked: each number within [low, high] and finite, each string in choices.

    A quantity is written with its unit, '0.05 m/s' or '0 0 -10 N', and with no other than the field's. Any other number
    that has a unit may be written so as well.
    A span is a pair [low, high] that may be written as one number.
    """
    bounds = {"low": low, "high": high, "choices": choices}
    metadata = {"unit": unit, "doc": doc, "quantity": quantity, "span": span, **bounds}
    if isinstance(default, list | dict):
        return dataclasses.field(default_factory=lambda: type(default)(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def inherited(cls: type, name: str, default: Any, **bounds: float) -> Any:
    """The field `name` of the dataclass cls with another default and narrower bounds, for a class that inherits it."""
    metadata = cls.__dataclass_fields__[name].metadata  # type: ignore[attr-defined]
    return dataclasses.field(default=default, metadata={**metadata, **bounds})


class _Node:
    """A YAML value with the line that it stands on."""

    __slots__ = ("line", "value")

    def __init__(self, value: Any, line: int) -> None:
        self.value = value
        self.line = line

    def __repr__(self) -> str:
        return repr(self.value)


def _wrap(value: Any) -> Any:
    """Plain data as nodes without lines."""
    if isinstance(value, Mapping):
        return _Node({str(k): _wrap(v) for k, v in value.items()}, 0)
    if isinstance(value, list | tuple):
        return _Node([_wrap(v) for v in value], 0)
    return _Node(value, 0)


class _Parser:
    """Nodes of a YAML text, with what repeats written out as often as it is named."""

    def __init__(self, loader: yaml.SafeLoader, source: str, most: int) -> None:
        """most: values that there may be."""
        self._loader, self._source, self._most, self._count = loader, source, most, 0

    def parse(self, node: yaml.Node | None) -> _Node:
        """Raises ConfigError: a key stands twice, a text cannot be written, a number is not read as it looks, or too
        many values come of aliases."""
        if node is None:
            return _Node({}, 1)
        line = node.start_mark.line + 1
        self._count += 1
        if self._count > self._most:
            raise ConfigError(f"{self._source}:{line}: aliases (*name) make more than {self._most} values of this text")
        if isinstance(node, yaml.MappingNode):
            out: dict[str, _Node] = {}
            for key_node, value_node in node.value:
                key = str(self._scalar(key_node))
                if key in out:
                    raise ConfigError(f"{self._source}:{key_node.start_mark.line + 1}: key '{key}' stands twice")
                out[key] = self.parse(value_node)
            return _Node(out, line)
        if isinstance(node, yaml.SequenceNode):
            return _Node([self.parse(n) for n in node.value], line)
        return _Node(self._scalar(node), line)

    def _scalar(self, node: yaml.Node) -> Any:
        value = self._loader.construct_object(node)
        if isinstance(value, int | float) and _OTHER_BASE.match(node.value):
            raise ConfigError(
                f"{self._source}:{node.start_mark.line + 1}: YAML reads {node.value} as {value:g}: write {value:g} if "
                "that is meant; a number has no leading zero and no colon"
            )
        if isinstance(value, str) and (wrong := [c for c in value if _is_no_text(c)]):
            raise ConfigError(
                f"{self._source}:{node.start_mark.line + 1}: a text has the character {wrong[0]!a}, which cannot "
                "be written or sent: leave it out"
            )
        return value


def _is_no_text(character: str) -> bool:
    """A lone surrogate, or a control character but for tab and end of line."""
    return unicodedata.category(character) in ("Cs", "Cc") and character not in "\t\n\r"


def parse_yaml(text: str, source: str = "<text>") -> _Node:
    """YAML text as nodes that know their lines.

    Raises:
        ConfigError: the text is no YAML, or too large.
    """
    if len(text) > MAX_BYTES:
        size = f"{len(text)} characters are too many for a configuration file"
        raise ConfigError(f"{source}: {size} (at most {MAX_BYTES})")
    loader = None
    try:
        loader = yaml.SafeLoader(text)  # reads the text's characters already
        return _Parser(loader, source, len(text) + SPARE_VALUES).parse(loader.get_single_node())
    except ConfigError:
        raise
    except Exception as error:  # besides YAMLError whatever the constructors of numbers and dates trip over
        raise ConfigError(f"{source}: not readable as YAML: {error}") from error
    finally:
        if loader is not None:
            loader.dispose()


def plain_yaml(text: str, source: str) -> Any:
    """YAML text as plain data, for files that are not ours alone. Raises ConfigError: the text is no YAML."""
    try:
        return yaml.safe_load(text)
    except Exception as error:  # as in parse_yaml
        raise ConfigError(f"{source}: not readable as YAML: {error}") from error


def load_text(text: str, cls: type[T], source: str = "<text>") -> T:
    """An instance of the dataclass cls from YAML text. Raises ConfigError with source and line."""
    return _build(parse_yaml(text, source), cls, "", source)


def load_file(path: str | Path, cls: type[T]) -> T:
    """An instance of the dataclass cls from a YAML file. Raises ConfigError with file and line."""
    return load_text(read_text(path), cls, str(path))


def load_saved(path: str | Path, cls: type[T], kind: str) -> T:
    """The same of a file that `save_file` has written, which ends with `version`; kind: what it is called in errors.

    Raises:
        ConfigError: as `load_file`; or it is another kind of file, or ends before, and would be read as another one.
    """
    node = parse_yaml(read_text(path), str(path))
    if isinstance(node.value, dict) and "version" not in node.value:
        known = [f.name for f in dataclasses.fields(cls)]  # type: ignore[arg-type]
        if other := next((key for key in node.value if key not in known), ""):
            raise ConfigError(f"{path} is no {kind}: unknown key '{other}'; a {kind} has {', '.join(known)}")
        raise ConfigError(f"{path}: its last key, version, is missing: the file was cut short; make it anew")
    return _build(node, cls, "", str(path))


def read_text(path: str | Path) -> str:
    """The text of a file. Raises ConfigError: it cannot be read, and why."""
    file = Path(path)
    try:
        return file.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise ConfigError(f"{file}: cannot be read: {no_such_file(file)}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{file}: cannot be read: {error}") from error


def from_mapping(data: Mapping[str, Any], cls: type[T], source: str = "<values>") -> T:
    """An instance of the dataclass cls from plain nested data (for example ROS parameters)."""
    return _build(_wrap(data), cls, "", source)


def check_values(data: Mapping[str, Any], cls: type, source: str = "<values>") -> None:
    """Check values of fields of the dataclass cls, each by itself: not how they go together, nor that all are there.

    Raises:
        ConfigError: a value is of the wrong type or out of bounds.
    """
    hints = typing.get_type_hints(cls)
    for f in dataclasses.fields(cls):
        if f.name in data:
            _convert(_wrap(data[f.name]), hints[f.name], f.name, source, f.metadata)


def to_mapping(value: Any) -> Any:
    """Plain data (dicts, lists, scalars) of a dataclass, ready for yaml.safe_dump."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: to_mapping(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(k): to_mapping(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [to_mapping(v) for v in value]
    return value.item() if hasattr(value, "item") else value


def checked(value: T, source: str = "<values>") -> T:
    """The dataclass instance value, once each of its fields has passed its check. Raises ConfigError."""
    from_mapping(to_mapping(value), type(value), source)
    return value


def _fail(node: _Node, source: str, message: str) -> typing.NoReturn:
    raise ConfigError(f"{source}:{node.line}: {message}" if node.line else f"{source}: {message}")


def _build(node: _Node, cls: type[T], path: str, source: str) -> T:
    hints = typing.get_type_hints(cls)
    if not isinstance(node.value, dict):
        _fail(node, source, f"{path or cls.__name__} must be a mapping with some of: {', '.join(hints)}")
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init}  # type: ignore[arg-type]
    for key, child in node.value.items():
        if key not in fields:
            hint = f"it is called '{RENAMED[key]}' now" if key in RENAMED else f"known here: {', '.join(fields)}"
            _fail(child, source, f"unknown key '{_join(path, key)}'; {hint}")
    values = {}
    for name, spec in fields.items():
        if name in node.value:
            values[name] = _convert(node.value[name], hints[name], _join(path, name), source, spec.metadata)
        elif spec.default is dataclasses.MISSING and spec.default_factory is dataclasses.MISSING:
            _fail(node, source, f"'{_join(path, name)}' is missing{_describe(spec.metadata)}")
    try:
        return cls(**values)
    except ConfigError as error:
        _fail(node.value.get(error.key, node), source, str(error))


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _describe(meta: Mapping[str, Any]) -> str:
    words = [w for w in (meta.get("unit", ""), meta.get("doc", "")) if w]
    return f" ({'; '.join(words)})" if words else ""


def _quantity(node: _Node, name: str, source: str, meta: Mapping[str, Any]) -> _Node:
    """The numbers of '0 0 -10 N' as plain nodes, once the unit has been found to be the field's."""
    unit = meta["unit"]
    numbers = _numbers(node, unit)
    if numbers is None:
        example = f"for example 0.5 {unit}, or 0 0 0.5 {unit} for three of them"
        _fail(node, source, f"{name} = {node.value!r} must be numbers with their unit, {unit}: {example}")
    return numbers


def _numbers(node: _Node, unit: str) -> _Node | None:
    """One number, or a list, of a text of numbers with this very unit; None of any other."""
    words = node.value.split() if isinstance(node.value, str) else []
    count = len(words) - len(unit.split())
    if count < 1 or " ".join(words[count:]) != unit:
        return None
    try:
        values = [_Node(_number(w), node.line) for w in words[:count]]
    except ValueError:
        return None
    return values[0] if len(values) == 1 else _Node(values, node.line)


def _number(word: str) -> float:
    """A word as a number, a whole one where it is written so. Raises ValueError: it is none."""
    try:
        return int(word)
    except ValueError:
        return float(word)


def _convert(node: _Node, kind: Any, name: str, source: str, meta: Mapping[str, Any]) -> Any:
    if meta.get("quantity") and node.value is not None:
        node, meta = _quantity(node, name, source, meta), {**meta, "quantity": False}
    elif meta.get("unit") and kind is not str:  # '0.1 kg' where 0.1 is meant to stand
        node = _numbers(node, meta["unit"]) or node
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        if node.value is None and type(None) in args:
            return None
        (kind,) = (a for a in args if a is not type(None))
        return _convert(node, kind, name, source, meta)
    if dataclasses.is_dataclass(kind):
        return _build(node, typing.cast(type, kind), name, source)
    if origin in (tuple, list):
        return _convert_sequence(node, origin, args, name, source, meta)
    if origin in (dict, Mapping):
        if not isinstance(node.value, dict):
            _fail(node, source, f"{name} must be a mapping")
        return {k: _convert(v, args[1], f"{name}.{k}", source, meta) for k, v in node.value.items()}
    return _convert_scalar(node, kind, name, source, meta)


def _convert_sequence(node: _Node, origin: Any, args: Any, name: str, source: str, meta: Mapping[str, Any]) -> Any:
    if meta.get("span") and isinstance(node.value, float | int) and not isinstance(node.value, bool):
        node = _Node([_Node(node.value, node.line)] * 2, node.line)
    if not isinstance(node.value, list):
        what, unit = "a number or a list of two" if meta.get("span") else "a list", meta.get("unit")
        if unit and isinstance(node.value, str) and node.value.lstrip("+-.")[:1].isdigit():
            _fail(node, source, f"{name} = {node.value!r} must be in {unit}: {what}, with or without that very unit")
        _fail(node, source, f"{name} must be {what}{_describe(meta)}, not {node.value!r}")
    kinds = [args[0]] * len(node.value) if origin is list or args[-1] is Ellipsis else list(args)
    if len(kinds) != len(node.value):
        _fail(node, source, f"{name} has {len(node.value)} values; it needs {len(kinds)}{_describe(meta)}")
    values = origin(
        _convert(v, k, f"{name}[{i}]", source, meta) for i, (v, k) in enumerate(zip(node.value, kinds, strict=True))
    )
    if meta.get("span") and values[0] > values[1]:
        low, high = f"{values[1]:g}", f"{values[0]:g}"
        _fail(node, source, f"{name} = [{high}, {low}] must run from low to high: [{low}, {high}]{_describe(meta)}")
    return values


def _convert_scalar(node: _Node, kind: Any, name: str, source: str, meta: Mapping[str, Any]) -> Any:
    value, unit = node.value, f" {meta['unit']}" if meta.get("unit") else ""
    if kind in (float, int):
        wanted = (int, float) if kind is float else (int,)
        if isinstance(value, bool) or not isinstance(value, wanted):
            word = "a number" if kind is float else "a whole number"
            _fail(node, source, f"{name} = {value!r} must be {word}{_describe(meta)}")
        if not abs(value) <= sys.float_info.max:  # nor is a whole number beyond that one that can be computed with
            _fail(node, source, f"{name} = {value!s:.60}{unit} must be finite")
        low, high = meta.get("low", -math.inf), meta.get("high", math.inf)
        if not low <= value <= high:
            _fail(node, source, f"{name} = {value:g}{unit} must be within {low:g} and {high:g}{unit}")
        return kind(value)
    if kind is bool or kind is str:
        if not isinstance(value, kind):
            _fail(node, source, f"{name} = {value!r} must be {'true or false' if kind is bool else 'a text'}")
        if meta.get("choices") and value not in meta["choices"]:
            meant = did_you_mean(str(value), meta["choices"])
            _fail(node, source, f"{name} = '{value}' must be one of: {', '.join(meta['choices'])}{meant}")
    return value


def save_file(path: str | Path, header: str, value: Any, width: int = 80, compact: bool = False) -> None:
    """Write a dataclass as YAML, whole or not at all; load_file reads it.

    Args:
        header: comments that stand first, with their line ends. width: characters after which lines are broken.
        compact: the innermost lists and mappings stand in one line each, as far as the width lets them.
    """
    style = None if compact else False
    text = yaml.safe_dump(to_mapping(value), sort_keys=False, width=width, default_flow_style=style)
    write_text(path, header + text)
