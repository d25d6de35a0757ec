# SPDX-License-Identifier: Apache-2.0
"""From targets at any rate to a smooth command at the servo rate, within speed, acceleration, jerk and workspace.

Three stages, each simple enough to be bounded by inspection:
1. `Reference` moves in a straight line from where it is to the newest target, over the time between targets.
2. `Follower` chases it: v = v_reference + direction * min(sqrt(2 a e), e / 10 ms), |v| and |dv/dt| limited.
3. A mean over the last n poses: keeps every bound of stage 2 (a mean of bounded vectors is bounded), stays inside
   any convex workspace, and limits the jerk to 2 a / (n dt).
Holding is stage 2 with v = 0: a deceleration at the limit, from whatever the state is.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import ceil, sqrt

from seed_core.quaternion import Quaternion, turn_between, turned
from seed_core.vector3 import ZERO, Vector3, capped, minus, norm, plus, scaled

APPROACH = 100.0  # [1/s] near the reference the distance decays at this rate
BRAKE_SHARE = 0.7  # of the acceleration limit is planned for braking, the rest is margin


@dataclass(frozen=True)
class Bounds:
    """Limits of a motion; linear ones in metres, the `turning` ones in radians."""

    speed: float
    turning: float
    acceleration: float
    turning_acceleration: float
    jerk: float
    low: Vector3  # workspace corner [m]
    high: Vector3


class Reference:
    """Stage 1: joins targets of any rate by straight lines."""

    def __init__(self, p: Vector3, q: Quaternion) -> None:
        self.p, self.q = p, q
        self.velocity, self.turning = ZERO, ZERO
        self._goal = (p, q)
        self._left = 0.0  # [s] until the goal is reached
        self._interval = 0.0  # [s] smoothed time between targets
        self._last = float("-inf")
        self._feed = (ZERO, ZERO)

    def set_goal(self, p: Vector3, q: Quaternion, now: float, longest: float) -> None:
        """A new target at time `now` [s]; targets are taken to come at most `longest` [s] apart."""
        gap = min(longest, now - self._last)
        self._interval = gap if gap >= longest or not self._interval else 0.8 * self._interval + 0.2 * gap
        self._last, self._goal = now, (p, q)
        self._left = max(1e-4, min(longest, 1.25 * self._interval))
        velocity = scaled(minus(p, self.p), 1.0 / self._left)
        turning = scaled(turn_between(q, self.q), 1.0 / self._left)
        self._feed = capped(velocity, norm(self.velocity)), capped(turning, norm(self.turning))
        self.velocity, self.turning = velocity, turning

    def step(self, dt: float) -> tuple[Vector3, Vector3]:
        """Advance; returns the velocity and angular velocity to feed forward (no more than the last line had)."""
        if self._left <= 0.0:
            self.velocity = self.turning = ZERO
            return ZERO, ZERO
        share = min(dt, self._left)
        self._left -= share
        if self._left <= 1e-9:
            (self.p, self.q), self._left = self._goal, 0.0
        else:
            self.p = plus(self.p, scaled(self.velocity, share))
            self.q = turned(self.q, scaled(self.turning, share))
        return self._feed


class Follower:
    """Stages 2 and 3. `p`, `q` is the command [m, quaternion]; `velocity`, `turning` belong to stage 2."""

    def __init__(self, p: Vector3, q: Quaternion, dt: float) -> None:
        self.dt = dt
        self.restart(p, q)

    def restart(self, p: Vector3, q: Quaternion) -> None:
        """Stand still at a pose."""
        self.inner_p, self.inner_q, self.p, self.q = p, q, p, q
        self.velocity, self.turning = ZERO, ZERO
        self._steps: deque[tuple[Vector3, Vector3]] = deque()  # newest first

    def propose(self, reference: Reference | None, feed: tuple[Vector3, Vector3], b: Bounds) -> None:
        """Stage 2: choose the velocity of this step; with no reference, brake."""
        dt = self.dt
        if reference is None:
            goal = turning_goal = ZERO
        else:
            gap = minus(reference.p, self.inner_p)
            lean = turn_between(reference.q, self.inner_q)
            goal = _chase(gap, feed[0], b.speed, b.acceleration)
            turning_goal = _chase(lean, feed[1], b.turning, b.turning_acceleration)
        self.velocity = _towards(self.velocity, goal, b.acceleration * dt)
        self.turning = _towards(self.turning, turning_goal, b.turning_acceleration * dt)

    def slow(self, share: float) -> None:
        """Scale this step's velocity, e.g. because a joint would be too fast."""
        self.velocity, self.turning = scaled(self.velocity, share), scaled(self.turning, share)

    def next_pose(self) -> tuple[Vector3, Quaternion]:
        """Where stage 2 would be after this step."""
        return (
            plus(self.inner_p, scaled(self.velocity, self.dt)),
            turned(self.inner_q, scaled(self.turning, self.dt)),
        )

    def advance(self, b: Bounds) -> None:
        """Take the step, never further out of the workspace, and smooth."""
        p, q = self.next_pose()
        old, low, high = self.inner_p, b.low, b.high
        if not (low[0] <= p[0] <= high[0] and low[1] <= p[1] <= high[1] and low[2] <= p[2] <= high[2]):
            x, y, z = (min(max(p[i], min(low[i], old[i])), max(high[i], old[i])) for i in range(3))
            p = (x, y, z)
        self.inner_p, self.inner_q = p, q
        if not self._steps and p == old and not any(self.turning):
            self.p, self.q = p, q  # at rest, and nothing of the past left
            return
        length = max(1, ceil(2.0 * b.acceleration / (b.jerk * self.dt)))
        self._steps.appendleft((minus(p, old), scaled(self.turning, self.dt)))
        while len(self._steps) >= length and self._steps:
            self._steps.pop()
        self._smooth(length)
        if not any(self.velocity) and not any(self.turning) and self.still:
            self._steps.clear()

    def _smooth(self, length: int) -> None:
        """Mean of the last `length` poses: the newest, less what each of the last steps adds to it.

        Rotations of a few milliradians are added as vectors; the error is of second order and does not accumulate.
        """
        back, lean = ZERO, ZERO
        for i, (step, turn) in enumerate(self._steps):
            weight = (length - 1 - i) / length
            back = back[0] + weight * step[0], back[1] + weight * step[1], back[2] + weight * step[2]
            lean = lean[0] - weight * turn[0], lean[1] - weight * turn[1], lean[2] - weight * turn[2]
        self.p = minus(self.inner_p, back)
        self.q = turned(self.inner_q, lean)

    @property
    def still(self) -> bool:
        """Whether neither the command nor its past moves."""
        return not any(self.velocity) and not any(self.turning) and not any(any(p) or any(r) for p, r in self._steps)


def _chase(error: Vector3, feed: Vector3, top: float, acceleration: float) -> Vector3:
    distance = norm(error)
    if distance == 0.0:
        return capped(feed, top)
    speed = min(sqrt(2.0 * BRAKE_SHARE * acceleration * distance), APPROACH * distance)
    return capped(plus(feed, scaled(error, speed / distance)), top)


def _towards(start: Vector3, goal: Vector3, step: float) -> Vector3:
    return plus(start, capped(minus(goal, start), step))
