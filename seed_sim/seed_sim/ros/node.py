# SPDX-License-Identifier: Apache-2.0
"""The simulated cell as a ROS node: target_frame in; what an arm, a gripper and sensors publish, and the truth, out."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from seed_msgs.msg import RelativePose
from seed_msgs.srv import SetGripperWidth
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from seed_control.tasks import load_task
from seed_core.arm.hold import HoldLatch
from seed_core.arm.target_checks import jump, stale
from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.hand import weight_about_T
from seed_core.spatial import Array
from seed_core.vector3 import as_vector3
from seed_ros import diagnostics
from seed_ros.conversions import check_frame, pose_to_matrix, seconds
from seed_ros.diagnostics import Counters
from seed_ros.frames import FrameNames
from seed_ros.loop import FixedRateLoop
from seed_ros.node import run
from seed_ros.parameters import declare, refuse_unknown
from seed_ros.qos import COMMAND, LATCHED
from seed_sim.closed_loop.run import start_pose
from seed_sim.plant.arm import ELBOW_UP
from seed_sim.plant.plant import DT, Plant, PlantError, save_replay
from seed_sim.ros.late_stream import LONGEST, Awaited
from seed_sim.ros.outputs import Outputs
from seed_sim.scenario import load_scenario
from seed_ur.plant_link import ArmState, PlantLink

BEHIND = 0.02  # [s] of wall time that the plant catches up on; what is beyond is lost and lowers the real-time factor
ROBOT_BEHIND = 0.1  # [s] the same, of the time of a stand-in controller
AHEAD = 1.0  # [periods] that a stand-in controller may be ahead of the plant, which follows it
MOVED = 5e-4  # [m] from where the tool was grasped: then the holder lets it down
LETTING_DOWN = 0.4  # [s]
REMEDY = "; call ~/resend_robot_program"
PATIENCE = {"target_frame": 0.05, "relative_pose": 0.13}  # [s] age, from which the plant waits for the next
ROBOT_PATIENCE = {"target_frame": 0.012, "current_pose": 0.012, "relative_pose": 0.1}  # [s] with a robot's own lag
LONG = {"relative_pose": 15.0}  # [s] of waiting; a disk may hold an estimator up, and poses end only with it
SLOW = 0.98  # real-time factor from which it warns


@dataclass(frozen=True)
class SimSettings:
    """Parameters of the simulated cell."""

    scenario: str = field("nominal", doc="name or file of the scenario")
    seed: int = field(0, low=0, high=2**31 - 1, doc="of the table and of all noise")
    task: str = field("squeegee", doc="name or file of the task whose work frame the table lies in")
    rate: float = field(250.0, unit="Hz", low=20.0, high=1000.0, doc="of current_pose")
    target_timeout: float = field(0.1, unit="s", low=0.01, high=2.0, doc="largest age of a target, and largest silence")
    max_step: float = field(0.05, unit="m", low=1e-4, high=1.0, doc="a target further from the flange is a jump")
    clock: bool = field(False, doc="publish the plant's time on /clock, and stand still for late estimates and targets")
    relative_pose: bool = field(False, doc="publish relative_pose from the truth, in place of cameras and estimator")
    robot_ip: str = field(
        "", doc="stand-in UR controller whose arm carries the gripper; empty: an arm of the cell's own"
    )
    replay: str = field("", doc="file for ~/save_replay; empty: nothing is recorded for a replay")


class SimNode(Node):
    """See docs/interfaces.md. A holder carries the tool until the arm moves after a grasp."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("sim", **arguments)
        self.settings = declare(self, SimSettings())
        self.frames = declare(self, FrameNames(), "frames")
        refuse_unknown(self)
        self.counters = Counters(self)
        self.scenario = load_scenario(self.settings.scenario)
        self._meshcat = _meshcat() if self.settings.replay else None
        task = load_task(self.settings.task)
        self._X_WE_start = start_pose(self.scenario, task)
        self.plant = Plant(self.scenario, self.settings.seed, task.frame.pose, self._X_WE_start, meshcat=self._meshcat)
        self.grasped = False
        self.in_holder = True
        self._held_at = self._X_WE_start
        self._let_down = 0.0  # share of its weight that the holder has given to the grasp
        self._latch, self._said = HoldLatch(self.settings.target_timeout), ""
        self.real_time_factor = 1.0
        self._link = self._join_robot()
        own_arm = self._link is None
        self._outputs = Outputs(
            self, self.plant, self.frames, self.settings.relative_pose, own_arm, self.settings.clock
        )
        self.loop = FixedRateLoop(self, self.settings.rate, self._tick)
        if own_arm:
            self.loop.poll(PoseStamped, "target_frame", self._on_target, COMMAND)
            self._hold_reason = self.create_publisher(String, "~/hold_reason", LATCHED)
            self.create_service(Trigger, "~/resend_robot_program", self._resume)
        elif self.settings.clock:
            self._await(PoseStamped, "target_frame")
            self._await(PoseStamped, "current_pose")
        if self.settings.clock:
            self._await(RelativePose, "relative_pose")
        self.create_subscription(Float64, "gripper/command", self._on_width, COMMAND)
        self.create_service(Trigger, "~/grasp", self._grasp)
        self.create_service(Trigger, "~/release", self._release)
        self.create_service(Trigger, "~/reset", self._reset)
        self.create_service(Trigger, "~/save_replay", self._save_replay)
        self.create_service(SetGripperWidth, "~/set_gripper_width", self._set_width)
        self._diagnostics = diagnostics.Diagnostics(self, f"scenario {self.scenario.name}", self._report)
        if self._meshcat is not None:
            self._meshcat.StartRecording(frames_per_second=10.0, set_visualizations_while_recording=False)
        self._start_clock()
        self.create_timer(1.0, self._rate_it, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _join_robot(self) -> PlantLink | None:
        """The stand-in controller whose arm carries the gripper, placed at the start; None for an arm of our own."""
        if not self.settings.robot_ip:
            return None
        link = PlantLink(self.settings.robot_ip)
        link.place(self._X_WE_start, ELBOW_UP, self._ros_now() if self.settings.clock else None)
        return link

    def _await(self, kind: Any, topic: str) -> None:
        """Have the plant's time stand still when this stream is late."""
        self.loop.poll(kind, topic, lambda m: self._awaited[topic].hear(seconds(m.header.stamp)), COMMAND)

    # time
    def _start_clock(self) -> None:
        """Tie the plant's time to the wall's, both steady and ROS's, from now on; or to a robot's clock."""
        self._steady_offset = time.monotonic() - self.plant.time
        self._ros_offset = self._ros_now() - self.plant.time
        self._robot_offset: float | None = None
        if self._link is not None and self._link.clock is not None:
            self._robot_offset = self._ros_offset = self._link.clock - self.plant.time
        self._lost = 0.0
        self._rated = (time.monotonic(), self.plant.time)
        patience = PATIENCE if self._link is None else ROBOT_PATIENCE
        self._awaited = {topic: Awaited(age, LONG.get(topic, LONGEST)) for topic, age in patience.items()}

    def _ros_now(self) -> float:
        return self.get_clock().now().nanoseconds * 1e-9

    @property
    def stamp(self) -> float:
        """ROS time of the plant's present state [s]."""
        return self._ros_offset + self.plant.time

    def _tick(self) -> None:
        before = self.plant.time
        if self._link is None:
            self._follow_clock()
        else:
            self._follow_robot(self._link)
        if self.in_holder:
            self._hold_tool(self.plant.time - before)
        self._outputs.publish(self.stamp, self.grasped)
        self._latch.check(self.stamp)
        self._say_why_it_holds()

    def _say_why_it_holds(self) -> None:
        if self._latch.reason != self._said:
            self._said = self._latch.reason
            self._hold_reason.publish(String(data=self._said))

    def _waits(self) -> bool:
        """Whether the plant stands still for a process that this machine is too busy to run in time."""
        steady = time.monotonic()
        late = {topic for topic, stream in self._awaited.items() if stream.late(self.stamp, steady)}
        if not self._awaited["target_frame"].runs:
            late.discard("current_pose")  # nobody steers by it, and a driver that starts its program says nothing
        return self.settings.clock and bool(late)

    def _lose(self, lost: float) -> None:
        """Wall time [s] in which the plant did not move; its own clock knows nothing of it."""
        self._steady_offset += lost
        self._lost += lost
        if not self.settings.clock:
            self._ros_offset += lost

    def _follow_clock(self) -> None:
        """An arm of our own, by the wall's time less what the plant has lost."""
        behind = time.monotonic() - self._steady_offset - self.plant.time
        advance = 0.0 if self._waits() else min(behind, BEHIND)
        self._lose(behind - advance)
        t = self.plant.time + advance
        if not self.in_holder:
            self.plant.advance(t)
            return
        while self.plant.time < t - DT:
            self.plant.advance(self.plant.time + DT)
            self.plant.grasp(self._let_down * self._sag())

    def _follow_robot(self, link: PlantLink) -> None:
        """The flange goes where the stand-in's arm is, in its time; the arm feels what the tool does to it."""
        state = link.receive()
        if state is not None:
            self._drive(state)
        load = self.plant.ft_wrench
        link.report(load.force, load.torque, self._lets_robot_run())

    def _drive(self, state: ArmState) -> None:
        if self._robot_offset is None:
            self._robot_offset = state.time - self.plant.time
        behind = state.time - self._robot_offset - self.plant.time
        if behind > ROBOT_BEHIND and not self.settings.clock:
            self._robot_offset += behind - ROBOT_BEHIND
            self._lose(behind - ROBOT_BEHIND)
            behind = ROBOT_BEHIND
        if behind > 0.5 * DT:
            self.plant.drive(state.X_WE, self.plant.time + behind)
        if self.in_holder:
            self.plant.grasp(self._let_down * self._sag())

    def _lets_robot_run(self) -> float | None:
        """How far a stand-in may run by its own clock, which then is the plant's [s]; None: as it likes."""
        if not self.settings.clock:
            return None
        return self.stamp + (0.0 if self._waits() else AHEAD / self.settings.rate)

    def _hold_tool(self, dt: float) -> None:
        """The holder carries the tool, and lets it down gently once the arm moves; dt: [s] since the last look."""
        moved = float(np.abs(self.plant.X_WE[:3, 3] - self._held_at[:3, 3]).max())
        if self.grasped and (moved > MOVED or self._let_down > 0.0):
            self._let_down += dt / LETTING_DOWN
            self.in_holder = self._let_down < 1.0

    def _sag(self) -> Array:
        """Where the tool hangs in the grasp: p_CT (3,) [m]."""
        mass = self.scenario.true_mass if self.scenario.true_mass is not None else self.scenario.tool.mass
        weight = weight_about_T(mass, self.scenario.tool.center_of_mass, self.plant.X_WC[:3, :3])
        return np.asarray(weight.force / np.array(self.plant.stiffness.translation))

    def _rate_it(self) -> None:
        now, then = (time.monotonic(), self.plant.time), self._rated
        self._rated = now
        if now[0] > then[0] and now[1] >= then[1]:
            self.real_time_factor = (now[1] - then[1]) / (now[0] - then[0])
            self._outputs.publish_slow(self.stamp, self.real_time_factor)
            if self.real_time_factor < SLOW:
                self.counters.add("slow", f"real-time factor {self.real_time_factor:.3f} is below {SLOW}")

    # in
    def _on_target(self, message: PoseStamped) -> None:
        try:
            X_WE, age = self._checked(message), self._age(message)
        except SeedError as error:
            self._latch.refused(str(error))
            self.counters.add("targets_refused", f"{error}; the arm holds")
            return
        if age or self._latch.reason:
            self.counters.add("targets_refused", age or f"target_frame is not followed: {self._latch.reason}{REMEDY}")
            return
        self._latch.heard(self.stamp)
        self._awaited["target_frame"].hear(seconds(message.header.stamp))
        self.plant.command(X_WE)

    def _age(self, message: PoseStamped) -> str:
        """What is wrong with a target's stamp. It is left out without a hold: a busy computer delays some."""
        now = self.stamp if self.settings.clock else self._ros_now()
        age = now - seconds(message.header.stamp)
        why = stale(age, self.settings.target_timeout)
        return f"{why}; the arm holds" if why else ""

    def _checked(self, message: PoseStamped) -> Array:
        check_frame(message.header.frame_id, (self.frames.base,), "target_frame")
        X_WE = pose_to_matrix(message.pose, "target_frame")
        places = as_vector3(X_WE[:3, 3]), as_vector3(self.plant.X_WE[:3, 3])
        if why := jump(*places, self.settings.max_step, "is {} from the flange"):
            raise SeedError(why)
        return X_WE

    def _resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._latch.resume()
        response.success, response.message = True, "following target_frame"
        return response

    # gripper
    def _grasp(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.grasped:
            response.success, response.message = False, "the tool is in the grasp already: call ~/release first"
            return response
        self.plant.grasp()
        self.grasped, self.in_holder, self._held_at = True, True, self.plant.X_WE.copy()
        self._let_down = 0.0
        response.success = True
        response.message = f"grasped the {self.scenario.tool_kind}; its holder lets go when the arm moves"
        return response

    def _release(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.plant.grasp()
        self.grasped, self.in_holder, self._let_down = False, True, 0.0
        self._outputs.regrasped()
        response.success, response.message = True, "released; the tool stands in its holder"
        return response

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._link is not None:
            response.success, response.message = False, "the arm is the UR controller's: move it with target_frame"
            return response
        self.plant.reset(self._X_WE_start)
        self.grasped, self.in_holder, self._held_at = False, True, self._X_WE_start
        self._let_down = 0.0
        self._latch.resume()
        self._outputs.restart()
        self._start_clock()
        response.success, response.message = True, "arm at its start, tool in its holder, gripper open"
        return response

    def _set_width(
        self, request: SetGripperWidth.Request, response: SetGripperWidth.Response
    ) -> SetGripperWidth.Response:
        response.success, response.message = self._close_to(request.width)
        response.width, response.pressure = float(self.plant.width), float(self.plant.pressure)
        return response

    def _on_width(self, message: Float64) -> None:
        done, words = self._close_to(message.data)
        if not done:
            self.counters.add("widths_refused", words)

    def _close_to(self, width: float) -> tuple[bool, str]:
        if not np.isfinite(width) or width < 0.0:
            return False, f"gripper width = {width} m must be finite and not negative"
        try:
            self.plant.set_gripper_width(width)
        except PlantError as error:
            return False, str(error)
        return True, f"fingers {1e3 * width:.1f} mm apart"

    def _save_replay(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._meshcat is None:
            response.success, response.message = False, "nothing was recorded: start with the parameter replay:=FILE"
            return response
        self._meshcat.StopRecording()
        self._meshcat.PublishRecording()
        file = Path(self.settings.replay)
        save_replay(self._meshcat, file)
        response.success, response.message = True, str(file)
        return response

    def _report(self) -> diagnostics.Report:
        values = {
            "scenario": self.scenario.name,
            "real_time_factor": round(self.real_time_factor, 4),
            "lost_seconds": round(self._lost, 3),
            "grasped": self.grasped,
            **self.counters.values(),
        }
        if self.real_time_factor < SLOW:
            return diagnostics.WARN, f"slower than real time: {self.real_time_factor:.3f}", values
        if self._latch.reason:
            return diagnostics.WARN, f"holds: {self._latch.reason}{REMEDY}", values
        if not self._latch.following:
            return diagnostics.OK, self.counters.last or "no target_frame yet: the arm holds", values
        return diagnostics.OK, "following target_frame", values


def _meshcat() -> Any:
    from pydrake.geometry import Meshcat, MeshcatParams

    return Meshcat(MeshcatParams(host="localhost"))


def main() -> None:
    """Run the node until it is interrupted."""
    sys.exit(run(SimNode))


if __name__ == "__main__":
    main()
