# SPDX-License-Identifier: Apache-2.0
"""What the driver publishes: poses, wrench, joints, state words, TF and diagnostics, from one state at a time."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, TransformStamped, TwistStamped, WrenchStamped
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Int8, String, UInt8
from tf2_msgs.msg import TFMessage

from seed_core.quaternion import rotate
from seed_driver.config import DriverConfig
from seed_driver.process.shared_memory import Sample, Stage, State
from seed_ros.conversions import stamp_from_seconds
from seed_ros.node import QUIET
from seed_ros.qos import LATCHED
from seed_ur.models import JOINT_NAMES

STATE_QOS = QoSProfile(depth=10)
DIAGNOSTICS_EVERY = 1.0  # [s], and at once when something changes


class Outputs:
    """The publishers; state words are published when they change and kept for late joiners."""

    def __init__(self, node: LifecycleNode, config: DriverConfig) -> None:
        self.node, self.config = node, config
        self.names = [config.joint_prefix + n for n in JOINT_NAMES]
        create = partial(node.create_publisher, event_callbacks=QUIET)
        self.pose = create(PoseStamped, "current_pose", STATE_QOS)
        self.twist = create(TwistStamped, "current_twist", STATE_QOS)
        self.wrench = create(WrenchStamped, "wrench", STATE_QOS)
        self.joints = create(JointState, "joint_states", STATE_QOS)
        self.tf = create(TFMessage, "/tf", QoSProfile(depth=100))
        self.robot_mode = create(Int8, "~/robot_mode", LATCHED)
        self.safety_mode = create(UInt8, "~/safety_mode", LATCHED)
        self.program = create(Bool, "~/robot_program_running", LATCHED)
        self.reason = create(String, "~/hold_reason", LATCHED)
        self.diagnostics = create(DiagnosticArray, "/diagnostics", STATE_QOS)
        self._count = 0
        self._sample_time = 0.0
        self._shortest = 0.75 / config.publish_rate  # [s] between samples that are published
        self._words: tuple[Any, ...] = ()
        self._diagnosed = 0.0

    def destroy(self) -> None:
        """Give the publishers back."""
        for publisher in (
            self.pose, self.twist, self.wrench, self.joints, self.tf, self.robot_mode, self.safety_mode, self.program,
            self.reason, self.diagnostics,
        ):  # fmt: skip
            self.node.destroy_publisher(publisher)

    def publish(self, state: State, now: float, refused: int, accepted: int, deaths: int) -> None:
        """Everything that is due; measurements only while they are fresh."""
        changed = self._publish_words(state)
        if changed or now - self._diagnosed > DIAGNOSTICS_EVERY:
            self._diagnosed = now
            self._publish_diagnostics(state, refused, accepted, deaths)
        if not state.linked or state.sample_time - self._sample_time < self._shortest:
            return
        self._sample_time = state.sample_time
        self._count += 1
        stamp = self._stamp(state)
        self._publish_pose(state.sample, stamp)
        if self._count % 2 == 0:
            self._publish_motion(state.sample, stamp)
        if self._count % 4 == 0:
            self._publish_joints(state.sample, stamp)

    def _stamp(self, state: State) -> Any:
        """When the sample was measured."""
        if self.config.simulated:
            return stamp_from_seconds(state.timestamp)
        age = time.monotonic() - state.sample_time  # read together with the ROS clock, or stamps jitter
        return (self.node.get_clock().now() - Duration(seconds=max(0.0, age))).to_msg()

    def publish_inactive(self, state: State) -> None:
        """Tell late joiners that nothing runs any more."""
        self._publish_words(state)
        self._publish_diagnostics(state, 0, 0, 0)

    def _publish_words(self, s: State) -> bool:
        running = s.linked and s.stage == Stage.SERVOING
        mode = s.sample.modes.robot_mode if s.linked else 0  # 0: disconnected
        words = (_say(s), mode, s.sample.modes.safety_mode if s.linked else 0, running)
        if words == self._words:
            return False
        before, self._words = self._words or (None,) * 4, words
        for publisher, message, old, new in zip(
            (self.reason, self.robot_mode, self.safety_mode, self.program), (String, Int8, UInt8, Bool), before, words,
            strict=True,
        ):  # fmt: skip
            if old != new:
                publisher.publish(message(data=new))
        if before[0] != words[0]:
            if words[0]:
                self.node.get_logger().warning(words[0])
            else:
                self.node.get_logger().info("ready: following target_frame")
        return True

    def _publish_pose(self, s: Sample, stamp: Any) -> None:
        message = PoseStamped()
        message.header.stamp, message.header.frame_id = stamp, self.config.base_frame
        _fill(message.pose.position, s.p)
        _fill_quaternion(message.pose.orientation, s.orientation)
        self.pose.publish(message)

    def _publish_motion(self, s: Sample, stamp: Any) -> None:
        twist = TwistStamped()
        twist.header.stamp, twist.header.frame_id = stamp, self.config.base_frame
        _fill(twist.twist.linear, s.twist[:3])
        _fill(twist.twist.angular, s.twist[3:])
        self.twist.publish(twist)
        wrench = WrenchStamped()
        wrench.header.stamp, wrench.header.frame_id = stamp, self.config.flange_frame
        x, y, z, w = s.orientation
        into_tool = (-x, -y, -z, w)
        _fill(wrench.wrench.force, rotate(into_tool, s.wrench[:3]))
        _fill(wrench.wrench.torque, rotate(into_tool, s.wrench[3:]))
        self.wrench.publish(wrench)

    def _publish_joints(self, s: Sample, stamp: Any) -> None:
        joints = JointState(name=self.names, position=s.q, velocity=s.qd, effort=s.current)
        joints.header.stamp, joints.header.frame_id = stamp, self.config.base_frame
        self.joints.publish(joints)
        if self.config.publish_tf:
            transform = TransformStamped(child_frame_id=self.config.flange_frame)
            transform.header.stamp, transform.header.frame_id = stamp, self.config.base_frame
            _fill(transform.transform.translation, s.p)
            _fill_quaternion(transform.transform.rotation, s.orientation)
            self.tf.publish(TFMessage(transforms=[transform]))

    def _publish_diagnostics(self, s: State, refused: int, accepted: int, deaths: int) -> None:
        level = DiagnosticStatus.OK
        if not s.linked:
            level = DiagnosticStatus.ERROR
        elif _say(s):
            level = DiagnosticStatus.WARN
        values = {
            "robot_ip": self.config.robot_ip,
            "polyscope": s.version,
            "stage": s.stage.name.lower(),
            "linked": s.linked,
            "following": s.armed,
            "targets_accepted": accepted,
            "targets_refused": refused,
            "servo_commands": s.sent,
            "latency_ms": round(1e3 * s.latency, 3),
            "period_p50_ms": round(1e3 * s.period_p50, 3),
            "period_p99_ms": round(1e3 * s.period_p99, 3),
            "period_max_ms": round(1e3 * s.period_max, 3),
            "servo_process_restarts": deaths,
            "speed_scaling": round(s.sample.speed_scaling, 3),
        }
        status = DiagnosticStatus(
            level=level, name=f"{self.node.get_name()}: robot link", hardware_id=self.config.robot_ip
        )
        status.message = _say(s) or "ready"
        status.values = [KeyValue(key=k, value=str(v)) for k, v in values.items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.node.get_clock().now().to_msg()
        self.diagnostics.publish(message)


def _say(s: State) -> str:
    """Why the arm holds, empty when it follows."""
    if s.linked and s.armed:
        return ""
    return s.reason or "no link to the robot"


def _fill(target: Any, numbers: Any) -> None:
    target.x, target.y, target.z = numbers


def _fill_quaternion(target: Any, q: Any) -> None:
    target.x, target.y, target.z, target.w = q
