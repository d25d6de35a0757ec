# SPDX-License-Identifier: Apache-2.0
"""The stand-in's arm: its servo, straight moves and braking, and where it is placed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.spatial import make_pose
from seed_ur.kinematics import URKinematics
from seed_ur.pose import matrix_from_pose, pose_from_matrix
from seed_ur.standin.arm import Arm, Hold, Move, Servo
from seed_ur.standin.controller import Controller
from seed_ur.standin.options import HOME, Options

KINEMATICS = URKinematics.for_model("ur5e")
DT = 0.002


def test_the_servo_lags_by_what_is_documented() -> None:
    """A ramp of joint angles at lookahead 0.03 s and gain 300 comes 36 ms later: 2/wn = 30 ms, and 6 ms."""
    arm, speed = Arm(KINEMATICS, HOME), 0.2
    arm.motion = servo = Servo(HOME, 0.03, 300.0)
    for i in range(500):
        servo.goal = [HOME[0] + speed * DT * i, *HOME[1:]]
        arm.step(DT)
    assert (servo.goal[0] - arm.q[0]) / speed == pytest.approx(0.036, abs=0.003)
    assert arm.qd[0] == pytest.approx(speed, rel=1e-3)


@pytest.mark.parametrize("scale", [0.5, 0.01])
def test_a_scaled_servo_moves_along_the_same_path_in_its_own_time(scale: float) -> None:
    """A goal that jumps: at 1 % the arm goes there a hundred times as slowly, and looks for a new one every 0.2 s."""
    arms = Arm(KINEMATICS, HOME), Arm(KINEMATICS, HOME)
    arms[1].slider = scale
    goal = [HOME[0] + 0.02, *HOME[1:]]
    for arm in arms:
        arm.motion = Servo(goal, 0.03, 2000.0)
    for _ in range(10):
        arms[0].step(DT)
        for _ in range(round(1.0 / scale)):
            arms[1].step(DT)
        assert arms[1].target_q[0] - HOME[0] == pytest.approx(arms[0].target_q[0] - HOME[0], abs=1e-3)
    moving = arms[1].target_qd[0]
    arms[1].motion.take(HOME, 0.03, 2000.0)
    arms[1].step(DT)
    assert arms[1].target_qd[0] == pytest.approx(moving, rel=0.1)


def test_a_placed_arm_keeps_its_slider_and_forgets_how_the_last_one_reached() -> None:
    robot = Controller(Options())
    pose = robot.arm.tcp_pose()
    robot.write_inputs({"speed_slider_mask": 1, "speed_slider_fraction": 0.4}, 0.0)
    here = robot.servo_goal(pose)
    robot.arm.set_tcp(make_pose(None, (0.0, 0.0, 0.1)))
    flange = matrix_from_pose(pose) @ make_pose(None, (0.0, 0.0, -0.1))
    assert_allclose(KINEMATICS.forward(robot.servo_goal(pose)), flange, atol=1e-9)
    robot.arm.set_tcp(np.eye(4))
    far = [HOME[0] - 0.3, *HOME[1:]]
    robot.place(pose_from_matrix(KINEMATICS.forward(far)), far)
    flipped = [*HOME[:3], HOME[3] + 1e-3, HOME[4], HOME[5] + 2.0 * np.pi]
    robot.place(pose, flipped)
    assert_allclose(robot.servo_goal(pose), robot.arm.q, atol=1e-6)
    assert abs(robot.servo_goal(pose)[5] - here[5]) > 6.0
    assert robot.arm.slider == 0.4


def test_a_servo_step_keeps_joint_limits_and_does_not_overshoot() -> None:
    arm = Arm(KINEMATICS, HOME)
    arm.motion = Servo([HOME[0] + 1.5, *HOME[1:]], 0.03, 2000.0)
    reached, fastest = [], 0.0
    for _ in range(1500):
        arm.step(DT)
        reached.append(arm.q[0])
        fastest = max(fastest, abs(arm.target_qd[0]))
    assert fastest <= KINEMATICS.model.speed[0] + 1e-12
    assert_allclose(reached[-1], HOME[0] + 1.5, atol=1e-6)
    assert np.isfinite(reached).all()


def test_straight_moves_are_straight_and_take_the_time_of_their_trapezoid() -> None:
    arm = Arm(KINEMATICS, HOME)
    start = arm.tcp_pose()
    goal = (start[0] - 0.1, start[1] + 0.05, start[2], *start[3:])
    arm.motion = move = Move(arm, goal, 0.1, 0.5, cartesian=True)
    steps, away = 0, 0.0
    line = np.subtract(goal[:3], start[:3]) / np.linalg.norm(np.subtract(goal[:3], start[:3]))
    while not move.done:
        arm.step(DT)
        steps += 1
        off = np.subtract(arm.target_tcp_pose()[:3], start[:3])
        away = max(away, float(np.linalg.norm(off - line * (off @ line))))
    length = np.hypot(0.1, 0.05)
    assert steps * DT == pytest.approx(length / 0.1 + 0.1 / 0.5, abs=0.01)
    assert away < 1e-6
    assert_allclose(arm.target_tcp_pose(), goal, atol=1e-6)


def test_holding_brakes_every_joint_in_proportion() -> None:
    arm = Arm(KINEMATICS, HOME)
    arm.target_qd = [0.5, -0.25, 0.1, 0.0, 0.0, 0.0]
    arm.motion = hold = Hold(10.0)
    time = 0.0
    while not hold.done:
        arm.step(DT)
        time += DT
    assert time == pytest.approx(0.05, abs=0.005)
