# SPDX-License-Identifier: Apache-2.0
"""Targets that are no poses, old, far away or unreachable do not pass, and the refusal carries the number."""

import math

import pytest

from seed_core.arm.target_checks import Target, refusal
from seed_core.quaternion import from_rotation_vector
from seed_driver.config import DriverConfig
from seed_driver.motion.kinematics import out_of_reach
from seed_driver.target_guard import GuardConfig, TargetGuard
from seed_ur.kinematics import URKinematics

ARM = URKinematics.for_model("ur5e")
JOINTS = [0.0, -1.7, 2.1, -1.97, -math.pi / 2, 0.0]
HERE = (-0.40610, -0.1333, 0.33155)
DOWN = from_rotation_vector((2.2210432, 2.2210432, 0.0008843))
CONFIG = DriverConfig(robot_ip="127.0.0.9")


def check(target: Target, command) -> str:
    return refusal(target, command, CONFIG) or out_of_reach(target, ARM, JOINTS)


def say(**changes) -> str:
    target = Target(**{"frame": "base", "age": 0.003, "p": HERE, "q": DOWN, **changes})
    return check(target, (HERE, DOWN))


def test_a_target_here_and_now_passes() -> None:
    assert not say()
    assert not say(p=(HERE[0], HERE[1] + 0.04, HERE[2]))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"p": (math.nan, 0.0, 0.0)}, "not finite"),
        ({"q": (0.0, 0.0, math.inf, 1.0)}, "not finite"),
        ({"q": (0.0, 0.0, 0.0, 0.0)}, "length 0.0000, must be 1"),
        ({"q": (0.0, 0.0, 0.0, 1.1)}, "length 1.1000, must be 1"),
        ({"frame": "base_link"}, "frame 'base_link', must be 'base'"),
        ({"age": 0.5}, "stamp is 0.500 s old, limit 0.1 s"),
        ({"age": -0.5}, "0.500 s ahead of this computer's clock"),
        ({"p": (HERE[0], HERE[1] + 1.0, HERE[2])}, "jumps 1 m from the command, limit 0.05 m"),
        ({"p": (HERE[0], HERE[1], 1.7)}, "z = 1.7 m leaves the workspace -0.6 to 1.6 m"),
    ],
)
def test_a_bad_target_is_refused_with_the_number(changes, reason) -> None:
    assert reason in say(**changes)


def test_a_quarter_turn_is_refused_as_a_jump() -> None:
    target = Target("base", 0.0, HERE, from_rotation_vector((0.0, 0.0, math.pi / 2)))
    assert "jumps 90.0 degrees" in check(target, (HERE, (0, 0, 0, 1)))


def test_a_target_out_of_reach_is_refused() -> None:
    far = (-0.95, -0.1333, 0.33)
    target = Target("base", 0.0, far, DOWN)
    assert "out of reach of the ur5e" in check(target, (far, DOWN))


def test_the_quaternion_of_either_sign_is_the_same_rotation() -> None:
    assert not say(q=tuple(-t for t in DOWN))


@pytest.mark.parametrize(
    "pose", [((math.nan, 0.0, 0.0), DOWN), (HERE, (0.0, 0.0, 0.0, 0.0)), (HERE, (math.nan, 0.0, 0.0, 1.0))]
)
def test_the_guard_does_not_start_from_what_is_no_pose(pose) -> None:
    guard = TargetGuard(GuardConfig())
    guard.measured(pose, 1.0)
    assert "no current_pose" in guard.resume(1.0)
    guard.measured((HERE, DOWN), 1.0)
    assert guard.resume(1.0) == ""
