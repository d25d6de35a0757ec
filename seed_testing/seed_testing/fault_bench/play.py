# SPDX-License-Identifier: Apache-2.0
"""Unlock and Play after a protective stop in which the driver died: the old command is still there."""

import math
import os
import signal
import time
from typing import Any, NamedTuple

import numpy as np

from seed_core.errors import SeedError
from seed_driver.robot.dashboard import dashboard
from seed_testing.fault_bench.bench import FaultBench

SERVO_L = 24  # in the command register
SOFT: dict[str, Any] = {"servo_lookahead": 0.1, "servo_gain": 300.0}  # the arm is 2 cm behind its command


class Played(NamedTuple):
    """What the arm did after Play."""

    moved: float  # [m]
    top_speed: float  # [m/s]


def play_after_stop(program: str) -> Played:
    """The worst case: the command register is full, and the robot's own watchdog sleeps while the program is paused.

    Args:
        program: the driver's setting `robot_program`.
    """
    with FaultBench("--unlock-after", "0.2", robot_program=program, **SOFT) as bench:
        bench.ready()
        bench.robot.ask("option", name="watchdog_sleeps", value=True)
        bench.sway(amplitude=0.05, rate=4.0)
        bench.run(0.8 + 0.1 * math.pi)
        os.kill(bench.supervisor.pid or 0, signal.SIGSTOP)
        bench.robot.ask("protective_stop")
        time.sleep(0.4)
        state = bench.robot.ask("state")
        if state["command"] != SERVO_L:
            raise SeedError(f"the command register holds {state['command']}, not servoL: nothing is tested")
        for commands, answer in (
            (("close safety popup", "unlock protective stop"), "releasing"),
            (("play",), "Starting"),
        ):
            if answer not in (said := dashboard(bench.robot.host, *commands)):
                raise SeedError(f"the dashboard answers '{commands[-1]}' with '{said}'")
        start = time.monotonic()
        time.sleep(0.5)
        motion = bench.motion(start - 0.1)
        moved = np.linalg.norm(motion[:, 1:4] - state["tcp_pose"][:3], axis=1)
        return Played(float(moved.max()), float(motion[:, 4].max()))
