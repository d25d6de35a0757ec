# SPDX-License-Identifier: Apache-2.0
"""The reference: a path through the targets, which may come at any rate."""

from seed_core.arm.quaternion import Quaternion, turn_between, turned
from seed_core.vector3 import ZERO, Vector3, capped, minus, norm, plus, scaled


class Reference:
    """Moves in a straight line from where it is (`p` [m], `q`) to the newest target, over the time between targets.

    It feeds forward no more than the targets themselves move, so that the command does not pass a target that stands.
    """

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
        interval = gap if gap >= longest or not self._interval else 0.8 * self._interval + 0.2 * gap
        self._interval = max(1e-4, interval)
        self._left = min(longest, 1.25 * self._interval)
        went, turn = norm(minus(p, self._target[0])), norm(turn_between(q, self._target[1]))
        self._last, self._target = now, (p, q)
        velocity = scaled(minus(p, self.p), 1.0 / self._left)
        angular_velocity = scaled(turn_between(q, self.q), 1.0 / self._left)
        self._feed = (
            capped(velocity, min(norm(self._velocity), went / self._interval)),
            capped(angular_velocity, min(norm(self._angular_velocity), turn / self._interval)),
        )
        self._velocity, self._angular_velocity = velocity, angular_velocity

    def step(self, dt: float) -> tuple[Vector3, Vector3]:
        """Advance by dt [s].

        Returns:
            Velocity [m/s] and angular velocity [rad/s] to feed forward.
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
