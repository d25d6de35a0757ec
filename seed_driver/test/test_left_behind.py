# SPDX-License-Identifier: Apache-2.0
"""An arm that is not where it was sent: one that moves is braked, one that stands is left where it is."""

import pytest

from seed_core.arm.quaternion import as_quaternion
from seed_driver.config import DriverConfig
from seed_driver.motion.calibrated_kinematics import arm_kinematics
from seed_driver.motion.servo_motion import ServoMotion
from seed_driver.process.shared_memory import RobotState, SharedMemory, TargetSlot
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


def test_a_stop_at_a_slider_of_zero_is_at_rest(session) -> None:
    """The path's time stands still, in the middle of braking: freedrive and zero_ft said that the arm is moving."""
    turned = as_quaternion(URKinematics.for_model("ur5e").forward(ELBOW_UP)[:3, :3])
    session.motion.restart(RobotState(q=ELBOW_UP, p=HERE, orientation=turned))
    session.motion.memory.write_target(TargetSlot(1, 1.0, (HERE[0] + 0.02, *HERE[1:]), turned))
    session.motion.take_target(1.0)
    for _ in range(30):
        session.motion.step()
    place = HERE[0] + 5e-4, *HERE[1:]  # where the arm has come to
    stands = RobotState(q=ELBOW_UP, p=place, orientation=turned, speed_scaling=0.0)
    session.stop()
    session._compare(stands._replace(twist=(0.03, 0.0, 0.0, 0.0, 0.0, 0.0)))
    assert session.motion.command[0] != place  # it is still on the way
    session._compare(stands)
    session._need_rest()
    assert session.motion.command[0] == place
