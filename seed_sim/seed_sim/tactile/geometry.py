# SPDX-License-Identifier: Apache-2.0
"""Viewing rays, and the depth at which they meet the bubble's dome and the tool. Lengths in metres, in C or in T."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, inverse_pose
from seed_sim.tactile.parameters import TactileParameters, ToolShape

Image = NDArray[np.float32]
FAR = np.float32(10.0)  # [m]; depth where a ray meets no tool


class Rays(NamedTuple):
    """Viewing rays of one camera in C: origin (3,), directions (3, h, w) of unit depth, side +1 (left) or -1."""

    origin: Array
    directions: NDArray[np.float32]
    side: float

    def at(self, depth: Image) -> NDArray[np.float32]:
        """Points (3, h, w) in C at depth (h, w)."""
        return np.asarray(self.directions * depth + self.origin.astype(np.float32)[:, None, None], np.float32)


def turned(R: Array, planes: NDArray[np.float32]) -> NDArray[np.float32]:
    """R (k, 3) applied to vectors given as planes (3, h, w): (k, h, w)."""
    flat = R.astype(np.float32) @ planes.reshape(3, -1)
    return np.asarray(flat.reshape(R.shape[0], *planes.shape[1:]), np.float32)


def dome_depth(rays: Rays, p: TactileParameters, height: float) -> Image:
    """Depth (h, w) of the undeformed dome whose rim lies where `squeeze` puts it; the plane of the rim elsewhere.

    The dome is half an ellipsoid over the rim's ellipse, turned to the grasp; its apex passes the tool's surface by
    `squeeze` at the grasp.
    """
    rim = p.tool.radius - p.squeeze + p.height
    axes = np.array((p.rim_x, height, p.rim_z))
    o = (rays.origin - (0.0, rays.side * rim, 0.0)) / axes
    d = rays.directions.astype(float) / axes[:, None, None]
    a, b, c = (d * d).sum(0), np.tensordot(o, d, 1), float(o @ o) - 1.0
    root = b * b - a * c
    far = (-b + np.sqrt(np.maximum(root, 0.0))) / a
    beyond = rays.side * (o[1] + far * d[1])
    plane = -o[1] / d[1]
    return np.asarray(np.where((root > 0.0) & (beyond < 0.0), far, plane), np.float32)


def _slab(o: float, d: Image, half: float) -> tuple[Image, Image]:
    """Where rays enter and leave |x| <= half."""
    safe = np.where(np.abs(d) < 1e-9, np.float32(1e-9), d)
    a, b = (-half - o) / safe, (half - o) / safe
    return np.minimum(a, b), np.maximum(a, b)


def _tube(o: Array, dx: Image, dy: Image, radius: float) -> tuple[Image, Image]:
    """Where rays enter and leave the infinite cylinder about z; (FAR, -FAR) where they miss it."""
    a = dx * dx + dy * dy
    b = dx * np.float32(o[0]) + dy * np.float32(o[1])
    root = b * b - a * np.float32(o[0] ** 2 + o[1] ** 2 - radius**2)
    hit = root > 0.0
    s = np.sqrt(np.where(hit, root, np.float32(0.0)))
    return np.where(hit, (-b - s) / a, FAR), np.where(hit, (-b + s) / a, -FAR)


def tool_depth(rays: Rays, tool: ToolShape, X_CT: Array) -> Image:
    """Depth (h, w) at which rays meet the tool at X_CT; FAR where they pass it."""
    X_TC = inverse_pose(X_CT)
    o = X_TC[:3, :3] @ rays.origin + X_TC[:3, 3]
    d = turned(X_TC[:3, :3], rays.directions)
    ends = _slab(float(o[2]), d[2], 0.5 * tool.length)
    if tool.round:
        body = _tube(o, d[0], d[1], tool.radius)
    else:
        front = _slab(float(o[1]), d[1], tool.radius)
        side = _slab(float(o[0]), d[0], 0.5 * tool.width)
        body = np.maximum(front[0], side[0]), np.minimum(front[1], side[1])
    enter, leave = np.maximum(ends[0], body[0]), np.minimum(ends[1], body[1])
    return np.where((enter < leave) & (enter > 0.0), enter, FAR).astype(np.float32)
