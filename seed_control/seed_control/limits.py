# SPDX-License-Identifier: Apache-2.0
"""The command's motion: speed, acceleration and jerk bounded, whatever is asked for."""

from __future__ import annotations

from math import sqrt

import numpy as np

from seed_control.vectors import Triple, dot, minus, plus, triple
from seed_core.spatial import Array, make_pose, so3_exp, so3_log

_RENEW = 64  # turns


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
        self.p: Triple = (0.0, 0.0, 0.0)
        self.R = np.eye(3)
        self._turns = 0

    def reset(self, X: Array) -> None:
        """At rest at X (4, 4)."""
        self.p, self.R = triple(X[:3, 3]), X[:3, :3].copy()
        self.linear.reset()
        self.angular.reset()

    def advance(self, p: Triple, R: Array, dt: float, speed: float) -> None:
        """One step of dt [s] towards position p [m] and rotation R (3, 3); speed [m/s] bounds it now."""
        self.p = plus(self.p, self.linear.advance(*minus(p, self.p), dt, speed))
        self._turn(self.angular.advance(*_rotation_vector(R, self.R), dt, self.angular.speed))

    def stop(self, dt: float) -> None:
        """One step of dt [s] of coming to rest."""
        self.p = plus(self.p, self.linear.stop(dt))
        self._turn(self.angular.stop(dt))

    @property
    def pose(self) -> Array:
        """The commanded pose (4, 4), a copy."""
        return make_pose(self.R, self.p)

    def _turn(self, step: Triple) -> None:
        if step == (0.0, 0.0, 0.0):
            return
        R = so3_exp(step) @ self.R
        self._turns += 1
        if self._turns % _RENEW == 0:  # rounding would add up over hours: a Newton step towards an orthonormal matrix
            R = 1.5 * R - 0.5 * R @ (R.T @ R)
        self.R = R


def _rotation_vector(R_goal: Array, R: Array) -> Triple:
    """so3_log(R_goal R^T), with the sine for the angle where it is small: what steers a filter needs no more."""
    (a, b, c), (u, v, w) = R_goal.tolist(), R.tolist()
    if dot(a, u) + dot(b, v) + dot(c, w) > 2.95:
        return 0.5 * (dot(c, v) - dot(b, w)), 0.5 * (dot(a, w) - dot(c, u)), 0.5 * (dot(b, u) - dot(a, v))
    return triple(so3_log(R_goal @ R.T))
