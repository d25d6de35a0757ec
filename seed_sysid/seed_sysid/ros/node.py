# SPDX-License-Identifier: Apache-2.0
"""The identification as a ROS node with the action ~/identify_stiffness, on simulated and real cells."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile
from seed_msgs.action import IdentifyStiffness
from seed_msgs.msg import RelativePose
from std_msgs.msg import Float32, Float64, String
from std_srvs.srv import Trigger

from seed_core.clocks import read_clocks
from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.hand import FINGERS, Frame, Hand
from seed_core.spatial import inverse_pose
from seed_ros import COMMAND, LATCHED, QUEUE, SENSOR, FixedRateLoop, FrameNames, SeedNode, diagnostics
from seed_ros.arm import arm_holds
from seed_ros.conversions import (
    check_frame,
    estimate_from_message,
    pose_stamped,
    pose_to_matrix,
    seconds,
    wrench_to_core,
)
from seed_sysid.data.bag import TOPIC
from seed_sysid.data.dataset import SOURCES, Header
from seed_sysid.data.sample_file import is_fresh, read
from seed_sysid.parameters import Procedure
from seed_sysid.ros.goal import ActiveGoal, ClocksBefore, GoalCancelledError, date
from seed_sysid.run.live import Live, LiveError, Streams
from seed_sysid.run.procedure import Command

LINES = QoSProfile(depth=2000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FEEDBACK = 0.5  # [s]
REACH = 10.0  # [m] no arm reaches so far
ZERO_PATIENCE = 5.0  # [s] for ft_sensor/zero to answer


@dataclass(frozen=True)
class Settings:
    """Parameters of the node itself."""

    rate: float = field(50.0, unit="Hz", low=10.0, high=500.0, doc="of target_frame and of the readings")
    tool: str = field("ft_sensor", doc="name of what is held")
    sensor: Frame = field(Frame((0.0, 0.0, 0.06)), doc="nominal pose of the sensor's frame in the tool's frame T")
    sensor_frame: str = field("", doc="frame_id of ft_sensor/wrench, others are refused; empty: that of the first")
    sensor_range_force: float = field(0.0, unit="N", low=0.0, high=1e5, doc="where the sensor saturates; 0: unknown")
    sensor_range_torque: float = field(0.0, unit="N m", low=0.0, high=1e5, doc="where the sensor saturates; 0: unknown")
    clocks: str = field("", doc="what the estimator was given as clocks: the comparison counts from there")
    robot: str = field("", doc="name of the robot, for clocks.yaml")
    cameras: str = field("", doc="names of the cameras, for clocks.yaml")
    output: str = field("results", doc="where a goal that names no folder makes one of its own, identify-TIME")


class SysidNode(SeedNode):
    """See docs/identification.md."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("sysid", **arguments)
        self.settings = self.declare(Settings())
        self.procedure = self.declare(Procedure(), "procedure")
        self.hand = self.declare(Hand(), "hand")
        self.frames = self.declare(FrameNames(), "frames")
        self.refuse_unknown(shared=("tool.", "grasp."))

        self.streams = Streams()
        self._sensor_frame = self.settings.sensor_frame
        self._active: ActiveGoal | None = None
        self._starting = False  # a goal waits for ft_sensor/zero
        self._clocks = ClocksBefore(
            read_clocks(self.settings.clocks).offset, self.settings.robot, self.settings.cameras
        )

        self._target = self.create_publisher(PoseStamped, "target_frame", COMMAND)
        self._width = self.create_publisher(Float64, "gripper/command", COMMAND)
        self._lines = self.create_publisher(String, TOPIC, LINES)
        self._zero = self.create_client(Trigger, "ft_sensor/zero")
        self.loop = FixedRateLoop(self, self.settings.rate, self._tick)
        self.listen(PoseStamped, "current_pose", self._on_pose, QUEUE, refused="poses_refused")
        self.listen(WrenchStamped, "ft_sensor/wrench", self._on_wrench, QUEUE, refused="wrenches_refused")
        self.listen(RelativePose, "relative_pose", self._on_estimate, QUEUE, refused="estimates_refused")
        self.loop.poll(String, "arm_hold_reason", self._on_arm_hold, LATCHED)
        self.loop.poll(Float64, "gripper/width", self._on_width, QUEUE)
        for finger in FINGERS:
            receive = partial(self._on_pressure, finger)
            self.loop.poll(Float32, f"bubble_{finger}/pressure", receive, SENSOR)
        self._server = self.serve_action(IdentifyStiffness, "~/identify_stiffness", self._execute)
        self.diagnose("sysid", self._report)

    def _report(self) -> diagnostics.Report:
        return (
            diagnostics.OK,
            "identifying" if self._active is not None else "waiting for a goal",
            self.counters.values(),
        )

    @property
    def _moving(self) -> ActiveGoal | None:
        """The goal whose poses are being visited."""
        return self._active if self._active is not None and self._active.visiting else None

    # in
    def _on_pose(self, message: PoseStamped) -> None:
        check_frame(message.header.frame_id, (self.frames.base,), "current_pose")
        X_WE = pose_to_matrix(message.pose, "current_pose")
        if (away := float(np.abs(X_WE[:3, 3]).max())) > REACH:
            raise LiveError(f"current_pose lies {away:.3g} m from the base: no arm reaches {REACH:g} m")
        self.streams.X_WE, self.streams.pose_stamp = X_WE, self.now()
        if self._moving is not None:
            X_TC = inverse_pose(self._moving.live.X_WT) @ X_WE @ self.hand.X_EC
            self._moving.clocks.robot(seconds(message.header.stamp), X_TC)

    def _on_wrench(self, message: WrenchStamped) -> None:
        self._sensor_frame = self._sensor_frame or message.header.frame_id
        check_frame(message.header.frame_id, (self._sensor_frame,), "ft_sensor/wrench")
        self.streams.wrenches.append(wrench_to_core(message.wrench, "ft_sensor/wrench").vector())
        self.streams.wrench_stamp = self.now()

    def _on_estimate(self, message: RelativePose) -> None:
        check_frame(message.header.frame_id, (self.frames.compliance,), "relative_pose")
        estimate = estimate_from_message(message)
        self.streams.take_estimate(estimate, self.now())
        if self._moving is not None and estimate.valid:
            self._moving.clocks.camera(estimate.stamp, inverse_pose(estimate.X_CT))

    def _on_arm_hold(self, message: String) -> None:
        self.streams.held = arm_holds(self, message.data)

    def _on_width(self, message: Float64) -> None:
        if np.isfinite(message.data):
            self.streams.take_width(float(message.data), self.now())

    def _on_pressure(self, finger: str, message: Float32) -> None:
        if np.isfinite(message.data):
            self.streams.take_pressure(finger, float(message.data), self.now())

    # the action
    async def _execute(self, goal: ServerGoalHandle) -> IdentifyStiffness.Result:
        try:
            active = await self._begin(goal)
        except (SeedError, OSError) as error:
            self.get_logger().error(f"identify_stiffness refused: {error}")
            goal.abort()
            return IdentifyStiffness.Result(success=False, message=str(error))
        return await active.finished

    async def _begin(self, goal: ServerGoalHandle) -> ActiveGoal:
        """Zero the sensor if asked for, unless a run goes on, and start; no other goal starts meanwhile."""
        if self._active is not None or self._starting:
            raise LiveError("an identification is running: cancel it first")
        if self.streams.held:
            raise LiveError(f"cannot start: {self.streams.held}")
        self._starting = True
        try:
            folder = Path(goal.request.output or f"{self.settings.output}/identify-{datetime.now(UTC):%Y%m%d-%H%M%S}")
            file = folder / "samples.jsonl"
            if goal.request.zero_sensor and not is_fresh(file) and read(file).samples:
                # the arm stands where it was interrupted: that load would be the new zero of the same grip
                self.get_logger().warning(f"ft_sensor/zero is not called: the run of {folder} goes on with its zero")
            elif goal.request.zero_sensor:
                await self._zero_sensor()
            return self._start(goal, folder)
        finally:
            self._starting = False

    async def _zero_sensor(self) -> None:
        if not self._zero.service_is_ready():
            raise LiveError("the service ft_sensor/zero is not there: start the sensor, or leave zero_sensor false")
        request = self._zero.call_async(Trigger.Request())
        deadline = self.create_timer(ZERO_PATIENCE, request.cancel, clock=Clock(clock_type=ClockType.STEADY_TIME))
        try:
            answer = await request
        finally:
            self.destroy_timer(deadline)
        if request.cancelled():
            self._zero.remove_pending_request(request)
            raise LiveError(f"ft_sensor/zero has not answered for {ZERO_PATIENCE:g} s: is the sensor's driver running?")
        if not answer.success:
            raise LiveError(f"ft_sensor/zero refused: {answer.message}")

    def _start(self, goal: ServerGoalHandle, folder: Path) -> ActiveGoal:
        source = goal.request.poses or "kinematic"
        if source not in SOURCES:
            raise LiveError(f"poses = '{source}' must be kinematic or estimator")
        s = self.settings
        head = Header(
            hand=self.hand.name,
            tool=s.tool,
            sensor_frame=self._sensor_frame,
            sensor_xyz=s.sensor.position,
            sensor_rpy=tuple(float(v) for v in np.deg2rad(s.sensor.rpy_deg)),
            sensor_range=(s.sensor_range_force, s.sensor_range_torque),
        )
        file, now = folder / "samples.jsonl", self.now()
        live = Live(self.procedure, head, self.hand.X_EC, self.streams, file, now, date(), source)
        assert self.streams.X_WE is not None
        self._active = ActiveGoal(goal, live, folder, source, self.streams.X_WE, self._clocks)
        self.destroy_publisher(self._lines)  # it would tell a bag that is begun now of the run before, too
        self._lines = self.create_publisher(String, TOPIC, LINES)
        for line in live.recorder.lines():
            self._lines.publish(String(data=line))
        if live.recorder.remark:
            self.get_logger().warning(live.recorder.remark)
        to_go = live.run.total - live.run.done
        self.get_logger().info(f"identification: {to_go} of {live.run.total} poses to go, {folder}")
        return self._active

    def _tick(self) -> None:
        active = self._active
        if active is None:
            return
        now = self.now()
        try:
            if active.visiting:
                self._tell(active, active.visit(now), now)
                result = None
            else:
                result = active.result()
        except GoalCancelledError as error:
            self._end(active, active.goal.canceled, IdentifyStiffness.Result(success=False, message=str(error)))
        except (SeedError, OSError) as error:
            self._end(active, active.goal.abort, IdentifyStiffness.Result(success=False, message=str(error)))
        else:
            if result is not None:
                self._end(active, active.goal.succeed, result)
        if self._active is not None:
            self._target.publish(pose_stamped(active.target, now, self.frames.base))

    def _tell(self, active: ActiveGoal, command: Command, now: float) -> None:
        if command.width is not None:
            self._width.publish(Float64(data=float(command.width)))
        if command.sample:
            self._lines.publish(String(data=active.live.recorder.lines()[-1]))
        if now - active.fed_back < FEEDBACK and not command.done:
            return
        active.fed_back = now
        run = active.live.run
        active.goal.publish_feedback(
            IdentifyStiffness.Feedback(
                state=command.state, grip=command.grip, done=run.done, total=run.total, remaining=run.remaining(now)
            )
        )

    def _end(self, active: ActiveGoal, end_goal: Callable[[], None], result: IdentifyStiffness.Result) -> None:
        self._active = None
        active.close()
        end_goal()
        self.tell(result.success, result.message or "identification done")
        active.finished.set_result(result)

    def destroy_node(self) -> None:
        """Close the file of a running identification as well."""
        if self._active is not None:
            self._active.close()
        super().destroy_node()


main = SysidNode.main
