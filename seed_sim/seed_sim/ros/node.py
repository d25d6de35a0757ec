# SPDX-License-Identifier: Apache-2.0
"""The simulated cell as a ROS node: target_frame in; what an arm, a gripper and sensors publish, and the truth, out."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.publisher import Publisher
from seed_msgs.msg import RelativePose
from seed_msgs.srv import SetGripperWidth
from std_msgs.msg import String
from std_srvs.srv import Trigger

from seed_control.tasks import load_task
from seed_core.arm.hold import HoldLatch
from seed_core.arm.target_checks import jump, stale
from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.program.files import write_text
from seed_core.spatial import Array
from seed_core.vector3 import as_vector3
from seed_ros import COMMAND, LATCHED, FixedRateLoop, FrameNames, MessageError, SeedNode, diagnostics
from seed_ros.arm import TargetSenders
from seed_ros.conversions import check_frame, pose_to_matrix, seconds
from seed_sim.closed_loop.run import start_pose
from seed_sim.hand_file import compare
from seed_sim.membrane import MembraneError
from seed_sim.plant.arm import ELBOW_UP
from seed_sim.plant.grip import PlantError
from seed_sim.plant.plant import Plant
from seed_sim.plant.plant_time import PlantTime
from seed_sim.plant.tool_holder import ToolHolder
from seed_sim.replay import Film, replay_of
from seed_sim.ros.fingers import Fingers
from seed_sim.ros.outputs import Outputs
from seed_sim.scenario import load_scenario
from seed_ur.models import MODELS
from seed_ur.plant_link import PlantLink

REMEDY = "; call sim/resend_robot_program"
UNSAVED = 1.0  # [s] of a replay that an end without ~/save_replay may lose
SLOW = 0.98  # real-time factor from which it warns
PUT = "sim/reset has put it at its start"  # why it holds: whoever steers it may send it to where it was for a while yet


@dataclass(frozen=True)
class SimSettings:
    """Parameters of the simulated cell."""

    scenario: str = field("nominal", doc="name or file of the scenario")
    hand_file: str = field(
        "",
        doc="what estimator and controller are told of hand, tool and grasp: another tool than the scenario's is "
        "refused, other numbers are warned of; empty: not compared",
    )
    seed: int = field(0, low=0, high=2**31 - 1, doc="of the table and of all noise")
    task: str = field("squeegee", doc="name or file of the task whose work frame the table lies in")
    rate: float = field(250.0, unit="Hz", low=100.0, high=1000.0, doc="of current_pose")
    target_timeout: float = field(0.1, unit="s", low=0.01, high=2.0, doc="largest age of a target, and largest silence")
    max_step: float = field(0.05, unit="m", low=1e-4, high=1.0, doc="a target further from the flange is a jump")
    clock: bool = field(False, doc="publish the plant's time on /clock, and stand still for late estimates and targets")
    relative_pose: bool = field(False, doc="publish relative_pose from the truth, in place of cameras and estimator")
    robot_ip: str = field(
        "", doc="stand-in UR controller whose arm carries the gripper; empty: an arm of the cell's own"
    )
    model: str = field("ur5e", choices=tuple(MODELS), doc="arm whose joint_states are shown, if it is the cell's own")
    realtime_priority: int = field(
        15, low=0, high=98, doc="SCHED_FIFO priority if allowed, below the estimator's; 0: none"
    )
    replay: str = field(
        "", doc="file that ~/save_replay, and the end of the node, writes; empty: nothing is recorded for a replay"
    )


class SimNode(SeedNode):
    """See docs/interfaces.md. A holder carries the tool until the arm moves after a grasp."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("sim", **arguments)
        self.settings = settings = self.declare(SimSettings())
        self.frames = self.declare(FrameNames(), "frames")
        self.refuse_unknown()

        self.scenario = load_scenario(settings.scenario)
        self._told_wrong = compare(self.scenario, settings.hand_file) if settings.hand_file else ""
        if self._told_wrong:
            self.get_logger().warning(self._told_wrong)
        task = load_task(settings.task)
        self._X_WE_start = start_pose(self.scenario, task)
        self._film, self._saved = _film(settings.replay) if settings.replay else None, 0.0
        self.plant = Plant(self.scenario, settings.seed, task.frame.pose, self._X_WE_start, film=self._film)
        self.holder = ToolHolder(self.plant)
        self._latch = HoldLatch(settings.target_timeout)
        self._reason_told: str | None = None
        self._robot = self._join_robot()

        own_arm = self._robot is None
        model = settings.model if own_arm else ""
        self._outputs = Outputs(self, self.plant, self.frames, settings.relative_pose, model, settings.clock)
        self.loop = FixedRateLoop(self, settings.rate, self._tick, priority=settings.realtime_priority)
        self._hold_reason: Publisher | None = None
        if own_arm:
            self._senders = TargetSenders(self)
            self.loop.poll(PoseStamped, "target_frame", self._on_target, COMMAND, informed=True)
            self._hold_reason = self.publisher(String, "~/hold_reason", LATCHED)
            self.serve(Trigger, "~/resend_robot_program", self._resume)
        elif settings.clock:
            self._wait_for(PoseStamped, "target_frame")
            self._wait_for(PoseStamped, "current_pose")
        if settings.clock:
            self._wait_for(RelativePose, "relative_pose")
        self.fingers = Fingers(self, self.plant, lambda: self.holder.grasped)

        self.serve(Trigger, "~/grasp", self._grasp)
        self.serve(Trigger, "~/release", self._release)
        self.serve(Trigger, "~/reset", self._reset)
        self.serve(Trigger, "~/save_replay", self._save_replay)
        self.create_service(SetGripperWidth, "~/set_gripper_width", self._set_width)
        self.create_timer(1.0, self._measure, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.diagnose(f"scenario {self.scenario.name}", self._report)
        self.time = PlantTime(self.plant, self.holder, self._robot, settings.clock, time.monotonic(), self.now())

    def now(self) -> float:
        """ROS time [s], which is the plant's where everybody's is."""
        time_of_plant: PlantTime | None = getattr(self, "time", None)
        return time_of_plant.stamp if time_of_plant is not None and self.settings.clock else super().now()

    def _join_robot(self) -> PlantLink | None:
        """The stand-in controller whose arm carries the gripper, placed at the start; None for an arm of our own.

        A node that is started again beside a running program finds the arm where it stands.
        """
        if not self.settings.robot_ip:
            return None
        link = PlantLink(self.settings.robot_ip)
        clock = self.now() if self.settings.clock else None
        link.place(self._X_WE_start, ELBOW_UP, clock, stay=clock is None)
        return link

    def _wait_for(self, kind: Any, topic: str) -> None:
        """Have the plant's time stand still when this stream is late."""
        self.loop.poll(kind, topic, lambda m: self.time.streams[topic].hear(seconds(m.header.stamp)), COMMAND)

    # the tick
    def _tick(self) -> None:
        try:
            if told := self.time.advance(time.monotonic(), 1.0 / self.settings.rate):
                self.counters.add("robot_clock_back", told)
            self.fingers.advance()
            self.beats.add()
        except MembraneError as error:
            self._lose_tool(str(error))
        self._outputs.publish(self.time.stamp, self.holder.grasped)
        self._latch.check(self.time.stamp, self._why_silent())
        if self._hold_reason is not None and self._latch.reason != self._reason_told:
            self._reason_told = self._latch.reason
            self._hold_reason.publish(String(data=self._reason_told))

    def _why_silent(self) -> str:
        """What may keep targets from coming: by the wall's clock a machine that is too busy, too."""
        if self.settings.clock:
            return ""
        busy = f"this computer is busy: real-time factor {self.time.factor:.2f};"
        asked = "does the controller run? is this computer busy?"
        return f"{busy if self.time.factor < SLOW else asked} use_sim_time:=true lets simulated time wait"

    def _lose_tool(self, why: str) -> None:
        """The membranes hold the tool no more: the arm holds, and the tool stands in its holder again."""
        text = f"the tool has left the grasp: {why}; call sim/grasp again"
        self._latch.refused(text)
        self.counters.add("tools_lost", text)
        self.holder.release()
        self._outputs.regrasped()

    def _measure(self) -> None:
        if self.time.measure(time.monotonic()):
            self._outputs.publish_factor(self.time.factor)
            if self.time.factor < SLOW:
                self.counters.add("slow", f"real-time factor {self.time.factor:.3f} is below {SLOW}")

    # in
    def _on_target(self, message: PoseStamped, information: dict[str, Any]) -> None:
        if (several := self._senders.conflict(information)) and not self._latch.reason:
            self._latch.hold(several)
        try:
            X_WE = self._checked(message)
        except SeedError as error:
            self._latch.refused(str(error))
            self.counters.add("targets_refused", f"{error}; the arm holds")
            return
        # a target that is old alone is left out without a hold: a busy computer delays some
        age = (self.time.stamp if self.settings.clock else self.now()) - seconds(message.header.stamp)
        if too_old := stale(age, self.settings.target_timeout):
            self.counters.add("targets_refused", f"{too_old}; the arm holds")
        elif self._latch.reason:
            self.counters.add("targets_refused", f"target_frame is not followed: {self._latch.reason}{REMEDY}")
        else:
            self._latch.heard(self.time.stamp)
            self.time.streams["target_frame"].hear(seconds(message.header.stamp))
            self.plant.command(X_WE)

    def _checked(self, message: PoseStamped) -> Array:
        check_frame(message.header.frame_id, (self.frames.base,), "target_frame")
        X_WE = pose_to_matrix(message.pose, "target_frame")
        places = as_vector3(X_WE[:3, 3]), as_vector3(self.plant.X_WE[:3, 3])
        if why := jump(*places, self.settings.max_step, "is {} from the flange"):
            raise MessageError(why)
        return X_WE

    # services
    def _resume(self) -> str:
        self._latch.resume()
        return "following target_frame, from the first that comes: enable the controller"

    def _grasp(self) -> str:
        if self.holder.grasped:
            raise PlantError("the tool is in the grasp already: release it first (sim/release; on the page: Release)")
        self.holder.grasp()
        wrong = f"; {self._told_wrong}" if self._told_wrong else ""
        return f"grasped the {self.scenario.tool.name}; its holder lets go when the arm moves{wrong}"

    def _release(self) -> str:
        self.holder.release()
        self._outputs.regrasped()
        return "released; the tool stands in its holder"

    def _reset(self) -> str:
        if self._robot is not None:
            raise PlantError("the arm is the UR controller's: move it with target_frame")
        now = self.now()  # everybody's time goes on, though the plant's begins anew
        self.plant.reset(self._X_WE_start)
        self.holder.release()
        self._latch.hold(PUT)
        self.fingers.restart()
        self._outputs.restart()
        self.time.restart(time.monotonic(), now)
        return f"arm at its start, tool in its holder, gripper open{REMEDY} to have the arm follow again"

    def _set_width(
        self, request: SetGripperWidth.Request, response: SetGripperWidth.Response
    ) -> SetGripperWidth.Response:
        try:
            response.success, response.message = True, self._close_to(request.width)
        except PlantError as error:
            response.success, response.message = False, str(error)
        response.width, response.pressure = float(self.plant.grip.width), float(self.plant.grip.pressure)
        return response

    def _close_to(self, width: float) -> str:
        if not np.isfinite(width) or width < 0.0:
            raise PlantError(f"gripper width = {width} m must be finite and not negative")
        self.plant.set_gripper_width(width)
        self.fingers.restart()
        return f"fingers {1e3 * width:.1f} mm apart"

    def _save_replay(self) -> str:
        if self._film is None:
            raise PlantError("nothing was recorded: start with the parameter replay:=FILE")
        file = Path(self.settings.replay)
        write_text(file, replay_of(self.plant, self._film, self.settings.model))
        self._saved = self.plant.time
        return str(file)

    def destroy_node(self) -> None:
        """Write what was recorded since it was saved last."""
        if self._film is not None and abs(self.plant.time - self._saved) > UNSAVED:
            print(f"writing the replay to {self.settings.replay}; Ctrl-C again ends without it", flush=True)
            with self.counters.refusing("replay_not_saved"):
                self._save_replay()
        super().destroy_node()

    def _report(self) -> diagnostics.Report:
        values = {
            "scenario": self.scenario.name,
            "real_time_factor": round(self.time.factor, 4),
            "lost_seconds": round(self.time.lost, 3),
            "grasped": self.holder.grasped,
            **self.counters.values(),
        }
        slow = f"slower than real time: {self.time.factor:.3f}" if self.time.factor < SLOW else ""
        holds = f"holds: {self._latch.reason}{REMEDY}" if self._latch.reason else ""
        if holds or slow or self._told_wrong:
            return diagnostics.WARN, "; ".join(filter(None, (holds, slow, self._told_wrong))), values
        if not self._latch.following:
            return diagnostics.OK, self.counters.last or "no target_frame yet: the arm holds", values
        return diagnostics.OK, "following target_frame", values


def _film(replay: str) -> Film:
    """Raises SeedError: the replay could not be written."""
    try:
        Path(replay).touch()
    except OSError as error:
        raise PlantError(f"replay = {replay}: cannot be written: {error.strerror}") from error
    return Film()


main = SimNode.main
