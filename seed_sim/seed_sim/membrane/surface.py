# SPDX-License-Identifier: Apache-2.0
"""Signed distance of points to a held tool, with normal and curvature; in T, metres.

A place counts by its profile: distance from z_T and height of a round tool, x, y and z of a box.
"""

import numpy as np

from seed_core.spatial import Array
from seed_sim.tactile.parameters import ToolShape


class ToolSurface:
    """A cylinder or a box with rounded edges about T, axis along z_T.

    Attributes:
        extent: (d,) [m] beyond which no profile is inside.
    """

    def __init__(self, shape: ToolShape, edge: float) -> None:
        """edge [m]: radius of the edges; at most the shape's smallest half-size."""
        self.round = shape.round
        half = [0.5 * shape.width, shape.radius, 0.5 * shape.length]
        sizes = half[1:] if self.round else half
        self.edge = min(edge, 0.999 * min(sizes))
        self.extent = np.array(sizes)
        self._core = self.extent - self.edge

    def profile(self, x: Array) -> Array:
        """(n, d) [m] of points x (n, 3); d is 2 for a round tool, 3 for a box."""
        if not self.round:
            return x
        return np.stack([np.sqrt(x[:, 0] ** 2 + x[:, 1] ** 2), x[:, 2]], axis=1)

    def axes(self, x: Array) -> Array:
        """(n, d, 3) slope of the profile at points x (n, 3)."""
        if not self.round:
            return np.broadcast_to(np.eye(3), (len(x), 3, 3))
        out = np.zeros((len(x), 2, 3))
        out[:, 0, :2] = x[:, :2] / np.maximum(np.hypot(x[:, 0], x[:, 1]), 1e-12)[:, None]
        out[:, 1, 2] = 1.0
        return out

    def bend(self, x: Array) -> Array:
        """(n, 3, 3) [1/m] slope of the first of the profile's axes at points x (n, 3); the others have none."""
        out = np.zeros((len(x), 3, 3))
        if self.round:
            s = np.maximum(np.hypot(x[:, 0], x[:, 1]), 1e-12)
            across = np.stack([-x[:, 1], x[:, 0]], axis=1) / s[:, None]
            out[:, :2, :2] = across[:, :, None] * across[:, None, :] / s[:, None, None]
        return out

    def distance(self, x: Array) -> Array:
        """(n,) [m] of points x (n, 3), negative inside."""
        return self.distance_of(self.profile(x))

    def distance_of(self, profile: Array) -> Array:
        """(n,) [m] of places of a profile (n, d), negative inside."""
        q = np.abs(profile) - self._core
        outside = np.sqrt((np.maximum(q, 0.0) ** 2).sum(1))
        return np.asarray(outside + np.minimum(q.max(1), 0.0) - self.edge)

    def local_of(self, profile: Array) -> tuple[Array, Array, Array]:
        """Distance (n,), its slope (n, d) and the slope's slope (n, d, d) [1/m] at places of a profile (n, d)."""
        sign = np.where(profile < 0.0, -1.0, 1.0)
        q = np.abs(profile) - self._core
        out = np.maximum(q, 0.0)
        length = np.sqrt((out * out).sum(1))
        outside = length > 0.0
        safe = np.where(outside, length, 1.0)
        local = np.where(outside[:, None], out / safe[:, None], q == q.max(1)[:, None]) * sign
        H = -local[:, :, None] * local[:, None, :]
        d = np.arange(q.shape[1])
        H[:, d, d] += out > 0.0
        H *= np.where(outside, 1.0 / safe, 0.0)[:, None, None]
        return np.where(outside, length, q.max(1)) - self.edge, local, H

    def local(self, x: Array) -> tuple[Array, Array, Array]:
        """Distance (n,), outward normal (n, 3) and the normal's slope (n, 3, 3) [1/m] at points x (n, 3)."""
        distance, slope, H = self.local_of(self.profile(x))
        J = self.axes(x)
        normal = (slope[:, None] @ J)[:, 0]
        return distance, normal, J.swapaxes(1, 2) @ H @ J + slope[:, :1, None] * self.bend(x)
