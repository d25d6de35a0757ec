# SPDX-License-Identifier: Apache-2.0
"""`target_guard`: sits between the controller and an arm that obeys everything (docs/arm_contract.md)."""

import sys
import time
from typing import Any

from geometry_msgs.msg import PoseStamped
from std_msgs.msg import String
from std_srvs.srv import Trigger

from seed_core.arm.target_checks import Target
from seed_core.errors import SeedError
from seed_driver.target_guard import GuardConfig, TargetGuard
from seed_ros import COMMAND, LATCHED, QUEUE, FixedRateLoop, SeedNode, diagnostics
from seed_ros.arm import TargetSenders
from seed_ros.conversions import fill, pose_to_tuples, seconds, stamped


class GuardNode(SeedNode):
    """Topics: target_frame and current_pose in, guarded_frame and ~/hold_reason out. Services as the driver's."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("guard", **arguments)
        self.guard = TargetGuard(self.declare(GuardConfig()))
        self.refuse_unknown()
        # a simulator that pauses, or is slower than the wall, is not silent
        self._time = self.now if self.get_parameter("use_sim_time").value else time.monotonic
        self._reason_told: str | None = None
        self._out = self.create_publisher(PoseStamped, "guarded_frame", COMMAND)
        self._reason = self.create_publisher(String, "~/hold_reason", LATCHED)
        self.loop = FixedRateLoop(self, self.guard.config.rate, self._step, service_period=0.0, catch_up=False)
        self._senders = TargetSenders(self)
        self.loop.poll(PoseStamped, "target_frame", self._on_target, COMMAND, informed=True)
        self.loop.poll(PoseStamped, "current_pose", self._on_pose, QUEUE)
        self.serve(Trigger, "~/resend_robot_program", self._resume)
        self.serve(Trigger, "~/stop", self._stop)
        self._age: float | None = None  # [s] of the newest target
        self.diagnose("target_guard", self._report)

    def _on_target(self, message: PoseStamped, information: dict[str, Any]) -> None:
        if (several := self._senders.conflict(information)) and not self.guard.reason:
            self.guard.hold(several)
        age = self.now() - seconds(message.header.stamp)
        self._age = age
        why = self.guard.target(Target(message.header.frame_id, age, *pose_to_tuples(message.pose)), self._time())
        if why:
            self.counters.add("targets_refused", f"target_frame is not followed: {why}")

    def _on_pose(self, message: PoseStamped) -> None:
        self.guard.measured(pose_to_tuples(message.pose), self._time())

    def _resume(self) -> str:
        refusal = self.guard.resume(self._time())
        if refusal:
            raise SeedError(refusal)
        return ""

    def _stop(self) -> str:
        self.guard.hold("stopped on request")
        return ""

    def _step(self) -> None:
        pose = self.guard.step(self._time())
        if self.guard.reason != self._reason_told:
            self._reason_told = self.guard.reason
            self._reason.publish(String(data=self._reason_told))
        if pose is not None:
            message = stamped(PoseStamped, self.now(), self.guard.config.base_frame)
            fill(message.pose.position, pose[0])
            fill(message.pose.orientation, pose[1])
            self._out.publish(message)
            self.beats.add(self._age)

    def _report(self) -> diagnostics.Report:
        if self.guard.reason:
            return diagnostics.WARN, f"holds: {self.guard.reason}", self.counters.values()
        return diagnostics.OK, "following target_frame", self.counters.values()


main = GuardNode.main

if __name__ == "__main__":
    sys.exit(main())
