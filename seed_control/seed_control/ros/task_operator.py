# SPDX-License-Identifier: Apache-2.0
"""Whoever has a task played: nobody presses on a table for a terminal that has gone.

An action tells its server nothing of a client that dies. `./seed play` says ten times a second on `~/operator` that it
is there, with the number of its goal; such a task ends when that stops. Of other clients it is only known that they
listen to the action's feedback: their task ends when nobody does (an operator page listens to all tasks, and does not
count), which the middleware finds out at once where they ended by themselves, and by its own patience (20 s) where
they were killed. Where every operator must be heard on `~/operator` (`operator_beats`), that is noticed as early of
these.
"""

from unique_identifier_msgs.msg import UUID

from seed_ros import COMMAND, SeedNode
from seed_ros.qos import full_name

LOOK = 0.1  # [s] between two looks at who listens
FIRST = 1.0  # [s] for the first word of an operator that must be heard
FOUND = 5.0  # [s] for one that listens to be found in the graph


class Operator:
    """`begin` with each task; `gone` says why it must end."""

    def __init__(self, node: SeedNode, action: str, timeout: float, *, must_beat: bool) -> None:
        """Look after the operators of an action.

        Args:
            timeout: [s]; 0: an operator may go.
            must_beat: one that says nothing on ~/operator is gone.
        """
        self._node, self._timeout, self._must_beat = node, timeout, must_beat
        self._began = 0.0  # [s]
        self._feedback = f"{node.resolve_service_name(action)}/_action/feedback"
        self._goal = b""
        self._heard: float | None = None  # [s]; None: this one says nothing
        self._listened = self._looked = 0.0  # [s]
        self._listens = False
        node.loop.poll(UUID, "~/operator", self._on_message, COMMAND)

    def begin(self, goal: bytes, now: float) -> None:
        """A task begins at now [s]."""
        self._goal, self._heard = goal, None
        self._began = now
        self._listened = self._looked = now
        self._listens = False

    def _on_message(self, message: UUID) -> None:
        if bytes(message.uuid) == self._goal:
            self._heard = self._node.now()

    def gone(self, now: float) -> str:
        """Why the task must end at now [s]; '' while it may go on."""
        if not self._timeout:
            return ""
        if self._heard is not None:
            silent = now - self._heard
            return f"the operator is gone: not heard for {silent:.2f} s" if silent > self._timeout else ""
        if self._must_beat:
            silent = now - self._began > max(FIRST, self._timeout)
            topic = self._node.resolve_topic_name("~/operator")
            return f"the operator is gone: it never said on {topic} that it is there" if silent else ""
        if now - self._looked >= LOOK or now < self._looked:
            self._looked = now
            if self._somebody_listens():
                self._listens, self._listened = True, now
        gone = now - self._listened > (self._timeout if self._listens else max(FOUND, self._timeout))
        return "the operator is gone: nobody listens to the task's feedback" if gone else ""

    def _somebody_listens(self) -> bool:
        """Whether anybody does but those who say that they are there where the task is theirs, as an operator page."""
        node, operator = self._node, self._node.resolve_topic_name("~/operator")
        speak = {full_name(e) for e in node.get_publishers_info_by_topic(operator)}
        listen = node.get_subscriptions_info_by_topic(self._feedback)
        return any(full_name(e) not in speak for e in listen)
