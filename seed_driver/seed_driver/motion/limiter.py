# SPDX-License-Identifier: Apache-2.0
"""The limiter: from the reference to a smooth command at the servo rate, within the limits of a motion.

Each of its two stages is simple enough to be bounded by inspection:
1. The inner pose chases the reference: v = v_reference + direction * min(sqrt(2 a e), e / 10 ms), with |v| and
   |dv/dt| limited. Holding is v_reference = 0 and no error: a deceleration at the limit, from whatever the state is.
2. The command is the mean of the last n inner poses: it keeps every bound of the first stage (a mean of bounded
   vectors is bounded), stays inside any convex workspace, and limits the jerk to 2 a / (n dt). n dt is bounded, too.

The controller has a limiter of its own (seed_control.command.limiter), before this one: that one shapes the motion
that the task wants, smoothly and with its lag known; this one guards the robot against whatever arrives here.
"""

from collections import deque
from dataclasses import replace
from math import ceil, copysign, sqrt

from seed_core.arm.limits import MotionLimits
from seed_core.arm.quaternion import Quaternion, turn_between, turned
from seed_core.vector3 import ZERO, Vector3, capped, dot, minus, norm, plus, plus_scaled, scaled
from seed_driver.motion.reference import Reference

APPROACH = 100.0  # [1/s] near the reference the distance decays at this rate,
STEP_SHARE = 0.5  # or by this share in a step where that is less: a step that goes too far has to come back, for ever
BRAKE_SHARE = 0.7  # of the acceleration limit is planned for braking, the rest is margin
SIDE_SHARE = BRAKE_SHARE / sqrt(3.0)  # before each side of the workspace: in a corner it brakes along three axes
AT_REST = 1e-9  # [m, rad] that the smoothing holds back at most where it makes no difference
BRAKING = "max_acceleration", "max_angular_acceleration", "max_jerk"  # what a stop's way follows from


class CommandLimiter:
    """The two stages. Per step: `propose`, whatever slows it down, then `advance`.

    Attributes:
        p, q: the command, position [m] and quaternion.
        reference: what it follows; None while it comes to rest.
        limits: those in use.
    """

    def __init__(self, p: Vector3, q: Quaternion, dt: float, limits: MotionLimits) -> None:
        """Stand still at p [m], q; dt: [s] of a step."""
        self.dt, self.limits, self._wanted = dt, limits, limits
        self.reference: Reference | None = None
        self.restart(p, q)

    def restart(self, p: Vector3, q: Quaternion) -> None:
        """Stand still at a pose."""
        self.inner_p, self.inner_q, self.p, self.q = p, q, p, q
        self.velocity, self.angular_velocity = ZERO, ZERO  # of the inner pose [m/s], [rad/s]
        self.limits = self._wanted
        self._low, self._high = self.limits.workspace_low, self.limits.workspace_high  # [m] of the workspace in use
        self._braking = False  # before a side that came too near
        self._steps: deque[tuple[Vector3, Vector3]] = deque()  # [m], [rad] of the inner pose, newest first

    def set_limits(self, limits: MotionLimits) -> None:
        """Take changed limits: speeds and workspace at once, accelerations and jerk as soon as the command rests.

        With another acceleration or smoothing in motion the command would jump, or stop elsewhere than was foretold.
        Before a side of the workspace that came too near it brakes within its limits, and may come to rest beyond it.
        """
        self._wanted = limits
        if self._resting:
            self.limits = limits
        else:
            self.limits = replace(limits, **{name: getattr(self.limits, name) for name in BRAKING})
        self._move_sides()

    def _move_sides(self) -> None:
        """Move the sides of the workspace in use to those wanted, as far as it can still brake before them."""
        low, high = self._wanted.workspace_low, self._wanted.workspace_high
        if self._low == low and self._high == high:
            self._braking = False
            return
        p, v, a = self.inner_p, self.velocity, SIDE_SHARE * self.limits.max_acceleration
        stop = [p[i] + copysign(_braking_distance(abs(v[i]), a, self._approach), v[i]) for i in range(3)]
        x, y, z = (min(low[i], max(self._low[i], min(p[i], stop[i]))) for i in range(3))
        self._low = x, y, z
        x, y, z = (max(high[i], min(self._high[i], max(p[i], stop[i]))) for i in range(3))
        self._high = x, y, z
        self._braking = any(
            min(low[i], p[i]) - self._low[i] > AT_REST or self._high[i] - max(high[i], p[i]) > AT_REST for i in range(3)
        )

    def follow(self, p: Vector3, q: Quaternion, now: float, longest: float) -> None:
        """Go to a new target from time `now` [s] on; targets are taken to come at most `longest` [s] apart."""
        if self.reference is None:
            self.reference = Reference(self.inner_p, self.inner_q)
        self.reference.set_target(p, q, now, longest)

    def hold(self) -> None:
        """Decelerate to rest."""
        self.reference = None

    @property
    def _approach(self) -> float:
        """Rate [1/s] at which the distance decays at last."""
        return min(APPROACH, STEP_SHARE / self.dt)

    @property
    def moving(self) -> bool:
        """Whether the velocity of this step is not zero."""
        return any(self.velocity) or any(self.angular_velocity)

    @property
    def still(self) -> bool:
        """Whether neither the command nor its past moves."""
        return not self.moving and not any(any(p) or any(r) for p, r in self._steps)

    @property
    def _resting(self) -> bool:
        """Whether the command and its past move so little that another smoothing does not show.

        Of a command that is not smoothed there is no past.
        """
        now = self.dt * sum(map(abs, (*self.velocity, *self.angular_velocity)))
        return now + sum(abs(x) for step in self._steps for part in step for x in part) < AT_REST

    def propose(self, hurry: float = 1.0) -> None:
        """Choose the velocity of this step: towards the reference, or to rest.

        Args:
            hurry: times the acceleration limit in coming to rest, where the time of the steps is not the wall's.
        """
        limits, goal, angular_goal, change = self.limits, ZERO, ZERO, hurry * self.dt
        if self.reference is not None:
            change = self.dt
            feed, angular_feed = self.reference.step(self.dt)
            gap, turn = minus(self.reference.p, self.inner_p), turn_between(self.reference.q, self.inner_q)
            approach = self._approach
            goal = _chase(gap, feed, limits.max_speed, limits.max_acceleration, approach)
            if self._braking:
                goal = ZERO
            angular_goal = _chase(
                turn, angular_feed, limits.max_angular_speed, limits.max_angular_acceleration, approach
            )
        self.velocity = self._inside_towards(goal, limits.max_acceleration * change)
        self.angular_velocity = _towards(self.angular_velocity, angular_goal, limits.max_angular_acceleration * change)

    def _inside_towards(self, goal: Vector3, step: float) -> Vector3:
        """The velocity a step [m/s] on at most: what the sides of the workspace ask for, the rest of it to the goal."""
        v, braked, inside = self.velocity, self._inside(self.velocity), self._inside(goal)
        change, rest = minus(braked, v), minus(inside, braked)
        # The largest share of `rest` with |change + share * rest| = step. What lies between two velocities that both
        # keep inside keeps inside, too.
        squared, along = dot(rest, rest), dot(change, rest)
        left = along * along + squared * max(step * step - dot(change, change), 0.0)
        share = 0.0 if squared == 0.0 else max(0.0, min(1.0, (sqrt(left) - along) / squared))
        return plus_scaled(braked, share, rest)

    def _inside(self, v: Vector3) -> Vector3:
        """A velocity from which it comes to rest before each side of the workspace that it goes towards."""
        p, low, high, approach = self.inner_p, self._low, self._high, self._approach
        a = SIDE_SHARE * self.limits.max_acceleration
        top = [_braking_speed(high[i] - p[i], a, approach) for i in range(3)]
        bottom = [-_braking_speed(p[i] - low[i], a, approach) for i in range(3)]
        x, y, z = (max(min(v[i], top[i]), bottom[i]) for i in range(3))
        return x, y, z

    def slow(self, share: float) -> None:
        """Scale this step's velocity, e.g. because a joint would be too fast."""
        self.velocity, self.angular_velocity = scaled(self.velocity, share), scaled(self.angular_velocity, share)

    def next_pose(self) -> tuple[Vector3, Quaternion]:
        """The inner pose after this step."""
        p = plus(self.inner_p, scaled(self.velocity, self.dt))
        return p, turned(self.inner_q, scaled(self.angular_velocity, self.dt))

    def advance(self) -> None:
        """Take the step, never further out of the workspace, and smooth."""
        limits, old, low, high = self.limits, self.inner_p, self._low, self._high
        p, q = self.next_pose()
        if not (low[0] <= p[0] <= high[0] and low[1] <= p[1] <= high[1] and low[2] <= p[2] <= high[2]):
            x, y, z = (min(max(p[i], min(low[i], old[i])), max(high[i], old[i])) for i in range(3))
            p = x, y, z
        self.inner_p, self.inner_q = p, q
        self._move_sides()
        if not self._steps and p == old and not any(self.angular_velocity):
            self.p, self.q = p, q  # at rest, and nothing of the past left
            self.limits = self._wanted
            return
        length = max(1, ceil(2.0 * limits.max_acceleration / (limits.max_jerk * self.dt)))
        self._steps.appendleft((minus(p, old), scaled(self.angular_velocity, self.dt)))
        while len(self._steps) >= length:
            self._steps.pop()
        self._smooth(length)
        if self.still:
            self._steps.clear()
        if self.limits is not self._wanted and self._resting:
            self.limits = self._wanted

    def _smooth(self, length: int) -> None:
        """Mean of the last `length` inner poses: the newest, less what each of the last steps adds to it.

        Rotations of a few milliradians are added as vectors; the error is of second order and does not accumulate.
        """
        back, turn = ZERO, ZERO
        for i, (step, angular_step) in enumerate(self._steps):
            weight = (length - 1 - i) / length
            back = plus_scaled(back, weight, step)
            turn = plus_scaled(turn, -weight, angular_step)
        self.p = minus(self.inner_p, back)
        self.q = turned(self.inner_q, turn)


def _braking_speed(distance: float, a: float, approach: float) -> float:
    """The speed [m/s] from which it comes to rest within a distance [m], slowing down by a [m/s^2] at most.

    The last part is an exponential decay: each step is finite, and a square root ends with a jump.
    """
    near = a / approach**2  # [m] where both parts have the same speed and the same slope
    if distance <= near:
        return approach * max(distance, 0.0)
    return sqrt(2.0 * a * (distance - 0.5 * near))


def _braking_distance(speed: float, a: float, approach: float) -> float:
    """The distance [m] within which it comes to rest from a speed [m/s]: the inverse of `_braking_speed`."""
    if speed <= a / approach:
        return speed / approach
    return 0.5 * (speed * speed / a + a / approach**2)


def _chase(error: Vector3, feed: Vector3, top: float, acceleration: float, approach: float) -> Vector3:
    """Velocity that makes up for `error`, braking in time, on top of the velocity `feed`; no faster than `top`."""
    distance = norm(error)
    if distance == 0.0:
        return capped(feed, top)
    speed = min(sqrt(2.0 * BRAKE_SHARE * acceleration * distance), approach * distance)
    return capped(plus_scaled(feed, speed / distance, error), top)


def _towards(start: Vector3, goal: Vector3, step: float) -> Vector3:
    return plus(start, capped(minus(goal, start), step))
