# SPDX-License-Identifier: Apache-2.0
"""The controller's ROS node: relative pose, kinematics and set-point in; flange pose out, at a fixed rate."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node
from seed_msgs.msg import ControllerState as StateMsg
from seed_msgs.msg import HybridSetpoint as HybridMsg
from seed_msgs.msg import RelativePose
from seed_msgs.msg import RelativePoseSetpoint as RelativePoseMsg
from seed_msgs.msg import WrenchSetpoint as WrenchMsg
from std_srvs.srv import SetBool

from seed_control.controller import Controller
from seed_control.parameters import ControllerParameters
from seed_control.ros import conversions as convert
from seed_control.ros.follow_setpoints import FollowServer
from seed_control.ros.identify_payload import WeighServer
from seed_control.ros.stiffness_schedule import GripListener
from seed_control.setpoint.setpoints import Setpoint
from seed_control.state import ControlOutput
from seed_control.wrench.stiffness_schedule import GripSettings
from seed_core.bushing import Stiffness
from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.hand import DEFAULT_STIFFNESS, Hand, Tool
from seed_ros import diagnostics
from seed_ros.conversions import (
    check_frame,
    estimate_from_message,
    pose_stamped,
    pose_to_matrix,
    seconds,
    stamp_from_seconds,
    transform_stamped,
    wrench_stamped,
)
from seed_ros.diagnostics import Counters
from seed_ros.frames import FrameNames
from seed_ros.loop import FixedRateLoop
from seed_ros.node import QUIET, TransformBroadcaster, run
from seed_ros.parameters import declare, refuse_unknown
from seed_ros.qos import COMMAND, QUEUE

AWAY = 0.02  # [m] an arm at rest this far from its command was moved by something else


@dataclass(frozen=True)
class NodeSettings:
    """What is the node's alone."""

    state_rate: float = field(50.0, unit="Hz", low=1.0, high=1000.0, doc="of ~/state and wrench_estimate")
    publish_tf: bool = field(True, doc="publish tool to tip on /tf_static")
    realtime_priority: int = field(40, low=0, high=98, doc="SCHED_FIFO priority of the loop if allowed; 0: none")


class ControllerNode(Node):
    """See docs/interfaces.md."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("controller", **arguments)
        self.settings = declare(self, NodeSettings())
        self.parameters = declare(self, ControllerParameters())
        self.frames = declare(self, FrameNames(), "frames")
        self.tool = declare(self, Tool(), "tool")
        stiffness = declare(
            self, DEFAULT_STIFFNESS, "grasp", live=("rotation", "translation"), on_change=self._on_stiffness
        )
        self.core = Controller(self.parameters, declare(self, Hand(), "hand"), self.tool, stiffness)
        grip = declare(self, GripSettings(), "grip")
        refuse_unknown(self)
        self.counters = Counters(self)
        self.steps = 0
        self._was_enabled = False
        self._here = np.eye(4)  # the newest flange pose
        self._output: ControlOutput | None = None
        self._wire()
        self.follow = FollowServer(self, self.core, self.now, lambda: self.weigh.busy)
        self.weigh = WeighServer(self, self.core, self.now, lambda: self.follow.busy)
        GripListener(self, grip, self.counters, self._on_stiffness)
        self._publish_tip()
        self._every = max(1, round(self.parameters.rate / self.settings.state_rate))
        self._diagnostics = diagnostics.Diagnostics(self, "controller", self._report)

    def now(self) -> float:
        """ROS time [s]."""
        return float(self.get_clock().now().nanoseconds * 1e-9)

    def _wire(self) -> None:
        self._target = self.create_publisher(PoseStamped, "target_frame", COMMAND, event_callbacks=QUIET)
        self._wrench = self.create_publisher(WrenchStamped, "wrench_estimate", COMMAND, event_callbacks=QUIET)
        self._state = self.create_publisher(StateMsg, "~/state", COMMAND, event_callbacks=QUIET)
        self._reference = self.create_publisher(PoseStamped, "~/reference", COMMAND, event_callbacks=QUIET)
        self._tf = TransformBroadcaster(self)
        self.loop = FixedRateLoop(self, self.parameters.rate, self._step, priority=self.settings.realtime_priority)
        self.loop.poll(PoseStamped, "current_pose", self._on_pose, QUEUE)
        self.loop.poll(RelativePose, "relative_pose", self._on_estimate, QUEUE)
        self.loop.poll(HybridMsg, "~/setpoint", self._on_hybrid, COMMAND)
        self.loop.poll(WrenchMsg, "~/wrench_setpoint", self._on_wrench, COMMAND)
        self.loop.poll(RelativePoseMsg, "~/relative_pose_setpoint", self._on_relative, COMMAND)
        self.create_service(SetBool, "~/enable", self._enable)

    # in
    def _on_pose(self, message: PoseStamped) -> None:
        try:
            check_frame(message.header.frame_id, (self.frames.base,), "current_pose")
            X_WE = pose_to_matrix(message.pose, "current_pose")
        except SeedError as error:
            self.counters.add("poses_refused", str(error))
            return
        if self.core.add_kinematics(seconds(message.header.stamp), X_WE):
            self._here = X_WE

    def _on_estimate(self, message: RelativePose) -> None:
        try:
            check_frame(message.header.frame_id, (self.frames.compliance,), "relative_pose")
            check_frame(message.child_frame_id, (self.frames.tool,), "relative_pose (child)")
            estimate = estimate_from_message(message)
        except SeedError as error:
            self.counters.add("estimates_refused", str(error))
            return
        self.core.add_estimate(estimate)

    def _on_hybrid(self, message: HybridMsg) -> None:
        self._take(lambda: convert.hybrid_setpoint(message, self.frames))

    def _on_wrench(self, message: WrenchMsg) -> None:
        self._take(lambda: convert.wrench_setpoint(message, self.frames, self.tool))

    def _on_relative(self, message: RelativePoseMsg) -> None:
        self._take(lambda: convert.relative_pose_setpoint(message, self.frames))

    def _take(self, read: Callable[[], Setpoint]) -> None:
        """A set-point from a topic; while a task is played it is refused."""
        try:
            setpoint = read()
        except SeedError as error:
            self.counters.add("setpoints_unreadable", str(error))
            return
        if self.follow.busy or self.weigh.busy:
            self.counters.add("setpoints_during_task", "a set-point came while a task is played: cancel the task first")
            return
        try:
            self.core.set_setpoint(setpoint, self.now())
        except SeedError as error:
            self.counters.add("setpoints_refused", str(error))

    def _enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if not request.data:
            self.core.disable(self.now(), "disabled by ~/enable")
            response.success, response.message = True, "disabled: the arm comes to rest and holds"
            return response
        try:
            self.core.enable(self.now())
        except SeedError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, "enabled: send a set-point or a task"
        return response

    def _on_stiffness(self, stiffness: Stiffness) -> None:
        self.core.set_stiffness(stiffness, self.now())

    # the step
    def _step(self) -> None:
        now = self.now()
        self.follow.before_step(now)
        self.weigh.before_step(now)
        self._output = output = self.core.step(now)
        self.steps += 1
        if output.X_WE is not None and self._may_send(output):
            self._target.publish(pose_stamped(output.X_WE, now, self.frames.base))
        self.follow.after_step(output.state)
        if self.steps % self._every == 0:
            self._publish_state(now, output)

    def _may_send(self, output: ControlOutput) -> bool:
        """From the first enable on; no more once an arm at rest was moved by something else."""
        assert output.X_WE is not None
        away = float(np.abs(self._here[:3, 3] - output.X_WE[:3, 3]).max()) > AWAY
        if output.state.enabled:
            self._was_enabled = True
        elif self._was_enabled and away:
            self._was_enabled = False
            self.counters.add(
                "moved_by_others", "the arm was moved by something else; target_frame pauses until enable"
            )
        return self._was_enabled

    def _publish_state(self, now: float, output: ControlOutput) -> None:
        message = convert.fill_state(StateMsg(), output.state, self.core.law.setpoint)
        message.header.stamp, message.header.frame_id = stamp_from_seconds(now), self.frames.base
        message.steps = self.steps
        message.ignored_poses += self.counters["poses_refused"]
        message.ignored_estimates += self.counters["estimates_refused"]
        message.refused_setpoints += self.counters["setpoints_unreadable"] + self.counters["setpoints_during_task"]
        message.estimator_reason = self.counters.last
        self._state.publish(message)
        if self.core.law.setpoint is not None:
            self._reference.publish(pose_stamped(self.core.law.setpoint.X_W_tip, now, self.frames.base))
        if output.state.estimated is not None:
            stamp = now - output.state.image_age
            in_base = output.state.estimated.rotated(output.state.R_W_task)
            self._wrench.publish(wrench_stamped(in_base, stamp, self.frames.base))

    def _publish_tip(self) -> None:
        if self.settings.publish_tf:
            self._tf.send_static(transform_stamped(self.tool.X_Ttip, self.now(), self.frames.tool, self.frames.tip))

    def _report(self) -> diagnostics.Report:
        values: dict[str, object] = {"steps": self.steps, **self.counters.values()}
        if self._output is None:
            return diagnostics.STALE, "no step yet", values
        state = self._output.state
        values |= state.counters._asdict() | {"mode": state.mode, "law": self.parameters.law}
        if len(self.loop.periods) > 10:
            p50, p99 = np.percentile(np.array(self.loop.periods) * 1e3, (50, 99))
            values |= {
                "period_p50_ms": round(float(p50), 3),
                "period_p99_ms": round(float(p99), 3),
                "overruns": self.loop.overruns,
            }
        level = diagnostics.WARN if state.mode == "holding" else diagnostics.OK
        return level, state.reason or state.mode, values


def main() -> None:
    """Run the node until it is interrupted."""
    sys.exit(run(ControllerNode))


if __name__ == "__main__":
    main()
