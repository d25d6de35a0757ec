# SPDX-License-Identifier: Apache-2.0
"""The commands of ur_rtde's control script: number, where its arguments are, what it does to the arm.

Doubles d0.. are input_double_registers, integers i1.. input_int_registers, both from the program's offset on.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple, TypeAlias

from seed_ur.kinematics import KinematicsError
from seed_ur.pose import matrix_from_pose, pose_from_matrix
from seed_ur.standin.arm import Hold, Motion, Move, Servo, Speed
from seed_ur.standin.controller import Controller
from seed_ur.standin.options import PERIOD, ProgramError

Job: TypeAlias = Callable[[], bool]  # called every cycle until it returns True
# What a command gives: a job to wait for, numbers for the output double registers, a bool for output_int_register_1.
Answer: TypeAlias = Job | Sequence[float] | bool | None
CARTESIAN = ("movel", "movel_fk")  # moves along a straight line in space
LARGEST = 1e4  # of any argument; ur_rtde sends poses as they are given, NaN too
JOG_BRAKE = 3.6  # [rad/s^2] deceleration of the end of jogging, stopl(1.2) there
ANOTHER_THREAD = "Another thread is already controlling the robot"


class PathMove(NamedTuple):
    """One line of a path."""

    kind: str
    target: list[float]
    acceleration: float
    speed: float


class StepCheck(NamedTuple):
    """How far, in any joint, a servo target may be from where the arm is on its way [rad]."""

    moving: float
    at_rest: float


class Commands:
    """The commands of one running script."""

    def __init__(
        self, robot: Controller, offset: int, path: Sequence[PathMove], check: StepCheck | None = None
    ) -> None:
        """check: of servo targets, which ur_rtde's own script does not make."""
        self.robot, self.offset, self.path, self.check = robot, offset, path, check
        self.thread: Servo | None = None  # goes on towards its target whenever the program does, until servoStop
        self.watchdog: float | None = None  # [s] longest time between updates of the command register
        self._background: Job | None = None  # an asynchronous move
        self._operation = 0  # counts asynchronous moves
        self._cycles = 0

    def process(self, number: int) -> Job | None:
        """Begin a command; the job to wait for, if there is one. Raises ProgramError and KinematicsError."""
        if number not in COMMANDS:
            raise ProgramError(f"command {number} is not emulated")
        answer = COMMANDS[number](self)
        if callable(answer):
            return answer
        if isinstance(answer, bool):
            self.robot.set_output_int(self.offset + 1, int(answer))
        elif answer is not None:
            for i, value in enumerate(answer):
                self.robot.set_output_double(self.offset + i, float(value))
        return None

    def advance(self) -> None:
        """One cycle of what goes on in the background."""
        self._cycles += 1
        if self.thread is not None:
            self._servo_on(self.thread)
        if self._background is not None and self._background():
            self._end_background()

    def _end_background(self) -> None:
        """An asynchronous move has ended, or gives way to another command."""
        if self._background is not None:
            self._background = None
            self._report_operation(running=False)

    def _take(self, motion: Motion) -> None:
        """The arm does this from now on, and no move of the background any more."""
        self._end_background()
        self.robot.arm.motion = motion

    def _report_operation(self, running: bool) -> None:
        """Progress word of asynchronous moves: bit 15 running, bits 24 to 30 the operation's number."""
        writes = (self._cycles & 0x7F) << 16
        word = (self._operation & 0x7F) << 24 | writes | (0x8000 if running else 0)
        self.robot.set_output_int(self.offset + 2, word)

    def doubles(self, first: int, count: int) -> list[float]:
        """Arguments d<first>.. of the command; raises ProgramError where one cannot be."""
        first += self.offset
        numbers = self.robot.in_double[first : first + count]
        if not all(abs(number) <= LARGEST for number in numbers):
            raise ProgramError(f"the arguments {numbers} of a command must be finite and within +-{LARGEST:g}")
        return numbers

    def move(self, kind: str) -> Job | None:
        """moveJ, moveJ_IK, moveL, moveL_FK: d0-d5 target, d6 speed, d7 acceleration, i1 in the background."""
        target, (speed, acceleration) = self.doubles(0, 6), self.doubles(6, 2)
        goal = self._goal(kind, target)
        return self._play([lambda: Move(self.robot.arm, goal, speed, acceleration, kind in CARTESIAN)])

    def move_path(self) -> Job | None:
        """movePath: the moves that stand in the script itself."""

        def start(m: PathMove) -> Move:
            goal = self._goal(m.kind, m.target)
            return Move(self.robot.arm, goal, m.speed, m.acceleration, m.kind in CARTESIAN)

        return self._play([partial(start, m) for m in self.path])

    def _goal(self, kind: str, target: list[float]) -> list[float]:
        arm = self.robot.arm
        if kind == "movej_ik":
            return arm.inverse(target, arm.target_q)
        if kind == "movel_fk":
            return list(pose_from_matrix(arm.kinematics.forward(target) @ arm.tcp))
        if kind == "movel":
            arm.inverse(target, arm.target_q)  # refuse the unreachable before moving
        return target

    def _play(self, moves: list[Callable[[], Move]]) -> Job | None:
        """Play moves one after the other, as a blocking job or (i1) in the background."""
        robot = self.robot
        if isinstance(robot.arm.motion, Servo | Speed) or robot.freedrive or robot.force_mode:
            raise ProgramError(ANOTHER_THREAD)
        self._end_background()
        if isinstance(robot.arm.motion, Move):  # which is left where it has got to
            robot.arm.motion = Hold()

        current: Move | None = None

        def job() -> bool:
            nonlocal current
            if not robot.arm.motion.done:
                return False
            if current is not None and current.done:  # else it was interrupted, and goes on from here
                moves.pop(0)
            if not moves:
                robot.arm.motion = Hold(1e3)
                return True
            robot.arm.motion = current = moves[0]()
            return False

        if not robot.in_int[self.offset + 1]:
            return job
        self._operation += 1
        self._background = job
        self._report_operation(running=True)
        return None

    def servo(self, cartesian: bool) -> None:
        """servoJ, servoL: d0-d5 target, d9 lookahead, d10 gain."""
        robot, target = self.robot, self.doubles(0, 6)
        goal = robot.servo_goal(target) if cartesian else target
        if not self._near(goal):
            return
        if self.thread is not None:
            robot.check_step(self.thread.goal, goal)
            self.thread.take(goal, *self.doubles(9, 2))
        else:
            robot.check_step(robot.arm.target_q, goal)
            self.thread = Servo(goal, *self.doubles(9, 2))
            self._take(self.thread)

    def _servo_on(self, servo: Servo) -> None:
        """The servo thread's next servoj: also after a stop, when the program goes on."""
        arm = self.robot.arm
        if arm.motion is not servo:
            self.thread = arm.motion = Servo(servo.goal, 0.03, 300.0)
            self.thread.rate = servo.rate
        if not self._near(servo.goal):
            arm.motion = Servo(arm.target_q, 0.03, 2000.0)

    def _near(self, goal: Sequence[float]) -> bool:
        """Whether a servo target passes the program's check."""
        if self.check is None:
            return True
        arm = self.robot.arm
        most = self.check.moving if any(arm.target_qd) else self.check.at_rest
        return all(abs(a - b) <= most for a, b in zip(goal, arm.target_q, strict=True))

    def servo_circular(self) -> None:
        """servoC: d0-d5 target."""
        self._take(Servo(self.robot.servo_goal(self.doubles(0, 6)), 0.1, 300.0))

    def speed(self, cartesian: bool) -> None:
        """speedJ, speedL: d0-d5 speed, d6 acceleration, d7 duration (0: until it is stopped)."""
        speed, (acceleration, duration) = self.doubles(0, 6), self.doubles(6, 2)
        motion = self.robot.arm.motion
        if not isinstance(motion, Speed) or motion.speed != speed or duration:
            self._take(Speed(speed, acceleration, duration, cartesian))

    def jog(self) -> None:
        """jogStart: d0-d5 speed, d6 in axes of base (0), TCP (1) or a frame (2), d7 acceleration, d8-d13 that frame."""
        arm, (feature, acceleration) = self.robot.arm, self.doubles(6, 2)
        frame = arm.tcp_pose() if feature == 1.0 else self.doubles(8, 6) if feature == 2.0 else (0.0,) * 6
        R = matrix_from_pose(frame)[:3, :3]
        speed = [*(R @ self.doubles(0, 3)).tolist(), *(R @ self.doubles(3, 3)).tolist()]
        self._take(Speed(speed, acceleration, 0.0, True))

    def jog_stop(self) -> Job:
        """jogStop, which has no arguments; wait until the arm stands."""
        return self._stop(JOG_BRAKE)

    def stop(self) -> Job:
        """servoStop, speedStop, stopL, stopJ: d0 deceleration; wait until the arm stands."""
        return self._stop(self.doubles(0, 1)[0] or 10.0)

    def _stop(self, deceleration: float) -> Job:
        robot = self.robot
        robot.freedrive = robot.force_mode = False
        self.thread = None
        self._take(Hold(deceleration))
        return lambda: robot.arm.motion.done

    def force_mode(self, on: bool) -> None:
        """forceMode, forceModeStop; without its forces."""
        self.robot.force_mode = on
        if not on:
            self._take(Hold())

    def freedrive(self, on: bool) -> None:
        """freedriveMode, endFreedriveMode, teachMode, endTeachMode."""
        self.robot.freedrive = on
        self._take(Hold())

    def set_payload(self) -> None:
        """setPayload: d0 mass, d1-d3 centre of mass; from PolyScope 5 on ur_rtde's own script keeps it for zero.

        So does its setTargetPayload.
        """
        self.robot.payload, *cog = self.doubles(0, 4)
        if any(cog) or self.check or self.robot.options.version[0] == 3:
            self.robot.payload_cog = cog

    def set_target_payload(self) -> None:
        """setTargetPayload: as setPayload, and d4-d9 inertia."""
        self.set_payload()
        self.robot.payload_inertia = self.doubles(4, 6)

    def set_tcp(self) -> None:
        """setTcp: d0-d5 pose vector in the flange frame."""
        self.robot.arm.set_tcp(matrix_from_pose(self.doubles(0, 6)))

    def set_watchdog(self) -> None:
        """setWatchdog: d0 least frequency."""
        self.watchdog = 1.0 / max(0.1, self.doubles(0, 1)[0])

    def inverse(self, near: bool) -> list[float]:
        """getInverseKinematics: d0-d5 pose of the TCP, d6-d11 joint angles near which to look."""
        arm = self.robot.arm
        return arm.inverse(self.doubles(0, 6), self.doubles(6, 6) if near else arm.target_q)

    def has_inverse(self, near: bool) -> bool:
        """getInverseKinematicsHasSolution, isPoseWithinSafetyLimits."""
        try:
            self.inverse(near)
        except KinematicsError:
            return False
        return True

    def forward(self) -> Sequence[float]:
        """getForwardKinematics: d0-d5 joint angles, d6-d11 TCP."""
        q, tcp = self.doubles(0, 6), self.doubles(6, 6)
        return pose_from_matrix(self.robot.arm.kinematics.forward(q) @ matrix_from_pose(tcp))

    def pose_trans(self) -> Sequence[float]:
        """poseTrans: d0-d5 and d6-d11 poses."""
        return pose_from_matrix(matrix_from_pose(self.doubles(0, 6)) @ matrix_from_pose(self.doubles(6, 6)))

    def joints_safe(self) -> bool:
        """isJointsWithinSafetyLimits: d0-d5 joint angles."""
        return all(abs(t) <= self.robot.arm.kinematics.model.range for t in self.doubles(0, 6))


COMMANDS: Mapping[int, Callable[[Commands], Answer]] = {
    1: lambda s: s.move("movej"),
    2: lambda s: s.move("movej_ik"),
    3: lambda s: s.move("movel"),
    4: lambda s: s.move("movel_fk"),
    6: lambda s: s.force_mode(True),
    7: lambda s: s.force_mode(False),
    8: lambda s: s.robot.zero_ft(),
    9: lambda s: s.speed(cartesian=False),
    10: lambda s: s.speed(cartesian=True),
    11: lambda s: s.servo(cartesian=False),
    12: Commands.servo_circular,
    **dict.fromkeys((15, 16, 33, 34), Commands.stop),
    17: Commands.set_payload,
    65: Commands.set_target_payload,
    **dict.fromkeys((18, 52), lambda s: s.freedrive(True)),
    **dict.fromkeys((19, 53), lambda s: s.freedrive(False)),
    **dict.fromkeys((20, 21, 56, 57, 59, 62, 63), lambda _: None),
    24: lambda s: s.servo(cartesian=True),
    **dict.fromkeys((25, 64), lambda _: False),
    26: lambda _: (PERIOD,),
    27: lambda s: s.robot.arm.q,
    28: lambda s: s.robot.arm.target_tcp_pose(),
    29: Commands.set_tcp,
    30: lambda s: s.inverse(near=True),
    31: lambda s: s.robot.protective_stop(),
    35: Commands.set_watchdog,
    **dict.fromkeys((36, 60), lambda s: s.has_inverse(near=False)),
    37: Commands.joints_safe,
    38: lambda _: (0.0,) * 6,
    39: Commands.pose_trans,
    40: lambda s: s.robot.arm.tcp_offset,
    41: Commands.jog,
    42: Commands.jog_stop,
    43: lambda s: s.robot.arm.tcp_pose(),
    44: Commands.forward,
    45: Commands.move_path,
    46: lambda s: s.inverse(near=False),
    47: lambda s: not any(s.robot.arm.target_qd),
    54: lambda s: s.robot.freedrive,
    58: lambda s: pose_from_matrix(s.robot.arm.X_WE),
    61: lambda s: s.has_inverse(near=True),
}
