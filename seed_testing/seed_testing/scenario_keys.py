# SPDX-License-Identifier: Apache-2.0
"""The keys of a scenario file as they are declared: for docs/scenarios.md and for the test that compares the two."""

import dataclasses
import sys
import typing
from collections.abc import Iterator
from math import isinf
from pathlib import Path
from typing import Any

from seed_sim.scenario import Scenario

HEADING = "## Keys\n"
HEAD = "| key | default | unit | bounds | meaning |\n|---|---|---|---|---|"


def section_of(kind: Any) -> type | None:
    """The dataclass of a key that is a section, whether or not it may be left out as none; None for a value."""
    return next((k for k in (kind, *typing.get_args(kind)) if dataclasses.is_dataclass(k)), None)  # type: ignore[return-value]


def rows_of(cls: type, value: Any, path: str) -> Iterator[str]:
    """A table row per key of a section and of those in it.

    Args:
        value: its default; None: none, and the keys have the defaults of the class.
        path: what stands before each key.
    """
    hints = typing.get_type_hints(cls)
    for f in dataclasses.fields(cls):
        default = f.default if value is None else getattr(value, f.name)
        if inner := section_of(hints[f.name]):
            yield row(f"{path}{f.name}", "none" if default is None else "", f.metadata)
            yield from rows_of(inner, default, f"{path}{f.name}.")
        else:
            yield row(f"{path}{f.name}", shown(default), f.metadata)


def row(key: str, default: str, meta: typing.Mapping[str, Any]) -> str:
    """The table row of one key."""
    bounds = ", ".join(meta["choices"])
    if not isinf(meta["low"]):
        bounds = f"{meta['low']:g} to {meta['high']:g}"
    return f"| `{key}` | {default} | {meta['unit']} | {bounds} | {meta['doc'].replace('|', '/')} |"


def shown(value: Any) -> str:
    """A default as a scenario file has it."""
    match value:
        case dataclasses.MISSING:
            return "must be given"
        case None | {}:
            return "none"
        case "":
            return "(empty)"
        case bool():
            return str(value).lower()
        case float():
            return f"{value:g}"
        case tuple():
            return f"[{', '.join(map(shown, value))}]"
    return str(value)


def tables() -> str:
    """The keys that stand for themselves, then a table for each section."""
    hints, scenario = typing.get_type_hints(Scenario), Scenario()
    single, parts = [], []
    for f in dataclasses.fields(Scenario):
        default = getattr(scenario, f.name)
        if inner := section_of(hints[f.name]):
            words = (
                f.metadata["doc"][0].upper() + f.metadata["doc"][1:] + ("; none if left out" if default is None else "")
            )
            rows = "\n".join(rows_of(inner, default, f"{f.name}."))
            parts.append(f"### {f.name}\n{words}.\n\n{HEAD}\n{rows}\n")
        else:
            single.append(row(f.name, shown(default), f.metadata))
    return "\n".join(["### Without a section", HEAD, *single, "", *parts])


def with_tables(document: str) -> str:
    """The document with the tables as they are now; they stand at its end."""
    return f"{document.partition(HEADING)[0]}{HEADING}{tables()}"


def main() -> int:
    """Write the tables into the file given."""
    file = Path(sys.argv[1])
    file.write_text(with_tables(file.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
