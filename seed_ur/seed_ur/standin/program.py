# SPDX-License-Identifier: Apache-2.0
"""What the running control script does once per 2 ms cycle: read the command register, act, answer by handshake.

The uploaded text is recognised, never interpreted. Handshake in output_int_register_0 (+ offset): 1 ready, 2 done.
Commands in CONTINUOUS are processed in every cycle that they stay in the register, and answered "ready" at once.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

from seed_ur.kinematics import KinematicsError
from seed_ur.standin import commands
from seed_ur.standin.commands import Job, ProgramError

if TYPE_CHECKING:
    from seed_ur.standin.controller import Controller

READY, DONE = 1, 2
STOP_SCRIPT = 255
CONTINUOUS = frozenset((6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)))
_HEAD = re.compile(r"^\s*def\s+(\w+)\s*\(", re.MULTILINE)
_OFFSET = re.compile(r"# float register offset\s+(\d+)")
_PATH_MOVE = re.compile(r"^\s*(movej|movel)\((p?)\[([^\]]*)\][^)]*?(?:a=([\d.eE+-]+))?,?\s*(?:v=([\d.eE+-]+))?", re.M)
Line: TypeAlias = tuple[str, list[float], float, float]  # move, target, acceleration, speed


class Program:
    """One uploaded program; `step` is called every cycle while the robot is playing it."""

    def __init__(self, text: str) -> None:
        head = _HEAD.search(text)
        offset = _OFFSET.search(text)
        self.name = head.group(1) if head else "unnamed"
        self.is_control_script = self.name == "rtde_control" or offset is not None
        self.offset = int(offset.group(1)) if offset else 0
        self.path = [_path_line(m) for m in _PATH_MOVE.finditer(text.partition("# inject move path")[2])]
        self.executing = False
        self.job: Job | None = None
        self.background: Job | None = None  # an asynchronous move
        self.operation = 0  # counts asynchronous moves
        self.watchdog: float | None = None  # [s] longest time between updates of the command register
        self.cycles = 0

    def step(self, box: Controller) -> bool:
        """One cycle; False when the program has ended. Raises ProgramError and KinematicsError when it fails."""
        self.cycles += 1
        if not self.is_control_script:
            return self._custom(box)
        if self.cycles == 1:
            box.set_output_int(self.offset, READY)
            box.set_output_int(self.offset + 2, 0)
        self._background(box)
        if self.job is not None:
            if self.job():
                self.job = None
                box.set_output_int(self.offset, DONE)
            return True
        return self._command(box, box.input_int(self.offset))

    def _command(self, box: Controller, command: int) -> bool:
        if command in CONTINUOUS:
            self._process(box, command)
            box.set_output_int(self.offset, READY)
        elif command == 0:
            self.executing = False
            box.set_output_int(self.offset, READY)
        elif command == STOP_SCRIPT:
            return False
        elif not self.executing:
            self.executing = True
            self.job = self._process(box, command)
            if self.job is None:
                box.set_output_int(self.offset, DONE)
        return True

    def _process(self, box: Controller, command: int) -> Job | None:
        action = commands.TABLE.get(command)
        if action is None:
            raise ProgramError(f"command {command} is not emulated")
        return action(box, self)

    def _custom(self, box: Controller) -> bool:
        """A script of the user's own: says ready, then done, and ends."""
        if self.cycles == 1:
            box.set_output_int(self.offset, READY)
        if self.cycles < 25:  # 50 ms
            return True
        box.set_output_int(self.offset, DONE)
        return False

    def _background(self, box: Controller) -> None:
        if self.background is not None and self.background():
            self.background = None
            self.report_operation(box, running=False)

    def report_operation(self, box: Controller, running: bool) -> None:
        """Progress word of asynchronous moves: bit 15 running, bits 24 to 30 the operation's number."""
        writes = (self.cycles & 0x7F) << 16
        box.set_output_int(self.offset + 2, (self.operation & 0x7F) << 24 | writes | (0x8000 if running else 0))


def _path_line(match: re.Match[str]) -> Line:
    numbers = [float(t) for t in match.group(3).split(",")]
    kind = "movej_ik" if match.group(1) == "movej" and match.group(2) else match.group(1)
    return kind, numbers, float(match.group(4) or 1.2), float(match.group(5) or 0.25)


__all__ = ["Callable", "KinematicsError", "Program", "ProgramError", "Sequence"]
