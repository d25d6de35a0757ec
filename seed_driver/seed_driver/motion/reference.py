# SPDX-License-Identifier: Apache-2.0
"""The reference: a path through the targets, which may come at any rate."""

from seed_core.arm.quaternion import Quaternion, turn_between, turned
from seed_core.vector3 import ZERO, Vector3, capped, minus, norm, plus, scaled


class Reference:
    """Moves in a straight line from where it is (`p` [m], `q`) to the newest target, over the time between targets."""

    def __init__(self, p: Vector3, q: Quaternion) -> None:
        self.p, self.q = p, q
        self._velocity, self._angular_velocity = ZERO, ZERO
        self._target = p, q
        self._left = 0.0  # [s] until the target is reached
        self._interval = 0.0  # [s] smoothed time between targets
        self._last = float("-inf")
        self._feed = ZERO, ZERO

    def set_target(self, p: Vector3, q: Quaternion, now: float, longest: float) -> None:
        """A new target at time `now` [s]; targets are taken to come at most `longest` [s] apart."""
        gap = min(longest, now - self._last)
        self._interval = gap if gap >= longest or not self._interval else 0.8 * self._interval + 0.2 * gap
        self._last, self._target = now, (p, q)
        self._left = max(1e-4, min(longest, 1.25 * self._interval))
        velocity = scaled(minus(p, self.p), 1.0 / self._left)
        angular_velocity = scaled(turn_between(q, self.q), 1.0 / self._left)
        self._feed = capped(velocity, norm(self._velocity)), capped(angular_velocity, norm(self._angular_velocity))
        self._velocity, self._angular_velocity = velocity, angular_velocity

    def step(self, dt: float) -> tuple[Vector3, Vector3]:
        """Advance by dt [s].

        Returns:
            Velocity [m/s] and angular velocity [rad/s] to feed forward, no more than those on the last line.
        """
        if self._left <= 0.0:
            self._velocity = self._angular_velocity = ZERO
            return ZERO, ZERO
        share = min(dt, self._left)
        self._left -= share
        if self._left <= 1e-9:
            (self.p, self.q), self._left = self._target, 0.0
        else:
            self.p = plus(self.p, scaled(self._velocity, share))
            self.q = turned(self.q, scaled(self._angular_velocity, share))
        return self._feed
