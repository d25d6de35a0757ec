# SPDX-License-Identifier: Apache-2.0
"""Payload identification, the service ~/weigh_tool: holds the tool in a few orientations and answers with its weight.

It blocks nothing: each control step gives the set-point of its moment.
"""

from collections.abc import Callable

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from seed_control.controller import Controller, ControlRefusedError
from seed_control.payload.motion import PayloadRun, report
from seed_core.errors import SeedError
from seed_ros import SeedNode


class PayloadIdentification:
    """Call before_step before each control step."""

    def __init__(self, node: SeedNode, core: Controller, others: Callable[[], bool]) -> None:
        """others: whether something else gives set-points."""
        self._core, self._others = core, others
        self._run: PayloadRun | None = None
        self._done = Future()
        # a group of its own: others are served while it waits for its answer, among them ~/enable, which ends it
        node.serve(Trigger, "~/weigh_tool", self._identify, group=ReentrantCallbackGroup(), log_as="weigh_tool")

    @property
    def busy(self) -> bool:
        """Whether a payload is being identified."""
        return self._run is not None

    async def _identify(self) -> str:
        state = self._core.state
        if self.busy or self._others():
            raise ControlRefusedError("cannot weigh the tool: a task or another weighing is under way; cancel it first")
        if not state.enabled or state.mode == "holding":
            raise ControlRefusedError(
                f"cannot weigh the tool: {state.reason or 'the controller is not enabled'}; "
                "./seed call controller/enable on first"
            )
        self._run = run = PayloadRun(self._core.wrench_estimator, self._core.tool, state)
        self._done = Future()
        ended_early = await self._done
        if ended_early:
            raise ControlRefusedError(f"the weighing ended early: {ended_early}")
        return report(run.result(), self._core.tool)

    def before_step(self, now: float) -> None:
        """Give the controller the set-point of this moment."""
        if self._run is None:
            return
        status, refused = self._run.step(now, self._core.state), ""
        if status.setpoint is not None:
            try:
                self._core.set_setpoint(status.setpoint, now)
            except SeedError as error:
                refused = str(error)
        if status.done or refused:
            self._run = None
            self._done.set_result(refused or (status.message if status.failed or status.cancelled else ""))
