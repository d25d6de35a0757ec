# SPDX-License-Identifier: Apache-2.0
"""Rotations as unit quaternions (x, y, z, w) in plain tuples: at four numbers several times faster than arrays.

For what runs at every step of the controller (250 Hz) and the driver (500 Hz); elsewhere `seed_core.spatial` serves.
"""

from collections.abc import Sequence
from math import atan2, cos, hypot, sin, sqrt

import numpy as np

from seed_core.spatial import Array, quaternion_from_rotation
from seed_core.vector3 import ZERO, Vector3

Quaternion = tuple[float, float, float, float]
IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)
_SMALL = 1e-8  # [rad]; below it the first term of each series is exact to rounding
_NEARLY_ONE = 0.9875  # square of w at 13 degrees
_STANDS_OUT = 0.32  # of a component; some is larger. Turns by steps of 30 or 45 degrees have none near it


def as_quaternion(R: Array) -> Quaternion:
    """The rotation matrix R (3, 3) as a quaternion with w >= 0."""
    x, y, z, w = quaternion_from_rotation(R).tolist()
    return x, y, z, w


def continued(q: Quaternion, before: Quaternion | None) -> Quaternion:
    """Of q and -q, the same rotation, the one nearest to `before`, for rows of numbers that must not jump.

    Without one before: that whose first component that stands out is positive. By w alone the noise of a hand that
    points down, half a turn from the base, would decide.
    """
    if before is None:
        side = next(c for c in q if abs(c) > _STANDS_OUT)
    else:
        side = sum(a * b for a, b in zip(q, before, strict=True))
    x, y, z, w = q
    return q if side >= 0.0 else (-x, -y, -z, -w)


def from_rotation_vector(vector: Vector3) -> Quaternion:
    """The exponential map: the quaternion of a rotation vector [rad]."""
    return turned(IDENTITY, vector)


def rotation_vector(q: Quaternion) -> Vector3:
    """The logarithm: the rotation vector [rad], no longer than pi, of q."""
    return turn_between(q, IDENTITY)


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


def inverse(q: Quaternion) -> Quaternion:
    """The rotation back."""
    return -q[0], -q[1], -q[2], q[3]


def rotate(q: Quaternion, v: Sequence[float]) -> Vector3:
    """The vector v, turned by q."""
    x, y, z, w = q
    tx, ty, tz = 2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


def turned(q: Quaternion, step: Vector3) -> Quaternion:
    """exp(step) q: q turned further by a rotation vector [rad] written in the parent frame.

    A Newton step renews the norm, so rounding does not add up however often this is done.
    """
    x, y, z = step
    angle = sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return q  # not even rounded: what stands still stands still
    scale = sin(0.5 * angle) / angle if angle > _SMALL else 0.5
    a, b, c, d = scale * x, scale * y, scale * z, cos(0.5 * angle)
    x, y, z, w = q
    i, j, k = d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x, d * z + a * y - b * x + c * w
    r = d * w - a * x - b * y - c * z
    unit = 1.5 - 0.5 * (i * i + j * j + k * k + r * r)
    return i * unit, j * unit, k * unit, r * unit


def turn_between(goal: Quaternion, start: Quaternion) -> Vector3:
    """Rotation vector [rad], in the parent frame, that turns `start` into `goal` the short way."""
    if goal == start:
        return ZERO
    x, y, z, w = multiply(goal, inverse(start))
    sine = hypot(x, y, z)
    half_angle = atan2(sine, w) if w >= 0.0 else atan2(-sine, -w)
    s = 2.0 * half_angle / sine if sine > _SMALL else 2.0 / w
    return s * x, s * y, s * z


def turn_towards(goal: Quaternion, start: Quaternion) -> Vector3:
    """As `turn_between`, but with the angle's sine for the angle below 13 degrees, where they differ by one percent.

    It saves the arc tangent. What steers a filter towards `goal` needs no more: both vanish together.
    """
    (a, b, c, d), (x, y, z, w) = goal, start
    r = d * w + a * x + b * y + c * z  # goal start^-1, written out: this runs at every step of the controller
    if r * r < _NEARLY_ONE:
        return turn_between(goal, start)
    s = 2.0 * r
    i, j, k = a * w - d * x - b * z + c * y, b * w - d * y - c * x + a * z, c * w - d * z - a * y + b * x
    return s * i, s * j, s * k


def to_pose(p: Vector3, q: Quaternion, point: Vector3 = ZERO) -> Array:
    """Pose (4, 4) of a body of rotation q whose point at `point` [m], in the body, is at p [m] in the parent frame."""
    x, y, z, w = q
    u, v, t = point
    a, b, c = 2.0 * x, 2.0 * y, 2.0 * z
    xx, yy, zz, xy, xz, yz, xw, yw, zw = a * x, b * y, c * z, a * y, a * z, b * z, a * w, b * w, c * w
    d, e, f = 1.0 - yy - zz, xy - zw, xz + yw
    g, h, i = xy + zw, 1.0 - xx - zz, yz - xw
    j, k, m = xz - yw, yz + xw, 1.0 - xx - yy
    n, o, r = p[0] - d * u - e * v - f * t, p[1] - g * u - h * v - i * t, p[2] - j * u - k * v - m * t
    flat = (d, e, f, n, g, h, i, o, j, k, m, r, 0.0, 0.0, 0.0, 1.0)
    return np.array(flat).reshape(4, 4)  # a flat tuple becomes an array in half the time of a nested one
