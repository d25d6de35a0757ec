# SPDX-License-Identifier: Apache-2.0
"""State of the stand-in controller: power, safety, program, registers, wrench. One `tick` is one 2 ms cycle."""

import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from seed_core.errors import SeedError
from seed_core.spatial import Wrench
from seed_ur import rtde
from seed_ur.kinematics import KinematicsError, URKinematics
from seed_ur.pose import checked_pose, matrix_from_pose
from seed_ur.standin.arm import BRAKE, PROGRAM_END_BRAKE, Arm
from seed_ur.standin.options import (
    IDLE,
    NORMAL,
    PAUSED,
    PERIOD,
    PLAYING,
    POWER_OFF,
    PROTECTIVE,
    ROBOT_EMERGENCY,
    RUNNING,
    SAFETY_FAULT,
    STOPPED,
    Faults,
    Options,
    ProgramError,
)
from seed_ur.standin.recorder import Recorder

_SAFETY_BITS = {NORMAL: 0x001, PROTECTIVE: 0x004, ROBOT_EMERGENCY: 0x0C0, SAFETY_FAULT: 0x200}
_SET_VOLTAGE = re.compile(r"set_tool_voltage\((0|12|24)\)")
UPTIME = 600.0  # [s] what a controller's clock shows when we meet it: it has been on for a while
TOOL_BIT = 16  # of the tool's digital outputs in actual_digital_output_bits


class Program(Protocol):
    """What runs on the controller; see script.py."""

    name: str
    offset: int  # of its registers

    @property
    def watchdog(self) -> float | None:
        """Longest time between updates of the command register [s]; None: any."""

    def step(self) -> bool:
        """One cycle; False when it has ended. Raises ProgramError and KinematicsError when it fails."""


class Controller:
    """The robot behind the ports. Time is passed in, in seconds, but for `robot_time`."""

    def __init__(self, options: Options) -> None:
        self.options, self.faults, self.recorder = options, Faults(), Recorder()
        self.arm = Arm(URKinematics.for_model(options.model), options.home)
        self.in_int, self.in_double = [0] * 48, [0.0] * 48
        self.values: dict[str, rtde.Value] = _initial_values()
        self.robot_mode, self.safety_mode, self.runtime_state = RUNNING, NORMAL, STOPPED
        self.program: Program | None = None
        self.pending: tuple[float, Program] | None = None  # starts at this time
        self.payload, self.payload_cog, self.payload_inertia = 0.0, [0.0] * 3, [0.0] * 6
        self.freedrive = self.force_mode = False
        self.wrench_E: tuple[float, ...] = (0.0,) * 6  # environment on flange, (force, torque) in E
        self.zero_W: tuple[float, ...] = (0.0,) * 6  # what zero_ftsensor subtracts
        self.now = self.stopped_at = self.register_written_at = self.watchdog_armed_at = 0.0
        self.boot: float | None = None  # [s] when the clock showed 0; None: UPTIME before the first cycle
        self.uploads = 0  # programs that were taken
        self.held_back = 0.0  # [s] that a plant has kept the robot's clock behind the wall's
        self.owners: dict[str, object] = {}  # the connection that may write an input
        self._offset = 0
        self.send_text: Callable[[str], None] = lambda _: None
        self._goal: tuple[tuple[object, ...], list[float]] = ((), [])  # the pose that was asked for last, in joints

    @property
    def robot_time(self) -> float:
        """The robot's time at this moment [s]: monotonic, less what a plant has held it back."""
        return time.monotonic() - self.held_back

    @property
    def clock(self) -> float:
        """What the controller's clock shows [s]."""
        return self.now - (self.now if self.boot is None else self.boot)

    @property
    def offset(self) -> int:
        """Of the registers that the program uses, or the last one did."""
        if self.program is not None:
            self._offset = self.program.offset
        return self._offset

    @property
    def outputs(self) -> Mapping[str, rtde.Value]:
        """The outputs as they are sent, corrupted ones included."""
        corrupt = self.faults.corrupt.items()
        return {**self.values, **{n: _with(self.values[n], *what) for n, what in corrupt}} if corrupt else self.values

    def set_output_int(self, index: int, value: int) -> None:
        """Write output_int_register_<index>; the ready and done marks are lost while they are stuck."""
        stuck = self.faults.stuck_ready and index == self.offset
        self.values[f"output_int_register_{index}"] = 0 if stuck else value

    def set_output_double(self, index: int, value: float) -> None:
        """Write output_double_register_<index>."""
        self.values[f"output_double_register_{index}"] = value

    def write_inputs(self, values: dict[str, rtde.Value], now: float) -> None:
        """What an RTDE client sends."""
        for name, value in values.items():
            number = name.rpartition("_")[2]
            if name in self.values:
                self.values[name] = value
            if name.startswith("input_int_register_"):
                self.in_int[int(number)] = int(value)  # type: ignore[arg-type]
            elif name.startswith("input_double_register_"):
                self.in_double[int(number)] = float(value)  # type: ignore[arg-type]
        if "speed_slider_fraction" in values and values.get("speed_slider_mask"):
            self.arm.slider = max(0.0, min(1.0, float(values["speed_slider_fraction"])))  # type: ignore[arg-type]
        if mask := int(values.get("tool_digital_output_mask", 0)):  # type: ignore[arg-type]
            bits, on = int(self.values["actual_digital_output_bits"]), int(values["tool_digital_output"])  # type: ignore[arg-type]
            self.values["actual_digital_output_bits"] = bits & ~(mask << TOOL_BIT) | (on & mask) << TOOL_BIT
        first = self.offset
        if f"input_int_register_{first}" in values:
            self.register_written_at = now
            self.recorder.command(self.in_int[first], now, self.in_double[first : first + 6])

    def upload(self, program: Program, now: float) -> str:
        """Take a new program; returns why not, or nothing."""
        if not self.options.remote_control:
            return "the robot is in local control"
        if self.robot_mode != RUNNING or self.safety_mode != NORMAL or self.faults.refuse_script:
            return "the robot is not ready to run programs"
        if self.program is not None:
            self.stop_program()
        self.pending = (now + 0.05, program)
        self.uploads += 1
        return ""

    def run_beside(self, text: str) -> None:
        """A secondary program (sec): of these, what sets the tool's voltage."""
        if self.options.remote_control and (match := _SET_VOLTAGE.search(text)):
            self.values["tool_output_voltage"] = int(match.group(1))

    def play(self, program: Program) -> None:
        """Start a program on the pendant, in place of what plays."""
        self.stop_program()
        self.program, self.runtime_state, self.register_written_at = program, PLAYING, self.now

    def set_clock_back(self, seconds: float) -> None:
        """As somebody does who sets the controller's clock."""
        if self.boot is not None:
            self.boot += seconds

    def stop_program(self) -> None:
        """End the program, or the one that is about to start; the arm slows down."""
        self.pending = None
        self.program, self.freedrive, self.force_mode = None, False, False
        self.runtime_state = STOPPED
        self.arm.stop(PROGRAM_END_BRAKE)

    def resume(self) -> bool:
        """Play a paused program."""
        if self.runtime_state == PAUSED and self.safety_mode == NORMAL and self.robot_mode == RUNNING:
            self.runtime_state = PLAYING
            if self.options.watchdog_sleeps:
                self.register_written_at = self.now
            return True
        return False

    def protective_stop(self, mode: int = PROTECTIVE) -> None:
        """As after a collision."""
        if self.safety_mode == NORMAL:
            self.stopped_at = self.now
        self.safety_mode = max(self.safety_mode, mode)  # neither replaces a graver one
        self.arm.stop(BRAKE)
        self.pending = None
        if self.program is not None and self.options.program_on_stop != "playing":
            self.runtime_state = PAUSED
            if self.options.program_on_stop == "stopped":
                self.stop_program()

    def safety_fault(self) -> None:
        """The safety system has found something wrong with itself; power goes too."""
        self.protective_stop(SAFETY_FAULT)
        self.robot_mode = POWER_OFF

    def restart_safety(self) -> None:
        """As after such a fault; the arm is without power then."""
        if self.safety_mode == SAFETY_FAULT:
            self.safety_mode = NORMAL
        self.power(False)

    def emergency_stop(self) -> None:
        """The red button; power goes too."""
        self.protective_stop(ROBOT_EMERGENCY)
        self.robot_mode = POWER_OFF

    def release_emergency_stop(self) -> None:
        """The button is pulled out again: safe, but without power."""
        if self.safety_mode == ROBOT_EMERGENCY:
            self.safety_mode = NORMAL

    def unlock_protective_stop(self) -> bool:
        """False within the first seconds, as UR's dashboard does."""
        if self.faults.refuse_unlock or self.now - self.stopped_at < self.options.unlock_after:
            return False
        if self.safety_mode == PROTECTIVE:
            self.safety_mode = NORMAL
        return True

    def power(self, on: bool) -> None:
        """Power of the arm; the brakes are released separately. An arm that has it goes on as it is."""
        if not on:
            self.robot_mode = POWER_OFF
            self.stop_program()
        elif self.robot_mode == POWER_OFF and self.safety_mode not in (ROBOT_EMERGENCY, SAFETY_FAULT):
            self.robot_mode = IDLE

    def release_brakes(self) -> bool:
        """From powered or idle to running."""
        if self.safety_mode != NORMAL:
            return False
        self.robot_mode = RUNNING
        return True

    def place(self, pose: Sequence[float], near: Sequence[float]) -> None:
        """Put the resting flange at a pose vector; raises SeedError while a program runs or when out of reach."""
        if self.program is not None:
            raise SeedError("the arm cannot be placed while a program runs")
        q = self.arm.kinematics.inverse(matrix_from_pose(checked_pose(pose, "pose")), checked_pose(near, "near"))
        before, self.arm = self.arm, Arm(self.arm.kinematics, q.tolist())
        self.arm.set_tcp(before.tcp)
        self.arm.slider, self.arm.limiting = before.slider, before.limiting

    def servo_goal(self, pose: Sequence[float]) -> list[float]:
        """Joint goal of a servoL pose (kept while pose, TCP and arm stay the same)."""
        asked = (self.arm, self.arm.tcp_offset, *pose)
        if asked != self._goal[0]:
            self._goal = (asked, self.arm.follow(pose))
        return self._goal[1]

    def check_step(self, before: Sequence[float], after: Sequence[float]) -> None:
        """Protective stop when a servo target jumps."""
        if max(abs(a - b) for a, b in zip(before, after, strict=True)) > self.options.max_joint_step:
            self.protective_stop()
            raise ProgramError("protective stop: sudden change in target position")

    def tick(self, now: float) -> None:
        """One cycle: program, motion, watchdog, values."""
        self.now = now
        self.boot = now - UPTIME if self.boot is None else self.boot
        if self.pending is not None and now >= self.pending[0]:
            self.program, self.pending = self.pending[1], None
            self.runtime_state = PLAYING
            self.register_written_at = now
        playing = self.runtime_state == PLAYING and self.program is not None
        try:
            if playing and self.safety_mode == NORMAL:
                self._play(now)
            self.arm.step(PERIOD)
        except (ProgramError, KinematicsError) as error:
            self._fail(str(error))
        pose, speed = self.publish()
        self.recorder.state(now, pose, speed, self.arm.qd)

    def _play(self, now: float) -> None:
        program = self.program
        assert program is not None
        waiting = program.watchdog
        if waiting is not None and now - max(self.register_written_at, self.watchdog_armed_at) > waiting:
            raise ProgramError("RTDE input watchdog: no update of the command register")
        if not program.step():
            self.stop_program()
        if waiting is None:
            self.watchdog_armed_at = now

    def _fail(self, text: str) -> None:
        self.faults.messages.append(text)
        self.send_text(text)
        if self.program is not None and self.runtime_state == PLAYING:
            self.stop_program()
        elif self.safety_mode == NORMAL:
            self.arm.stop()

    def wrench_W(self) -> tuple[float, ...]:
        """(fx fy fz tx ty tz) of the environment on the tool as actual_TCP_force: in W, about the flange or the TCP."""
        R = self.arm.X_WE[:3, :3]
        to_tcp = R @ self.arm.tcp[:3, 3]
        total = Wrench(R @ self.wrench_E[3:], R @ self.wrench_E[:3])
        if self.faults.wall is not None:  # which the TCP itself meets
            height, stiffness = self.faults.wall
            push = np.array((0.0, 0.0, max(0.0, stiffness * (height - self.arm.tcp_pose()[2]))))
            total = total.plus(Wrench(np.zeros(3), push).about(-to_tcp))
        if not rtde.force_is_at_flange(self.options.version):
            total = total.about(to_tcp)
        return (*total.force.tolist(), *total.torque.tolist())

    def zero_ft(self) -> None:
        """zero_ftsensor()."""
        self.zero_W = self.wrench_W()

    def set_wrench(self, wrench_E: Sequence[float]) -> None:
        """Wrench of the environment on the flange, (fx fy fz tx ty tz) in E; refuses what is not finite."""
        self.wrench_E = checked_pose(wrench_E, "wrench")

    def publish(self) -> tuple[Sequence[float], Sequence[float]]:
        """Set the outputs to what is, and stop an arm that is too fast; pose and velocity of the TCP."""
        arm, values = self.arm, self.values
        pose, speed = arm.tcp_pose(), arm.tcp_velocity(arm.qd)
        if math.hypot(*speed[:3]) > self.options.max_tcp_speed and self.safety_mode == NORMAL:
            self.protective_stop()
        wrench = tuple(w - z for w, z in zip(self.wrench_W(), self.zero_W, strict=True))
        playing = self.runtime_state == PLAYING
        values.update(
            timestamp=self.clock,
            target_q=arm.target_q,
            target_qd=arm.target_qd,
            target_qdd=arm.target_qdd,
            actual_q=arm.q,
            actual_qd=arm.qd,
            actual_TCP_pose=pose,
            actual_TCP_speed=speed,
            actual_TCP_force=wrench,
            ft_raw_wrench=wrench,
            tcp_offset=arm.tcp_offset,
            target_TCP_pose=arm.target_tcp_pose(),
            target_TCP_speed=arm.tcp_velocity(arm.target_qd),
            speed_scaling=arm.limiting,
            target_speed_fraction=arm.slider,
            payload=self.payload,
            payload_cog=self.payload_cog,
            payload_inertia=self.payload_inertia,
            robot_mode=self.robot_mode,
            safety_mode=self.safety_mode,
            safety_status=self.safety_mode,
            runtime_state=self.runtime_state,
            robot_status_bits=(self.robot_mode >= IDLE) | (2 if playing else 0),
            safety_status_bits=_SAFETY_BITS[self.safety_mode],
        )
        return pose, speed


def _with(numbers: rtde.Value, index: int, value: float) -> rtde.Value:
    """The same with one number replaced."""
    return (*numbers[:index], value, *numbers[index + 1 :]) if isinstance(numbers, Sequence) else value


def _initial_values() -> dict[str, rtde.Value]:
    """A value of the right shape for every output."""
    values: dict[str, rtde.Value] = {}
    for name, kind in rtde.OUTPUTS.items():
        length = int(rtde.FORMATS[kind][:-1] or 1)
        zero: float | int = 0.0 if rtde.FORMATS[kind][-1] == "d" else 0
        values[name] = zero if length == 1 else (zero,) * length
    values["joint_mode"] = (253,) * 6  # running
    values["joint_temperatures"] = (28.0,) * 6
    values["actual_main_voltage"], values["actual_robot_voltage"] = 48.0, 48.0
    return values
