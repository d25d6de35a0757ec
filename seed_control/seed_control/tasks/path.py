# SPDX-License-Identifier: Apache-2.0
"""A polyline run through with a trapezoidal speed: position and velocity by time."""

from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from seed_core.spatial import Array


class Path:
    """Through points (n, 3) [m], starting and ending at rest."""

    def __init__(self, points: ArrayLike, speed: float, acceleration: float) -> None:
        """Along the whole at most at speed [m/s], with acceleration [m/s^2] at both ends."""
        corners = np.asarray(points, dtype=float).reshape(-1, 3)
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        keep = np.concatenate([[True], lengths > 1e-9])
        self.points = corners[keep]
        self._along = np.cumsum([0.0, *lengths[keep[1:]]])
        self.length = float(self._along[-1])
        self.speed, self.acceleration = min(speed, sqrt(acceleration * self.length)), acceleration
        self._ramp = self.speed / acceleration
        self.duration = self._ramp + self.length / self.speed if self.length else 0.0

    def at(self, t: float) -> tuple[Array, Array]:
        """Position (3,) [m] and velocity (3,) [m/s] at t [s] after the start; at rest before and after."""
        a, left = self.acceleration, self.duration - max(t, 0.0)
        if left <= 0.0:
            return self.points[-1].copy(), np.zeros(3)
        t = self.duration - left
        if t < self._ramp:
            s, v = 0.5 * a * t * t, a * t
        elif left < self._ramp:
            s, v = self.length - 0.5 * a * left * left, a * left
        else:
            s, v = self.speed * (t - 0.5 * self._ramp), self.speed
        i = min(max(int(np.searchsorted(self._along, s, side="right")) - 1, 0), len(self.points) - 2)
        direction = (self.points[i + 1] - self.points[i]) / (self._along[i + 1] - self._along[i])
        return self.points[i] + (s - self._along[i]) * direction, v * direction
