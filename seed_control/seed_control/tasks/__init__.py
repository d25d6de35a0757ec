# SPDX-License-Identifier: Apache-2.0
"""Tasks as data: a YAML file of phases, and the player that turns it into set-points."""

from seed_control.tasks.load import load_task, shipped_tasks
from seed_control.tasks.player import TaskPlayer, TaskStatus
from seed_control.tasks.task import Task, TaskError

__all__ = ["Task", "TaskError", "TaskPlayer", "TaskStatus", "load_task", "shipped_tasks"]
