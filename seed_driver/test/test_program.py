# SPDX-License-Identifier: Apache-2.0
"""The program on the robot, run: URScript's blocks are Python's but for `end`, threads and critical sections.

What it calls of the controller is a model of one whose servoj takes the arm to its target within a cycle.
"""

import math
import re
from itertools import count

import pytest

from seed_driver.robot.program import AT_REST, MOVING, program
from seed_ur.standin.commands import COMMANDS

Q = [0.0, -1.7, 2.1, -1.97, -1.57, 0.0]


def as_python(text: str) -> str:
    """The program as a Python generator that yields in every cycle; threads are generators, too."""
    out = []
    for line in text.splitlines():
        code = line.split("#")[0].rstrip()
        body = code.strip()
        if body in ("", "end", "enter_critical", "exit_critical"):
            continue
        code = re.sub(r"\bglobal (\w+) =", r"shared.\1 =", code).replace("local ", "")
        code = re.sub(r"\bthread (\w+)\(\):", r"def \1():", code)
        code = re.sub(r"\brun (\w+)\(\)", r"start(\1())", code)
        code = re.sub(r"\bkill (\w+)", r"end(\1)", code)
        code = re.sub(r"\bp\[", "list_of[", code)
        code = re.sub(r"(\s)(servoj\()", r"\1yield \2", code) if body.startswith("servoj(") else code
        code = "".join((code[: len(code) - len(body)], "yield")) if body == "sync()" else code
        out.append(code)
    python = "\n".join(out)
    for name in re.findall(r"shared\.(\w+) =", python):
        python = re.sub(rf"(?<!shared\.)\b{name}\b(?!=)", f"shared.{name}", python)
    return python


class ListOf:
    def __getitem__(self, numbers):
        return list(numbers)


class Controller:
    """What the program calls; `step` is one cycle of 2 ms."""

    def __init__(self, version=(5, 12), offset=0) -> None:
        self.offset, self.ints, self.doubles = offset, [0] * 48, [0.0] * 48
        self.out, self.q, self.qd = [0] * 48, list(Q), [0.0] * 6
        self.threads, self.calls, self.ids = {}, [], count(1)
        self.out_doubles, self.ended = [0.0] * 48, False
        self.tcp = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
        names = {
            "shared": type("Globals", (), {})(),
            "list_of": ListOf(),
            "read_input_float_register": lambda i: self.doubles[i],
            "read_input_integer_register": lambda i: self.ints[i],
            "write_output_integer_register": self.out.__setitem__,
            "get_target_joint_positions": lambda: list(self.q),
            "get_target_joint_speeds": lambda: list(self.qd),
            "get_inverse_kin": lambda x: x,
            "norm": lambda v: abs(v) if isinstance(v, float | int) else math.sqrt(sum(a * a for a in v)),
            "servoj": self.servoj,
            "start": self.start,
            "end": lambda number: self.threads.pop(number),
            "textmsg": lambda *_: None,
            "get_tcp_offset": lambda: list(self.tcp),
            "write_output_float_register": self.out_doubles.__setitem__,
        }
        for name in ("zero_ftsensor", "stopl", "set_payload", "rtde_set_watchdog", "set_target_payload"):
            names[name] = lambda *values, name=name: self.calls.append((name, *values))
        for name in ("freedrive_mode", "end_freedrive_mode", "teach_mode", "end_teach_mode"):
            names[name] = lambda name=name: self.calls.append((name,))
        names["set_tcp"] = self.set_tcp
        exec(as_python(program(version, offset)), names)  # our own text
        self.main = names["rtde_control"]()

    def start(self, thread) -> int:
        number = next(self.ids)
        self.threads[number] = thread
        return number

    def servoj(self, q, t, lookahead_time, gain) -> None:  # noqa: ARG002
        self.qd = [(b - a) / 0.002 for a, b in zip(self.q, q, strict=True)]
        self.q = list(q)

    def set_tcp(self, tcp) -> None:
        self.calls.append(("set_tcp", tcp))
        self.tcp = list(tcp)

    def command(self, number: int, *doubles: float) -> None:
        self.ints[self.offset] = number
        self.doubles[self.offset : self.offset + len(doubles)] = doubles

    def servo(self, q) -> None:
        self.command(24, *q, 0.0, 0.0, 0.002, 0.03, 2000.0)

    def step(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            self.ended |= next(self.main, "ended") == "ended"
            for thread in list(self.threads.values()):
                next(thread)

    def stop_safely(self) -> None:
        """As in a protective stop: the arm stands somewhere, the program waits."""
        self.qd = [0.0] * 6


def moving(controller: Controller, cycles: int = 50) -> list[float]:
    """The arm at 0.5 rad/s after so many cycles; its last target."""
    q = list(Q)
    for i in range(cycles):
        q[0] += min(1e-4 * i, 1e-3)
        controller.servo(q)
        controller.step()
    return q


@pytest.mark.parametrize("offset", [0, 24])
def test_a_motion_that_starts_softly_is_followed(offset: int) -> None:
    robot = Controller(offset=offset)
    q = moving(robot)
    robot.step(2)
    assert robot.q == pytest.approx(q)
    assert robot.out[offset] == 1


def test_a_target_away_from_a_resting_arm_is_not_gone_to() -> None:
    robot = Controller()
    robot.servo([Q[0] + 2 * AT_REST, *Q[1:]])
    robot.step(100)
    assert robot.q == Q
    assert robot.threads == {}


def test_a_jump_while_the_arm_moves_is_not_followed() -> None:
    robot = Controller()
    q = moving(robot)
    robot.servo([q[0] + 1.1 * MOVING, *q[1:]])
    robot.step(10)
    assert robot.q[0] <= q[0] + 1e-3


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_a_target_that_is_not_a_number_is_near_nowhere(wrong: float) -> None:
    robot = Controller()
    q = moving(robot)
    robot.servo([*q[:5], wrong])
    robot.step(10)
    assert all(map(math.isfinite, robot.q))


def test_after_a_stop_and_play_the_arm_stays_though_an_old_target_is_in_register_and_thread() -> None:
    robot = Controller()
    moving(robot)
    robot.step()
    robot.q[0] -= 0.01  # where the stop has left it
    robot.stop_safely()
    stood = list(robot.q)
    robot.step(200)
    assert robot.q == stood
    robot.servo(stood)  # the driver starts again from where the arm stands
    robot.step(5)
    robot.servo([stood[0] + 1e-4, *stood[1:]])
    robot.step(5)
    assert robot.q[0] == pytest.approx(stood[0] + 1e-4)


def test_servo_stop_ends_the_servo_thread_and_the_next_command_starts_another() -> None:
    robot = Controller()
    q = moving(robot)
    robot.command(16, 10.0)
    robot.step(2)
    assert robot.threads == {}
    assert robot.calls == [("stopl", 10.0)]
    assert robot.out[0] == 2
    robot.command(0)
    robot.step()
    assert robot.out[0] == 1
    robot.stop_safely()
    robot.servo(q)
    robot.step(3)
    assert len(robot.threads) == 1


@pytest.mark.parametrize(
    ("number", "doubles", "call"),
    [
        (8, (), ("zero_ftsensor",)),
        (17, (1.5, 0.0, 0.1, 0.2), ("set_payload", 1.5, [0.0, 0.1, 0.2])),
        (29, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6), ("set_tcp", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])),
        (35, (10.0,), ("rtde_set_watchdog", "input_int_register_24", 10.0, "stop")),
        (52, (), ("freedrive_mode",)),
        (53, (), ("end_freedrive_mode",)),
        (65, (*range(10),), ("set_target_payload", 0, [1, 2, 3], [4, 5, 6, 7, 8, 9])),
    ],
)
def test_a_command_is_done_once_and_answered(number, doubles, call) -> None:
    robot = Controller(offset=24)
    robot.command(number, *doubles)
    robot.step(5)
    assert robot.calls == [call]
    assert robot.out[24] == 2
    assert not robot.ended
    assert number in COMMANDS


def test_the_tcp_is_told_on_request() -> None:
    robot = Controller(offset=24)
    robot.command(40)
    robot.step(3)
    assert robot.out_doubles[24:30] == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    assert robot.out[24] == 2


def test_a_tcp_that_somebody_else_changes_ends_the_program_before_another_target_is_gone_to() -> None:
    """The targets that come are poses of the one before, and the network may hold many of them."""
    robot = Controller()
    q = moving(robot)
    robot.step()
    stood = list(robot.q)
    robot.tcp[2] += 0.03
    robot.servo([q[0] + 1e-3, *q[1:]])
    robot.step(5)
    assert robot.q == stood
    assert robot.calls == [("stopl", 10.0)]
    assert robot.threads == {}
    assert robot.ended


def test_a_tcp_that_the_driver_sets_does_not_end_it() -> None:
    robot = Controller()
    q = moving(robot)
    robot.command(29, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0)
    robot.step(3)
    assert robot.out[0] == 2
    robot.command(0)
    robot.step()
    robot.servo([q[0] + 1e-4, *q[1:]])
    robot.step(5)
    assert not robot.ended
    assert robot.q[0] == pytest.approx(q[0] + 1e-4)
    robot.tcp[5] += 0.01
    robot.step(2)
    assert robot.ended


@pytest.mark.parametrize("number", [255, 3, 999])
def test_stop_script_and_what_it_does_not_know_end_it(number: int) -> None:
    robot = Controller()
    robot.step(2)
    robot.command(number)
    robot.step(3)
    assert robot.ended
    assert robot.out[0] == 1


def test_an_old_controller_is_asked_for_what_it_knows() -> None:
    text = program((5, 4, 2, 0), 0)
    assert "teach_mode()" in text
    assert "freedrive_mode" not in text
    assert "set_target_payload" not in text


@pytest.mark.parametrize("version", [(3, 15), (5, 4), (5, 12), (10, 10)])
def test_blocks_are_closed_and_nothing_is_left_to_fill_in(version) -> None:
    text = program(version, 24)
    opened = [line for line in text.splitlines() if re.match(r"\s*(def|thread|while|if)\b.*:\s*$", line)]
    assert len(opened) == sum(line.strip() == "end" for line in text.splitlines())
    assert "@" not in text
    assert "$" not in text  # ur_rtde would take it for a version
    assert max(map(len, text.splitlines())) < 120
