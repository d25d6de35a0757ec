# SPDX-License-Identifier: Apache-2.0
"""Vectors of three as plain tuples: at a few numbers, several times faster than arrays. For what runs at every step."""

from __future__ import annotations

from collections.abc import Sequence

from seed_core.spatial import Array

Triple = tuple[float, float, float]
Rows = Sequence[Sequence[float]]  # of a matrix


def triple(v: Array) -> Triple:
    """The vector (3,) as a tuple."""
    x, y, z = v.tolist()
    return x, y, z


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def plus(a: Sequence[float], b: Sequence[float]) -> Triple:
    """a + b"""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Sequence[float], b: Sequence[float]) -> Triple:
    """a - b"""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def along(a: Sequence[float], s: float, n: Sequence[float]) -> Triple:
    """a + s n"""
    return a[0] + s * n[0], a[1] + s * n[1], a[2] + s * n[2]


def turned(R: Rows, v: Sequence[float]) -> Triple:
    """R v"""
    return dot(R[0], v), dot(R[1], v), dot(R[2], v)


def placed(X: Rows, v: Sequence[float]) -> Triple:
    """The point v in the frame of pose X, measured where X is."""
    return dot(X[0], v) + X[0][3], dot(X[1], v) + X[1][3], dot(X[2], v) + X[2][3]
