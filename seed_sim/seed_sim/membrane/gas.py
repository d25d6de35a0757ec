# SPDX-License-Identifier: Apache-2.0
"""The enclosed gas: its volume over the rim's plane, with slopes, and p V = const."""

import numpy as np

from seed_core.spatial import Array
from seed_sim.membrane.mesh import Index


class Volume:
    """Volume between a dome and the plane of its rim, which passes through the origin."""

    def __init__(self, triangles: Index, count: int, sign: float) -> None:
        """sign: +1 or -1, so that the volume of the dome comes out positive."""
        self.triangles, self._sign, self._count = triangles, sign, count
        self._flat = (triangles[:, :, None] * 3 + np.arange(3)).ravel()

    def value(self, x: Array) -> float:
        """[m^3] of nodes x (n, 3)."""
        a, b, c = (x[self.triangles[:, i]] for i in range(3))
        return self._sign * float(np.einsum("mi,mi->", a, _cross(b, c))) / 6.0

    def slope(self, x: Array) -> tuple[float, Array]:
        """Volume [m^3] and its gradient (n, 3) [m^2]."""
        a, b, c = (x[self.triangles[:, i]] for i in range(3))
        g = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1) * (self._sign / 6.0)
        value = float(np.einsum("mi,mi->", a, g[:, 0]))
        return value, np.asarray(np.bincount(self._flat, g.ravel(), 3 * self._count).reshape(-1, 3), float)

    def add_curvature(self, x: Array, factor: float, K: Array) -> None:
        """Add factor times the volume's second derivative to the triangles' matrices K (m, 9, 9)."""
        blocks = K.reshape(-1, 3, 3, 3, 3)
        c = factor * self._sign / 6.0
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            # d(x_j x x_k) = -[x_k] dx_j + [x_j] dx_k is the slope of the force on node i
            for column, other, sign in ((j, k, -c), (k, j, c)):
                v = sign * x[self.triangles[:, other]]
                blocks[:, i, 0, column, 1] -= v[:, 2]
                blocks[:, i, 0, column, 2] += v[:, 1]
                blocks[:, i, 1, column, 0] += v[:, 2]
                blocks[:, i, 1, column, 2] -= v[:, 0]
                blocks[:, i, 2, column, 0] -= v[:, 1]
                blocks[:, i, 2, column, 1] += v[:, 0]


def _cross(a: Array, b: Array) -> Array:
    return np.column_stack(
        [
            a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0],
        ]
    )
