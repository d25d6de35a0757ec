# SPDX-License-Identifier: Apache-2.0
"""Signed distance of points to a held tool, with normal and curvature; in T, metres.

A place counts by its profile: distance from z_T and height of a round tool, x, y and z of a box.
"""

import numpy as np
from numpy.typing import NDArray

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

    def distance(self, x: Array) -> Array:
        """(n,) [m] of points x (n, 3), negative inside."""
        return self.distance_of(self.profile(x))

    def may_hold(self, profile: Array) -> NDArray[np.bool_]:
        """(n,) whether places of a profile (n, d) lie within the tool's extent; none outside is inside the tool."""
        within = np.abs(profile) < self.extent
        return np.asarray(np.logical_and.reduce([within[:, i] for i in range(len(self.extent))]))

    def distance_of(self, profile: Array) -> Array:
        """(n,) [m] of places of a profile (n, d), negative inside."""
        q = np.abs(profile) - self._core
        outside = np.sqrt(_total(np.maximum(q, 0.0) ** 2))
        return np.asarray(outside + np.minimum(_largest(q), 0.0) - self.edge)

    def local_of(self, profile: Array) -> tuple[Array, Array, Array]:
        """Distance (k,), its slope (k, d) and the slope's slope (k, d, d) [1/m] at places of a profile (k, d)."""
        sign = np.where(profile < 0.0, -1.0, 1.0)
        q = np.abs(profile) - self._core
        out = np.maximum(q, 0.0)
        length, most = np.sqrt(_total(out * out)), _largest(q)
        outside = length > 0.0
        safe = np.where(outside, length, 1.0)
        local = np.where(outside[:, None], out / safe[:, None], q == most[:, None]) * sign
        H = -local[:, :, None] * local[:, None, :]
        d = np.arange(q.shape[1])
        H[:, d, d] += out > 0.0
        H *= np.where(outside, 1.0 / safe, 0.0)[:, None, None]
        return np.where(outside, length, most) - self.edge, local, H

    def slope_by_ends(self, slope: Array, ends: Array) -> Array:
        """(k, 2, 3) slope of a function of the mean profile of two points, ends (k, 2, 3) [m], by those.

        slope: (k, d) by the mean profile.
        """
        if not self.round:
            return np.broadcast_to(0.5 * slope[:, None], ends.shape)
        out = np.empty_like(ends)
        out[..., :2] = (0.5 * slope[:, 0])[:, None, None] * self._radial(ends)[0]
        out[..., 2] = 0.5 * slope[:, 1:]
        return out

    def bend_by_ends(self, slope: Array, H: Array, ends: Array) -> Array:
        """(k, 2, 2, 3, 3) the slope of `slope_by_ends` by the ends, of each by each; H: (k, d, d), slope of slope."""
        k, H = len(ends), 0.25 * H
        if not self.round:
            return np.broadcast_to(H[:, None, None], (k, 2, 2, 3, 3))
        radial, s = self._radial(ends)
        out = np.empty((k, 2, 2, 3, 3))
        out[..., :2, :2] = H[:, 0, 0, None, None, None, None] * (radial[:, :, None, :, None] * radial[:, None, :, None])
        out[..., :2, 2] = H[:, 0, 1, None, None, None] * radial[:, :, None]
        out[..., 2, :2] = H[:, 1, 0, None, None, None] * radial[:, None]
        out[..., 2, 2] = H[:, 1, 1, None, None]
        across = np.stack([-radial[..., 1], radial[..., 0]], axis=-1)
        turn = (0.5 * slope[:, 0, None] / s)[..., None, None] * across[..., :, None] * across[..., None, :]
        out[:, 0, 0, :2, :2] += turn[:, 0]
        out[:, 1, 1, :2, :2] += turn[:, 1]
        return out

    @staticmethod
    def _radial(x: Array) -> tuple[Array, Array]:
        """Away from z_T (..., 2), and how far that is (...) [m]."""
        s = np.maximum(np.sqrt(x[..., 0] ** 2 + x[..., 1] ** 2), 1e-12)
        return x[..., :2] / s[..., None], s


def _total(v: Array) -> Array:
    """(n,) sums over the few columns of v (n, d): faster than along a short last axis."""
    return np.asarray(np.add.reduce([v[:, i] for i in range(v.shape[1])]))


def _largest(v: Array) -> Array:
    """(n,) the same of the largest."""
    return np.asarray(np.maximum.reduce([v[:, i] for i in range(v.shape[1])]))
