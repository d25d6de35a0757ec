# SPDX-License-Identifier: Apache-2.0
"""A task from what a client of the action sends: a name, a file, or the YAML text itself, with overrides."""

from __future__ import annotations

from dataclasses import dataclass

from seed_control.tasks.load import changed, load_task
from seed_control.tasks.task import Task, TaskError
from seed_core.config import field, load_text

MAX_TEXT = 100_000  # characters of a task sent as text


@dataclass(frozen=True)
class Overrides:
    """What a client may change of a task."""

    force: float | None = field(None, unit="N", low=0.1, high=200.0, doc="size of every force of the task")
    text: str | None = field(None, doc="text to write")


def read_task(source: str, overrides: str = "") -> Task:
    """The task with its overrides (a YAML mapping with `force`, `text`).

    Raises:
        TaskError: no such task, or one that an override does not fit.
        ConfigError: with source and line.
    """
    change = load_text(overrides, Overrides, "overrides") if overrides.strip() else Overrides()
    if "\n" not in source:
        return load_task(source.strip(), change.force, change.text)
    if len(source) > MAX_TEXT:
        raise TaskError(f"a task of {len(source)} characters is too long; at most {MAX_TEXT}")
    return changed(load_text(source, Task, "task"), change.force, change.text)
