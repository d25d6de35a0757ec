# SPDX-License-Identifier: Apache-2.0
"""Rotations in tuples against SciPy's and against the matrices of the core."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from seed_core.arm.quaternion import (
    IDENTITY,
    as_quaternion,
    continued,
    from_rotation_vector,
    inverse,
    multiply,
    rotate,
    rotation_vector,
    to_pose,
    turn_between,
    turn_towards,
    turned,
)
from seed_core.spatial import so3_exp
from seed_core.vector3 import ZERO, Vector3, as_vector3

RNG = np.random.default_rng(4)
ANGLES = [0.0, 1e-9, 1e-7, 0.01, 0.2, 1.5, 3.1]  # [rad]


def turn_of(angle: float) -> Vector3:
    axis = RNG.standard_normal(3)
    return as_vector3(angle * axis / np.linalg.norm(axis))


@pytest.mark.parametrize("angle", ANGLES)
def test_turning_on_is_the_exponential_map_from_the_left(angle: float) -> None:
    R, step = Rotation.random(random_state=3).as_matrix(), turn_of(angle)
    q = turned(as_quaternion(R), step)
    assert_allclose(to_pose(ZERO, q)[:3, :3], Rotation.from_rotvec(step).as_matrix() @ R, atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_turn_between_leads_from_one_to_the_other(angle: float) -> None:
    R, step = Rotation.random(random_state=5).as_matrix(), turn_of(angle)
    goal, now = as_quaternion(so3_exp(step) @ R), as_quaternion(R)
    turn = np.array(turn_between(goal, now))
    assert_allclose(turn, step, atol=1e-14 / max(np.pi - angle, 0.1))  # ill-conditioned near half a turn
    assert_allclose(turn_between(tuple(-v for v in goal), now), turn, atol=1e-15)  # type: ignore[arg-type]


@pytest.mark.parametrize("angle", ANGLES)
def test_turn_towards_steers_there_with_the_sine_for_a_small_angle(angle: float) -> None:
    goal, start = turned(IDENTITY, turn_of(angle)), IDENTITY
    share = np.sin(angle) / max(angle, 1e-300) if angle < np.deg2rad(12.0) else 1.0
    assert_allclose(turn_towards(goal, start), share * np.array(turn_between(goal, start)), atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_unit_quaternions_are_a_group_that_acts_as_the_matrices_do(angle: float) -> None:
    a, b, c = (from_rotation_vector(turn_of(angle)) for _ in range(3))
    R_a, R_b = to_pose(ZERO, a)[:3, :3], to_pose(ZERO, b)[:3, :3]
    assert_allclose(multiply(multiply(a, b), c), multiply(a, multiply(b, c)), atol=1e-15)
    assert_allclose(multiply(a, IDENTITY), a, atol=0.0)
    assert_allclose(multiply(a, inverse(a)), IDENTITY, atol=1e-15)
    assert_allclose(to_pose(ZERO, multiply(a, b))[:3, :3], R_a @ R_b, atol=1e-15)
    assert_allclose(rotate(a, (1.0, -2.0, 3.0)), R_a @ (1.0, -2.0, 3.0), atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_logarithm_inverts_the_exponential(angle: float) -> None:
    vector = turn_of(angle)
    q = from_rotation_vector(vector)
    assert_allclose(q, Rotation.from_rotvec(vector).as_quat(), atol=1e-15)
    assert_allclose(rotation_vector(q), vector, rtol=1e-13, atol=1e-24)


@pytest.mark.parametrize(
    "parts", [(1, 0, 0, 0), (0, 1, 0, 0), (0, -1, 1, 0), (1, -1, 1, 1), (-2, 1, 0, 0), (0, 0, 2, -1)]
)
def test_noise_does_not_decide_between_the_two_quaternions_of_a_rotation(parts: tuple[float, ...]) -> None:
    q, before = Rotation.from_quat(parts), None
    first = continued(as_quaternion(q.as_matrix()), None)
    for _ in range(50):
        R = (Rotation.from_rotvec(0.02 * RNG.standard_normal(3)) * q).as_matrix()
        for near in (continued(as_quaternion(R), None), continued(as_quaternion(R), before)):
            assert_allclose(Rotation.from_quat(near).as_matrix(), R, atol=1e-12)
            assert_allclose(near, first, atol=0.06)
        before = near


def test_a_quaternion_goes_on_through_whole_turns() -> None:
    q = continued(IDENTITY, None)
    for k in range(1, 101):  # one turn: to the other quaternion of the same rotation
        q = continued(as_quaternion(so3_exp((0.0, 0.0, 0.02 * np.pi * k))), q)
        assert_allclose(q, (0.0, 0.0, np.sin(0.01 * np.pi * k), np.cos(0.01 * np.pi * k)), atol=1e-12)


def test_a_million_small_turns_leave_a_unit_quaternion() -> None:
    q = IDENTITY
    for _ in range(1_000_000):
        q = turned(q, (1e-3, -2e-3, 1e-3))
    assert abs(np.linalg.norm(q) - 1.0) < 1e-15


def test_pose_puts_the_point_of_the_body_in_its_place() -> None:
    R, arm, p = Rotation.random(random_state=8).as_matrix(), (0.1, -0.2, 0.3), (1.0, 2.0, 3.0)
    X = to_pose(p, as_quaternion(R), arm)
    assert_allclose(X[:3, :3], R, atol=1e-14)
    assert_allclose(X @ (*arm, 1.0), (*p, 1.0), atol=1e-14)
    assert_allclose(X[3], (0.0, 0.0, 0.0, 1.0), atol=0.0)
