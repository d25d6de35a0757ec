# SPDX-License-Identifier: Apache-2.0
"""How far a tool reaches into a gel: its surface along the gel's normal, cell by cell, in closed form."""

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array
from seed_sim.tactile.parameters import ToolShape

Field = NDArray[np.float32]  # (h, w)
MISSED = 1.0  # [m] where the tool is not: farther than any gel


def tool_surface(shape: ToolShape, X_XT: Array, x: Field, y: Field) -> Field:
    """z (h, w) [m] at which the lines through (x, y) along z of frame X enter the tool; MISSED beside it."""
    R, p = X_XT[:3, :3], X_XT[:3, 3]
    o = [np.asarray(R[0, i] * (x - p[0]) + R[1, i] * (y - p[1]) - R[2, i] * p[2], np.float32) for i in range(3)]
    d = R[2]  # z of X, in T
    ends = _slab(o[2], d[2], 0.5 * shape.length)
    if shape.round:
        body = _tube(o[0], o[1], float(d[0]), float(d[1]), shape.radius)
    else:
        faces, sides = _slab(o[1], d[1], shape.radius), _slab(o[0], d[0], 0.5 * shape.width)
        body = np.maximum(faces[0], sides[0]), np.minimum(faces[1], sides[1])
    enter, leave = np.maximum(ends[0], body[0]), np.minimum(ends[1], body[1])
    return np.where(enter < leave, enter, np.float32(MISSED)).astype(np.float32)


def ball_surface(radius: float, middle: Array, x: Field, y: Field) -> Field:
    """The same of a ball about middle (3,) [m] in X."""
    left = np.float32(radius**2) - (x - np.float32(middle[0])) ** 2 - (y - np.float32(middle[1])) ** 2
    reach = np.sqrt(np.maximum(left, 0.0))
    return np.where(left > 0.0, np.float32(middle[2]) - reach, np.float32(MISSED)).astype(np.float32)


def _slab(o: Field, d: float, half: float) -> tuple[Field, Field]:
    """Where lines enter and leave |coordinate| <= half."""
    safe = np.float32(d if abs(d) > 1e-7 else 1e-7)
    a, b = (-np.float32(half) - o) / safe, (np.float32(half) - o) / safe
    return np.minimum(a, b), np.maximum(a, b)


def _tube(ox: Field, oy: Field, dx: float, dy: float, radius: float) -> tuple[Field, Field]:
    """Where lines enter and leave the infinite cylinder about z."""
    a = np.float32(max(dx * dx + dy * dy, 1e-12))
    b = ox * np.float32(dx) + oy * np.float32(dy)
    root = b * b - a * (ox * ox + oy * oy - np.float32(radius**2))
    s = np.sqrt(np.maximum(root, 0.0))
    hit = root > 0.0
    return np.where(hit, (-b - s) / a, np.float32(MISSED)), np.where(hit, (-b + s) / a, np.float32(-MISSED))
