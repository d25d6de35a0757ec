# SPDX-License-Identifier: Apache-2.0
"""Options, faults and ports of a stand-in, and the numbers that UR gives to modes and states."""

import math
from collections import deque
from dataclasses import dataclass, field

from seed_ur import rtde

PERIOD = 0.002  # [s]
RTDE_PORT, DASHBOARD_PORT, SIDE_PORT, PLANT_PORT = 30004, 29999, 30099, 30098
SCRIPT_PORTS = (30001, 30002, 30003)
STOPPED, PLAYING, PAUSED = 1, 2, 4  # runtime_state
POWER_OFF, IDLE, RUNNING = 3, 5, 7  # robot_mode
NORMAL, PROTECTIVE, ROBOT_EMERGENCY, SAFETY_FAULT = 1, 3, 7, 9  # safety_mode
HOME = (0.0, -1.7, 2.1, -1.97, -math.pi / 2, 0.0)  # [rad] flange pointing down in front of the arm


class ProgramError(Exception):
    """A runtime error that ends the program."""


@dataclass
class Options:
    """What a stand-in is; see docs/ur_controller.md."""

    model: str = "ur5e"
    version: rtde.Version = (5, 12, 4, 1101319)
    home: tuple[float, ...] = HOME  # [rad] joint angles at start
    remote_control: bool = True
    program_on_stop: str = "paused"  # paused | stopped | playing: what a safety stop does to the program
    unlock_after: float = 5.0  # [s] a protective stop cannot be unlocked before
    max_tcp_speed: float = 1.5  # [m/s] faster is a protective stop
    max_joint_step: float = 1.0  # [rad] a servo target further away than this is a protective stop
    watchdog_sleeps: bool = False  # of the RTDE inputs: its time stands still while the program is paused


@dataclass
class Faults:
    """Misbehaviour that can be switched on while running."""

    stuck_ready: bool = False  # the ready bit is never given
    refuse_unlock: bool = False
    refuse_script: bool = False
    corrupt: dict[str, tuple[int, float]] = field(default_factory=dict)  # output: which of its numbers, and its value
    wall: tuple[float, float] | None = None  # height [m] and stiffness [N/m] of a virtual table
    messages: deque[str] = field(default_factory=lambda: deque(maxlen=20))  # the last text messages
