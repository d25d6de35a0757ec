# SPDX-License-Identifier: Apache-2.0
"""The command's motion: speed, acceleration and jerk bounded, whatever is asked for."""

from __future__ import annotations

from math import sqrt

import numpy as np

from seed_core.spatial import Array, make_pose, so3_log

Triple = tuple[float, float, float]


class VectorLimiter:
    """A point in three dimensions that follows a target with bounded speed, acceleration and jerk (in norm).

    Far away it brakes on v^2 = 2 a d; close by it follows like a critically damped second-order filter of the given
    bandwidth, so that noise in the target is smoothed and a target in steady motion is followed without swinging.
    """

    def __init__(self, speed: float, acceleration: float, jerk: float, bandwidth: float) -> None:
        self.speed, self.acceleration, self.jerk, self.bandwidth = speed, acceleration, jerk, bandwidth
        self.v: Triple = (0.0, 0.0, 0.0)
        self.a: Triple = (0.0, 0.0, 0.0)
        self.limited = False

    def reset(self) -> None:
        """At rest."""
        self.v = self.a = (0.0, 0.0, 0.0)
        self.limited = False

    def advance(self, dx: float, dy: float, dz: float, dt: float, speed: float) -> Triple:
        """Step (3,) of the point in dt [s] towards a target that lies (dx, dy, dz) away; speed [m/s] bounds it now."""
        w = self.bandwidth
        distance = sqrt(dx * dx + dy * dy + dz * dz)
        wanted = 0.5 * w * distance
        cap = min(self.speed, speed, sqrt(1.4 * self.acceleration * distance))
        scale = 0.5 * w if wanted <= cap else cap / distance
        self.limited = wanted > min(self.speed, speed)
        return self._towards(dx * scale, dy * scale, dz * scale, dt)

    def stop(self, dt: float) -> Triple:
        """Step (3,) of the point in dt [s] while it comes to rest."""
        return self._towards(0.0, 0.0, 0.0, dt)

    def _towards(self, vx: float, vy: float, vz: float, dt: float) -> Triple:
        """Change the velocity towards a wanted one at rate 2 w, acceleration and jerk within bounds."""
        gain = min(2.0 * self.bandwidth, 1.0 / dt)
        ux, uy, uz = self.v
        ax, ay, az = _clipped((vx - ux) * gain, (vy - uy) * gain, (vz - uz) * gain, self.acceleration)
        bx, by, bz = self.a
        jx, jy, jz = _clipped(ax - bx, ay - by, az - bz, self.jerk * dt)
        self.a = ax, ay, az = bx + jx, by + jy, bz + jz
        self.v = ux, uy, uz = ux + ax * dt, uy + ay * dt, uz + az * dt
        return ux * dt, uy * dt, uz * dt


def _clipped(x: float, y: float, z: float, bound: float) -> Triple:
    norm = sqrt(x * x + y * y + z * z)
    if norm <= bound:
        return x, y, z
    s = bound / norm
    return x * s, y * s, z * s


class PoseLimiter:
    """The commanded pose: what is sent to the arm, moved towards each step's target within the limits."""

    def __init__(self, linear: VectorLimiter, angular: VectorLimiter) -> None:
        self.linear, self.angular = linear, angular
        self.p = np.zeros(3)
        self.R = np.eye(3)

    def reset(self, X: Array) -> None:
        """At rest at X (4, 4)."""
        self.p, self.R = X[:3, 3].copy(), X[:3, :3].copy()
        self.linear.reset()
        self.angular.reset()

    def advance(self, p: Array, R: Array, dt: float, speed: float) -> None:
        """One step of dt [s] towards position p (3,) and rotation R (3, 3); speed [m/s] bounds it now."""
        ex, ey, ez = (p - self.p).tolist()
        self._move(self.linear.advance(ex, ey, ez, dt, speed))
        x, y, z = _rotation_vector(R @ self.R.T)
        self._turn(self.angular.advance(x, y, z, dt, self.angular.speed))

    def stop(self, dt: float) -> None:
        """One step of dt [s] of coming to rest."""
        self._move(self.linear.stop(dt))
        self._turn(self.angular.stop(dt))

    @property
    def pose(self) -> Array:
        """The commanded pose (4, 4), a copy."""
        return make_pose(self.R, self.p)

    def _move(self, step: Triple) -> None:
        self.p = self.p + step

    def _turn(self, step: Triple) -> None:
        x, y, z = step
        if x == y == z == 0.0:
            return
        R = self.R + np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))) @ self.R
        # A step is below 0.01 rad: one Newton step towards an orthonormal matrix leaves 1e-8, the next ones rounding.
        for _ in range(2):
            R = 1.5 * R - 0.5 * R @ (R.T @ R)
        self.R = R


def _rotation_vector(R: Array) -> Triple:
    """so3_log, with the sine for the angle where it is small: what steers a filter needs no more."""
    (_, r01, r02), (r10, _, r12), (r20, r21, r22) = rows = R.tolist()
    if rows[0][0] + rows[1][1] + r22 > 2.95:
        return 0.5 * (r21 - r12), 0.5 * (r02 - r20), 0.5 * (r10 - r01)
    x, y, z = so3_log(R).tolist()
    return x, y, z
