# SPDX-License-Identifier: Apache-2.0
"""Rotations in tuples against SciPy's and against the matrices of the core."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from seed_control.command.limiter import PoseLimiter, VectorLimiter
from seed_core.quaternion import pose_of, quaternion, turn_between, turned_on
from seed_core.spatial import make_pose, so3_exp
from seed_core.vector3 import Triple, triple

RNG = np.random.default_rng(4)
ANGLES = [0.0, 1e-9, 1e-7, 0.01, 0.2, 1.5, 3.1]  # [rad]


def turn_of(angle: float) -> Triple:
    axis = RNG.standard_normal(3)
    return triple(angle * axis / np.linalg.norm(axis))


@pytest.mark.parametrize("angle", ANGLES)
def test_turning_on_is_the_exponential_map_from_the_left(angle: float) -> None:
    R, step = Rotation.random(random_state=3).as_matrix(), turn_of(angle)
    q = turned_on(quaternion(R), step)
    turned = pose_of(q, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))[:3, :3]
    assert_allclose(turned, Rotation.from_rotvec(step).as_matrix() @ R, atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_turn_between_leads_from_one_to_the_other(angle: float) -> None:
    R, step = Rotation.random(random_state=5).as_matrix(), turn_of(angle)
    goal, now = quaternion(so3_exp(step) @ R), quaternion(R)
    turn = np.array(turn_between(goal, now))
    size = np.sin(angle) if angle < np.deg2rad(12.0) else angle
    assert_allclose(turn, size * np.array(step) / max(angle, 1e-300), atol=1e-12)
    assert_allclose(turn_between(tuple(-v for v in goal), now), turn, atol=1e-15)  # type: ignore[arg-type]


def test_pose_puts_the_point_of_the_body_in_its_place() -> None:
    R, arm, p = Rotation.random(random_state=8).as_matrix(), (0.1, -0.2, 0.3), (1.0, 2.0, 3.0)
    X = pose_of(quaternion(R), p, arm)
    assert_allclose(X[:3, :3], R, atol=1e-14)
    assert_allclose(X @ (*arm, 1.0), (*p, 1.0), atol=1e-14)
    assert_allclose(X[3], (0.0, 0.0, 0.0, 1.0), atol=0.0)


def test_body_turns_about_its_limited_point() -> None:
    """The point's speed is what is limited, so a pure turn leaves it where it is and swings the body's origin."""
    arm = (0.0, 0.0, 0.15)
    body = PoseLimiter(VectorLimiter(0.25, 2.0, 200.0, 80.0), VectorLimiter(0.5, 6.0, 600.0, 80.0), arm)
    body.reset(make_pose(None, (0.4, 0.0, 0.3)))
    goal = quaternion(so3_exp((0.0, 0.4, 0.0)))
    for _ in range(500):
        body.advance(body.p, goal, 0.004, 0.25)
    assert_allclose((body.pose @ (*arm, 1.0))[:3], (0.4, 0.0, 0.45), atol=1e-12)
    assert_allclose(body.pose[0, 3], 0.4 - 0.15 * np.sin(0.4), atol=1e-6)
