# SPDX-License-Identifier: Apache-2.0
"""A task as the text of a task file: every quantity with its unit, and nothing that is the default anyway."""

from dataclasses import MISSING, fields, is_dataclass
from typing import Any

import yaml

from seed_control.tasks import Task

WIDTH = 120  # characters of a line
DIGITS = 6  # behind the point: micrometres


class _Dumper(yaml.SafeDumper):
    """Short lists in one line, mappings in lines."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True


_Dumper.add_representer(
    list,
    lambda dumper, data: dumper.represent_sequence(
        "tag:yaml.org,2002:seq", data, flow_style=not any(isinstance(item, dict) for item in data)
    ),
)


def task_text(task: Task, *comments: str) -> str:
    """The file's text, with comments of a line each at its top; `load_task` reads it."""
    head = "".join(f"# {line}\n" for line in comments)
    return head + yaml.dump(_plain(task), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=WIDTH)


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        out = {}
        for f in fields(value):
            own = getattr(value, f.name)
            if f.default is not MISSING and own == f.default:
                continue
            out[f.name] = _quantity(own, f.metadata["unit"]) if f.metadata.get("quantity") else _plain(own)
        return out
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return _number(value) if isinstance(value, float) else value


def _quantity(value: Any, unit: str) -> str:
    numbers = value if isinstance(value, list | tuple) else (value,)
    return " ".join([*(f"{_number(v):.12g}" for v in numbers), unit])


def _number(value: float) -> float:
    return round(value, DIGITS) + 0.0
