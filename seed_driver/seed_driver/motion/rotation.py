# SPDX-License-Identifier: Apache-2.0
"""Unit quaternions (x, y, z, w) in plain Python for the 500 Hz path, where NumPy's overhead would dominate."""

from __future__ import annotations

from math import atan2, cos, hypot, sin, sqrt

import numpy as np
from numpy.typing import NDArray

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]
Array = NDArray[np.float64]


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """The rotation b, then a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def difference(goal: Quaternion, start: Quaternion) -> Vector:
    """Rotation vector [rad], written in the fixed frame, that turns `start` into `goal` the short way."""
    if goal == start:
        return 0.0, 0.0, 0.0
    x, y, z, w = multiply(goal, (-start[0], -start[1], -start[2], start[3]))
    length = hypot(x, y, z)
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    scale = 2.0 / w if length < 1e-9 else 2.0 * atan2(length, w) / length
    return x * scale, y * scale, z * scale


def turned(start: Quaternion, vector: Vector) -> Quaternion:
    """`start` turned further by a rotation vector [rad] written in the fixed frame; normalised."""
    x, y, z = vector
    angle = hypot(x, y, z)
    if angle == 0.0:
        return start
    scale = 0.5 - angle * angle / 48.0 if angle < 1e-4 else sin(0.5 * angle) / angle
    qx, qy, qz, qw = multiply((x * scale, y * scale, z * scale, cos(0.5 * angle)), start)
    n = 1.0 / sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    return qx * n, qy * n, qz * n, qw * n


def rotation_vector(q: Quaternion) -> Vector:
    """Rotation vector [rad] of q, no longer than pi."""
    return difference(q, (0.0, 0.0, 0.0, 1.0))


def rotate(q: Quaternion, v: Vector) -> Vector:
    """v, turned by q."""
    x, y, z, w = q
    tx, ty, tz = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


def pose_matrix(p: Vector, q: Quaternion) -> Array:
    """(4, 4) pose from position [m] and quaternion."""
    x, y, z, w = q
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), p[0]),
            (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), p[1]),
            (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), p[2]),
            (0.0, 0.0, 0.0, 1.0),
        )
    )


def from_rotation_vector(vector: Vector) -> Quaternion:
    """Quaternion of a rotation vector [rad]."""
    return turned((0.0, 0.0, 0.0, 1.0), vector)
