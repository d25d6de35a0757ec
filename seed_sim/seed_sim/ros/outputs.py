# SPDX-License-Identifier: Apache-2.0
"""What the simulated cell publishes, each stream at its rate."""

from __future__ import annotations

from functools import partial

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from seed_msgs.msg import RelativePose
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32, Float64

from seed_core.estimate import RelativePoseEstimate
from seed_core.regrasp import Regrasp
from seed_core.spatial import Array, so3_log
from seed_ros.conversions import (
    estimate_to_message,
    pose_stamped,
    stamp_from_seconds,
    transform_stamped,
    wrench_stamped,
)
from seed_ros.frames import FrameNames
from seed_ros.node import QUIET, TransformBroadcaster
from seed_ros.qos import CLOCK, COMMAND, LATCHED, QUEUE, SENSOR
from seed_sim.plant.plant import Plant
from seed_ur.models import JOINT_NAMES


class Outputs:
    """Publishers of the node; `publish` is called once per tick."""

    def __init__(
        self, node: Node, plant: Plant, frames: FrameNames, stand_in: bool, own_arm: bool = True, clock: bool = False
    ) -> None:
        """stand_in: publish relative_pose from the truth, in place of cameras and estimator.

        own_arm: publish what an arm publishes; with a UR behind its driver, that is the driver's business.
        clock: publish the time of each tick.
        """
        self._own_arm = own_arm
        self._plant, self._frames = plant, frames
        create = partial(node.create_publisher, event_callbacks=QUIET)
        self._relative_pose = create(RelativePose, "relative_pose", COMMAND) if stand_in else None
        self._next_image = 0.0
        self._regrasp = Regrasp()
        self._clock = create(Clock, "/clock", CLOCK) if clock else None
        self._pose = create(PoseStamped, "current_pose", QUEUE)
        self._twist = create(TwistStamped, "current_twist", QUEUE)
        self._wrench = create(WrenchStamped, "wrench", QUEUE)
        self._ft = create(WrenchStamped, "ft_sensor/wrench", QUEUE)
        self._joints = create(JointState, "joint_states", QUEUE)
        self._width = create(Float64, "gripper/width", QUEUE)
        self._pressures = [create(Float32, f"bubble_{f}/pressure", SENSOR) for f in ("left", "right")]
        self._true_pose = create(RelativePose, "~/ground_truth/relative_pose", QUEUE)
        self._true_wrench = create(WrenchStamped, "~/ground_truth/contact_wrench", QUEUE)
        self._true_tip = create(PoseStamped, "~/ground_truth/tip_pose", QUEUE)
        self._table = create(PoseStamped, "~/ground_truth/table_pose", LATCHED)
        self._factor = create(Float32, "~/real_time_factor", QUEUE)
        self._tf = TransformBroadcaster(node)
        self._count = 0
        self._before: tuple[float, Array] | None = None
        self._table.publish(pose_stamped(plant.surface.X_WS, node.get_clock().now().nanoseconds * 1e-9, frames.base))

    def publish(self, t: float, grasped: bool) -> None:
        """Everything that is due at time t [s]: the pose at the full rate, loads and truth at half of it."""
        X_WE = self._plant.X_WE
        if self._clock is not None:
            self._clock.publish(Clock(clock=stamp_from_seconds(t)))
        if self._own_arm:
            self._pose.publish(pose_stamped(X_WE, t, self._frames.base))
        self._count += 1
        if self._count % 2 == 0:
            self._publish_truth(t, grasped)  # first: cameras expose at it
            self._publish_loads(t)
        if self._own_arm and self._count % 4 == 0:
            self._publish_motion(t, X_WE)
        if self._count % 5 == 0:
            self._publish_gripper()

    def regrasped(self) -> None:
        """The tool was let go: where it is grasped next, T becomes C anew."""
        self._regrasp.begin("grasp")
        self._regrasp.end()

    def restart(self) -> None:
        """The plant's time has gone back to zero."""
        self.regrasped()
        self._next_image, self._before = 0.0, None

    def publish_slow(self, t: float, factor: float) -> None:
        """Once a second."""
        del t
        self._factor.publish(Float32(data=float(factor)))

    def _publish_loads(self, t: float) -> None:
        load = self._plant.ft_wrench
        flange = self._frames.flange
        self._ft.publish(wrench_stamped(load, t, flange))
        if self._own_arm:
            self._wrench.publish(wrench_stamped(load, t, flange))  # what an arm's own sensor reports

    def _publish_truth(self, t: float, grasped: bool) -> None:
        plant, frames = self._plant, self._frames
        exact = np.eye(6) * 1e-12
        estimate = RelativePoseEstimate(
            t, plant.X_CT, exact, valid=grasped, reason="" if grasped else "no tool in the grasp", method="ground_truth"
        )
        message = estimate_to_message(estimate, frames.compliance, frames.tool)
        self._true_pose.publish(message)
        if self._relative_pose is not None and plant.time >= self._next_image:
            self._next_image = max(self._next_image + 1.0 / plant.scenario.measurement.rate, plant.time)
            told = self._regrasp.through(estimate)
            self._relative_pose.publish(estimate_to_message(told, frames.compliance, frames.tool))
            if told.valid:
                self._tf.send(transform_stamped(plant.X_CT, t, frames.compliance, frames.tool))
        self._true_wrench.publish(wrench_stamped(plant.contact_wrench, t, frames.base))
        self._true_tip.publish(pose_stamped(plant.X_WT @ plant.tool.X_Ttip, t, frames.base))

    def _publish_motion(self, t: float, X_WE: Array) -> None:
        before, self._before = self._before, (t, X_WE.copy())
        self._tf.send(transform_stamped(X_WE, t, self._frames.base, self._frames.flange))
        if before is None or t <= before[0]:
            return
        dt = t - before[0]
        twist = TwistStamped()
        twist.header.stamp, twist.header.frame_id = stamp_from_seconds(t), self._frames.base
        linear = (X_WE[:3, 3] - before[1][:3, 3]) / dt
        angular = so3_log(X_WE[:3, :3] @ before[1][:3, :3].T) / dt
        for target, values in ((twist.twist.linear, linear), (twist.twist.angular, angular)):
            target.x, target.y, target.z = (float(v) for v in values)
        self._twist.publish(twist)
        if len(self._plant.arm.q):
            joints = JointState(name=list(JOINT_NAMES), position=[float(q) for q in self._plant.arm.q])
            joints.header.stamp, joints.header.frame_id = stamp_from_seconds(t), self._frames.base
            self._joints.publish(joints)

    def _publish_gripper(self) -> None:
        self._width.publish(Float64(data=float(self._plant.width)))
        for publisher in self._pressures:
            publisher.publish(Float32(data=float(self._plant.pressure)))
