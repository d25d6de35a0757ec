# SPDX-License-Identifier: Apache-2.0
"""The command moves as the robot's clock does, whatever ours shows."""

import pytest

from seed_driver.config import DriverConfig
from seed_driver.motion.kinematics import arm_kinematics
from seed_driver.motion.servo_motion import Motion
from seed_driver.process.shared_memory import SharedMemory
from seed_driver.session import AHEAD, Session

DT = 0.002  # [s] the cycle


@pytest.fixture
def memory():
    made = SharedMemory.create()
    yield made
    made.close()


def steps(memory: SharedMemory, pace: float, cycles: int = 500) -> int:
    """Steps of motion in some cycles beside a robot whose clock runs at `pace` of ours."""
    config = DriverConfig(robot_ip="127.0.0.1")
    session = Session(Motion(memory, arm_kinematics(config), config), config, False)
    total = 0
    for i in range(cycles):
        session.clock = 7.0 + int(pace * i) * DT
        total += session.may_step()
    return total


@pytest.mark.parametrize("pace", [1.0, 0.5, 0.1])
def test_a_robot_gets_as_many_steps_as_its_clock_advances(memory, pace) -> None:
    assert steps(memory, pace) == pytest.approx(500 * pace, abs=AHEAD)


def test_a_robot_whose_clock_stands_still_gets_no_more_than_two_steps(memory) -> None:
    assert steps(memory, 0.0) == AHEAD


def test_a_robot_whose_clock_has_run_ahead_gets_one_step_per_cycle(memory) -> None:
    assert steps(memory, 10.0) == 500
