# SPDX-License-Identifier: Apache-2.0
"""The servo process counts time as the robot does where the robot is a simulation, and by its own clock elsewhere."""

import pytest

from seed_driver.config import DriverConfig
from seed_driver.kinematics import arm_kinematics
from seed_driver.motion import Motion
from seed_driver.session import Session
from seed_driver.shared import SharedMemory

DT = 0.002  # [s] the cycle, and between states every other time


@pytest.fixture
def memory():
    made = SharedMemory.create()
    yield made
    made.close()


def steps(memory: SharedMemory, simulated: bool, pace: float, cycles: int = 500) -> int:
    """Steps of motion in some cycles beside a robot whose clock runs at `pace` of ours."""
    config = DriverConfig(robot_ip="127.0.0.1", simulated=simulated)
    session = Session(Motion(memory, arm_kinematics(config), config), config, False)
    total = 0
    for i in range(cycles):
        now = 100.0 + i * DT
        if i % 2 == 0:
            session.watch.update(7.0 + pace * i * DT, now)
        count = session.steps_due(now)
        total += count if i else 0  # the first look only finds out what time it is there
    return total


def test_a_real_robot_gets_one_step_per_cycle(memory) -> None:
    assert steps(memory, False, 1.0) == 499
    assert steps(memory, False, 0.5) == 499


@pytest.mark.parametrize("pace", [1.0, 0.5, 0.1])
def test_a_simulated_robot_gets_as_many_steps_as_its_clock_advances(memory, pace) -> None:
    assert steps(memory, True, pace) == pytest.approx(499 * pace, abs=3)


def test_a_simulated_robot_that_stands_still_gets_none(memory) -> None:
    assert steps(memory, True, 0.0) <= 2
