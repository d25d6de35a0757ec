# SPDX-License-Identifier: Apache-2.0
"""A cross-section, round or rectangular: signed distance to its outline, and points along it."""

from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array

_ROUND, _SIDE = 24, 6  # points along a circle, and along each side of a rectangle


class Section(NamedTuple):
    """Half the widths a and b [m] along x and y; of a round one both are its radius."""

    round: bool
    a: float
    b: float

    def grown(self, by: float) -> "Section":
        """The same outline, further out by so much [m]."""
        return Section(self.round, self.a + by, self.b + by)

    def distance(self, p: Array) -> Array:
        """How far points p (n, 2+) lie outside (n,) [m], negative inside."""
        if self.round:
            return np.asarray(np.sqrt(p[:, 0] ** 2 + p[:, 1] ** 2) - self.a)
        x, y = np.abs(p[:, 0]) - self.a, np.abs(p[:, 1]) - self.b
        out = np.sqrt(np.maximum(x, 0.0) ** 2 + np.maximum(y, 0.0) ** 2)
        return np.where(out > 0.0, out, np.maximum(x, y))

    def outward(self, p: Array) -> Array:
        """Gradient (n, 3) of the distance at points p (n, 2+); its z is zero."""
        g = np.zeros((len(p), 3))
        if self.round:
            g[:, :2] = p[:, :2] / np.maximum(np.sqrt(p[:, 0] ** 2 + p[:, 1] ** 2), 1e-9)[:, None]
            return g
        over = np.abs(p[:, :2]) - (self.a, self.b)
        out = np.maximum(over, 0.0)
        size = np.sqrt((out * out).sum(axis=1))[:, None]
        nearest = np.column_stack([over[:, 0] >= over[:, 1], over[:, 0] < over[:, 1]])
        g[:, :2] = np.where(size > 0.0, out / np.maximum(size, 1e-12), nearest) * np.where(p[:, :2] < 0.0, -1.0, 1.0)
        return g

    def outline(self, z: float) -> Array:
        """Points (n, 3) [m] along it at height z [m]."""
        if self.round:
            angle = 2.0 * np.pi * np.arange(_ROUND) / _ROUND
            x, y = self.a * np.cos(angle), self.a * np.sin(angle)
        else:
            s, one = 2.0 * np.arange(_SIDE) / _SIDE - 1.0, np.ones(_SIDE)
            x = self.a * np.concatenate([s, one, -s, -one])
            y = self.b * np.concatenate([-one, s, one, -s])
        return np.column_stack([x, y, np.full(len(x), z)])
