# SPDX-License-Identifier: Apache-2.0
"""A target's way to the command: only new targets are followed, silence and the end of the reach are latched holds."""

import math

import numpy as np
import pytest

from seed_core.arm.quaternion import as_quaternion, to_pose, turned
from seed_core.vector3 import as_vector3
from seed_driver.config import DriverConfig
from seed_driver.motion.calibrated_kinematics import arm_kinematics
from seed_driver.motion.servo_motion import COMMANDED, ServoMotion
from seed_driver.process.shared_memory import RobotState, SharedMemory, TargetSlot

DT = 0.002  # [s]
ELBOW_UP = (0.0, -1.7, 2.1, -1.97, -1.57, 0.0)  # [rad]
SINGULAR = (0.0, -1.6, 1.9, -1.9, -0.12, 0.0)  # the wrist's axes are almost in line


class Run:
    """A motion by a steady clock, from rest at joint angles q."""

    def __init__(self, memory: SharedMemory, q=ELBOW_UP, **settings) -> None:
        config = DriverConfig(robot_ip="127.0.0.1", **settings)
        self.memory, self.arm, self.now, self.number = memory, arm_kinematics(config), 5.0, 0
        self.motion = ServoMotion(memory, self.arm, config)
        X_WE = self.arm.forward(q)
        self.p, self.q = as_vector3(X_WE[:3, 3]), as_quaternion(X_WE[:3, :3])
        self.motion.restart(RobotState()._replace(q=q, p=self.p, orientation=self.q))
        self.commands = [(self.p, self.q)]

    def target(self, p, q=None) -> None:
        self.number += 1
        self.memory.write_target(TargetSlot(self.number, self.now, p, self.q if q is None else q))

    def steps(self, count: int, p=None, q=None, share: float = 1.0) -> None:
        for _ in range(count):
            self.now += DT
            if p is not None:
                self.target(p, q)
            self.motion.take_target(self.now)
            self.motion.step(share)
            self.commands.append(self.motion.command)

    def along_y(self, way: float) -> tuple[float, float, float]:
        return self.p[0], self.p[1] + way, self.p[2]


@pytest.fixture
def memory():
    made = SharedMemory.create()
    yield made
    made.close()


def test_a_target_of_the_past_is_not_followed(memory) -> None:
    run = Run(memory)
    run.target(run.along_y(0.02))
    run.motion.accept_targets()
    run.steps(100)
    assert run.commands[-1] == run.commands[0]
    assert not run.motion.latch.reason
    assert not run.motion.latch.following
    run.steps(400, run.along_y(0.02))
    assert run.commands[-1][0] == pytest.approx(run.along_y(0.02), abs=1e-6)


def test_nothing_is_followed_before_targets_are_accepted(memory) -> None:
    run = Run(memory)
    run.steps(100, run.along_y(0.02))
    assert run.commands[-1] == run.commands[0]
    assert run.motion.latch.reason == "starting"


@pytest.mark.parametrize("way", [0.002, 0.01, 0.02, 0.04])
@pytest.mark.parametrize("every", [1, 4])
def test_a_constant_target_is_never_passed(memory, way: float, every: int) -> None:
    run = Run(memory)
    run.motion.accept_targets()
    for _ in range(600 // every):
        run.target(run.along_y(way))
        run.steps(every)
    assert max(p[1] for p, _ in run.commands) == pytest.approx(run.p[1] + way, abs=1e-6)


def test_silence_is_a_latched_hold(memory) -> None:
    run = Run(memory)
    run.motion.accept_targets()
    run.steps(60, run.along_y(0.04))
    run.steps(50)
    assert not run.motion.latch.reason  # 0.1 s
    run.steps(2)
    assert run.motion.latch.reason == "no target_frame for 0.1 s"
    run.steps(200, run.along_y(0.04))
    assert run.motion.limiter.still
    rest = run.commands[-1]
    run.motion.accept_targets()
    run.steps(500, run.along_y(0.04))
    assert run.commands[-1][0] == pytest.approx(run.along_y(0.04), abs=1e-6)
    assert math.dist(rest[0], run.along_y(0.04)) > 0.001


def test_a_command_that_stands_still_already_is_at_rest_there(memory) -> None:
    """The link was lost in motion: the arm stands where the last command was, not where braking would have led."""
    run = Run(memory)
    run.motion.accept_targets()
    run.steps(60, run.along_y(0.04))
    stood = run.commands[-1]
    run.motion.hold("link lost")
    run.motion.halt()
    run.steps(50)
    assert run.commands[-1] == stood


def test_accepting_targets_again_does_not_disturb_a_motion(memory) -> None:
    """Another resend_robot_program while the arm moves."""
    runs = []
    for again in (False, True):
        run = Run(memory)
        run.motion.accept_targets()
        run.number = 1000 * len(runs)  # the memory is the same
        run.steps(60, run.along_y(0.04))
        if again:
            run.motion.accept_targets()
        run.steps(100, run.along_y(0.04))
        runs.append(run.commands)
    assert runs[0] == runs[1]


def test_the_end_of_the_reach_is_a_hold_with_its_reason(memory) -> None:
    run = Run(memory, max_joint_speed=3.0)
    run.motion.accept_targets()
    for i in range(4000):
        run.steps(1, (run.p[0] - min(0.9, 2e-4 * i), run.p[1], run.p[2]))
    assert "out of reach of the ur5e" in run.motion.latch.reason
    assert run.motion.limiter.still


def test_no_joint_is_commanded_faster_than_its_limit_near_a_singularity(memory) -> None:
    run = Run(memory, SINGULAR, max_joint_speed=0.6)
    run.motion.accept_targets()
    for i in range(1000):
        run.steps(1, run.p, turned(run.q, (0.0, 0.0, min(0.5, 0.4 * i * DT))))
    joints = [list(SINGULAR)]
    for p, q in run.commands:
        joints.append(run.arm.follow(to_pose(p, q), joints[-1]))
    speeds = np.abs(np.diff(joints, axis=0)) / DT
    assert 0.5 < speeds.max() <= COMMANDED * 0.6 * 1.02  # the smoothing is of poses, not of joints


def test_a_robot_that_is_scaled_down_is_sent_along_the_same_path_more_slowly(memory) -> None:
    runs = []
    for share in (1.0, 0.25):
        run = Run(memory)
        run.motion.accept_targets()
        run.number = 1000 * len(runs)  # the memory is the same
        run.target(run.along_y(0.02))
        run.motion.latch.patience = 10.0
        run.steps(int(400 / share), share=share)
        runs.append(np.array([p for p, _ in run.commands]))
    full, quarter = runs
    np.testing.assert_allclose(quarter[::4], full, atol=1e-9)
    assert (
        np.linalg.norm(np.diff(quarter, axis=0), axis=1).max()
        <= 0.26 * np.linalg.norm(np.diff(full, axis=0), axis=1).max()
    )


@pytest.mark.parametrize("share", [0.5, 0.1, 0.01])
def test_a_hold_brakes_by_the_time_of_the_wall(memory, share) -> None:
    """At 10 % the arm must not creep on for ten times as long."""
    run = Run(memory)
    run.motion.accept_targets()
    for i in range(200):
        run.steps(1, run.along_y(0.2 * i * DT))
    start = len(run.commands)
    run.steps(1, run.along_y(0.2 * 200 * DT), share=share)
    run.motion.hold("stopped on request")
    run.steps(int(2.0 / DT), share=share)
    way = np.array([p[1] for p, _ in run.commands[start:]])
    c = run.motion.limiter.limits
    braking = (c.max_speed * share) ** 2 / 2.0 / c.max_acceleration
    smoothing = c.max_speed * c.max_acceleration / c.max_jerk
    assert way[-1] - way[0] <= braking + smoothing + 2.0 * DT * c.max_speed
    assert way[-1] == pytest.approx(way[-2 - int(1.0 / DT)], abs=1e-6)


@pytest.mark.parametrize("ahead", [0.001, -0.05])
def test_before_a_workspace_that_is_narrowed_in_motion_it_brakes_within_its_limits(memory, ahead: float) -> None:
    """Its side lies 1 mm ahead, or 5 cm behind; once it has come to rest, it goes no further out."""
    run, way = Run(memory), 0.0
    run.motion.accept_targets()
    for _ in range(250):
        way += 0.2 * DT
        run.steps(1, run.along_y(way))
    side = run.commands[-1][0][1] + ahead
    run.motion.configure(DriverConfig(robot_ip="127.0.0.1", workspace_high=(1.4, side, 1.6)))
    start = len(run.commands)
    for _ in range(250):
        way += 0.2 * DT
        run.steps(1, run.along_y(way))
    y = np.array([p[1] for p, _ in run.commands])
    assert fastest_change(run) <= 1.1
    speed = run.motion.limiter.limits.max_speed
    assert y.max() - y[start - 1] < speed**2 / 2.0 / 0.7 + 0.008 * speed  # braking, and the smoothing
    assert y[-1] == y[-50]
    run.steps(1500, (run.p[0], side - 0.02, run.p[2]))
    run.steps(1500, run.along_y(way))
    assert run.commands[-1][0][1] == pytest.approx(side, abs=1e-5)
    assert run.commands[-1][0][1] <= side + 1e-9


def test_a_joint_speed_that_is_lowered_in_motion_brakes_within_the_limits(memory) -> None:
    run, way = Run(memory), 0.0
    run.motion.accept_targets()
    joints = []
    for i in range(1000):
        way += 0.2 * DT if i < 300 else 0.05 * DT
        if i == 250:
            run.motion.configure(DriverConfig(robot_ip="127.0.0.1", max_joint_speed=0.1))
        run.steps(1, run.along_y(way))
        joints.append(run.arm.follow(to_pose(*run.commands[-1]), joints[-1] if joints else list(ELBOW_UP)))
    speeds = np.abs(np.diff(joints, axis=0)).max(axis=1) / DT
    assert fastest_change(run) <= 1.1
    assert speeds[200] > 0.2
    assert 0.05 < speeds[600:].max() <= COMMANDED * 0.1 * 1.02


def fastest_change(run: Run) -> float:
    """Largest acceleration [m/s^2] that was commanded."""
    p = np.array([p for p, _ in run.commands])
    return float(np.linalg.norm(np.diff(p, 2, axis=0), axis=1).max()) / DT**2


@pytest.mark.parametrize("phase", range(4))
def test_after_a_restart_elsewhere_the_first_step_is_looked_at(memory, phase: int) -> None:
    """Far from a singularity steps pass without a look; at one, where the arm was put meanwhile, none may."""
    run = Run(memory)
    run.motion.accept_targets()
    run.steps(100 + phase, run.along_y(0.02))
    X_WE = run.arm.forward(SINGULAR)
    p, q = as_vector3(X_WE[:3, 3]), as_quaternion(X_WE[:3, :3])
    run.motion.restart(RobotState()._replace(q=SINGULAR, p=p, orientation=q))
    before = list(run.motion.joints.q)
    run.steps(1, p, turned(q, (0.0, 0.0, 0.1)))
    assert run.motion.joints.q != before


@pytest.mark.parametrize("joint_speed", [1.0, 0.1])
@pytest.mark.parametrize("q", [ELBOW_UP, (0.37, -0.65, 0.001, -0.95, -1.5, 0.47)], ids=["elbow up", "stretched"])
@pytest.mark.parametrize("off", [0.0005, 0.005, 0.02])
def test_an_arm_that_is_not_quite_our_model_is_led_all_the_same(memory, joint_speed: float, q, off: float) -> None:
    """Every UR has a calibration of its own: without its file our model has other joints for the robot's pose."""
    run = Run(memory, q=q, max_joint_speed=joint_speed)
    inward = -np.array(run.p) / np.linalg.norm(run.p)
    p = as_vector3(np.array(run.p) + off * inward)
    run.motion.restart(RobotState()._replace(q=q, p=p, orientation=run.q))
    run.motion.accept_targets()
    goal = as_vector3(np.array(p) + 0.01 * inward)
    run.steps(1500, goal)
    assert run.motion.latch.reason == ""
    np.testing.assert_allclose(run.motion.command[0], goal, atol=1e-5)
    fastest = np.linalg.norm(np.diff([c for c, _ in run.commands[1:]], axis=0), axis=1).max() / DT
    assert fastest <= 0.25


def test_joints_of_our_model_are_not_taken_where_it_reaches_the_pose_with_the_arm_bent_otherwise_only(memory) -> None:
    """A stretched arm whose own calibration reaches half a millimetre further: clearances were those of another arm."""
    q = (0.37, -0.65, 0.001, -0.95, -1.5, 0.47)
    run = Run(memory, q=q)
    outward = np.array(run.p) / np.linalg.norm(run.p)
    p = as_vector3(np.array(run.p) + 0.0005 * outward)
    run.motion.restart(RobotState()._replace(q=q, p=p, orientation=run.q))
    assert run.motion.joints.q == list(q)
    run.motion.accept_targets()
    run.steps(400, as_vector3(np.array(p) - 0.03 * outward))
    assert "only with its joints turned over" in run.motion.latch.reason
    assert math.dist(run.motion.command[0], p) < 1e-6


def test_an_arm_that_could_go_on_only_with_its_joints_turned_over_says_so(memory) -> None:
    """It stood there without a reason, as long as the target was near enough to be accepted."""
    run = Run(memory)
    run.motion.accept_targets()
    run.motion.joints.restart((1.0, *ELBOW_UP[1:]))  # as at the end of a branch: every way on is a jump
    run.steps(240, run.along_y(0.02))
    assert run.motion.latch.reason == ""
    run.steps(20, run.along_y(0.02))
    assert "only with its joints turned over" in run.motion.latch.reason
    assert np.abs(np.array([p for p, _ in run.commands]) - run.p).max() < 1e-6
