# SPDX-License-Identifier: Apache-2.0
"""`target_guard`: sits between the controller and an arm that obeys everything (docs/arm_contract.md)."""

from __future__ import annotations

import sys
import time
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from seed_core.arm.target_checks import Target
from seed_driver.target_guard import GuardConfig, Pose, TargetGuard
from seed_ros.conversions import seconds
from seed_ros.node import run
from seed_ros.parameters import declare, refuse_unknown
from seed_ros.qos import COMMAND, LATCHED, QUEUE


class GuardNode(Node):
    """Topics: target_frame and current_pose in, guarded_frame and ~/hold_reason out. Services as the driver's."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("guard", **arguments)
        self.guard = TargetGuard(declare(self, GuardConfig()))
        refuse_unknown(self)
        self._said: str | None = None
        self._out = self.create_publisher(PoseStamped, "guarded_frame", COMMAND)
        self._reason = self.create_publisher(String, "~/hold_reason", LATCHED)
        self.create_subscription(PoseStamped, "target_frame", self._on_target, COMMAND)
        self.create_subscription(PoseStamped, "current_pose", self._on_pose, QUEUE)
        self.create_service(Trigger, "~/resend_robot_program", self._resume)
        self.create_service(Trigger, "~/stop", self._stop)
        self.create_timer(1.0 / self.guard.config.rate, self._step)

    def _on_target(self, message: PoseStamped) -> None:
        age = self.get_clock().now().nanoseconds * 1e-9 - seconds(message.header.stamp)
        why = self.guard.target(Target(message.header.frame_id, age, *_pose(message)), time.monotonic())
        if why:
            self.get_logger().warning(f"target_frame is not followed: {why}", throttle_duration_sec=1.0)

    def _on_pose(self, message: PoseStamped) -> None:
        self.guard.measured(_pose(message), time.monotonic())

    def _resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = self.guard.resume(time.monotonic())
        response.success = not response.message
        return response

    def _stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.guard.hold("stopped on request")
        response.success = True
        return response

    def _step(self) -> None:
        pose = self.guard.step(time.monotonic())
        if self.guard.reason != self._said:
            self._said = self.guard.reason
            self._reason.publish(String(data=self._said))
        if pose is not None:
            self._out.publish(_message(pose, self.guard.config.base_frame, self.get_clock().now().to_msg()))


def _pose(message: PoseStamped) -> Pose:
    p, q = message.pose.position, message.pose.orientation
    return (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)


def _message(pose: Pose, frame: str, stamp: Any) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id, message.header.stamp = frame, stamp
    p, q = message.pose.position, message.pose.orientation
    (p.x, p.y, p.z), (q.x, q.y, q.z, q.w) = pose
    return message


def main() -> None:
    """Run the node until it is interrupted."""
    sys.exit(run(GuardNode))


if __name__ == "__main__":
    main()
