# SPDX-License-Identifier: Apache-2.0
"""Whether a set-point is followed, by what the controller tells and, where it is in the bag, the state of its tasks."""

from math import inf
from typing import Any

STOOD = 1.0  # [s] that a set-point may stand while nothing is pressed and no task is played
LAST_STEP = 0.1  # [s] after a task's end in which the set-point of its last step may still be told
_PRESSING = ("approach", "contact")
_ACTIVE = (1, 2, 3)  # action_msgs/GoalStatus: accepted, executing, cancelling


class Following:
    """Takes messages as they come.

    A set-point that stands is followed while force is pressed, while a task is played (a dwell), and for `STOOD`.
    What stands when a task has ended, or when the bag begins, is not: the next that differs is.
    """

    def __init__(self) -> None:
        self._state: Any = None
        self._reference: tuple[float, ...] | None = None
        self._asked: tuple[Any, ...] | None = None  # what of the state is of the set-point
        self._moved, self._ended, self._began = -inf, -inf, inf  # [s]: set-point; last task's end; start of one played

    def take(self, name: str, message: Any, t: float) -> None:
        """A message that came at t [s]."""
        if name == "controller/state":
            d, followed = message.desired, _hybrid(message)
            asked = (followed, d.force.x, d.force.y, d.force.z, d.torque.x, d.torque.y, d.torque.z)
            if self._asked not in (None, asked):
                self._changed(t)
            self._state, self._asked = message, asked
        elif name == "controller/reference":
            p, q = message.pose.position, message.pose.orientation
            reference = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
            if self._reference not in (None, reference):
                self._changed(t)
            self._reference = reference
        else:
            self._task(any(goal.status in _ACTIVE for goal in message.status_list), t)

    def at(self, t: float) -> bool:
        """Whether one is followed at t [s]."""
        if self._state is None or not _hybrid(self._state):
            return False
        if self._moved <= self._ended:
            return self._ended == -inf and self._state.mode in _PRESSING
        return self._state.mode in _PRESSING or self._moved >= self._began or t - self._moved <= STOOD

    def _changed(self, t: float) -> None:
        if t > self._ended + LAST_STEP:
            self._moved = t

    def _task(self, active: bool, t: float) -> None:
        if active and self._began == inf:
            self._began = t
        elif not active and self._began < inf:
            self._began, self._ended = inf, t


def _hybrid(state: Any) -> bool:
    on = state.mode in ("position", *_PRESSING)
    return bool(state.enabled and on and state.setpoint_kind == "hybrid")
