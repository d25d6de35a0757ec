# SPDX-License-Identifier: Apache-2.0
"""Ports 30001 to 30003: the program that runs on the stand-in, above all ur_rtde's control script.

The uploaded text is recognised, never interpreted. Each cycle of 2 ms reads the command register, acts, and answers by
handshake in output_int_register_0 (+ offset): 1 ready, 2 done. Commands in CONTINUOUS are processed in every cycle
that they stay in the register, and answered "ready" at once.
"""

import re
import socket
import time

from seed_core.errors import SeedError
from seed_ur.pose import checked_pose
from seed_ur.standin.channel import Channel, Network
from seed_ur.standin.commands import Commands, Job, PathMove, StepCheck
from seed_ur.standin.controller import Controller

READY, DONE = 1, 2
CONTROL_SCRIPT = "rtde_control"  # name of ur_rtde's
LAST_OFFSET = 24  # of the registers that it uses: the upper half of the 48
STOP_SCRIPT = 255
SET_TCP = 29
SAME_TCP = 1e-4  # [m], [rad] of any of its numbers
CONTINUOUS = frozenset((6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)))
CUSTOM_CYCLES = 25  # of a script of the user's own: 50 ms
LONGEST_SCRIPT = 2_000_000  # [byte]
_HEAD = re.compile(r"^\s*def\s+(\w+)\s*\(", re.MULTILINE)
_CHECK = re.compile(r"global step_moving = (\S+)\s+global step_at_rest = (\S+)")  # of seed_driver's program
_TCP_CHECK = "global poses_of = get_tcp_offset()"  # of the same
_OFFSET = re.compile(r"# float register offset\s+(\d+)")
_PATH_MOVE = re.compile(r"^\s*(movej|movel)\((p?)\[([^\]]*)\]([^)\n]*)", re.MULTILINE)
_ACCELERATION, _SPEED = re.compile(r"\ba=([\d.eE+-]+)"), re.compile(r"\bv=([\d.eE+-]+)")  # of one move
_KINDS = {"movej": "movej", "movejp": "movej_ik", "movelp": "movel", "movel": "movel_fk"}  # p: to a pose


class Script:
    """One uploaded program; `step` is called every cycle while the robot is playing it."""

    def __init__(self, robot: Controller, text: str) -> None:
        """Raises SeedError and ValueError on numbers in the text that are none, or that cannot be."""
        self.robot = robot
        head, offset = _HEAD.search(text), _OFFSET.search(text)
        self.name = head.group(1) if head else "unnamed"
        self.offset = register_offset(offset.group(1)) if offset else 0
        path = [_path_move(m) for m in _PATH_MOVE.finditer(text.partition("# inject move path")[2])]
        check = _CHECK.search(text)
        limits = StepCheck(float(check.group(1)), float(check.group(2))) if check else None
        self._commands = Commands(robot, self.offset, path, limits)
        self._is_control_script = self.name == CONTROL_SCRIPT or offset is not None
        self._checks_tcp = _TCP_CHECK in text
        self._tcp: list[float] = []  # that its targets are poses of
        self._executing = False
        self._job: Job | None = None
        self._cycles = 0

    @property
    def watchdog(self) -> float | None:
        """Longest time between updates of the command register [s]; None: any."""
        return self._commands.watchdog

    def step(self) -> bool:
        """One cycle; False when the program has ended. Raises ProgramError and KinematicsError when it fails."""
        self._cycles += 1
        if self._cycles == 1:
            self._handshake(READY)
        if not self._is_control_script:
            if self._cycles == CUSTOM_CYCLES:
                self._handshake(DONE)
            return self._cycles < CUSTOM_CYCLES
        if self._cycles == 1:
            self.robot.set_output_int(self.offset + 2, 0)
        self._commands.advance()
        if self._checks_tcp and self._tcp_is_another():
            return False
        if self._job is None:
            return self._command(self.robot.in_int[self.offset])
        if self._job():
            self._job = None
            self._handshake(DONE)
        return True

    def _command(self, number: int) -> bool:
        if number in CONTINUOUS:
            self._commands.process(number)
            self._handshake(READY)
        elif number == 0:
            self._executing = False
            self._handshake(READY)
        elif number == STOP_SCRIPT:
            return False
        elif not self._executing:
            self._executing = True
            self._job = self._commands.process(number)
            if number == SET_TCP:
                self._tcp = list(self.robot.arm.tcp_offset)
            if self._job is None:
                self._handshake(DONE)
        return True

    def _tcp_is_another(self) -> bool:
        """Whether somebody else has changed the TCP since the program set it or began."""
        here = list(self.robot.arm.tcp_offset)
        self._tcp = self._tcp or here
        return any(abs(a - b) > SAME_TCP for a, b in zip(here, self._tcp, strict=True))

    def _handshake(self, mark: int) -> None:
        self.robot.set_output_int(self.offset, mark)


def register_offset(value: str | int) -> int:
    """Of the registers that a program uses; raises SeedError where there are too few after it."""
    if not 0 <= int(value) <= LAST_OFFSET:
        raise SeedError(f"register offset = {value} must be 0 to {LAST_OFFSET}")
    return int(value)


def _path_move(match: re.Match[str]) -> PathMove:
    name, p, target, rest = match.groups()
    acceleration, speed = _ACCELERATION.search(rest), _SPEED.search(rest)
    return PathMove(
        _KINDS[name + p],
        list(checked_pose(target.split(","), "a move of the path")),
        float(acceleration.group(1)) if acceleration else 1.2,
        float(speed.group(1)) if speed else 0.25,
    )


class OtherProgram:
    """A program of somebody else's that plays for some cycles and knows nothing of registers."""

    offset = 0
    watchdog = None

    def __init__(self, name: str, cycles: int) -> None:
        self.name, self._left = name, cycles

    def step(self) -> bool:
        """One cycle; False when it has ended."""
        self._left -= 1
        return self._left > 0


class ScriptChannel(Channel):
    """A connection to port 30001, 30002 or 30003: a program ends with a line `end` and 10 ms of silence, or with it.

    One that was made in local control takes no program in remote control either, as on a UR.
    """

    name = "script"
    _heard = 0.0  # [s] monotonic, when the last bytes came

    def __init__(self, connection: socket.socket, robot: Controller, network: Network) -> None:
        super().__init__(connection, robot, network)
        self._read_only = not robot.options.remote_control

    def received(self) -> None:
        self._heard = time.monotonic()
        if len(self.buffer) > LONGEST_SCRIPT:
            self.open = False

    def finished(self) -> None:
        self._upload()

    def cycle(self, now: float, paused: bool) -> bool:  # noqa: ARG002
        if self.buffer and now - self._heard > 0.01 and self.buffer.rstrip().endswith(b"\nend"):
            self._upload()
        return self.open

    def _upload(self) -> None:
        text = self.buffer.decode("utf-8", "replace")
        self.buffer.clear()
        if self._read_only:
            self.robot.send_text("C210: this connection was made in local control and takes no program")
        elif text.lstrip().startswith("sec "):
            self.robot.run_beside(text)
        elif text.strip() and (refused := self._take(text)):
            self.robot.send_text(refused)

    def _take(self, text: str) -> str:
        """Why a program was not taken; '' if it was."""
        try:
            return self.robot.upload(Script(self.robot, text), self.robot.robot_time)
        except (SeedError, ValueError) as error:
            return f"the program cannot be run: {error}"
