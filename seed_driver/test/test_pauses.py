# SPDX-License-Identifier: Apache-2.0
"""The robot keeps the limits when the servo process, the network or the robot pauses and what was late comes at once.

By simulated time, so that every pause is there in every run; robot and servo process are those of the real tests.
"""

import random
import socket
from collections import deque

import numpy as np
import pytest

from seed_core.arm.quaternion import from_rotation_vector, to_pose, turned
from seed_driver.config import DriverConfig
from seed_driver.process.cycle_timing import CLOSEST, Deadlines
from seed_driver.process.shared_memory import Modes, Sample, SharedMemory, TargetSlot
from seed_driver.servo import ServoProcess
from seed_ur.kinematics import URKinematics
from seed_ur.pose import pose_from_matrix
from seed_ur.standin.arm import Arm, Servo

PERIOD = 0.002  # [s]
PATH_TIME = 1e-4  # [s] from one computer to the other
SINGULAR = (0.0, -1.6, 1.9, -1.9, -0.12, 0.0)  # [rad] the wrist's axes are almost in line
ELBOW_UP = (0.0, -1.7, 2.1, -1.97, -1.57, 0.0)


class Pauses:
    """Random ones of 3 to 50 ms, each `kind` at times of its own."""

    def __init__(self, kind: str, seed: int) -> None:
        rng, self.spans, at = random.Random(f"{kind}/{seed}"), [], 0.3
        while at < 3.0:
            length = rng.uniform(0.003, 0.05)
            self.spans.append((at, at + length))
            at += length + rng.uniform(0.01, 0.2)

    def over(self, t: float) -> float:
        """When something that is due at `t` [s] happens."""
        return next((end for start, end in self.spans if start <= t < end), t)


class Robot:
    """A stand-in's arm that takes the newest command in each of its cycles, as far as the network has brought it."""

    def __init__(self, q, pauses) -> None:
        self.arm, self.now, self.rate = Arm(URKinematics.for_model("ur5e"), q), 0.0, 500.0
        self.pauses = pauses
        self.commands, self.states = deque(), deque()  # (time of arrival, content)
        self.newest = (0.0, self._sample())
        self.connected, self.control = True, None
        self.cycles, self.top_joint, self.top_speed, self.sent = 0, 0.0, 0.0, []

    def _sample(self):
        *p, rx, ry, rz = self.arm.tcp_pose()
        orientation = from_rotation_vector((rx, ry, rz))
        return Sample()._replace(q=tuple(self.arm.q), p=tuple(p), orientation=orientation, modes=Modes(7, 1, 2, 1))

    def _carried(self, content):
        return self.pauses["network"].over(self.now) + PATH_TIME, content

    def run_until(self, now: float) -> None:
        """Every cycle that is due; those that a pause has delayed follow each other at once."""
        while (at := self.pauses["robot"].over(self.cycles * PERIOD + 0.0007)) <= now:
            while self.commands and self.commands[0][0] <= at:
                self.arm.motion = self._servo(self.commands.popleft()[1])
            self.arm.step(PERIOD)
            self.cycles, self.now = self.cycles + 1, at
            self.top_joint = max(self.top_joint, *map(abs, self.arm.qd))
            self.top_speed = max(self.top_speed, float(np.linalg.norm(self.arm.tcp_velocity(self.arm.qd)[:3])))
            self.states.append(self._carried((self.cycles * PERIOD, self._sample())))
        self.now = now

    def _servo(self, pose) -> Servo:
        goal = self.arm.follow(pose)
        if isinstance(self.arm.motion, Servo):
            self.arm.motion.goal = goal
            return self.arm.motion
        return Servo(goal, 0.03, 2000.0)

    # what the servo process uses
    @property
    def timestamp(self) -> float:
        while self.states and self.states[0][0] <= self.now:
            self.newest = self.states.popleft()[1]
        return self.newest[0]

    def sample(self):
        return self.newest[1]

    def start_program(self) -> None:
        pass

    def servo(self, p, q, period: float) -> None:  # noqa: ARG002
        self.sent.append(self.now)
        self.commands.append(self._carried(pose_from_matrix(to_pose(p, q))))


def play(q, path, seed: int, **settings) -> Robot:
    """Three seconds of a path, with targets every 4 ms."""
    config = DriverConfig(robot_ip="127.0.0.1", **settings)
    pauses = {kind: Pauses(kind, seed) for kind in ("process", "network", "robot")}
    memory, (ours, theirs) = SharedMemory.create(), socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    process, robot = ServoProcess(memory, ours, config, False), Robot(q, pauses)
    session = process.session
    session.robot, session.linked, session.sample = robot, True, robot.sample()
    session.start()
    session.watch.restart(robot.timestamp, 0.0)
    deadlines, due, targets = Deadlines(PERIOD, 0.0), 0.0, 0
    *start, orientation = (*session.sample.p, session.sample.orientation)
    while due < 3.0:
        now = pauses["process"].over(due)
        robot.run_until(now)
        if now >= 0.004 * targets:
            targets = 1 + int(now / 0.004)
            memory.write_target(TargetSlot(targets, now, *path(now, tuple(start), orientation)))
        if session.linked and session.reason:
            session.start()  # after a hold, for a pause that was too long
        process.tick(robot, now)
        due = deadlines.next(now + 1e-4)
    for wire in (ours, theirs):
        wire.close()
    memory.close()
    return robot


@pytest.mark.parametrize("seed", range(3))
def test_joints_keep_their_limit_at_a_singularity_whatever_pauses(seed: int) -> None:
    robot = play(SINGULAR, lambda t, p, q: (p, turned(q, (0.0, 0.0, min(0.5, 0.4 * t)))), seed, max_joint_speed=0.6)
    assert 0.5 < robot.top_joint <= 0.6


@pytest.mark.parametrize("seed", range(3))
def test_the_flange_keeps_its_limit_whatever_pauses(seed: int) -> None:
    def path(t, p, q):
        return (p[0], p[1] + 0.5 * (-1.0) ** int(t), p[2]), q

    robot = play(ELBOW_UP, path, seed)
    assert 0.2 < robot.top_speed <= 0.25


def test_no_two_commands_come_within_one_cycle_of_the_robot() -> None:
    robot = play(ELBOW_UP, lambda t, p, q: ((p[0], p[1] + 0.01 * t, p[2]), q), 5)
    assert np.diff(robot.sent).min() >= CLOSEST * PERIOD
