# SPDX-License-Identifier: Apache-2.0
"""A line run through with a trapezoidal speed: position and velocity by time."""

from math import asinh, cos, pi, sin, sqrt

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
        self._points = corners[keep]
        self._along = np.cumsum([0.0, *lengths[keep[1:]]])
        self._set_pace(float(self._along[-1]), speed, acceleration)

    def _set_pace(self, length: float, speed: float, acceleration: float) -> None:
        self.length = length
        self.speed, self.acceleration = min(speed, sqrt(acceleration * length)), acceleration
        self._ramp = self.speed / acceleration
        self.duration = self._ramp + length / self.speed if length else 0.0

    def at(self, t: float) -> tuple[Array, Array]:
        """Position (3,) [m] and velocity (3,) [m/s] at t [s] after the start; at rest before and after."""
        s, v = self._gone(t)
        position, direction = self._place(s)
        return position, v * direction

    def share(self, t: float) -> float:
        """Of its length that it has gone at t [s] after the start."""
        return self._gone(t)[0] / self.length if self.length else 1.0

    def _gone(self, t: float) -> tuple[float, float]:
        """Way [m] and speed [m/s] at t [s] after the start."""
        a, left = self.acceleration, self.duration - max(t, 0.0)
        if left <= 0.0:
            return self.length, 0.0
        t = self.duration - left
        if t < self._ramp:
            return 0.5 * a * t * t, a * t
        if left < self._ramp:
            return self.length - 0.5 * a * left * left, a * left
        return self.speed * (t - 0.5 * self._ramp), self.speed

    def _place(self, s: float) -> tuple[Array, Array]:
        """Position (3,) [m] and direction (3,) at s [m] from the start."""
        if s >= self.length:
            return self._points[-1].copy(), np.zeros(3)
        i = min(max(int(np.searchsorted(self._along, s, side="right")) - 1, 0), len(self._points) - 2)
        direction = (self._points[i + 1] - self._points[i]) / (self._along[i + 1] - self._along[i])
        return self._points[i] + (s - self._along[i]) * direction, direction


class Spiral(Path):
    """Archimedes', about x and y of the work frame, from its centre to a radius, and once around at the end.

    Each place is computed when it is needed: as points, the largest spirals are millions.
    """

    def __init__(self, centre: ArrayLike, radius: float, pitch: float, speed: float, acceleration: float) -> None:
        """About centre (3,) to radius, with pitch between turns [m]; speed and acceleration as of a `Path`."""
        self._centre, self._radius = np.asarray(centre, dtype=float), radius
        self._per_angle = pitch / (2.0 * pi)  # [m/rad]
        self._angle = radius / self._per_angle  # [rad] at which the radius is reached
        self._outwards = self._arc(self._angle)  # [m]
        self._set_pace(self._outwards + 2.0 * pi * radius, speed, acceleration)

    def _arc(self, angle: float) -> float:
        """[m] from the centre to an angle [rad]."""
        return 0.5 * self._per_angle * (angle * sqrt(1.0 + angle * angle) + asinh(angle))

    def _place(self, s: float) -> tuple[Array, Array]:
        if s >= self._outwards:
            angle, r, drift = self._angle + (s - self._outwards) / self._radius, self._radius, 0.0
        else:
            angle = min(sqrt(2.0 * s / self._per_angle), s / self._per_angle)
            for _ in range(4):  # Newton's, of a convex function, from above
                angle -= (self._arc(angle) - s) / (self._per_angle * sqrt(1.0 + angle * angle))
            r, drift = self._per_angle * angle, self._per_angle
        c, n = cos(angle), sin(angle)
        out = np.array((drift * c - r * n, drift * n + r * c, 0.0))
        return self._centre + np.array((r * c, r * n, 0.0)), out / sqrt(drift * drift + r * r)
