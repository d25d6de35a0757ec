# SPDX-License-Identifier: Apache-2.0
"""UR's pose vectors, p[x, y, z, rx, ry, rz] with a rotation vector; to and from (4, 4) poses."""

from collections.abc import Sequence
from math import isfinite

from seed_core.errors import SeedError
from seed_core.spatial import Array, make_pose, so3_exp, so3_log

Pose6 = tuple[float, float, float, float, float, float]


def checked_pose(values: Sequence[float | str], name: str = "pose") -> Pose6:
    """Six finite numbers [m, rad]; raises SeedError otherwise."""
    numbers = tuple(float(v) for v in values)
    if len(numbers) != 6:
        raise SeedError(f"{name} has {len(numbers)} numbers; it needs x y z [m] and a rotation vector [rad]")
    if not all(isfinite(v) for v in numbers):
        raise SeedError(f"{name} = {numbers} must be finite")
    return numbers


def matrix_from_pose(pose: Sequence[float] | Array) -> Array:
    """(4, 4) from a pose vector (6,) [m, rad]."""
    return make_pose(so3_exp(pose[3:]), pose[:3])


def pose_from_matrix(X: Array) -> Pose6:
    """Pose vector (6,) of a (4, 4) pose, the rotation vector no longer than pi."""
    x, y, z = X[:3, 3].tolist()
    rx, ry, rz = so3_log(X[:3, :3]).tolist()
    return x, y, z, rx, ry, rz
