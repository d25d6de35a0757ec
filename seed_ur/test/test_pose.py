# SPDX-License-Identifier: Apache-2.0
"""UR pose vectors against SciPy, with samples near zero and near half a turn."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from seed_core.errors import SeedError
from seed_ur.pose import checked_pose, matrix_from_pose, pose_from_matrix


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-4, 0.5, 2.0, 3.0, np.pi - 1e-7])
def test_pose_vector_round_trip_agrees_with_scipy(angle: float) -> None:
    rng = np.random.default_rng(4)
    for axis in rng.normal(size=(50, 3)):
        rotvec = angle * axis / np.linalg.norm(axis)
        X = matrix_from_pose([0.1, -0.2, 0.3, *rotvec])
        assert_allclose(X[:3, :3], Rotation.from_rotvec(rotvec).as_matrix(), atol=1e-14)
        assert_allclose(pose_from_matrix(X), [0.1, -0.2, 0.3, *rotvec], atol=1e-9)


def test_half_a_turn_comes_back_as_the_same_rotation() -> None:
    for axis in np.eye(3):
        X = matrix_from_pose([0, 0, 0, *(np.pi * axis)])
        assert_allclose(matrix_from_pose(pose_from_matrix(X)), X, atol=1e-15)


@pytest.mark.parametrize(
    ("values", "message"), [([0.0] * 5, "has 5 numbers"), ([0, 0, float("nan"), 0, 0, 0], "must be finite")]
)
def test_bad_pose_is_refused(values: list[float], message: str) -> None:
    with pytest.raises(SeedError, match=message):
        checked_pose(values, "target")
