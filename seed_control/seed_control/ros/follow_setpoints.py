# SPDX-License-Identifier: Apache-2.0
"""The action ~/follow_setpoints: plays a task through the controller, one step at a time, blocking nothing."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future
from seed_msgs.action import FollowSetpoints

from seed_control.controller import Controller
from seed_control.ros.task_operator import Operator
from seed_control.state import ControllerState
from seed_control.tasks import TaskPlayer, TaskStatus, check_fits, read_task
from seed_control.tasks.contact_stop import FoundPlace
from seed_core.errors import SeedError
from seed_core.spatial import Wrench
from seed_ros import SeedNode
from seed_ros.conversions import fill_pose, fill_wrench

FEEDBACK_PERIOD = 0.1  # [s]


@dataclass
class _Run:
    """One goal being played."""

    goal: ServerGoalHandle
    player: TaskPlayer
    started: float  # [s]
    done: Future
    fed_back: float = 0.0  # [s]
    phase: tuple[str, int | None] = "", None  # name and index
    refusal: str = ""
    regulating: bool = False
    squares: np.ndarray = field(default_factory=lambda: np.zeros(2))  # sums of squared force and torque error
    samples: int = 0


def _player(task: str, overrides: str) -> TaskPlayer:
    """Of a task as a client sends it. Raises SeedError: it cannot be read or played."""
    return TaskPlayer(read_task(task, overrides), waits=False)


class _TaskReader:
    """A task that is read beside the loop: a long one takes longer than an arm waits for its target.

    Attributes:
        player: future of its player.
    """

    def __init__(self, worker: ThreadPoolExecutor, goal: ServerGoalHandle) -> None:
        self.player, self._goal = Future(), goal
        self._job = worker.submit(_player, goal.request.task, goal.request.overrides)

    def look(self) -> None:
        """Pass on what has become of it."""
        if self.player.done():
            return
        if self._goal.is_cancel_requested:
            self.player.set_exception(SeedError("cancelled while it was being read; nothing has moved"))
            return
        if not self._job.done():
            return
        if error := self._job.exception():
            self.player.set_exception(error)
        else:
            self.player.set_result(self._job.result())


class FollowServer:
    """Call before_step and after_step around each control step."""

    def __init__(
        self, node: SeedNode, core: Controller, why_not: Callable[[], str], operator: Operator, lost: str, base: str
    ) -> None:
        """Offer the action.

        Args:
            why_not: why no task may begin now; '' for nothing.
            operator: whoever has a task played.
            lost: 'lift' or 'hold', when it is gone.
            base: name of the frame W.
        """
        self._node, self._core, self._why_not = node, core, why_not
        self._operator, self._lost, self._base = operator, lost, base
        self._run: _Run | None = None
        self._reader: _TaskReader | None = None
        self._worker = ThreadPoolExecutor(1, "tasks")
        # Begins its thread before the loop, which raises the priority of all threads that there are: a worker that had
        # to wait for other programs in the middle of a task would keep Python's lock from the loop.
        self._worker.submit(int)
        self._server = node.serve_action(FollowSetpoints, "~/follow_setpoints", self._execute)

    @property
    def _enable(self) -> str:
        return f"{self._node.get_fully_qualified_name()[1:]}/enable"

    @property
    def busy(self) -> bool:
        """Whether a task is being played."""
        return self._run is not None

    async def _execute(self, goal: ServerGoalHandle) -> FollowSetpoints.Result:
        try:
            run = self._run = await self._start(goal)
        except SeedError as error:
            self._node.get_logger().error(f"follow_setpoints refused: {error}")
            if goal.is_cancel_requested:
                goal.canceled()
            else:
                goal.abort()
            return _result(False, str(error))
        return self._finish(run, await run.done)

    async def _start(self, goal: ServerGoalHandle) -> _Run:
        if self._run is not None:
            raise SeedError(
                f"task '{self._run.player.task.name}' is being played: cancel it first, as ./seed cancel does"
            )
        if self._reader is not None:
            raise SeedError("another task is being read, and is played then: cancel it first, as ./seed cancel does")
        self._reader = _TaskReader(self._worker, goal)
        try:
            player: TaskPlayer = await self._reader.player
        finally:
            self._reader = None
        task = player.task
        if why_not := self._why_not():
            raise SeedError(f"cannot play '{task.name}': {why_not}")
        check_fits(task, self._core.tool, self._core.parameters)
        state = self._core.state
        if not state.enabled or state.mode == "holding":
            raise SeedError(f"cannot play '{task.name}': {state.reason or 'not enabled'}; then call {self._enable} on")
        self._operator.begin(bytes(goal.goal_id.uuid), self._node.now())
        self._node.get_logger().info(f"playing '{task.name}': {', '.join(player.phases)}")
        return _Run(goal, player, self._node.now(), Future())

    def before_step(self, now: float) -> None:
        """Give the controller the set-point of this moment."""
        if self._reader is not None:
            self._reader.look()
        run = self._run
        if run is None:
            return
        if run.goal.is_cancel_requested and not run.refusal:
            run.player.cancel()
        elif gone := self._operator.gone(now):
            self._give_up(run, now, gone)
        status = run.player.step(now, self._core.state)
        if status.done:
            self._run = None
            run.done.set_result(status)
            return
        if status.setpoint is not None:
            try:
                self._core.set_setpoint(status.setpoint, now)
            except SeedError as error:
                self._refused(run, error)
        phase = status.phase, status.index
        if now - run.fed_back >= FEEDBACK_PERIOD or phase != run.phase:
            run.fed_back, run.phase = now, phase
            self._feed_back(run, status)

    def _give_up(self, run: _Run, now: float, gone: str) -> None:
        """Nobody sees to this task any more."""
        if self._lost == "hold":
            self._core.hold(now, gone)
        else:
            run.player.cancel(gone)

    def _refused(self, run: _Run, error: SeedError) -> None:
        """The controller does not take the task's set-point: end early, which lifts."""
        if not run.refusal:
            run.refusal = str(error)
            run.player.cancel(str(error))
            return
        self._run = None  # not even the lift is possible
        self._core.disable(self._node.now(), f"{run.refusal}; then {error}")
        run.done.set_result(TaskStatus(None, run.player.phase, 0.0, True, True, False, run.refusal))

    def after_step(self, state: ControllerState) -> None:
        """Sum up the error while force is regulated, from the first time it has settled."""
        run = self._run
        if run is None or state.desired is None:
            return
        wants = bool(np.abs(state.desired.force).max() > 0.0)
        run.regulating = wants and (run.regulating or state.settled)
        if run.regulating:
            error = self._core.law.regulated_error()
            assert error is not None  # it has been in contact
            run.squares += (error.force @ error.force, error.torque @ error.torque)
            run.samples += 1

    def _feed_back(self, run: _Run, status: TaskStatus) -> None:
        message = FollowSetpoints.Feedback(phase=status.phase, progress=float(status.progress))
        message.phase_count = len(run.player.phases)
        message.phase_index = message.phase_count if status.index is None else status.index
        fill_wrench(message.error, self._core.law.regulated_error() or Wrench.zero())
        run.goal.publish_feedback(message)

    def _pose(self, found: FoundPlace) -> PoseWithCovarianceStamped:
        message = PoseWithCovarianceStamped()
        message.header.frame_id = self._base
        fill_pose(message.pose.pose, found.X_W_tip)
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = np.diag(found.deviation**2)
        message.pose.covariance = covariance.ravel().tolist()
        return message

    def _finish(self, run: _Run, status: TaskStatus) -> FollowSetpoints.Result:
        text = run.refusal or status.message
        success = not (status.failed or status.cancelled or run.refusal)
        if success:
            run.goal.succeed()
        elif run.goal.is_cancel_requested:
            run.goal.canceled()
        else:
            run.goal.abort()
        result = _result(success, text)
        result.duration = self._node.now() - run.started
        result.found = [f.name for f in run.player.found]
        result.found_poses = [self._pose(f) for f in run.player.found]
        if run.samples:
            result.force_rmse, result.torque_rmse = (float(v) for v in np.sqrt(run.squares / run.samples))
        if success:  # rclpy wants one severity per line of code
            self._node.get_logger().info(f"'{run.player.task.name}': {text}")
        else:
            self._node.get_logger().warning(f"'{run.player.task.name}': {text}")
        return result


def _result(success: bool, message: str) -> Any:
    return FollowSetpoints.Result(success=success, message=message, force_rmse=np.nan, torque_rmse=np.nan)
