# SPDX-License-Identifier: Apache-2.0
"""The robot keeps the limits when the servo process, the network or the robot pauses and what was late comes at once.

By simulated time, so that every pause is there in every run; robot and servo process are those of the real tests.
"""

import numpy as np
import pytest

from seed_core.arm.quaternion import turned
from seed_driver.process.cycle_timing import CLOSEST
from seed_testing.fault_bench.rig import CALM, PERIOD, RigRobot, play

SINGULAR = (0.0, -1.6, 1.9, -1.9, -0.12, 0.0)  # [rad] the wrist's axes are almost in line
ELBOW_UP = (0.0, -1.7, 2.1, -1.97, -1.57, 0.0)


def paused(q, path, seed: int, **settings) -> RigRobot:
    return play(q, path, pauses=CALM, seed=seed, **settings)[0]


@pytest.mark.parametrize("seed", range(3))
def test_joints_keep_their_limit_at_a_singularity_whatever_pauses(seed: int) -> None:
    robot = paused(SINGULAR, lambda t, p, q: (p, turned(q, (0.0, 0.0, min(0.5, 0.4 * t)))), seed, max_joint_speed=0.6)
    assert 0.5 < robot.top_joint <= 0.6


@pytest.mark.parametrize("seed", range(3))
def test_the_flange_keeps_its_limit_whatever_pauses(seed: int) -> None:
    def path(t, p, q):
        return (p[0], p[1] + 0.5 * (-1.0) ** int(t), p[2]), q

    robot = paused(ELBOW_UP, path, seed)
    assert 0.2 < robot.top_speed <= 0.25


def test_no_two_commands_come_within_one_cycle_of_the_robot() -> None:
    robot = paused(ELBOW_UP, lambda t, p, q: ((p[0], p[1] + 0.01 * t, p[2]), q), 5)
    assert np.diff(robot.sent).min() >= CLOSEST * PERIOD
