# SPDX-License-Identifier: Apache-2.0
"""How a change of the wanted force moves the gripper along one direction: at once, and without going too far.

Such a change is no measurement. It has no noise to be smoothed, and its way is known to its end.
"""

from math import sqrt

_SHARE = 0.9  # of acceleration and jerk: the rest is for what the images bring meanwhile
_HALVINGS = 14  # of the jerks that are possible: the chosen one is within 0.03 m/s^3
_THERE, _RESTS = 1e-7, 1e-5  # [m], [m/s] of a change that has come to its end


class ForceChange:
    """A way that is gone as fast as bounds of speed, acceleration and jerk allow.

    Each step takes the largest jerk after which the way still ends without going back.

    Attributes:
        left: [m] yet to go. v, a: velocity [m/s] and acceleration [m/s^2].
    """

    def __init__(self, acceleration: float, jerk: float) -> None:
        """Nothing is left to go; bounds [m/s^2], [m/s^3]."""
        self._acceleration, self._jerk = _SHARE * acceleration, _SHARE * jerk
        self.forget()

    def forget(self) -> None:
        """Nothing is left to go."""
        self.left = self.v = self.a = 0.0

    def advance(self, dt: float, speed: float) -> float:
        """One step [m] of dt [s], at most at speed [m/s]."""
        if abs(self.left) < _THERE and abs(self.v) < _RESTS:
            self.forget()
            return 0.0
        way = 1.0 if self.left > self._stopping(self.v, self.a) else -1.0
        v, a = way * self.v, way * self.a
        jerk = self._largest_jerk(way * self.left, v, a, dt, speed)
        self.a = way * min(max(a + jerk * dt, -self._acceleration), self._acceleration)
        self.v += self.a * dt
        self.left -= self.v * dt
        return self.v * dt

    def _largest_jerk(self, left: float, v: float, a: float, dt: float, speed: float) -> float:
        """Jerk [m/s^3] of a step with which `left` [m] are to go, at most at speed [m/s]."""

        def may(jerk: float) -> bool:
            now = min(max(a + jerk * dt, -self._acceleration), self._acceleration)
            fast = v + now * dt
            if fast + 0.5 * max(now, 0.0) ** 2 / self._jerk > speed:  # once the acceleration is taken back
                return False
            return self._stopping(fast, now) + 0.5 * fast * dt <= left  # a step goes by the speed at its end

        low, high = -self._jerk, self._jerk
        if may(high):
            return high
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if may(middle) else (low, middle)
        return low

    def _stopping(self, v: float, a: float) -> float:
        """Way [m], with its sign, until velocity v and acceleration a are both zero, as soon as the bounds allow."""
        if v < 0.0 or (v == 0.0 and a < 0.0):
            return -self._stopping(-v, -a)
        turning = abs(a) / self._jerk  # [s] until the acceleration is zero, or since it was
        gained = 0.5 * a * turning  # [m/s] of the velocity in that time
        if a >= 0.0:
            return (v + 2.0 / 3.0 * gained) * turning + self._braking(v + gained)
        if v + gained >= 0.0:  # it is braking already, as from a faster speed
            return self._braking(v - gained) - (v - 2.0 / 3.0 * gained) * turning
        return (v + 2.0 / 3.0 * gained) * turning - self._braking(-v - gained)

    def _braking(self, v: float) -> float:
        """Way [m] from a steady velocity v >= 0 to rest."""
        if v < self._acceleration**2 / self._jerk:
            return v * sqrt(v / self._jerk)
        return 0.5 * v * (v / self._acceleration + self._acceleration / self._jerk)
