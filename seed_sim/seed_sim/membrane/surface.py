# SPDX-License-Identifier: Apache-2.0
"""Signed distance of points to a held tool, with normal and curvature; in T, metres."""

import numpy as np

from seed_core.spatial import Array
from seed_sim.tactile.parameters import ToolShape


class ToolSurface:
    """A cylinder or a box with rounded edges about T, axis along z_T."""

    def __init__(self, shape: ToolShape, edge: float) -> None:
        """edge [m]: radius of the edges; at most the shape's smallest half-size."""
        self.round = shape.round
        half = [0.5 * shape.width, shape.radius, 0.5 * shape.length]
        sizes = half[1:] if self.round else half
        self.edge = min(edge, 0.999 * min(sizes))
        self._core = np.array(sizes) - self.edge
        self.half = np.array([shape.radius, *half[1:]] if self.round else half)  # [m] of the box around the tool

    def distance(self, x: Array) -> Array:
        """(n,) [m] of points x (n, 3), negative inside."""
        q = np.abs(x)
        if self.round:
            q = np.stack([np.sqrt(x[:, 0] ** 2 + x[:, 1] ** 2), q[:, 2]], axis=1)
        q = q - self._core
        outside = np.sqrt((np.maximum(q, 0.0) ** 2).sum(1))
        return np.asarray(outside + np.minimum(q.max(1), 0.0) - self.edge)

    def _beyond(self, x: Array) -> tuple[Array, Array]:
        """Distances past the core in its own axes, and the signed unit vectors of those axes (n, k, 3)."""
        n = len(x)
        if self.round:
            s = np.maximum(np.hypot(x[:, 0], x[:, 1]), 1e-12)
            axes = np.zeros((n, 2, 3))
            axes[:, 0, 0], axes[:, 0, 1] = x[:, 0] / s, x[:, 1] / s
            axes[:, 1, 2] = np.where(x[:, 2] < 0.0, -1.0, 1.0)
            return np.column_stack([s, np.abs(x[:, 2])]) - self._core, axes
        axes = np.zeros((n, 3, 3))
        for i in range(3):
            axes[:, i, i] = np.where(x[:, i] < 0.0, -1.0, 1.0)
        return np.abs(x) - self._core, axes

    def local(self, x: Array) -> tuple[Array, Array, Array]:
        """Distance (n,), outward normal (n, 3) and the normal's slope (n, 3, 3) [1/m] at points x (n, 3)."""
        q, axes = self._beyond(x)
        out = np.maximum(q, 0.0)
        length = np.sqrt((out * out).sum(1))
        outside = length > 0.0
        safe = np.where(outside, length, 1.0)
        nearest = q == q.max(1)[:, None]
        local = np.where(outside[:, None], out / safe[:, None], nearest)
        normal = np.einsum("nk,nki->ni", local, axes)
        distance = np.where(outside, length, q.max(1)) - self.edge
        H = np.where(outside, 1.0 / safe, 0.0)[:, None, None] * (
            np.einsum("nk,nki,nkj->nij", (out > 0.0).astype(float), axes, axes)
            - normal[:, :, None] * normal[:, None, :]
        )
        if self.round:
            t = np.zeros_like(x)
            t[:, 0], t[:, 1] = -axes[:, 0, 1], axes[:, 0, 0]
            s = q[:, 0] + self._core[0]
            H += (local[:, 0] / s)[:, None, None] * t[:, :, None] * t[:, None, :]
        return distance, normal, H
