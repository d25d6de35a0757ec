# SPDX-License-Identifier: Apache-2.0
"""An arm that is not where it was sent: one that moves is braked, one that stands is left where it is."""

import pytest

from seed_driver.config import DriverConfig
from seed_driver.motion.calibrated_kinematics import arm_kinematics
from seed_driver.motion.servo_motion import ServoMotion
from seed_driver.process.shared_memory import RobotState, SharedMemory
from seed_driver.session import Session
from seed_testing.fault_bench.slider import ELBOW_UP
from seed_ur.kinematics import URKinematics

FAR = 0.035  # [m] beyond max_tracking_error
HERE = tuple(URKinematics.for_model("ur5e").forward(ELBOW_UP)[:3, 3].tolist())  # [m]
THERE = (HERE[0] - FAR, *HERE[1:])


@pytest.fixture
def session():
    memory = SharedMemory.create()
    config = DriverConfig(robot_ip="127.0.0.1")
    motion = ServoMotion(memory, arm_kinematics(config), config)
    motion.restart(RobotState(q=ELBOW_UP, p=THERE))
    motion.accept_targets()
    made = Session(motion, config, want_start=False)
    made.running = True
    yield made
    memory.close()


def test_the_command_does_not_jump_back_to_an_arm_that_moves(session) -> None:
    """States that the network delays by 0.1 s, or one that is wrong: the arm itself may be where it was sent."""
    command = session.motion.command
    session._compare(RobotState(q=ELBOW_UP, p=HERE, twist=(0.22, 0.0, 0.0, 0.0, 0.0, 0.0)))
    assert "the arm is 0.035 m from its command" in session.reason
    assert session.motion.command == command


def test_the_command_is_taken_back_to_an_arm_that_stands(session) -> None:
    here = RobotState(q=ELBOW_UP, p=HERE)
    session._compare(here)
    assert "the arm is 0.035 m from its command" in session.reason
    assert session.motion.command[0] == here.p


def test_a_pose_where_the_arm_cannot_be_does_not_become_the_command(session) -> None:
    """All of it zero, for one: the robot's program finds no joints for that, and ends."""
    command = session.motion.command
    session._compare(RobotState(q=ELBOW_UP))
    assert "m from its command" in session.reason
    assert session.motion.command == command
