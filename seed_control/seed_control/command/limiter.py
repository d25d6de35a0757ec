# SPDX-License-Identifier: Apache-2.0
"""The command's motion: speed, acceleration and jerk bounded, whatever is asked for.

The driver has a limiter of its own (seed_driver.motion.limiter), behind this one: this one shapes the motion that the
task wants, smoothly and with its lag known; that one guards the robot against whatever arrives there.
"""

from __future__ import annotations

from math import sqrt

from seed_core.quaternion import IDENTITY, Quaternion, as_quaternion, to_pose, turn_towards, turned
from seed_core.spatial import Array
from seed_core.vector3 import Vector3, plus, transformed


class VectorLimiter:
    """A point in three dimensions that follows a target with bounded speed, acceleration and jerk (in norm).

    Far away it brakes on v^2 = 2 a d; close by it follows like a critically damped second-order filter of the given
    bandwidth, so that noise in the target is smoothed and a target in steady motion is followed without swinging.
    """

    def __init__(self, speed: float, acceleration: float, jerk: float, bandwidth: float) -> None:
        self.speed, self.acceleration, self.jerk, self.bandwidth = speed, acceleration, jerk, bandwidth
        self.v: Vector3 = (0.0, 0.0, 0.0)
        self.a: Vector3 = (0.0, 0.0, 0.0)
        self.limited = False

    def reset(self) -> None:
        """At rest."""
        self.v = self.a = (0.0, 0.0, 0.0)
        self.limited = False

    def advance(self, dx: float, dy: float, dz: float, dt: float, speed: float) -> Vector3:
        """Step (3,) of the point in dt [s] towards a target that lies (dx, dy, dz) away; speed [m/s] bounds it now."""
        w = self.bandwidth
        distance = sqrt(dx * dx + dy * dy + dz * dz)
        wanted = 0.5 * w * distance
        cap = min(self.speed, speed, sqrt(1.4 * self.acceleration * distance))
        scale = 0.5 * w if wanted <= cap else cap / distance
        self.limited = wanted > min(self.speed, speed)
        return self._towards(dx * scale, dy * scale, dz * scale, dt)

    def stop(self, dt: float) -> Vector3:
        """Step (3,) of the point in dt [s] while it comes to rest."""
        return self._towards(0.0, 0.0, 0.0, dt)

    def _towards(self, vx: float, vy: float, vz: float, dt: float) -> Vector3:
        """Change the velocity towards a wanted one at rate 2 w, acceleration and jerk within bounds."""
        gain = min(2.0 * self.bandwidth, 1.0 / dt)
        (ux, uy, uz), (bx, by, bz) = self.v, self.a
        ax, ay, az = (vx - ux) * gain, (vy - uy) * gain, (vz - uz) * gain
        size, bound = sqrt(ax * ax + ay * ay + az * az), self.acceleration
        if size > bound:
            s = bound / size
            ax, ay, az = s * ax, s * ay, s * az
        jx, jy, jz = ax - bx, ay - by, az - bz
        size, bound = sqrt(jx * jx + jy * jy + jz * jz), self.jerk * dt
        if size > bound:
            s = bound / size
            ax, ay, az = bx + s * jx, by + s * jy, bz + s * jz
        self.a = ax, ay, az
        self.v = ux, uy, uz = ux + ax * dt, uy + ay * dt, uz + az * dt
        return ux * dt, uy * dt, uz * dt


class PoseLimiter:
    """The commanded pose of a body, moved towards each step's target within the limits of one of its points.

    Args:
        point: (3,) [m] in the body, whose speed `linear` limits.
    """

    def __init__(self, linear: VectorLimiter, angular: VectorLimiter, point: Vector3 = (0.0, 0.0, 0.0)) -> None:
        self.linear, self.angular, self.point = linear, angular, point
        self.p: Vector3 = point  # of the point, in the parent frame
        self.q: Quaternion = IDENTITY  # of the body

    def reset(self, X: Array) -> None:
        """At rest with the body at X (4, 4)."""
        self.p, self.q = transformed(X.tolist(), self.point), as_quaternion(X[:3, :3])
        self.linear.reset()
        self.angular.reset()

    def advance(self, p: Vector3, q: Quaternion, dt: float, speed: float) -> None:
        """One step of dt [s] towards the point's place p [m] and rotation q; speed [m/s] bounds it now."""
        (x, y, z), (a, b, c) = self.p, p
        u, v, w = self.linear.advance(a - x, b - y, c - z, dt, speed)
        self.p = x + u, y + v, z + w
        self.q = turned(self.q, self.angular.advance(*turn_towards(q, self.q), dt, self.angular.speed))

    def stop(self, dt: float) -> None:
        """One step of dt [s] of coming to rest."""
        self.p = plus(self.p, self.linear.stop(dt))
        self.q = turned(self.q, self.angular.stop(dt))

    @property
    def pose(self) -> Array:
        """The commanded pose (4, 4), a copy."""
        return to_pose(self.p, self.q, self.point)
