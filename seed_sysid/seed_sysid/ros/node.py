# SPDX-License-Identifier: Apache-2.0
"""The identification as a ROS node with the action ~/identify_stiffness, on simulated and real cells."""

from __future__ import annotations

import sys
from concurrent.futures import Future as Job
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from dataclasses import field as member
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from seed_msgs.action import IdentifyStiffness
from seed_msgs.msg import RelativePose
from std_msgs.msg import Float32, Float64, String
from std_srvs.srv import Trigger

from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.hand import Frame, Hand
from seed_core.spatial import Array, inverse_pose
from seed_ros.conversions import (
    check_frame,
    estimate_from_message,
    pose_stamped,
    pose_to_matrix,
    seconds,
    wrench_to_core,
)
from seed_ros.diagnostics import Counters
from seed_ros.frames import FrameNames
from seed_ros.loop import FixedRateLoop
from seed_ros.node import run
from seed_ros.parameters import declare, refuse_unknown
from seed_ros.qos import COMMAND, QUEUE, SENSOR
from seed_sysid.data.bag import TOPIC
from seed_sysid.data.dataset import Header
from seed_sysid.fit.analysis import Analysis, analyse
from seed_sysid.fit.clock_offset import ClockError, ClockOffset, ClockWatch
from seed_sysid.parameters import Procedure
from seed_sysid.report.results import write_results
from seed_sysid.report.summary import summary
from seed_sysid.run.live import Live, LiveError, Streams
from seed_sysid.run.procedure import Command

LINES = QoSProfile(depth=2000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FEEDBACK = 0.5  # [s]


@dataclass(frozen=True)
class Settings:
    """Parameters of the node itself."""

    rate: float = field(50.0, unit="Hz", low=10.0, high=500.0, doc="of target_frame and of the readings")
    tool: str = field("ft_sensor", doc="name of what is held")
    sensor: Frame = field(Frame((0.0, 0.0, 0.06)), doc="nominal pose of the sensor's frame in the tool's frame T")
    sensor_range_force: float = field(0.0, unit="N", low=0.0, high=1e5, doc="where the sensor saturates; 0: unknown")
    sensor_range_torque: float = field(0.0, unit="N m", low=0.0, high=1e5, doc="where the sensor saturates; 0: unknown")
    output: str = field("results/identification", doc="folder used when the goal names none")


@dataclass(frozen=True)
class Findings:
    """What a finished run tells."""

    analysis: Analysis
    clock: ClockOffset | None
    remarks: tuple[str, ...]


@dataclass
class _Active:
    """A goal being worked on."""

    goal: ServerGoalHandle
    live: Live
    folder: Path
    source: str
    finished: Future
    target: Array
    clocks: ClockWatch = member(default_factory=ClockWatch)
    fed_back: float = 0.0
    job: Job[Findings] | None = None


class SysidNode(Node):
    """See docs/identification.md."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("sysid", **arguments)
        self.settings = declare(self, Settings())
        self.procedure = declare(self, Procedure(), "procedure")
        self.hand = declare(self, Hand(), "hand")
        self.frames = declare(self, FrameNames(), "frames")
        refuse_unknown(self)
        self.streams, self.counters = Streams(), Counters(self)
        self._active: _Active | None = None
        self._worker = ThreadPoolExecutor(1)
        self.loop = FixedRateLoop(self, self.settings.rate, self._tick)
        self._wire()

    def _wire(self) -> None:
        self._target = self.create_publisher(PoseStamped, "target_frame", COMMAND)
        self._width = self.create_publisher(Float64, "gripper/command", COMMAND)
        self._lines = self.create_publisher(String, TOPIC, LINES)
        self._zero = self.create_client(Trigger, "ft_sensor/zero")
        self.loop.poll(PoseStamped, "current_pose", self._on_pose, QUEUE)
        self.loop.poll(WrenchStamped, "ft_sensor/wrench", self._on_wrench, QUEUE)
        self.loop.poll(RelativePose, "relative_pose", self._on_estimate, QUEUE)
        self.create_subscription(Float64, "gripper/width", self._on_width, QUEUE)
        for finger in ("left", "right"):
            self.create_subscription(Float32, f"bubble_{finger}/pressure", self._on_pressure(finger), SENSOR)
        self._server = ActionServer(
            self,
            IdentifyStiffness,
            "~/identify_stiffness",
            execute_callback=self._execute,
            goal_callback=lambda _: GoalResponse.ACCEPT,  # a refusal needs words, which only a result has
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def now(self) -> float:
        """ROS time [s]."""
        return self.get_clock().now().nanoseconds * 1e-9

    @property
    def _moving(self) -> _Active | None:
        """The goal whose poses are being visited."""
        return self._active if self._active is not None and self._active.job is None else None

    # in
    def _on_pose(self, message: PoseStamped) -> None:
        try:
            check_frame(message.header.frame_id, (self.frames.base,), "current_pose")
            X_WE = pose_to_matrix(message.pose, "current_pose")
            self.streams.X_WE, self.streams.pose_stamp = X_WE, self.now()
            if self._moving is not None:
                X_TC = inverse_pose(self._moving.live.X_WT) @ X_WE @ self.hand.X_EC
                self._moving.clocks.robot(seconds(message.header.stamp), X_TC)
        except SeedError as error:
            self.counters.add("poses_refused", str(error))

    def _on_wrench(self, message: WrenchStamped) -> None:
        try:
            self.streams.wrenches.append(wrench_to_core(message.wrench, "ft_sensor/wrench").vector())
            self.streams.wrench_stamp = self.now()
        except SeedError as error:
            self.counters.add("wrenches_refused", str(error))

    def _on_estimate(self, message: RelativePose) -> None:
        try:
            check_frame(message.header.frame_id, (self.frames.compliance,), "relative_pose")
            estimate = estimate_from_message(message)
            self.streams.estimate = estimate
            self.streams.slip.append(estimate.slip)
            if self._moving is not None and estimate.valid:
                self._moving.clocks.camera(estimate.stamp, inverse_pose(estimate.X_CT))
        except SeedError as error:
            self.counters.add("estimates_refused", str(error))

    def _on_width(self, message: Float64) -> None:
        if np.isfinite(message.data):
            self.streams.width = float(message.data)

    def _on_pressure(self, finger: str) -> Any:
        def receive(message: Float32) -> None:
            if np.isfinite(message.data):
                self.streams.pressures[finger] = float(message.data)

        return receive

    # the action
    async def _execute(self, goal: ServerGoalHandle) -> IdentifyStiffness.Result:
        try:
            if goal.request.zero_sensor:
                await self._zero_sensor()
            active = self._start(goal)
        except SeedError as error:
            self.get_logger().error(f"identify_stiffness refused: {error}")
            goal.abort()
            return IdentifyStiffness.Result(success=False, message=str(error))
        return await active.finished  # type: ignore[no-any-return]

    async def _zero_sensor(self) -> None:
        if not self._zero.service_is_ready():
            raise LiveError("the service ft_sensor/zero is not there: start the sensor, or leave zero_sensor false")
        answer = await self._zero.call_async(Trigger.Request())
        if not answer.success:
            raise LiveError(f"ft_sensor/zero refused: {answer.message}")

    def _start(self, goal: ServerGoalHandle) -> _Active:
        if self._active is not None:
            raise LiveError("an identification is running: cancel it first")
        source = goal.request.poses or "kinematic"
        if source not in ("kinematic", "estimator"):
            raise LiveError(f"poses = '{source}' must be kinematic or estimator")
        s = self.settings
        head = Header(
            hand=self.hand.name,
            tool=s.tool,
            sensor_xyz=s.sensor.position,
            sensor_rpy=tuple(float(v) for v in np.deg2rad(s.sensor.rpy_deg)),
            sensor_range=(s.sensor_range_force, s.sensor_range_torque),
        )
        folder = Path(goal.request.output or s.output)
        live = Live(self.procedure, head, self.hand.X_EC, self.streams, folder / "samples.jsonl", self.now(), _date())
        assert self.streams.X_WE is not None
        self._active = _Active(goal, live, folder, source, Future(), self.streams.X_WE)
        for line in live.recorder.lines():
            self._lines.publish(String(data=line))
        self.get_logger().info(
            f"identification: {live.run.total - live.run.done} of {live.run.total} poses to go, {folder}"
        )
        return self._active

    def _tick(self) -> None:
        active = self._active
        if active is None:
            return
        if active.job is None:
            self._step(active)
        elif active.job.done():
            self._finish(active, active.job)
        if self._active is not None:
            self._target.publish(pose_stamped(active.target, self.now(), self.frames.base))

    def _step(self, active: _Active) -> None:
        if active.goal.is_cancel_requested:
            done, total = active.live.run.done, active.live.run.total
            words = f"cancelled; {done} of {total} poses are kept: call again with the same output to go on"
            self._end(active, IdentifyStiffness.Result(success=False, message=words), "canceled")
            return
        try:
            active.target, command = active.live.tick(self.now())
        except SeedError as error:
            self._end(active, IdentifyStiffness.Result(success=False, message=str(error)), "abort")
            return
        self._width.publish(Float64(data=float(command.width)))
        if command.sample:
            self._lines.publish(String(data=active.live.recorder.lines()[-1]))
        if command.done:
            active.job = self._worker.submit(_analysed, active)
        self._feed_back(active, command)

    def _feed_back(self, active: _Active, command: Command) -> None:
        now = self.now()
        if now - active.fed_back < FEEDBACK and not command.done:
            return
        active.fed_back = now
        live = active.live.run
        active.goal.publish_feedback(
            IdentifyStiffness.Feedback(
                state=command.state, grip=command.grip, done=live.done, total=live.total, remaining=live.remaining(now)
            )
        )

    def _finish(self, active: _Active, job: Job[Findings]) -> None:
        try:
            result = self._write(active.folder, job.result())
        except (SeedError, OSError) as error:
            self._end(active, IdentifyStiffness.Result(success=False, message=str(error)), "abort")
            return
        self._end(active, result, "succeed")

    def _write(self, folder: Path, found: Findings) -> IdentifyStiffness.Result:
        a = found.analysis
        file, figures = folder / "stiffness.yaml", summary(a)
        figures["camera_clock"] = asdict(found.clock) if found.clock else None
        write_results(folder, a, figures, _date())
        k, std = a.solution.value.stiffness[a.nominal], a.solution.std.stiffness[a.nominal]
        return IdentifyStiffness.Result(
            success=True,
            message="; ".join([*a.warnings, *found.remarks]),
            stiffness_file=str(file),
            rotation=k[:3],
            translation=k[3:],
            rotation_std=std[:3],
            translation_std=std[3:],
        )

    def _end(self, active: _Active, result: IdentifyStiffness.Result, how: str) -> None:
        self._active = None
        active.live.recorder.close()
        getattr(active.goal, how)()
        level = self.get_logger().info if result.success else self.get_logger().error
        level(result.message or "identification done")
        active.finished.set_result(result)

    def destroy_node(self) -> None:
        """Close the file of a running identification as well."""
        if self._active is not None:
            self._active.live.recorder.close()
        self._worker.shutdown(wait=False, cancel_futures=True)
        super().destroy_node()


def _analysed(active: _Active) -> Findings:
    analysis = analyse(active.live.recorder.dataset, active.source, active.live.run.procedure.fit)
    if not active.clocks.seen:
        return Findings(analysis, None, ())
    try:
        clock = active.clocks.offset()
    except ClockError as error:
        return Findings(analysis, None, (str(error),))
    return Findings(analysis, clock, (clock.advice,) if clock.advice else ())


def _date() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def main(argv: list[str] | None = None) -> int:
    """Entry point."""
    return run(SysidNode, argv)


if __name__ == "__main__":
    sys.exit(main())
