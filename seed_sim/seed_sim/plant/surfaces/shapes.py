# SPDX-License-Identifier: Apache-2.0
"""Convex, hollow and wavy bodies by their distance: exact, so that a tip that slides over them feels no facets.

Everything in the frame S of the table, z out of it. What touches is a sphere; where two bodies meet (a floor and a
step) it touches both, each by its own nearest point.
"""

from dataclasses import dataclass
from math import cos, hypot, sin, sqrt, tan
from typing import Protocol

import numpy as np

from seed_core.spatial import Array
from seed_core.vector3 import Vector3

_FOOT_STEPS = 6  # of the search for the nearest point: the error shrinks by the distance over the radius each time


class Shape(Protocol):
    """A body under the tool."""

    def nearest(self, p: Vector3) -> tuple[float, Vector3]:
        """Distance [m] of p (3,) [m] from the surface, below zero inside, and the unit normal (3,) there."""
        ...

    def height(self, x: Array, y: Array) -> Array:
        """Height [m] of the surface over places (...) [m]; not a number where there is none. To look at."""
        ...


@dataclass(frozen=True)
class Plane:
    """z = 0."""

    def nearest(self, p: Vector3) -> tuple[float, Vector3]:
        return p[2], (0.0, 0.0, 1.0)

    def height(self, x: Array, y: Array) -> Array:  # noqa: ARG002
        return np.zeros_like(x)


@dataclass(frozen=True)
class Round:
    """A cylinder along y or a sphere, from outside or from inside; its highest (lowest) line is z = 0 at x = at.

    Attributes:
        radius: [m]. at: [m].
        ball: a sphere. hollow: seen from inside.
    """

    radius: float
    at: float
    ball: bool = False
    hollow: bool = False

    def nearest(self, p: Vector3) -> tuple[float, Vector3]:
        side = -1.0 if self.hollow else 1.0
        x, y, z = p[0] - self.at, p[1] if self.ball else 0.0, p[2] + side * self.radius
        away = sqrt(x * x + y * y + z * z)
        scale = side / max(away, 1e-12)
        return side * (away - self.radius), (scale * x, scale * y, scale * z)

    def height(self, x: Array, y: Array) -> Array:
        side = -1.0 if self.hollow else 1.0
        squares = self.radius**2 - (x - self.at) ** 2 - (y**2 if self.ball else 0.0)
        return side * (np.sqrt(np.where(squares > 0.0, squares, np.nan)) - self.radius)


@dataclass(frozen=True)
class Corner:
    """A block whose upper side z = top [m] ends at x = at [m]: beyond it (side 1) or before it (side -1) is nothing."""

    at: float
    top: float
    side: float

    def nearest(self, p: Vector3) -> tuple[float, Vector3]:
        x, z = self.side * (p[0] - self.at), p[2] - self.top
        if x > 0.0 and z > 0.0:
            away = hypot(x, z)
            return away, (self.side * x / away, 0.0, z / away)
        return (z, (0.0, 0.0, 1.0)) if z >= x else (x, (self.side, 0.0, 0.0))

    def height(self, x: Array, y: Array) -> Array:  # noqa: ARG002
        return np.asarray(np.where(self.side * (x - self.at) <= 0.0, self.top, np.nan))


@dataclass(frozen=True)
class Ridge:
    """A roof: both sides fall by angle [rad] from the ridge at x = at [m], z = top [m]."""

    at: float
    top: float
    angle: float

    def nearest(self, p: Vector3) -> tuple[float, Vector3]:
        c, s = cos(self.angle), sin(self.angle)
        x, z = p[0] - self.at, p[2] - self.top
        side = 1.0 if x >= 0.0 else -1.0
        if c * abs(x) - s * z >= 0.0:  # the foot of the perpendicular lies below the ridge
            return s * abs(x) + c * z, (side * s, 0.0, c)
        away = hypot(x, z)
        return away, (x / away, 0.0, z / away)

    def height(self, x: Array, y: Array) -> Array:  # noqa: ARG002
        return self.top - tan(self.angle) * np.abs(x - self.at)


@dataclass(frozen=True)
class Waves:
    """Sum of waves z = amplitude cos(wave . (x, y) + phase): hills as smooth as can be.

    Attributes:
        waves: (n, 2) [rad/m]. amplitudes: (n,) [m]. phases: (n,) [rad].
        offset: [m] added, so that the height at the origin is zero.
    """

    waves: Array
    amplitudes: Array
    phases: Array
    offset: float

    def rise(self, x: float, y: float) -> tuple[float, float, float]:
        """Height [m] at a place [m], and its derivatives along x and y [1]."""
        angle = self.waves[:, 0] * x + self.waves[:, 1] * y + self.phases
        fall = -self.amplitudes * np.sin(angle)
        h = float(self.amplitudes @ np.cos(angle))
        return h + self.offset, float(fall @ self.waves[:, 0]), float(fall @ self.waves[:, 1])

    def nearest(self, p: Vector3) -> tuple[float, Vector3]:
        return _nearest_of_graph(self, p)

    def height(self, x: Array, y: Array) -> Array:
        angle = np.multiply.outer(x, self.waves[:, 0]) + np.multiply.outer(y, self.waves[:, 1]) + self.phases
        return np.asarray(np.cos(angle) @ self.amplitudes + self.offset)


@dataclass(frozen=True)
class Saddle:
    """z = ((x - at)^2 - y^2) / (2 radius), all in [m]."""

    radius: float
    at: float

    def rise(self, x: float, y: float) -> tuple[float, float, float]:
        """Height [m] at a place [m], and its derivatives along x and y [1]."""
        a = x - self.at
        return 0.5 * (a * a - y * y) / self.radius, a / self.radius, -y / self.radius

    def nearest(self, p: Vector3) -> tuple[float, Vector3]:
        return _nearest_of_graph(self, p)

    def height(self, x: Array, y: Array) -> Array:
        return 0.5 * ((x - self.at) ** 2 - y**2) / self.radius


def _nearest_of_graph(graph: Waves | Saddle, p: Vector3) -> tuple[float, Vector3]:
    """Distance [m] and normal (3,), as `Shape.nearest`: Gauss and Newton's steps of the foot from below p (3,) [m]."""
    u, v = p[0], p[1]
    for _ in range(_FOOT_STEPS):
        h, a, b = graph.rise(u, v)
        x, y, z = p[0] - u, p[1] - v, p[2] - h
        # (J^T J) step = J^T r with the tangents (1, 0, a), (0, 1, b)
        right, left, cross, det = 1.0 + a * a, 1.0 + b * b, a * b, 1.0 + a * a + b * b
        f, g = x + a * z, y + b * z
        u, v = u + (left * f - cross * g) / det, v + (right * g - cross * f) / det
    h, a, b = graph.rise(u, v)
    size = sqrt(1.0 + a * a + b * b)
    away = sqrt((p[0] - u) ** 2 + (p[1] - v) ** 2 + (p[2] - h) ** 2)
    above = p[2] >= graph.rise(p[0], p[1])[0]
    return (away if above else -away), (-a / size, -b / size, 1.0 / size)
