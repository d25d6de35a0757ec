# SPDX-License-Identifier: Apache-2.0
"""Spatial algebra against SciPy and its own laws, near nothing and near half a turn as well."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from seed_core.spatial import (
    SpatialError,
    Wrench,
    both,
    check_pose,
    cross,
    interpolate_pose,
    inverse_pose,
    make_pose,
    motion_adjoint,
    pose_from_quaternion,
    pose_from_rpy,
    quaternion_from_rotation,
    rotation_error,
    rotation_from_rpy,
    rpy_from_rotation,
    skew,
    so3_exp,
    so3_log,
    wrench_adjoint,
)

RNG = np.random.default_rng(2)
ANGLES = [0.0, 1e-12, 1e-7, 1.1e-6, 1e-3, 0.5, 2.0, 3.0, np.pi - 1e-3, np.pi - 1e-7]


def rotation_vectors(angle: float, count: int = 30) -> np.ndarray:
    axes = RNG.normal(size=(count, 3))
    return angle * axes / np.linalg.norm(axes, axis=1)[:, None]


def random_poses(count: int) -> list[np.ndarray]:
    return [pose_from_rpy(RNG.uniform(-1.4, 1.4, 3), RNG.normal(size=3)) for _ in range(count)]


@pytest.mark.parametrize("angle", ANGLES)
def test_exponential_is_scipys_and_the_logarithm_inverts_it(angle: float) -> None:
    for v in rotation_vectors(angle):
        R = so3_exp(v)
        assert_allclose(R, Rotation.from_rotvec(v).as_matrix(), atol=1e-15)
        assert_allclose(so3_log(R), v, atol=1e-9 if angle > 3.1 else 2e-15)  # a sine loses digits near half a turn


@pytest.mark.parametrize("scale", [1e-12, 1e-7, 0.3, 1.5])
def test_rpy_is_fixed_axis_xyz_and_comes_back(scale: float) -> None:
    for rpy in scale * RNG.uniform(-1, 1, (50, 3)):
        R = rotation_from_rpy(rpy)
        assert_allclose(R, Rotation.from_euler("xyz", rpy).as_matrix(), atol=1e-15)
        assert_allclose(rpy_from_rotation(R), rpy, atol=1e-14)


def test_rpy_of_the_inverse_is_not_the_negative() -> None:
    rpy = np.array((0.3, -0.4, 0.5))
    assert np.abs(rpy_from_rotation(rotation_from_rpy(rpy).T) + rpy).max() > 0.05


def test_poses_form_a_group() -> None:
    for A, B in zip(random_poses(20), random_poses(20), strict=True):
        assert_allclose(inverse_pose(A) @ A, np.eye(4), atol=1e-15)
        assert_allclose(inverse_pose(A @ B), inverse_pose(B) @ inverse_pose(A), atol=1e-14)


def test_interpolation_starts_ends_and_halves() -> None:
    for A, B in zip(random_poses(20), random_poses(20), strict=True):
        assert_allclose(interpolate_pose(A, B, 0.0), A, atol=1e-15)
        assert_allclose(interpolate_pose(A, B, 1.0), B, atol=1e-12)
        half = interpolate_pose(A, B, 0.5)
        assert_allclose(rotation_error(half[:3, :3], A[:3, :3]), rotation_error(B[:3, :3], half[:3, :3]), atol=1e-9)


def test_power_of_a_wrench_does_not_depend_on_point_or_frame() -> None:
    for X in random_poses(30):
        R, p = X[:3, :3], X[:3, 3]
        load = Wrench(RNG.normal(size=3), RNG.normal(size=3))
        w, v = RNG.normal(size=3), RNG.normal(size=3)
        moved = load.about(p)  # velocity of the other point: v + w x p
        assert_allclose(
            moved.torque @ w + moved.force @ (v + np.cross(w, p)), load.torque @ w + load.force @ v, atol=1e-13
        )
        turned = load.rotated(R)
        assert_allclose(turned.torque @ (R @ w), load.torque @ w, atol=1e-14)


def test_cross_and_skew_are_numpys_cross() -> None:
    for a, b in RNG.normal(size=(20, 2, 3)):
        assert_allclose(cross(a, b), np.cross(a, b), atol=1e-15)
        assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-15)


def test_wrench_vectors_and_sums() -> None:
    a = Wrench.from_vector(np.arange(6.0))
    assert_allclose(a.vector(), np.arange(6.0))
    assert_allclose(a.plus(a).minus(a).vector(), a.vector())
    assert_allclose(Wrench.zero().vector(), np.zeros(6))


def test_quaternion_round_trip_with_positive_w() -> None:
    for X in random_poses(30):
        q = quaternion_from_rotation(X[:3, :3])
        assert q[3] >= 0.0
        assert_allclose(pose_from_quaternion(q, X[:3, 3]), X, atol=1e-15)


@pytest.mark.parametrize(
    ("q", "p", "message"),
    [
        ((0.0, 0.0, 0.0, 1.1), (0.0, 0.0, 0.0), "norm 1.1; a unit quaternion"),
        ((0.0, 0.0, 0.0, np.nan), (0.0, 0.0, 0.0), "not finite"),
        ((0.0, 0.0, 0.0, 1.0), (0.0, np.inf, 0.0), "not finite"),
    ],
)
def test_bad_quaternions_are_refused_by_name(q: tuple[float, ...], p: tuple[float, ...], message: str) -> None:
    with pytest.raises(SpatialError, match=f"current_pose.*{message}"):
        pose_from_quaternion(q, p, "current_pose")


def test_rotations_are_poses_and_mirrored_ones_are_not() -> None:
    """Axis-aligned ones as well, where most of the determinant's terms vanish."""
    quarters = [rotation_from_rpy(0.5 * np.pi * np.array(q)) for q in np.ndindex(4, 4, 4)]
    for R in [*quarters, *(X[:3, :3] for X in random_poses(30))]:
        check_pose(make_pose(R))
        with pytest.raises(SpatialError, match="no pose"):
            check_pose(make_pose(-R))


@pytest.mark.parametrize(
    ("X", "message"),
    [
        (np.eye(3), "shape"),
        (np.full((4, 4), np.nan), "not finite"),
        (make_pose(1.01 * np.eye(3)), "orthonormal"),
        (make_pose(np.diag([1.0, 1.0, -1.0])), "orthonormal"),
    ],
)
def test_what_is_no_pose_is_refused(X: np.ndarray, message: str) -> None:
    with pytest.raises(SpatialError, match=message):
        check_pose(X)


def test_a_wrench_does_the_same_work_in_either_frame() -> None:
    for X in random_poses(20):
        motion, load = RNG.normal(size=(2, 6))
        there, about = motion_adjoint(X) @ motion, wrench_adjoint(X) @ load
        assert_allclose(there @ about, motion @ load, atol=1e-12)
        wrench = Wrench.from_vector(load)
        assert_allclose(about, wrench.rotated(X[:3, :3]).about(-X[:3, 3]).vector(), atol=1e-12)
        assert_allclose(both(X[:3, :3]) @ load, wrench.rotated(X[:3, :3]).vector(), atol=1e-12)


def test_a_wrench_is_added_and_scaled_as_a_vector_and_not_as_a_tuple() -> None:
    a, b = Wrench.from_vector(RNG.normal(size=6)), Wrench.from_vector(RNG.normal(size=6))
    for found, expected in (
        (a + b, a.vector() + b.vector()),
        (a - b, a.vector() - b.vector()),
        (-a, -a.vector()),
        (2 * a, 2.0 * a.vector()),
        (a * 0.5, 0.5 * a.vector()),
        (np.float64(0.5) * a, 0.5 * a.vector()),
    ):
        assert isinstance(found, Wrench)
        assert_allclose(found.vector(), expected, rtol=1e-15)
    with pytest.raises(TypeError):
        a * b
    with pytest.raises(TypeError):
        a.vector() + a
    with pytest.raises(AttributeError):
        a + tuple(a)
