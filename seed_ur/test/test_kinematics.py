# SPDX-License-Identifier: Apache-2.0
"""UR kinematics against published numbers, against finite differences and against itself backwards."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from seed_core.errors import SeedError
from seed_ur.kinematics import KinematicsError, URKinematics

ARMS = ("ur5e", "ur10e")


def product_of_exponential_tables(arm: URKinematics, q: np.ndarray) -> np.ndarray:
    """The DH product written out with 4x4 matrices: an independent check of the unrolled code."""
    X = np.eye(4)
    twists = (np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0)
    for theta, d, a, alpha in zip(q, arm.model.d, arm.model.a, twists, strict=True):
        R = Rotation.from_euler("z", theta) * Rotation.from_euler("x", alpha)
        A = np.eye(4)
        A[:3, :3] = R.as_matrix()
        A[:3, 3] = a * np.cos(theta), a * np.sin(theta), d
        X = X @ A
    return X


def test_ur5e_at_zero_is_where_universal_robots_says() -> None:
    X = URKinematics.for_model("ur5e").forward(np.zeros(6))
    assert_allclose(X[:3, 3], [-0.8172, -0.2329, 0.0628], atol=1e-12)
    assert_allclose(Rotation.from_matrix(X[:3, :3]).as_rotvec(), [np.pi / 2, 0, 0], atol=1e-12)


@pytest.mark.parametrize("name", ARMS)
def test_forward_is_the_dh_product(name: str) -> None:
    arm = URKinematics.for_model(name)
    for q in np.random.default_rng(1).uniform(-2 * np.pi, 2 * np.pi, (50, 6)):
        assert_allclose(arm.forward(q), product_of_exponential_tables(arm, q), atol=1e-13)
        assert_allclose(arm.frames(q)[5], arm.forward(q), atol=0)


@pytest.mark.parametrize("name", ARMS)
def test_every_branch_reaches_the_pose_and_one_is_the_joint_vector(name: str) -> None:
    arm = URKinematics.for_model(name)
    for q in np.random.default_rng(2).uniform(-np.pi, np.pi, (1000, 6)):
        X = arm.forward(q)
        branches = arm.all_inverse(X)
        assert 2 <= len(branches) <= 8
        worst = max(np.abs(arm.forward(b) - X).max() for b in branches)
        assert worst < 1e-9  # [m, 1]: 5e-13 typical, larger where the arm is nearly stretched
        assert_allclose(arm.inverse(X, near=q), q, atol=1e-5)  # square-root sensitivity at branch points


@pytest.mark.parametrize("name", ARMS)
def test_following_a_path_stays_on_its_branch(name: str) -> None:
    arm, rng = URKinematics.for_model(name), np.random.default_rng(6)
    apart = 0
    for q in rng.uniform(-np.pi, np.pi, (200, 6)):
        for step in rng.normal(size=(3, 6)):
            nearby = q + 1e-3 * step
            X = arm.forward(nearby)
            assert_allclose(arm.forward(arm.follow(X, near=q.tolist())), X, atol=1e-9)
            if min(abs(np.sin(q[4])), abs(np.sin(q[2]))) > 0.05:  # away from where branches meet
                assert_allclose(arm.follow(X, near=q.tolist()), nearby, atol=1e-5)
                apart += 1
    assert apart > 500  # of 600


@pytest.mark.parametrize("name", ARMS)
def test_wrist_singularity_keeps_the_joint_that_is_free(name: str) -> None:
    arm = URKinematics.for_model(name)
    for q5 in (0.0, np.pi):
        q = np.array([0.4, -1.2, 1.5, -0.7, q5, 0.9])
        assert_allclose(arm.inverse(arm.forward(q), near=q), q, atol=1e-6)


@pytest.mark.parametrize("name", ARMS)
def test_jacobian_is_the_derivative_of_forward(name: str) -> None:
    arm, h = URKinematics.for_model(name), 1e-6
    for q in np.random.default_rng(3).uniform(-np.pi, np.pi, (20, 6)):
        J = arm.jacobian(q)
        for i, dq in enumerate(h * np.eye(6)):
            plus, minus = arm.forward(q + dq), arm.forward(q - dq)
            turn = Rotation.from_matrix(plus[:3, :3] @ minus[:3, :3].T).as_rotvec() / (2 * h)
            assert_allclose(J[:3, i], turn, atol=1e-8)
            assert_allclose(J[3:, i], (plus - minus)[:3, 3] / (2 * h), atol=1e-8)
        assert_allclose(arm.twist(q, q[::-1]), J @ q[::-1], atol=1e-13)


def test_inverse_keeps_whole_turns_within_the_range_of_the_joints() -> None:
    arm = URKinematics.for_model("ur5e")
    q = np.array([5.5, -1.2, 1.5, -5.0, 1.2, -6.0])
    assert_allclose(arm.inverse(arm.forward(q), near=q), q, atol=1e-9)


def test_out_of_reach_is_refused_with_the_place() -> None:
    X = np.eye(4)
    X[:3, 3] = 2.0, 0.0, 0.1
    with pytest.raises(KinematicsError, match=r"\(2\.000, 0\.000, 0\.100\) m is out of reach of the ur5e"):
        URKinematics.for_model("ur5e").inverse(X, near=np.zeros(6))
    X[:3, 3] = 0.0, 0.0, 0.3
    X[:3, :3] = Rotation.from_euler("x", np.pi).as_matrix()
    with pytest.raises(KinematicsError):
        URKinematics.for_model("ur10e").inverse(X, near=np.zeros(6))


def test_unknown_model_is_named() -> None:
    with pytest.raises(SeedError, match="'ur16' is not known; choose one of ur5e, ur10e"):
        URKinematics.for_model("ur16")


@pytest.mark.parametrize(
    ("cb3", "model", "d", "a"),  # of UR's table of DH parameters
    [
        ("ur5", "ur5e", (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823), (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)),
        ("ur10", "ur10e", (0.1273, 0.0, 0.0, 0.163941, 0.1157, 0.0922), (0.0, -0.612, -0.5723, 0.0, 0.0, 0.0)),
    ],
)
def test_an_arm_of_a_cb3_is_no_arm_of_an_e_series(cb3: str, model: str, d: tuple, a: tuple) -> None:
    """Its flange is further from the model's than a calibration puts it (0.03 m), but for a few of a thousand poses."""
    ours = URKinematics.for_model(model)
    theirs = URKinematics(replace(ours.model, name=cb3, d=d, a=a))
    poses = np.random.default_rng(8).uniform(-np.pi, np.pi, (500, 6))
    off = [np.linalg.norm((ours.forward(q) - theirs.forward(q))[:3, 3]) for q in poses]
    assert np.quantile(off, 0.02) > 0.03
