# SPDX-License-Identifier: Apache-2.0
"""The fault bench: servo process and supervisor against a stand-in controller, with a stream of targets."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seed_core.arm.quaternion import Quaternion
from seed_core.errors import SeedError
from seed_core.vector3 import Vector3
from seed_driver.config import DriverConfig
from seed_driver.process.shared_memory import ServoState
from seed_driver.process.supervisor import Reply, Supervisor
from seed_ur.standin_client import StandIn, private_host

Targets = Callable[[float], tuple[Vector3, Quaternion]]  # by time [s]
STEP = 0.004  # [s] between targets: a 250 Hz controller
AT_REST = 2e-3  # [m/s]
JUMP = 1e-3  # [m] that the arm may move on recovery, without a target


class FaultBench:
    """A context manager that leaves no process behind. Stand-in options as on its command line."""

    def __init__(self, *standin: str, robot: StandIn | None = None, **settings: Any) -> None:
        """robot: a stand-in that is there already, and stays; else one of its own is started."""
        host = robot.host if robot is not None else private_host()
        self.supervisor = Supervisor(DriverConfig(**{"robot_ip": host, **settings}))
        self._borrowed = robot is not None
        self.robot = robot or StandIn(host, *standin)
        self.path: Targets | None = None
        self._path_start = 0.0

    def __enter__(self) -> FaultBench:
        self.supervisor.start(start_program=True)
        return self

    def __exit__(self, *_: object) -> None:
        self.supervisor.close()
        if not self._borrowed:
            self.robot.close()

    @property
    def state(self) -> ServoState:
        """The newest state."""
        return self.supervisor.state

    def step(self) -> ServoState:
        """One turn: supervision, and a target if there is a path and the driver follows."""
        now = time.monotonic()
        state = self.supervisor.step(now)
        if self.path is not None and state.armed:
            self.supervisor.write_target(*self.path(now - self._path_start), now)
        else:
            self._path_start = now
        time.sleep(STEP)
        return state

    def run(self, seconds: float) -> None:
        """Turn for some time."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.step()

    def wait(self, condition: Callable[[ServoState], bool], timeout: float, what: str) -> float:
        """Turn until `condition`; the seconds it took. Raises SeedError after `timeout` [s]."""
        start = time.monotonic()
        while not condition(self.step()):
            if time.monotonic() - start > timeout:
                raise SeedError(f"{what}: not within {timeout} s; the driver says {self.state.reason!r}")
        return time.monotonic() - start

    def ready(self, timeout: float = 60.0) -> None:
        """Wait until the driver follows targets."""
        self.wait(lambda s: s.armed, timeout, "driver ready")

    def ask(self, do: str, timeout: float = 9.0, **arguments: Any) -> Reply:
        """A request to the servo process and its answer."""
        number = self.supervisor.send(do, **arguments)
        self.wait(lambda _: number in self.supervisor.replies, timeout, f"answer to {do}")
        return self.supervisor.replies.pop(number)

    def recover(self, timeout: float = 10.0) -> float:
        """Ask for the program again until it runs; the seconds it took."""
        start = time.monotonic()
        while not self.ask("start").ok:
            if time.monotonic() - start > timeout:
                raise SeedError(f"no recovery within {timeout} s; the driver says {self.state.reason!r}")
            self.run(0.05)
        self.ready(timeout)
        return time.monotonic() - start

    def recover_in_place(self) -> tuple[float, float]:
        """Recover without targets: the seconds that took, the metres that the arm moved. Raises SeedError at a jump."""
        self.still()
        place = self.position()
        seconds = self.recover()
        self.run(0.2)
        jump = math.dist(self.position(), place)
        if jump > JUMP:
            raise SeedError(f"the arm jumped {jump:.4f} m on recovery, limit {JUMP} m")
        return seconds, jump

    def sway(self, amplitude: float = 0.02, rate: float = 2.0) -> None:
        """Stream a sine along y about the present command, starting at rest there."""
        (x, y, z), q = self.state.command
        self.follow(lambda t: ((x, y + amplitude * (1.0 - math.cos(rate * t)), z), q))

    def follow(self, path: Targets) -> None:
        """Stream a path that starts now."""
        self.path, self._path_start = path, time.monotonic()

    def still(self) -> None:
        """No more targets."""
        self.path = None

    def position(self) -> list[float]:
        """Position [m] of the arm's TCP."""
        place: list[float] = self.robot.ask("state")["tcp_pose"][:3]
        return place

    def motion(self, since: float) -> NDArray[np.float64]:
        """(n, 6): time, position (3) [m], speed [m/s], turning [rad/s] of the arm at every controller cycle."""
        rows = self.robot.ask("motion", since=since)["motion"]
        return np.array(rows, dtype=float).reshape(-1, 6)

    def travel(self, since: float, rest_from: float) -> float:
        """Travel [m] of the arm since a time [s]; raises SeedError when it still moves from `rest_from` [s] on.

        A dead controller has no arm to look at: 0.
        """
        try:
            rows = self.motion(since)
        except OSError:
            return 0.0
        speeds = rows[rows[:, 0] > rest_from, 4]
        if len(speeds) and speeds.max() > AT_REST:
            raise SeedError(f"the arm still moves at {speeds.max():.4f} m/s")
        return math.dist(rows[-1, 1:4], rows[0, 1:4]) if len(rows) else 0.0


def leftover_processes(parent: int) -> list[int]:
    """Servo processes whose parent is the process of this number."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # ended meanwhile
            status = (process / "stat").read_text().rpartition(")")[2].split()
            if int(status[1]) == parent and "seed_driver.servo" in (process / "cmdline").read_text():
                found.append(int(process.name))
    return found
