# SPDX-License-Identifier: Apache-2.0
"""What the simulated cell publishes, each stream at its rate."""

import contextlib

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rosgraph_msgs.msg import Clock
from seed_msgs.msg import RelativePose
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32, Float64, Float64MultiArray
from visualization_msgs.msg import Marker

from seed_core.estimate import NO_TOOL, Regrasp, RelativePoseEstimate
from seed_core.hand import FINGERS
from seed_core.spatial import Array, so3_log
from seed_ros import CLOCK, COMMAND, LATCHED, QUEUE, SENSOR, FrameNames, SeedNode, TransformBroadcaster
from seed_ros.conversions import (
    estimate_to_message,
    fill,
    pose_stamped,
    stamp_from_seconds,
    stamped,
    transform_stamped,
    wrench_stamped,
)
from seed_sim.plant.arm import ELBOW_UP
from seed_sim.plant.plant import Plant
from seed_sim.pressure import PressureSensors
from seed_sim.ros.every import Every
from seed_sim.ros.membrane_message import TOPIC, Membranes, membranes_to_message
from seed_sim.ros.table_marker import table_marker
from seed_ur.kinematics import KinematicsError, URKinematics
from seed_ur.models import JOINT_NAMES

_GRIPPER_PERIOD = 0.02  # [s] between two widths, and two pressures of each bubble


class Outputs:
    """Publishers of the node; `publish` is called once per tick."""

    def __init__(
        self, node: SeedNode, plant: Plant, frames: FrameNames, stand_in: bool, model: str, clock: bool
    ) -> None:
        """stand_in: publish relative_pose from the truth, in place of cameras and estimator.

        model: of the arm; '' with a UR behind its driver, whose business it is to publish what an arm publishes.
        clock: publish the time of each tick.
        """
        self._own_arm = bool(model)
        self._kinematics = URKinematics.for_model(model) if model else None
        self._q = list(ELBOW_UP)
        self._plant, self._frames = plant, frames
        create = node.publisher
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
        self._pressures = {f: create(Float32, f"bubble_{f}/pressure", SENSOR) for f in FINGERS}
        membranes = plant.membranes
        self._membranes = create(Float64MultiArray, f"~/{TOPIC}", SENSOR) if membranes is not None else None
        self._told = -1.0  # [s] the solve that was published last
        self._sensors = PressureSensors(plant.scenario, 0)
        self._true_pose = create(RelativePose, "~/ground_truth/relative_pose", QUEUE)
        self._true_wrench = create(WrenchStamped, "~/ground_truth/contact_wrench", QUEUE)
        self._true_tip = create(PoseStamped, "~/ground_truth/tip_pose", QUEUE)
        self._table = create(PoseStamped, "~/ground_truth/table_pose", LATCHED)
        self._shape = create(Marker, "~/ground_truth/table", LATCHED)
        self._factor = create(Float32, "~/real_time_factor", QUEUE)
        self._tf = TransformBroadcaster(node, fixed=False)
        self._count, self._gripper_every = 0, Every(_GRIPPER_PERIOD)
        self._before: tuple[float, Array] | None = None
        X_WS = pose_stamped(plant.surface.X_WS, node.now(), frames.base)
        self._table.publish(X_WS)
        self._shape.publish(table_marker(plant.surface, X_WS))

    def publish(self, t: float, grasped: bool) -> None:
        """All that is due at time t [s]: the pose at the full rate, loads and truth at half of it, fingers at 50 Hz."""
        X_WE = self._plant.X_WE
        if self._clock is not None:
            self._clock.publish(Clock(clock=stamp_from_seconds(t)))
        if self._own_arm:
            self._pose.publish(pose_stamped(X_WE, t, self._frames.base))
        self._count += 1
        if self._count % 2 == 0:
            self._publish_truth(t, grasped)  # first: cameras expose at it
        self._publish_membranes(t, grasped)
        if self._count % 2 == 0:
            self._publish_loads(t)
        if self._own_arm and self._count % 4 == 0:
            self._publish_motion(t, X_WE)
        if self._gripper_every.due(self._plant.time):
            self._publish_gripper()

    def regrasped(self) -> None:
        """The tool was let go: where it is grasped next, T becomes C anew."""
        self._regrasp.begin("grasp")
        self._regrasp.end()

    def restart(self) -> None:
        """The plant's time has gone back to zero."""
        self.regrasped()
        self._next_image, self._before, self._told = 0.0, None, -1.0

    def publish_factor(self, factor: float) -> None:
        """The real-time factor."""
        self._factor.publish(Float32(data=float(factor)))

    def _publish_membranes(self, t: float, grasped: bool) -> None:
        """The nodes of a new solve: cameras expose at it."""
        hold = self._plant.membranes
        if self._membranes is None or hold is None or hold.time == self._told:
            return
        self._told = hold.time
        nodes = {name: bubble.nodes for name, bubble in hold.state.bubbles.items()}
        solved = Membranes(t - (self._plant.time - hold.time), grasped, nodes)
        self._membranes.publish(membranes_to_message(solved))

    def _publish_loads(self, t: float) -> None:
        message = wrench_stamped(self._plant.ft_wrench, t, self._frames.flange)
        self._ft.publish(message)
        if self._own_arm:
            self._wrench.publish(message)  # what an arm's own sensor reports

    def _publish_truth(self, t: float, grasped: bool) -> None:
        plant, frames = self._plant, self._frames
        exact = np.eye(6) * 1e-12
        estimate = RelativePoseEstimate(
            t, plant.X_CT, exact, valid=grasped, reason="" if grasped else NO_TOOL, method="ground_truth"
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
        twist = stamped(TwistStamped, t, self._frames.base)
        fill(twist.twist.linear, (X_WE[:3, 3] - before[1][:3, 3]) / (t - before[0]))
        fill(twist.twist.angular, so3_log(X_WE[:3, :3] @ before[1][:3, :3].T) / (t - before[0]))
        self._twist.publish(twist)
        joints = stamped(JointState, t, self._frames.base)
        joints.name, joints.position = list(JOINT_NAMES), self._joint_angles(X_WE)
        self._joints.publish(joints)

    def _joint_angles(self, X_WE: Array) -> list[float]:
        """Of the plant's arm; of the model at this pose, to look at, where the plant's arm has no joints [rad]."""
        if len(self._plant.arm.q):
            return [float(q) for q in self._plant.arm.q]
        assert self._kinematics is not None
        with contextlib.suppress(KinematicsError):  # out of the model's reach: it is shown where it was
            self._q = self._kinematics.follow(X_WE, self._q)
        return self._q

    def _publish_gripper(self) -> None:
        self._width.publish(Float64(data=float(self._plant.grip.width)))
        for finger, pressure in self._sensors.read(self._plant.grip.pressures, self._plant.time).items():
            self._pressures[finger].publish(Float32(data=float(pressure)))
