# SPDX-License-Identifier: Apache-2.0
"""The commands of ur_rtde's control script: number, where its arguments are, what it does to the arm.

Doubles d0.. are input_double_registers, integers i1.. input_int_registers, both from the program's offset on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from seed_ur.kinematics import KinematicsError
from seed_ur.pose import matrix_from_pose, pose_from_matrix
from seed_ur.standin.arm import Hold, Move, Servo, Speed

if TYPE_CHECKING:
    from seed_ur.standin.controller import Controller
    from seed_ur.standin.program import Program

Job: TypeAlias = Callable[[], bool]  # called every cycle until it returns True
Action: TypeAlias = "Callable[[Controller, Program], Job | None]"
ANOTHER_THREAD = "Another thread is already controlling the robot"


class ProgramError(Exception):
    """A runtime error that ends the program."""


def _doubles(box: Controller, program: Program, first: int, count: int) -> list[float]:
    return [box.input_double(program.offset + first + i) for i in range(count)]


def _int(box: Controller, program: Program, index: int) -> int:
    return box.input_int(program.offset + index)


def _answer(box: Controller, program: Program, values: list[float]) -> None:
    for i, value in enumerate(values):
        box.set_output_double(program.offset + i, float(value))


def _free_arm(box: Controller) -> None:
    if isinstance(box.arm.motion, Servo | Speed) or box.freedrive or box.force_mode:
        raise ProgramError(ANOTHER_THREAD)


def _run(box: Controller, program: Program, moves: list[Callable[[], Move]], in_background: bool) -> Job | None:
    """Play moves one after the other, as a blocking job or in the background."""
    _free_arm(box)
    queue = list(moves)

    def job() -> bool:
        if not box.arm.motion.done and isinstance(box.arm.motion, Move):
            return False
        if not queue:
            box.arm.motion = Hold(1e3)
            return True
        box.arm.motion = queue.pop(0)()
        return False

    if not in_background:
        return job
    program.operation += 1
    program.background = job
    program.report_operation(box, running=True)
    return None


def _move(kind: str) -> Action:
    cartesian = kind in ("movel", "movel_fk")

    def action(box: Controller, program: Program) -> Job | None:
        target, (speed, acceleration) = _doubles(box, program, 0, 6), _doubles(box, program, 6, 2)
        goal = _goal(box, kind, target)
        make = [lambda: Move(box.arm, goal, speed, acceleration, cartesian)]
        return _run(box, program, make, bool(_int(box, program, 1)))

    return action


def _goal(box: Controller, kind: str, target: list[float]) -> list[float]:
    if kind == "movej_ik":
        return box.arm.inverse(target, box.arm.target_q)
    if kind == "movel_fk":
        return list(pose_from_matrix(box.arm.kinematics.forward(target) @ box.arm.tcp))
    if kind == "movel":
        box.arm.inverse(target, box.arm.target_q)  # refuse the unreachable before moving
    return target


def _path(box: Controller, program: Program) -> Job | None:
    moves: list[Callable[[], Move]] = []
    for kind, target, acceleration, speed in program.path:

        def make(k: str = kind, t: list[float] = target, a: float = acceleration, v: float = speed) -> Move:
            return Move(box.arm, _goal(box, k, t), v, a, k == "movel")

        moves.append(make)
    return _run(box, program, moves, bool(_int(box, program, 1)))


def _servo(cartesian: bool) -> Action:
    def action(box: Controller, program: Program) -> Job | None:
        target = _doubles(box, program, 0, 6)
        lookahead, gain = _doubles(box, program, 9, 2)
        goal = box.servo_goal(target) if cartesian else target
        if not np.isfinite(goal).all():
            raise ProgramError(f"servoj: target {goal} is not finite")
        if isinstance(box.arm.motion, Servo):
            motion = box.arm.motion
            box.check_step(motion.goal, goal)
            if motion.rate != (fresh := Servo(goal, lookahead, gain)).rate:
                box.arm.motion = fresh
            motion.goal = list(goal)
        else:
            box.check_step(box.arm.target_q, goal)
            box.arm.motion = Servo(goal, lookahead, gain)
        return None

    return action


def _servo_circular(box: Controller, program: Program) -> Job | None:
    box.arm.motion = Servo(box.servo_goal(_doubles(box, program, 0, 6)), 0.1, 300.0)
    return None


def _speed(cartesian: bool) -> Action:
    def action(box: Controller, program: Program) -> Job | None:
        speed, (acceleration, duration) = _doubles(box, program, 0, 6), _doubles(box, program, 6, 2)
        if isinstance(box.arm.motion, Speed) and box.arm.motion.speed == speed and not duration:
            return None
        box.arm.motion = Speed(speed, acceleration, duration, cartesian)
        return None

    return action


def _jog(box: Controller, program: Program) -> Job | None:
    box.arm.motion = Speed(_doubles(box, program, 0, 6), 0.5, 0.0, True)
    return None


def _stop(box: Controller, program: Program) -> Job | None:
    """servoStop, speedStop, stopL, stopJ, jogStop: wait until the arm stands."""
    program.background = None
    deceleration = box.input_double(program.offset) or 10.0
    box.freedrive = box.force_mode = False
    box.arm.motion = Hold(deceleration)
    return lambda: box.arm.motion.done


def _force_mode(on: bool) -> Action:
    def action(box: Controller, _: Program) -> Job | None:
        box.force_mode = on
        if not on:
            box.arm.motion = Hold()
        return None

    return action


def _freedrive(on: bool) -> Action:
    def action(box: Controller, _: Program) -> Job | None:
        box.freedrive = on
        box.arm.motion = Hold()
        return None

    return action


def _freedrive_status(box: Controller, program: Program) -> None:
    box.set_output_int(program.offset + 1, int(box.freedrive))


def _payload(box: Controller, program: Program) -> None:
    box.payload, *box.payload_cog = _doubles(box, program, 0, 4)


def _tcp(box: Controller, program: Program) -> None:
    box.arm.set_tcp(matrix_from_pose(_doubles(box, program, 0, 6)))


def _watchdog(box: Controller, program: Program) -> None:
    program.watchdog = 1.0 / max(0.1, box.input_double(program.offset))


def _ik(box: Controller, program: Program, near: bool) -> list[float]:
    start = _doubles(box, program, 6, 6) if near else box.arm.target_q
    return box.arm.inverse(_doubles(box, program, 0, 6), start)


def _has_ik(box: Controller, program: Program, near: bool) -> None:
    try:
        _ik(box, program, near)
    except KinematicsError:
        box.set_output_int(program.offset + 1, 0)
    else:
        box.set_output_int(program.offset + 1, 1)


def _fk(box: Controller, program: Program) -> None:
    q, tcp = _doubles(box, program, 0, 6), _doubles(box, program, 6, 6)
    _answer(box, program, list(pose_from_matrix(box.arm.kinematics.forward(q) @ matrix_from_pose(tcp))))


def _joints_safe(box: Controller, program: Program) -> None:
    q = _doubles(box, program, 0, 6)
    box.set_output_int(program.offset + 1, int(all(abs(t) <= box.arm.kinematics.model.range for t in q)))


def _pose_trans(box: Controller, program: Program) -> None:
    A, B = (matrix_from_pose(_doubles(box, program, i, 6)) for i in (0, 6))
    _answer(box, program, list(pose_from_matrix(A @ B)))


def _nothing(_: Controller, __: Program) -> None:
    return None


def _do(effect: Callable[[Controller, Program], object]) -> Action:
    """An action that is over at once."""

    def action(box: Controller, program: Program) -> Job | None:
        effect(box, program)
        return None

    return action


def _tell(values: Callable[[Controller, Program], list[float]]) -> Action:
    """An action that answers in the output double registers."""
    return _do(lambda box, program: _answer(box, program, values(box, program)))


def _flag(value: Callable[[Controller], bool]) -> Action:
    """An action that answers in output_int_register_1."""
    return _do(lambda box, program: box.set_output_int(program.offset + 1, int(value(box))))


TABLE: Mapping[int, Action] = {
    1: _move("movej"),
    2: _move("movej_ik"),
    3: _move("movel"),
    4: _move("movel_fk"),
    6: _force_mode(True),
    7: _force_mode(False),
    8: _do(lambda box, _: box.zero_ft()),
    9: _speed(False),
    10: _speed(True),
    11: _servo(False),
    12: _servo_circular,
    15: _stop,
    16: _stop,
    17: _do(_payload),
    18: _freedrive(True),
    19: _freedrive(False),
    20: _do(_nothing),
    21: _do(_nothing),
    24: _servo(True),
    25: _flag(lambda _: False),
    26: _tell(lambda _, __: [0.002]),
    27: _tell(lambda box, _: box.arm.q),
    28: _tell(lambda box, _: list(box.arm.target_tcp_pose())),
    29: _do(_tcp),
    30: _tell(lambda box, program: _ik(box, program, near=True)),
    31: _do(lambda box, _: box.protective_stop()),
    33: _stop,
    34: _stop,
    35: _do(_watchdog),
    36: _do(lambda box, program: _has_ik(box, program, near=False)),
    37: _do(_joints_safe),
    38: _tell(lambda _, __: [0.0] * 6),
    39: _do(_pose_trans),
    40: _tell(lambda box, _: list(pose_from_matrix(box.arm.tcp))),
    41: _jog,
    42: _stop,
    43: _tell(lambda box, _: list(box.arm.tcp_pose())),
    44: _do(_fk),
    45: _path,
    46: _tell(lambda box, program: _ik(box, program, near=False)),
    47: _flag(lambda box: not any(box.arm.target_qd)),
    52: _freedrive(True),
    53: _freedrive(False),
    54: _do(_freedrive_status),
    56: _do(_nothing),
    57: _do(_nothing),
    58: _tell(lambda box, _: list(pose_from_matrix(box.arm.X_WE))),
    59: _do(_nothing),
    60: _do(lambda box, program: _has_ik(box, program, near=False)),
    61: _do(lambda box, program: _has_ik(box, program, near=True)),
    62: _do(_nothing),
    63: _do(_nothing),
    64: _flag(lambda _: False),
    65: _do(_payload),
}
