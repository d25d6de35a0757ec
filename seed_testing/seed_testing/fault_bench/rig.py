# SPDX-License-Identifier: Apache-2.0
"""The servo process and a stand-in's arm by simulated time: every pause and every move of the slider as asked for."""

from __future__ import annotations

import random
import socket
from collections import deque
from collections.abc import Callable, Sequence
from math import hypot
from typing import Any

from seed_core.arm.quaternion import Quaternion, from_rotation_vector, to_pose
from seed_core.vector3 import Vector3
from seed_driver.config import DriverConfig
from seed_driver.process.cycle_timing import Deadlines
from seed_driver.process.shared_memory import Modes, RobotState, SharedMemory, TargetSlot
from seed_driver.robot.connection import where_meant
from seed_driver.robot.tcp_and_payload import TcpAndPayload
from seed_driver.servo import ServoProcess
from seed_ur.kinematics import URKinematics
from seed_ur.pose import pose_from_matrix
from seed_ur.standin.arm import Arm, Servo

PERIOD = 0.002  # [s]
TARGETS = 0.004  # [s] from target to target
PATH_TIME = 1e-4  # [s] from one computer to the other
CALM = ("process", "network", "robot")
Path = Callable[[float, Vector3, Quaternion], tuple[Vector3, Quaternion]]  # by time [s] and the pose at the start


class Pauses:
    """Random ones of 3 to 50 ms, each `kind` at times of its own; none for `kind` ''."""

    def __init__(self, kind: str, seed: int) -> None:
        self.spans: list[tuple[float, float]] = []
        rng, at = random.Random(f"{kind}/{seed}"), 0.3
        while kind and at < 3.0:
            length = rng.uniform(0.003, 0.05)
            self.spans.append((at, at + length))
            at += length + rng.uniform(0.01, 0.2)

    def over(self, t: float) -> float:
        """When something that is due at `t` [s] happens."""
        return next((end for start, end in self.spans if start <= t < end), t)


class RigRobot:
    """A stand-in's arm that takes the newest command in each of its cycles, as far as the network has brought it.

    What the servo process uses of `seed_driver.robot.connection.Robot` is here.
    """

    def __init__(self, q: Sequence[float], pauses: dict[str, Pauses]) -> None:
        """q: (6,) [rad] at the start."""
        self.arm, self.now, self.rate = Arm(URKinematics.for_model("ur5e"), q), 0.0, 500.0
        self.pauses = pauses
        self.slider: Callable[[float], float] = lambda _: 1.0  # by time [s]
        self.tells = True  # how it is scaled
        self.commands: deque[tuple[float, Any]] = deque()  # time of arrival, and what arrives
        self.states: deque[tuple[float, Any]] = deque()
        self.connected, self.control, self.tool, self.taking = True, None, TcpAndPayload(), False
        self.newest = (0.0, self._sample(), self._target())
        self.cycles = 0
        self.sent: list[float] = []
        self.top_joint = self.top_speed = self.top_turning = 0.0
        self.track: list[tuple[float, ...]] = []  # time [s], position [m], quaternion, scale

    def _sample(self) -> RobotState:
        x, y, z, rx, ry, rz = self.arm.tcp_pose()
        return RobotState()._replace(
            q=tuple(self.arm.q),
            p=(x, y, z),
            orientation=from_rotation_vector((rx, ry, rz)),
            modes=Modes(7, 1, 2, 1),
            speed_scaling=self.arm.scaling if self.tells else 1.0,
        )

    def _target(self) -> RobotState:
        x, y, z, rx, ry, rz = self.arm.target_tcp_pose()
        q = from_rotation_vector((rx, ry, rz))
        return self._sample()._replace(q=tuple(self.arm.target_q), p=(x, y, z), orientation=q)

    def _carried(self, content: object) -> tuple[float, Any]:
        return self.pauses["network"].over(self.now) + PATH_TIME, content

    def run_until(self, now: float) -> None:
        """Every cycle that is due; those that a pause has delayed follow each other at once."""
        while (at := self.pauses["robot"].over(self.cycles * PERIOD + 0.0007)) <= now:
            self.arm.slider = self.slider(at)
            while self.commands and self.commands[0][0] <= at:
                self._servo(self.commands.popleft()[1])
            self.arm.step(PERIOD)
            self.cycles, self.now = self.cycles + 1, at
            self._record(at)
            self.states.append(self._carried((self.cycles * PERIOD, self._sample(), self._target())))
        self.now = now

    def _record(self, at: float) -> None:
        vx, vy, vz, wx, wy, wz = self.arm.tcp_velocity(self.arm.qd)
        self.top_joint = max(self.top_joint, *map(abs, self.arm.qd))
        self.top_speed = max(self.top_speed, hypot(vx, vy, vz))
        self.top_turning = max(self.top_turning, hypot(wx, wy, wz))
        s = self._sample()
        self.track.append((at, *s.p, *s.orientation, self.arm.scaling))

    def _servo(self, pose: Sequence[float]) -> None:
        goal = self.arm.follow(pose)
        if isinstance(self.arm.motion, Servo):
            self.arm.motion.take(goal, 0.03, 2000.0)
        else:
            self.arm.motion = Servo(goal, 0.03, 2000.0)

    @property
    def timestamp(self) -> float:
        """The controller's clock in the newest state that has come [s]."""
        while self.states and self.states[0][0] <= self.now:
            self.newest = self.states.popleft()[1]
        return self.newest[0]

    def sample(self) -> RobotState:
        """The newest state."""
        return self.newest[1]

    def meant(self, s: RobotState) -> RobotState:
        """With joints and pose of the robot's own target."""
        return where_meant(s, self.newest[2])

    tells_tcp = True

    def tool_changed(self) -> str:
        """Nobody changes it."""
        return ""

    def start_program(self) -> None:
        """There is one."""

    def clear_command(self) -> None:
        """Nothing is left over."""

    def servo(self, p: Vector3, q: Quaternion, period: float) -> None:  # noqa: ARG002
        """A command goes on its way."""
        self.sent.append(self.now)
        self.commands.append(self._carried(pose_from_matrix(to_pose(p, q))))


def play(
    q: Sequence[float],
    path: Path,
    seconds: float = 3.0,
    pauses: tuple[str, ...] = (),
    seed: int = 0,
    slider: Callable[[float], float] = lambda _: 1.0,
    tells: bool = True,
    **settings: Any,
) -> tuple[RigRobot, list[str]]:
    """Some seconds of a path, with a target every 4 ms; after a hold it is followed again from where the arm stands.

    Args:
        q: (6,) [rad] where the arm stands at first.
        pauses: what pauses at random: of process, network, robot.
        slider: of the pendant by time [s], 0..1; tells: whether the robot tells how it is scaled.

    Returns:
        The robot and what it has recorded, and the reasons of the holds.
    """
    config = DriverConfig(robot_ip="127.0.0.1", **settings)
    at = {kind: Pauses(kind if kind in pauses else "", seed) for kind in CALM}
    memory, (ours, theirs) = SharedMemory.create(), socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    process, robot = ServoProcess(memory, ours, config, False), RigRobot(q, at)
    robot.slider, robot.tells, session = slider, tells, process.session
    session.robot, session.linked, session.sample = robot, True, robot.sample()  # type: ignore[assignment]
    session.start()
    session.watch.restart(robot.timestamp, 0.0)
    deadlines, due, targets, holds = Deadlines(PERIOD, 0.0), 0.0, 0, list[str]()
    start_p, start_q = session.sample.p, session.sample.orientation
    while due < seconds:
        now = at["process"].over(due)
        robot.run_until(now)
        if now >= TARGETS * targets:
            targets = 1 + int(now / TARGETS)
            memory.write_target(TargetSlot(targets, now, *path(now, start_p, start_q)))
        if session.linked and session.reason:
            holds.append(session.reason)
            session.start()  # after a hold, for a pause that was too long
        process.tick(robot, now)  # type: ignore[arg-type]
        due = deadlines.next(now + 1e-4)
    for wire in (ours, theirs):
        wire.close()
    memory.close()
    return robot, holds
