# SPDX-License-Identifier: Apache-2.0
"""Whoever has a task played: nobody presses on a table for a terminal that has gone.

An action tells its server nothing of a client that dies. `./seed play` says ten times a second on `~/operator` that it
is there, with the number of its goal; such a task ends when that stops. Of other clients it is only known that they
listen to the action's feedback: their task ends when nobody does, which the middleware finds out at once where they
ended by themselves, and by its own patience (20 s) where they were killed.
"""

from unique_identifier_msgs.msg import UUID

from seed_ros import COMMAND, SeedNode

LOOK = 0.1  # [s] between two looks at who listens


class Operator:
    """`begin` with each task; `gone` says why it must end."""

    def __init__(self, node: SeedNode, action: str, timeout: float) -> None:
        """timeout: [s]; 0: an operator may go."""
        self._node, self._timeout = node, timeout
        self._feedback = f"{node.resolve_service_name(action)}/_action/feedback"
        self._goal = b""
        self._heard: float | None = None  # [s]; None: this one says nothing
        self._listened = self._looked = 0.0  # [s]
        self._listens = False
        node.loop.poll(UUID, "~/operator", self._on_message, COMMAND)

    def begin(self, goal: bytes, now: float) -> None:
        """A task begins at now [s]."""
        self._goal, self._heard = goal, None
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
        if now - self._looked >= LOOK or now < self._looked:
            self._looked = now
            if self._node.count_subscribers(self._feedback):
                self._listens, self._listened = True, now
        gone = self._listens and now - self._listened > self._timeout
        return "the operator is gone: nobody listens to the task's feedback" if gone else ""
