# SPDX-License-Identifier: Apache-2.0
"""What the driver publishes: poses, wrench, joints, state words, TF and diagnostics, from one state at a time."""

import time
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TransformStamped, TwistStamped, WrenchStamped
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, Int8, String, UInt8
from tf2_msgs.msg import TFMessage

from seed_core.arm.quaternion import inverse, rotate
from seed_driver.config import DriverConfig
from seed_driver.process.shared_memory import RobotState, ServoState, Stage
from seed_ros import LATCHED, QUEUE, TF, Diagnostics, SeedNode, diagnostics
from seed_ros.conversions import fill, stamp_from_seconds, stamped
from seed_ur.models import JOINT_NAMES

DIAGNOSTICS_EVERY = 1.0  # [s], and at once when something changes


def link_status(node: SeedNode) -> str:
    """Name of the driver's status on /diagnostics."""
    return f"{node.get_name()}: robot link"


class Outputs:
    """The publishers; state words are published when they change and kept for late joiners."""

    def __init__(self, node: SeedNode, config: DriverConfig) -> None:
        self.node, self.config = node, config
        self.names = [config.joint_prefix + n for n in JOINT_NAMES]
        self._publishers: list[Publisher] = []
        self.pose = self._publisher(PoseStamped, "current_pose")
        self.twist = self._publisher(TwistStamped, "current_twist")
        self.wrench = self._publisher(WrenchStamped, "wrench")
        self.joints = self._publisher(JointState, "joint_states")
        self.tf = self._publisher(TFMessage, "/tf", TF)
        self.reason = self._publisher(String, "~/hold_reason", LATCHED)
        self.robot_mode = self._publisher(Int8, "~/robot_mode", LATCHED)
        self.safety_mode = self._publisher(UInt8, "~/safety_mode", LATCHED)
        self.program = self._publisher(Bool, "~/robot_program_running", LATCHED)
        self.speed_scaling = self._publisher(Float64, "~/speed_scaling", LATCHED)
        self.diagnostics = Diagnostics(
            node, config.robot_ip, self._report, node.beats, node.counters, link_status(node), timed=False
        )
        self._publishers.append(self.diagnostics.publisher)
        self._count = 0
        self._due = 0.0  # [s] monotonic, after which the next sample to be published was measured
        self._words: tuple[Any, ...] = (None,) * 5
        self._diagnosed = 0.0
        self._told = ServoState(), 0, 0, 0  # state, targets accepted and refused, restarts of the servo process

    def _publisher(self, kind: Any, topic: str, qos: QoSProfile | int = QUEUE) -> Publisher:
        publisher = self.node.publisher(kind, topic, qos)
        self._publishers.append(publisher)
        return publisher

    def destroy(self) -> None:
        """Give the publishers back."""
        for publisher in self._publishers:
            self.node.destroy_publisher(publisher)

    def publish(self, state: ServoState, now: float, refused: int, accepted: int, deaths: int) -> None:
        """Publish what is due; measurements only while they are fresh.

        Args:
            now: time.monotonic() [s].
            refused, accepted: targets so far. deaths: of the servo process.
        """
        changed = self._publish_words(state)
        if changed or now - self._diagnosed > DIAGNOSTICS_EVERY:
            self._diagnosed, self._told = now, (state, accepted, refused, deaths)
            self.diagnostics.publish()
        if not state.linked or state.sample_time <= self._due:
            return
        self._due = max(self._due + 1.0 / self.config.publish_rate, state.sample_time)  # nothing is made up for
        self._count += 1
        stamp = self._stamp(state)
        self._publish_pose(state.sample, stamp)
        self.node.beats.add(state.latency)
        if self._count % 2 == 0:
            self._publish_motion(state.sample, stamp)
        if self._count % 4 == 0:
            self._publish_joints(state.sample, stamp)

    def publish_inactive(self, state: ServoState) -> None:
        """Tell late joiners that nothing runs any more."""
        self._publish_words(state)
        self._told = state, 0, 0, 0
        self.diagnostics.publish()

    def _stamp(self, state: ServoState) -> Time:
        """When the sample was measured."""
        if self.config.simulated:
            return stamp_from_seconds(state.timestamp)
        age = time.monotonic() - state.sample_time  # read together with the ROS clock, or stamps jitter
        return (self.node.get_clock().now() - Duration(seconds=max(0.0, age))).to_msg()

    def _publish_words(self, s: ServoState) -> bool:
        running = s.linked and s.stage == Stage.SERVOING
        mode = s.sample.modes.robot_mode if s.linked else 0  # 0: disconnected
        safety = s.sample.modes.safety_mode if s.linked else 0
        words = (_say(s), mode, safety, running, round(s.sample.speed_scaling, 2) if s.linked else 0.0)
        if words == self._words:
            return False
        before, self._words = self._words, words
        publishers = (self.reason, self.robot_mode, self.safety_mode, self.program, self.speed_scaling)
        for publisher, old, new in zip(publishers, before, words, strict=True):
            if old != new:
                publisher.publish(publisher.msg_type(data=new))
        if before[0] != words[0]:
            if words[0]:
                self.node.get_logger().warning(words[0])
            else:
                self.node.get_logger().info("ready: following target_frame")
        return True

    def _publish_pose(self, s: RobotState, stamp: Time) -> None:
        message = stamped(PoseStamped, stamp, self.config.base_frame)
        fill(message.pose.position, s.p)
        fill(message.pose.orientation, s.orientation)
        self.pose.publish(message)

    def _publish_motion(self, s: RobotState, stamp: Time) -> None:
        twist = stamped(TwistStamped, stamp, self.config.base_frame)
        fill(twist.twist.linear, s.twist[:3])
        fill(twist.twist.angular, s.twist[3:])
        self.twist.publish(twist)
        wrench = stamped(WrenchStamped, stamp, self.config.flange_frame)
        into_tool = inverse(s.orientation)
        fill(wrench.wrench.force, rotate(into_tool, s.wrench[:3]))
        fill(wrench.wrench.torque, rotate(into_tool, s.wrench[3:]))
        self.wrench.publish(wrench)

    def _publish_joints(self, s: RobotState, stamp: Time) -> None:
        joints = stamped(JointState, stamp, self.config.base_frame)
        joints.name, joints.position, joints.velocity, joints.effort = self.names, s.q, s.qd, s.current
        self.joints.publish(joints)
        if self.config.publish_tf:
            transform = stamped(TransformStamped, stamp, self.config.base_frame)
            transform.child_frame_id = self.config.flange_frame
            fill(transform.transform.translation, s.p)
            fill(transform.transform.rotation, s.orientation)
            self.tf.publish(TFMessage(transforms=[transform]))

    def _report(self) -> diagnostics.Report:
        s, accepted, refused, deaths = self._told
        level = diagnostics.WARN if _say(s) else diagnostics.OK
        values = {
            "robot_ip": self.config.robot_ip,
            "polyscope": s.version,
            "stage": s.stage.name.lower(),
            "linked": s.linked,
            "following": s.armed,
            "targets_accepted": accepted,
            "targets_refused": refused,
            "servo_commands": s.sent,
            "period_p50_ms": round(1e3 * s.period_p50, 3),
            "period_p99_ms": round(1e3 * s.period_p99, 3),
            "period_max_ms": round(1e3 * s.period_max, 3),
            "servo_process_restarts": deaths,
            "speed_scaling": round(s.sample.speed_scaling, 3),
        }
        return level if s.linked else diagnostics.ERROR, _say(s) or "ready", values


def _say(s: ServoState) -> str:
    """Why the arm holds, empty when it follows."""
    if s.linked and s.armed:
        return ""
    return s.reason or "no link to the robot"
