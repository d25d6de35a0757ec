# SPDX-License-Identifier: Apache-2.0
"""The service ~/weigh_tool: holds the tool in a few orientations and answers with its weight, blocking nothing."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from seed_control.controller import Controller, ControlRefusedError
from seed_control.payload.motion import WeighingRun, report
from seed_core.errors import SeedError


class WeighServer:
    """Call before_step before each control step."""

    def __init__(self, node: Node, core: Controller, now: Callable[[], float], others: Callable[[], bool]) -> None:
        self._core, self._now, self._others, self._logger = core, now, others, node.get_logger()
        self._run: WeighingRun | None = None
        self._done: Future | None = None
        # a group of its own: others are served while it waits for its answer, among them ~/enable, which ends it
        node.create_service(Trigger, "~/weigh_tool", self._weigh, callback_group=ReentrantCallbackGroup())

    @property
    def busy(self) -> bool:
        """Whether the tool is being weighed."""
        return self._run is not None

    async def _weigh(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            self._start()
            assert self._done is not None
            run, message = await self._done
            if message:
                raise ControlRefusedError(f"the weighing ended early: {message}")
            response.success, response.message = True, report(run.result(), self._core.tool)
            self._logger.info(f"weigh_tool: {response.message}")
        except SeedError as error:
            response.success, response.message = False, str(error)
            self._logger.error(f"weigh_tool: {error}")
        return response

    def _start(self) -> None:
        state = self._core.state
        if self.busy or self._others():
            raise ControlRefusedError("cannot weigh the tool: a task or another weighing is under way; cancel it first")
        if not state.enabled or state.mode == "holding":
            raise ControlRefusedError(
                f"cannot weigh the tool: {state.reason or 'the controller is not enabled'}; call ~/enable first"
            )
        self._run = WeighingRun(self._core.gauge.bushing, self._core.tool, state)
        self._done = Future()

    def before_step(self, now: float) -> None:
        """Give the controller the set-point of this moment."""
        run = self._run
        if run is None:
            return
        status = run.step(now, self._core.state)
        refused = ""
        if status.setpoint is not None:
            try:
                self._core.set_setpoint(status.setpoint, now)
            except SeedError as error:
                refused = str(error)
        if status.done or refused:
            self._run = None
            assert self._done is not None
            self._done.set_result((run, refused or (status.message if status.failed or status.cancelled else "")))
