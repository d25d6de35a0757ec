# SPDX-License-Identifier: Apache-2.0
"""The command's motion: speed, acceleration and jerk bounded, whatever is asked for.

The driver has a limiter of its own (seed_driver.motion.limiter), behind this one: this one shapes the motion that the
task wants, smoothly and with its lag known; that one guards the robot against whatever arrives there.
"""

from math import sqrt

from seed_core.arm.quaternion import IDENTITY, Quaternion, as_quaternion, to_pose, turn_towards, turned
from seed_core.spatial import Array
from seed_core.vector3 import ZERO, Vector3, capped, minus, norm, plus, plus_scaled, scaled, transformed

Motion = tuple[Vector3, Vector3]  # velocity [m/s] as a step begins, and acceleration [m/s^2] during it
AT_REST: Motion = (ZERO, ZERO)


class VectorLimiter:
    """A point in three dimensions that follows a target with bounded speed, acceleration and jerk (in norm).

    Far away it brakes on v^2 = 2 a d; close by it follows like a critically damped second-order filter of the given
    bandwidth, so that noise in the target is smoothed and a target in steady motion is followed without swinging.

    Attributes:
        v, a: velocity [m/s] and acceleration [m/s^2] of the point.
        limited: whether the speed bound shaped the last step.
    """

    def __init__(self, speed: float, acceleration: float, jerk: float, bandwidth: float) -> None:
        """Bounds [m/s], [m/s^2], [m/s^3] or of radians; bandwidth [rad/s]."""
        self.speed, self.acceleration, self.jerk, self.bandwidth = speed, acceleration, jerk, bandwidth
        self.reset()

    def reset(self) -> None:
        """At rest."""
        self.v = self.a = ZERO
        self.limited = False

    def advance(self, way: Vector3, dt: float, speed: float, known: Motion = AT_REST) -> Vector3:
        """Step (3,) of the point in dt [s] towards a target that lies `way` from it; speed [m/s] bounds it now.

        known: part of the target's motion that is no noise. It is followed at once, within the same bounds.
        """
        v, a = known
        if known is not AT_REST:
            way = plus_scaled(plus_scaled(way, -dt, v), -dt * dt, a)
        distance, gain = norm(way), 0.5 * self.bandwidth
        wanted = gain * distance
        if self.speed < speed:
            speed = self.speed
        self.limited = wanted > speed
        cap = sqrt(1.4 * self.acceleration * distance)
        if speed < cap:
            cap = speed
        goal = scaled(way, gain if wanted <= cap else cap / distance)
        if known is not AT_REST:
            goal = plus(goal, v)
            if norm(goal) > speed:
                goal, a = capped(goal, speed), ZERO
        return self._towards(goal, dt, a)

    def stopping(self, speed: float) -> float:
        """Way [m], at most, in which the point comes to rest from a speed [m/s] at which it may yet be gaining speed.

        The jerk takes a time to take the acceleration back, and another to turn it round; then the point brakes at the
        full acceleration, and its last part at the rate of the smoothing.
        """
        turning = self.acceleration / self.jerk
        fastest = speed + 0.5 * self.acceleration * turning
        return fastest * (0.5 * fastest / self.acceleration + 1.5 * turning + 0.5 / self.bandwidth)

    def stop(self, dt: float) -> Vector3:
        """Step (3,) of the point in dt [s] while it comes to rest."""
        return self._towards(ZERO, dt)

    def _towards(self, v: Vector3, dt: float, known: Vector3 = ZERO) -> Vector3:
        """Change the velocity towards a wanted one at rate 2 w, acceleration and jerk within bounds.

        known: (3,) acceleration [m/s^2] that the wanted velocity is known to have.
        """
        gain = min(2.0 * self.bandwidth, 1.0 / dt)
        (x, y, z), (ux, uy, uz), (ax, ay, az), (kx, ky, kz) = v, self.v, self.a, known
        x, y, z = capped(((x - ux) * gain + kx, (y - uy) * gain + ky, (z - uz) * gain + kz), self.acceleration)
        x, y, z = capped((x - ax, y - ay, z - az), self.jerk * dt)
        self.a = ax, ay, az = ax + x, ay + y, az + z
        self.v = ux, uy, uz = ux + ax * dt, uy + ay * dt, uz + az * dt
        return ux * dt, uy * dt, uz * dt


class PoseLimiter:
    """The commanded pose of a body, moved towards each step's target within the limits of one of its points.

    Args:
        point: (3,) [m] in the body, whose speed `linear` limits.
    """

    def __init__(self, linear: VectorLimiter, angular: VectorLimiter, point: Vector3 = ZERO) -> None:
        self.linear, self.angular, self.point = linear, angular, point
        self.p: Vector3 = point  # of the point, in the parent frame
        self.q: Quaternion = IDENTITY  # of the body

    def reset(self, X: Array) -> None:
        """At rest with the body at X (4, 4)."""
        self.p, self.q = transformed(X.tolist(), self.point), as_quaternion(X[:3, :3])
        self.linear.reset()
        self.angular.reset()

    def advance(self, p: Vector3, q: Quaternion, dt: float, speed: float, known: Motion = AT_REST) -> None:
        """One step of dt [s] towards the point's place p [m] and rotation q; speed [m/s] bounds it now.

        known: part of the motion of p that is no noise.
        """
        self.p = plus(self.p, self.linear.advance(minus(p, self.p), dt, speed, known))
        self.q = turned(self.q, self.angular.advance(turn_towards(q, self.q), dt, self.angular.speed))

    def shift(self, p: Vector3, dt: float, speed: float) -> None:
        """One step of dt [s] towards the point's place p [m], while the rotation comes to rest."""
        self.p = plus(self.p, self.linear.advance(minus(p, self.p), dt, speed))
        self.q = turned(self.q, self.angular.stop(dt))

    def stop(self, dt: float) -> None:
        """One step of dt [s] of coming to rest."""
        self.p = plus(self.p, self.linear.stop(dt))
        self.q = turned(self.q, self.angular.stop(dt))

    @property
    def pose(self) -> Array:
        """The commanded pose (4, 4), a copy."""
        return to_pose(self.p, self.q, self.point)
