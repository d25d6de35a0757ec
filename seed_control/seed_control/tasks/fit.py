# SPDX-License-Identifier: Apache-2.0
"""Whether a task can be played with the tool in the hand and within what the controller may be asked for.

What the controller would refuse in the middle of a task is refused before it begins.
"""

from collections.abc import Iterator
from math import sqrt

from seed_control.parameters import ControllerParameters
from seed_control.tasks.task import Control, Task, TaskError
from seed_core.hand import Tool


def check_fits(task: Task, tool: Tool, parameters: ControllerParameters) -> None:
    """Raises TaskError: made for another tool, or a force, torque or reach is beyond what may be asked for."""
    check_tool(task, tool)
    p = parameters
    _check_reach(task, p.max_free_travel)
    for name, control in _controls(task):
        for what, vector, bound, unit in (
            ("force", control.at_most().force, p.max_force, "N"),
            ("torque", control.torque, p.max_torque, "N m"),
        ):
            size = sqrt(sum(v * v for v in vector))
            if size > bound * (1 + 1e-9):
                raise TaskError(
                    f"task '{task.name}': {name} asks for a {what} of {size:.3g} {unit}, beyond the controller's "
                    f"max_{what} = {bound:g} {unit}: ask for less"
                )


def _check_reach(task: Task, most: float) -> None:
    """Raises TaskError: a contact_stop would reach further than the controller lets an approach go [m]."""
    for phase in task.phases:
        stop = phase.contact_stop
        if stop is not None and not stop.edge and stop.reach > most * (1 + 1e-9):
            raise TaskError(
                f"task '{task.name}': phase '{phase.name}' reaches for {stop.reach:g} m, and the controller holds "
                f"after max_free_travel = {most:g} m without contact: let it begin nearer, or raise that limit"
            )


def check_tool(task: Task, tool: Tool) -> None:
    """Raises TaskError: the task names another tool than this one, whose weight and tip are reckoned with."""
    if task.tool and task.tool != tool.name:
        raise TaskError(
            f"task '{task.name}' is made for the tool '{task.tool}', and the hand holds '{tool.name}', with whose "
            "weight and tip forces are computed: take that tool and describe it under tool: in the hand file "
            "(simulated: launch with a scenario that holds it, such as scenario:=pen), or give the task this one's name"
        )


def _controls(task: Task) -> Iterator[tuple[str, Control]]:
    for phase in task.phases:
        if phase.control is not None:
            yield f"phase '{phase.name}'", phase.control
        if phase.contact_stop is not None:
            yield f"phase '{phase.name}'", Control((0.0, 0.0, phase.contact_stop.force))
    if task.draw is not None:
        yield "the drawing", task.draw.control
        for number, force in enumerate(task.draw.forces, start=1):
            yield f"stroke {number}", task.draw.control.scaled_to(force)
