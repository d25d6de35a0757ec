# SPDX-License-Identifier: Apache-2.0
"""Messages that are well typed and otherwise anything, made from the definitions of their types."""

import math
import re
from array import array
from collections.abc import Iterator
from functools import cache
from random import Random
from typing import Any

from seed_bringup.bags.types import message_class

REALS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 1e30, 1e9, -1.0, 0.0, -0.0, 1.0, 1e-3, 40.0)
SINGLE = 3.4e38  # no float32 is larger
WORDS = ["", "\0", "..", "/", "x" * 300, "ä ☃", "nan", "\n", "a\nb: [", "{", "%s{}"]
WORDS += ["base", "tool0", "world", "compliance", "tool", "tip", "surface", "left", "squeegee", "peg"]
WORDS += ["32FC1", "mono16", "16UC1", "bgr8", "plumb_bob"]
SIZES = (0, 1, 2, 3, 5, 6, 9, 36, 64, 200)
ARRAY = re.compile(r"^(?:sequence<(?P<item>.+?)(?:, (?P<most>\d+))?>|(?P<fixed>.+)\[(?P<size>\d+)\])$")
INTEGER = re.compile(r"^(u?)int(\d+)$")


def real(rng: Random) -> float:
    """A number that a formula may not expect, or a plausible one."""
    return rng.choice(REALS) if rng.random() < 0.7 else rng.gauss(0.0, 10.0 ** rng.randint(-4, 4))


def whole(rng: Random, low: int, high: int) -> int:
    """An integer of [low, high], often at an end."""
    return rng.choice((low, high, 0, 1, min(high, 77), rng.randint(low, high)))


def text(rng: Random) -> str:
    """A word of the interfaces, none, or a strange one."""
    return rng.choice(WORDS)


def value(rng: Random, kind: str) -> Any:
    """A value of a type as `get_fields_and_field_types` names it."""
    found = ARRAY.match(kind)
    if found:
        item = found["item"] or found["fixed"]
        most = int(found["most"] or 200)
        size = int(found["size"]) if found["size"] else min(rng.choice(SIZES), most, 6 if "/" in item else 200)
        return _as_list(item, [value(rng, item) for _ in range(size)])
    if kind == "double":
        return real(rng)
    if kind == "float":
        number = real(rng)
        return number if not math.isfinite(number) else max(-SINGLE, min(SINGLE, number))
    if kind == "boolean":
        return rng.random() < 0.5
    if kind.startswith(("string", "wstring")):
        return text(rng)
    if kind == "octet":
        return bytes([rng.randrange(256)])
    if kind == "char":
        return rng.randrange(256)
    if integer := INTEGER.match(kind):
        bits = int(integer[2])
        return whole(rng, 0, 2**bits - 1) if integer[1] else whole(rng, -(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return message(rng, message_type(kind))


def _as_list(item: str, values: list[Any]) -> Any:
    return array("B", values) if item == "uint8" else values


@cache
def message_type(kind: str) -> Any:
    """The class of a message by name, package/Type or package/msg/Type."""
    return message_class(kind if kind.count("/") == 2 else kind.replace("/", "/msg/"))


def message(rng: Random, kind: Any) -> Any:
    """A message of which every field is anything."""
    made = kind()
    for name, field in kind.get_fields_and_field_types().items():
        setattr(made, name, value(rng, field))
    return made


def spoil(rng: Random, made: Any) -> None:
    """Make one field of a message, at any depth, anything of its type."""
    names = list(made.get_fields_and_field_types().items())
    if not names:
        return
    name, kind = rng.choice(names)
    inside = getattr(made, name)
    if hasattr(inside, "get_fields_and_field_types") and rng.random() < 0.95:
        spoil(rng, inside)
    elif ARRAY.match(kind) and len(inside) and rng.random() < 0.7:
        _spoil_item(rng, made, name, kind)
    else:
        setattr(made, name, value(rng, kind))


def _spoil_item(rng: Random, made: Any, name: str, kind: str) -> None:
    """Change, double or drop one item of a list."""
    inside = getattr(made, name)
    found = ARRAY.match(kind)
    assert found
    at = rng.randrange(len(inside))
    item = inside[at]
    if hasattr(item, "get_fields_and_field_types"):
        spoil(rng, item)
    elif found["size"] or rng.random() < 0.6:
        inside[at] = value(rng, found["item"] or found["fixed"])
    else:
        values = list(inside)
        del values[at:]
        setattr(made, name, _as_list(found["item"], values if rng.random() < 0.5 else [*inside, *inside]))


@cache
def _reals_of(kind: type) -> tuple[tuple[str, bool], ...]:
    """Fields that hold real numbers, and those that hold messages (True)."""
    out = []
    for name, field in kind.get_fields_and_field_types().items():  # type: ignore[attr-defined]
        found = ARRAY.match(field)
        item = (found["item"] or found["fixed"]) if found else field
        if item in ("double", "float") or "/" in item:
            out.append((name, "/" in item))
    return tuple(out)


def reals(made: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Path and value of every real number in a message."""
    for name, nested in _reals_of(type(made)):  # type: ignore[arg-type]
        inside = getattr(made, name)
        items = [inside] if hasattr(inside, "get_fields_and_field_types") or isinstance(inside, float) else inside
        for item in items:
            if nested:
                yield from reals(item, f"{path}{name}.")
            else:
                yield f"{path}{name}", float(item)
