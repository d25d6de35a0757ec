# SPDX-License-Identifier: Apache-2.0
"""Rotations as unit quaternions (x, y, z, w) in plain tuples, for what turns a little at every step."""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

import numpy as np

from seed_core.spatial import Array, quaternion_from_rotation
from seed_core.vector3 import Triple

Quaternion = tuple[float, float, float, float]
NO_TURN: Quaternion = (0.0, 0.0, 0.0, 1.0)
_SMALL = 1e-8  # [rad]
_NEARLY_ONE = 0.9875  # square of w at 13 degrees


def quaternion(R: Array) -> Quaternion:
    """The rotation matrix R (3, 3) as a quaternion."""
    x, y, z, w = quaternion_from_rotation(R).tolist()
    return x, y, z, w


def turned_on(q: Quaternion, step: Triple) -> Quaternion:
    """exp(step) q: turned on by a rotation vector [rad] written in the parent frame.

    A Newton step renews the norm, so rounding does not add up however often this is done.
    """
    x, y, z = step
    angle = sqrt(x * x + y * y + z * z)
    scale = sin(0.5 * angle) / angle if angle > _SMALL else 0.5
    a, b, c, d = scale * x, scale * y, scale * z, cos(0.5 * angle)
    x, y, z, w = q
    i, j, k = d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x, d * z + a * y - b * x + c * w
    r = d * w - a * x - b * y - c * z
    unit = 1.5 - 0.5 * (i * i + j * j + k * k + r * r)
    return i * unit, j * unit, k * unit, r * unit


def turn_between(goal: Quaternion, now: Quaternion) -> Triple:
    """Rotation vector [rad] from now to goal, in the parent frame; its sine for its angle where that is small.

    What steers a filter needs no more than the sine: below 13 degrees it is within one percent.
    """
    (a, b, c, d), (x, y, z, w) = goal, now
    i, j, k = a * w - d * x - b * z + c * y, b * w - d * y - c * x + a * z, c * w - d * z - a * y + b * x
    r = d * w + a * x + b * y + c * z
    if r * r > _NEARLY_ONE:
        s = 2.0 * r
    else:
        sine = sqrt(i * i + j * j + k * k)
        s = 2.0 * (atan2(sine, r) if r >= 0.0 else atan2(-sine, -r)) / sine
    return s * i, s * j, s * k


def pose_of(q: Quaternion, p: Triple, arm: Triple) -> Array:
    """Pose (4, 4) of a body of rotation q, whose point at `arm` [m], in the body, is at p [m]."""
    x, y, z, w = q
    u, v, t = arm
    a, b, c = 2.0 * x, 2.0 * y, 2.0 * z
    xx, yy, zz, xy, xz, yz, xw, yw, zw = a * x, b * y, c * z, a * y, a * z, b * z, a * w, b * w, c * w
    d, e, f = 1.0 - yy - zz, xy - zw, xz + yw
    g, h, i = xy + zw, 1.0 - xx - zz, yz - xw
    j, k, m = xz - yw, yz + xw, 1.0 - xx - yy
    n, o, r = p[0] - d * u - e * v - f * t, p[1] - g * u - h * v - i * t, p[2] - j * u - k * v - m * t
    flat = (d, e, f, n, g, h, i, o, j, k, m, r, 0.0, 0.0, 0.0, 1.0)
    return np.array(flat).reshape(4, 4)  # a flat tuple becomes an array in half the time of a nested one
