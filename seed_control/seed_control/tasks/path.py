# SPDX-License-Identifier: Apache-2.0
"""A polyline run through with a trapezoidal speed: position and velocity by time."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from seed_core.spatial import Array


class Path:
    """Through points (n, 3) [m], starting and ending at rest."""

    def __init__(self, points: ArrayLike, speed: float, acceleration: float) -> None:
        corners = np.asarray(points, dtype=float).reshape(-1, 3)
        lengths = np.sqrt((np.diff(corners, axis=0) ** 2).sum(axis=1))
        keep = np.concatenate([[True], lengths > 1e-9])
        self.points = corners[keep]
        self._along = np.concatenate([[0.0], np.cumsum(lengths[keep[1:]])])
        self.length = float(self._along[-1])
        self.speed, self.acceleration = min(speed, sqrt(acceleration * self.length)), acceleration
        self._ramp = self.speed / acceleration
        self.duration = 2.0 * self._ramp + (self.length / self.speed - self._ramp) if self.length else 0.0

    def at(self, t: float) -> tuple[Array, Array]:
        """Position (3,) [m] and velocity (3,) [m/s] at t [s] after the start; at rest before and after."""
        if t >= self.duration or self.length == 0.0:
            return self.points[-1].copy(), np.zeros(3)
        s, v = self._travel(max(t, 0.0))
        i = min(max(int(np.searchsorted(self._along, s, side="right")) - 1, 0), len(self.points) - 2)
        direction = (self.points[i + 1] - self.points[i]) / (self._along[i + 1] - self._along[i])
        return self.points[i] + (s - self._along[i]) * direction, v * direction

    def _travel(self, t: float) -> tuple[float, float]:
        a, left = self.acceleration, self.duration - t
        if t < self._ramp:
            return 0.5 * a * t * t, a * t
        if left < self._ramp:
            return self.length - 0.5 * a * left * left, a * left
        return self.speed * (t - 0.5 * self._ramp), self.speed
