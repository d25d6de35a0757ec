# SPDX-License-Identifier: Apache-2.0
"""Tasks as data: a YAML file of phases, and the player that turns it into set-points.

task.py     what a task file may contain
load.py     from a file, a shipped name or a text to a Task, and to what is sent to a controller elsewhere
fit.py      whether a task fits the tool in the hand and what the controller may be asked for
steps.py    from a Task to its steps, and each step's set-points along its path (path.py) or strokes (font.py)
player.py   from step to step, which run each needs, cancel, and the lift that ends a task early
"""

from seed_control.tasks.fit import check_fits, check_tool
from seed_control.tasks.load import LEAST_FORCE, MOST_FORCE, load_task, read_task, shipped_tasks, task_to_send
from seed_control.tasks.player import TaskPlayer, TaskStatus
from seed_control.tasks.task import Task, TaskError

__all__ = [
    "LEAST_FORCE",
    "MOST_FORCE",
    "Task",
    "TaskError",
    "TaskPlayer",
    "TaskStatus",
    "check_fits",
    "check_tool",
    "load_task",
    "read_task",
    "shipped_tasks",
    "task_to_send",
]
