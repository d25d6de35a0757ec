# SPDX-License-Identifier: Apache-2.0
"""Whether the controller that plays a task is still there.

The middleware keeps a process that was killed in the graph for up to 20 s. One that is started meanwhile takes its
place without a gap, and no result comes ever. So where feedback stays away, the task's result is asked for once more:
a controller that does not know the task answers at once. Silence alone ends nothing, for a simulated clock may stand.
"""

import time
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.task import Future

GONE = 3.0  # [s] without the action's server, after which the task has ended with it
QUIET = 3.0  # [s] without feedback until the controller is asked; then 6, 12, ...
AT_REST = "the arm is at rest by its own timeout"


class PlayedGoal:
    """One task on its way: `hear` with each feedback, `why_over` often."""

    def __init__(self, client: ActionClient, handle: Any) -> None:
        """handle: of the goal that the client has sent."""
        self._client, self._handle = client, handle
        self._there = self._heard = time.monotonic()
        self._patience = QUIET
        self._asked: Future | None = None

    def hear(self) -> None:
        """Feedback has come."""
        self._heard, self._patience = time.monotonic(), QUIET

    def ask(self) -> None:
        """Ask the controller whether it knows the task."""
        self._asked = self._handle.get_result_async()

    def why_over(self) -> str:
        """Why no result will come; '' while one may."""
        now = time.monotonic()
        if self._client.server_is_ready():
            self._there = now
        if now - self._there > GONE:
            return f"the controller has been gone for {now - self._there:.0f} s: {AT_REST}"
        if now - self._heard > self._patience:
            self._patience *= 2.0
            self.ask()
        if self._asked is None or not self._asked.done():
            return ""
        known = self._asked.result().status != GoalStatus.STATUS_UNKNOWN
        return "" if known else f"the controller was started anew, and does not know the task: {AT_REST}"
