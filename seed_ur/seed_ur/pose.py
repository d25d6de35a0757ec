# SPDX-License-Identifier: Apache-2.0
"""UR's pose vectors, p[x, y, z, rx, ry, rz] with a rotation vector, to and from (4, 4) poses, at 500 Hz."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, hypot, isfinite, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from seed_core.errors import SeedError

Array = NDArray[np.float64]
Pose6 = tuple[float, float, float, float, float, float]


def checked_pose(values: Sequence[float], name: str = "pose") -> Pose6:
    """Six finite numbers [m, rad]; raises SeedError otherwise."""
    numbers = tuple(float(v) for v in values)
    if len(numbers) != 6:
        raise SeedError(f"{name} has {len(numbers)} numbers; it needs x y z [m] and a rotation vector [rad]")
    if not all(isfinite(v) for v in numbers):
        raise SeedError(f"{name} = {numbers} must be finite")
    return numbers


def matrix_from_pose(pose: Sequence[float] | Array) -> Array:
    """(4, 4) from a pose vector (6,) [m, rad] (Rodrigues' formula)."""
    x, y, z, rx, ry, rz = (float(v) for v in pose)
    squared = rx * rx + ry * ry + rz * rz
    angle = sqrt(squared)
    if angle < 1e-5:
        a, b, c = 1.0 - squared / 6.0, 0.5 - squared / 24.0, 1.0 - squared / 2.0
    else:
        a, b, c = sin(angle) / angle, (1.0 - cos(angle)) / squared, cos(angle)
    return np.array(
        (
            (c + b * rx * rx, b * rx * ry - a * rz, b * rx * rz + a * ry, x),
            (b * rx * ry + a * rz, c + b * ry * ry, b * ry * rz - a * rx, y),
            (b * rx * rz - a * ry, b * ry * rz + a * rx, c + b * rz * rz, z),
            (0.0, 0.0, 0.0, 1.0),
        )
    )


def pose_from_matrix(X: Array) -> Pose6:
    """Pose vector (6,) of a (4, 4) pose, the rotation vector no longer than pi."""
    (xx, yx, zx, px), (xy, yy, zy, py), (xz, yz, zz, pz), _ = X.tolist()
    qx, qy, qz, qw = _quaternion(xx, yx, zx, xy, yy, zy, xz, yz, zz)
    if qw < 0.0:
        qx, qy, qz, qw = -qx, -qy, -qz, -qw
    length = hypot(qx, qy, qz)
    scale = 2.0 if length < 1e-9 else 2.0 * atan2(length, qw) / length
    return px, py, pz, scale * qx, scale * qy, scale * qz


def _quaternion(
    xx: float, yx: float, zx: float, xy: float, yy: float, zy: float, xz: float, yz: float, zz: float
) -> tuple[float, float, float, float]:
    """x, y, z, w of the rotation with columns (xx, xy, xz), ..., by the largest component (Shepperd)."""
    parts = (1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz, 1.0 + xx + yy + zz)
    largest = parts.index(max(parts))
    s = 0.5 / sqrt(parts[largest])
    if largest == 3:
        return s * (yz - zy), s * (zx - xz), s * (xy - yx), s * parts[3]
    if largest == 0:
        return s * parts[0], s * (yx + xy), s * (zx + xz), s * (yz - zy)
    if largest == 1:
        return s * (yx + xy), s * parts[1], s * (zy + yz), s * (zx - xz)
    return s * (zx + xz), s * (zy + yz), s * parts[2], s * (xy - yx)
