# SPDX-License-Identifier: Apache-2.0
"""Tasks from files, from the shipped ones by name, or from YAML text; with another force or another text to write."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

from seed_control.tasks.task import Task, TaskError
from seed_core.config import ConfigError, field, load_file, load_text, read_text
from seed_core.program.files import shared_path
from seed_core.program.suggestions import did_you_mean, no_such_file

MAX_TEXT = 1_000_000  # characters of a task sent as text
LEAST_FORCE, MOST_FORCE = 0.1, 200.0  # [N] that every force of a task can be set to


@dataclass(frozen=True)
class Overrides:
    """What a client may change of a task."""

    force: float | None = field(None, unit="N", low=LEAST_FORCE, high=MOST_FORCE, doc="size of every force of the task")
    text: str | None = field(None, doc="text to write")


def shipped_tasks() -> dict[str, Path]:
    """The tasks that come with the package, by name."""
    return {f.stem: f for f in sorted(shared_path("seed_control", "config/tasks").glob("*.yaml"))}


def load_task(source: str | Path, force: float | None = None, text: str | None = None) -> Task:
    """A task from a file, or by the name of a shipped one.

    Args:
        source: path of a YAML file, or one of shipped_tasks().
        force: [N] replaces the size of every force in the task, those of contact_stop as well.
        text: replaces the text of a task that writes.

    Raises:
        TaskError: no such task, or one that the changes do not fit.
        ConfigError: with file and line.
    """
    return _changed(load_file(_file_of(source), Task), force, text)


def task_to_send(source: str | Path) -> str:
    """A task as `read_task` takes it on any computer: the name of a shipped one, else the text of the file.

    Args:
        source: as that of `load_task`.

    Raises:
        TaskError: no such task, or a text that is too long.
        ConfigError: the file cannot be read.
    """
    path = _file_of(source)
    if str(source) in shipped_tasks():
        return str(source)
    text = f"{read_text(path).rstrip()}\n"
    if len(text) > MAX_TEXT:
        raise TaskError(f"{path} has {len(text)} characters, too many to be sent; at most {MAX_TEXT}")
    return text


def _file_of(source: str | Path) -> Path:
    shipped = shipped_tasks()
    path = shipped.get(str(source), Path(source))
    if not _is_file(path):
        raise TaskError(f"no task '{source!s:.100}': {_why_none(path, shipped)}")
    return path


def _why_none(path: Path, shipped: Collection[str]) -> str:
    """For a mistyped file what its folder has, else which tasks there are, and what may have been meant."""
    if path.suffix in (".yaml", ".yml"):
        return no_such_file(path)
    return f"neither a file nor one of {', '.join(shipped)}{did_you_mean(str(path), shipped)}"


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name that no file can have: too long, or with a zero byte
        return False


def read_task(source: str, overrides: str = "") -> Task:
    """A task as a client of the action sends it: a name, a file, or the YAML text itself.

    Args:
        overrides: a YAML mapping with `force` [N], `text`; empty for none.

    Raises:
        TaskError: no such task, or one that an override does not fit.
        ConfigError: with source and line.
    """
    change = load_text(overrides, Overrides, "overrides") if overrides.strip() else Overrides()
    if "\n" not in source:
        return load_task(source.strip(), change.force, change.text)
    if len(source) > MAX_TEXT:
        raise TaskError(f"a task of {len(source)} characters is too long; at most {MAX_TEXT}")
    return _changed(load_text(source, Task, "task"), change.force, change.text)


def _changed(task: Task, force: float | None, text: str | None) -> Task:
    if force is not None:
        if not LEAST_FORCE <= force <= MOST_FORCE:
            raise TaskError(f"force = {force:g} N must be from {LEAST_FORCE:g} to {MOST_FORCE:g} N")
        phases = tuple(p.scaled_to(force) for p in task.phases)
        draw = replace(task.draw, control=task.draw.control.scaled_to(force), forces=()) if task.draw else None
        task = replace(task, phases=phases, draw=draw)
    if text is not None:
        if task.draw is None or not task.draw.text:
            raise TaskError(f"task '{task.name}' does not write a text")
        if not text.strip() or len(text) > 80:
            raise TaskError(f"a text of {len(text)} characters cannot be written; give 1 to 80")
        try:
            task = replace(task, draw=replace(task.draw, text=text))
        except ConfigError as error:
            raise TaskError(f"task '{task.name}': {error}") from error
    return task
