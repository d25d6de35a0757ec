# SPDX-License-Identifier: Apache-2.0
"""Vectors of three as plain tuples: at a few numbers, several times faster than arrays. For what runs at every step."""

from collections.abc import Sequence
from math import hypot

from seed_core.spatial import Array

Vector3 = tuple[float, float, float]
Rows = Sequence[Sequence[float]]  # of a matrix
ZERO: Vector3 = (0.0, 0.0, 0.0)


def as_vector3(v: Array) -> Vector3:
    """The array (3,) as a tuple."""
    x, y, z = v.tolist()
    return x, y, z


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: Sequence[float]) -> float:
    """|a|"""
    return hypot(*a)


def plus(a: Sequence[float], b: Sequence[float]) -> Vector3:
    """a + b"""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Sequence[float], b: Sequence[float]) -> Vector3:
    """a - b"""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scaled(a: Sequence[float], s: float) -> Vector3:
    """s a"""
    return a[0] * s, a[1] * s, a[2] * s


def plus_scaled(a: Sequence[float], s: float, b: Sequence[float]) -> Vector3:
    """a + s b"""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


def capped(a: Vector3, longest: float) -> Vector3:
    """a, shortened to the norm `longest` where it is longer."""
    length = hypot(*a)
    return a if length <= longest else scaled(a, longest / length)


def transformed(X: Rows, v: Sequence[float]) -> Vector3:
    """The point v in the frame of pose X, measured where X is."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = X
    j, k, m = v
    return a * j + b * k + c * m + x, d * j + e * k + f * m + y, g * j + h * k + i * m + z
