# SPDX-License-Identifier: Apache-2.0
"""How a change of the wanted force moves the gripper along one direction: at once, and without going too far.

Such a change is no measurement. It has no noise to be smoothed, and its way is known to its end.
"""

from math import sqrt

_NEARS, _ANSWERS = 50.0, 160.0  # [1/s] at which the end is neared, and at which a wanted velocity is
_BRAKES = 0.7  # share of the acceleration on which the braking counts
_NOTHING = 1e-7  # [m], [m/s] of a change that has come to its end


class ForceChange:
    """A way that is gone with bounded acceleration and jerk.

    Attributes:
        left: [m] yet to go. v, a: velocity [m/s] and acceleration [m/s^2].
    """

    def __init__(self, acceleration: float, jerk: float) -> None:
        """Nothing is left to go; bounds [m/s^2], [m/s^3]."""
        self._acceleration, self._jerk = acceleration, jerk
        self.forget()

    def forget(self) -> None:
        """Nothing is left to go."""
        self.left = self.v = self.a = 0.0

    def advance(self, dt: float, speed: float) -> float:
        """One step [m] of dt [s], at most at speed [m/s]."""
        distance, way = abs(self.left), 1.0 if self.left > 0.0 else -1.0
        if distance + abs(self.v) < _NOTHING:
            self.forget()
            return 0.0
        turning = max(way * self.a + self._acceleration, 0.0) / self._jerk  # [s] until it brakes
        braking = max(distance - turning * max(way * self.v, 0.0), 0.0)  # [m] that are left then
        most = min(sqrt(2.0 * _BRAKES * self._acceleration * braking), speed)
        v = way * min(_NEARS * distance, most)
        step, a = self.v * dt, (v - self.v) * min(_ANSWERS, 1.0 / dt)
        fastest = self._acceleration
        if a * self.v > 0.0:  # no more than the jerk can take back before the speed is there
            fastest = min(fastest, sqrt(self._jerk * max(speed - abs(self.v), 0.0)))
        a = min(max(a, -fastest), fastest)
        self.a += min(max(a - self.a, -self._jerk * dt), self._jerk * dt)
        self.v += self.a * dt
        self.left -= step
        return step
