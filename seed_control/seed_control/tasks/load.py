# SPDX-License-Identifier: Apache-2.0
"""Where tasks come from: files, the shipped ones by name, and changes to one that is loaded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from seed_control.tasks.task import Task, TaskError
from seed_core.config import load_file
from seed_core.files import shared_path


def shipped_tasks() -> dict[str, Path]:
    """The tasks that come with the package, by name."""
    return {f.stem: f for f in sorted(shared_path("seed_control", "config/tasks").glob("*.yaml"))}


def load_task(source: str | Path, force: float | None = None, text: str | None = None) -> Task:
    """A task from a file, or by the name of a shipped one.

    Args:
        source: path of a YAML file, or one of shipped_tasks().
        force: [N] replaces the size of every force in the task.
        text: replaces the text of a task that writes.

    Raises:
        TaskError: no such task.
        ConfigError: with file and line.
    """
    shipped = shipped_tasks()
    path = shipped.get(str(source), Path(source))
    if not path.is_file():
        raise TaskError(f"no task '{source}': neither a file nor one of {', '.join(shipped)}")
    return changed(load_file(path, Task), force, text)


def changed(task: Task, force: float | None = None, text: str | None = None) -> Task:
    """The task with another size of every force [N], or another text to write. Raises TaskError."""
    if force is not None:
        task = _with_force(task, force)
    if text is not None:
        task = _with_text(task, text)
    return task


def _with_force(task: Task, force: float) -> Task:
    if not 0.0 < force <= 200.0:
        raise TaskError(f"force = {force} N must be above 0 and at most 200 N")
    phases = tuple(replace(p, control=p.control.scaled_to(force)) if p.control else p for p in task.phases)
    draw = replace(task.draw, control=task.draw.control.scaled_to(force), forces=()) if task.draw else None
    return replace(task, phases=phases, draw=draw)


def _with_text(task: Task, text: str) -> Task:
    if task.draw is None or not task.draw.text:
        raise TaskError(f"task '{task.name}' does not write a text")
    if not text.strip() or len(text) > 80:
        raise TaskError(f"a text of {len(text)} characters cannot be written; give 1 to 80")
    return replace(task, draw=replace(task.draw, text=text))
