# SPDX-License-Identifier: Apache-2.0
"""Holds the command before it comes too near to anything: where it would come to rest is looked at, not where it is.

What is found there can still be avoided by braking now. A row of `Clearances` that is below 0 may not become smaller:
whatever stands too near may move away, and comes no nearer, however slowly.
"""

from collections.abc import Iterator, Sequence
from math import ceil

import numpy as np

from seed_core.arm.quaternion import Quaternion, to_pose, turned
from seed_core.spatial import Array
from seed_core.vector3 import Vector3, norm, plus, scaled
from seed_driver.clearance_settings import ClearanceSettings
from seed_driver.motion.clearances import Clearances
from seed_driver.motion.limiter import CommandLimiter
from seed_ur.kinematics import KinematicsError, URKinematics

ROUNDING = 1e-6  # [m, rad] by which a row may fall and count as the same
APART = 0.06, 0.15  # [m], [rad] between poses that are looked at on the way to rest
MOST_POSES = 6
RESPONSE = 3.0  # steps at speed: this one, the next, by whose end braking begins, and what is gained until then
AGAIN = "call ~/resend_robot_program, then targets that lead away from it are followed"


class StopCheck:
    """`check` at each step of a limiter that follows targets.

    Attributes:
        most_steps: without a look, however far everything is.
    """

    def __init__(self, arm: URKinematics, settings: ClearanceSettings, top: float) -> None:
        """top: [rad/s] that no joint exceeds. Raises SeedError where a file is missing or wrong."""
        self._arm, self.most_steps = arm, 10
        self.clearances = Clearances(arm, settings)
        self.configure(settings, top)

    def configure(self, settings: ClearanceSettings, top: float) -> None:
        """Take changed settings."""
        self.clearances.configure(settings)
        speeds = [min(top, own) for own in self._arm.model.speed]
        self._speeds = self.clearances.rates @ np.array(speeds)  # (rows,) [m/s], [rad/s] at which a row falls at most
        self.restart()

    def restart(self) -> None:
        """The arm stands, perhaps somewhere else, or other things count: what is too near now may stay so near."""
        self._least: Array | None = None  # (rows,) at most 0, that no row may fall below
        self._idle = 0  # steps that need no look

    def check(self, limiter: CommandLimiter, near: Sequence[float]) -> str:
        """Why this step must be the first of a stop; '' while it need not.

        Args:
            near: (6,) joint angles [rad] about where the limiter's inner pose is.
        """
        if limiter.reference is None or not limiter.moving:
            return ""
        if self._idle > 0:
            self._idle -= 1
            return ""
        try:
            joints = [self._arm.follow(to_pose(limiter.inner_p, limiter.inner_q), near)]
        except KinematicsError as error:
            return str(error)
        for pose in _to_rest(limiter):
            try:
                joints.append(self._arm.follow(to_pose(*pose), joints[-1]))
            except KinematicsError:
                break  # it will not get there: the end of the reach stops it before
        rows = self.clearances.values(joints)
        now, then = rows[0], rows[1:].min(axis=0, initial=np.inf)
        least = np.minimum(now, 0.0) if self._least is None else np.maximum(self._least, np.minimum(now, 0.0))
        self._least = least
        wrong = (then < least - ROUNDING) | (then <= self.clearances.inside)
        if wrong.any():
            worst = int(np.argmin(np.where(wrong, then - least, np.inf)))
            self._idle = 0
            return f"{self.clearances.words(worst, float(then[worst]))}: {AGAIN}"
        # The arm and the pose where it would come to rest both move, each at most as fast as the joints may turn.
        steps = (rows.min(axis=0) - least) / (2.0 * self._speeds * limiter.dt)
        self._idle = max(0, int(min(self.most_steps, steps.min())))
        return ""


def _to_rest(limiter: CommandLimiter) -> Iterator[tuple[Vector3, Quaternion]]:
    """Poses on the way of the inner pose if it begins to brake after this step, the last one at rest.

    It turns and moves along straight lines, each at its own deceleration: one of the two may end earlier.
    """
    limits, start = limiter.limits, RESPONSE * limiter.dt
    v, w = limiter.velocity, limiter.angular_velocity
    moves, turns = norm(v) / limits.max_acceleration, norm(w) / limits.max_angular_acceleration  # [s] to rest
    way, angle = norm(v) * (start + 0.5 * moves), norm(w) * (start + 0.5 * turns)
    count = min(MOST_POSES, max(2, ceil(way / APART[0]), ceil(angle / APART[1])))
    for k in range(1, count + 1):
        t = k / count * max(moves, turns)
        p = plus(limiter.inner_p, scaled(v, start + _braked(t, moves)))
        yield p, turned(limiter.inner_q, scaled(w, start + _braked(t, turns)))


def _braked(t: float, whole: float) -> float:
    """How far a stop that takes `whole` [s] goes in its first t [s], as time at the speed that it begins with."""
    t = min(t, whole)
    return t - 0.5 * t * t / whole if whole > 0.0 else 0.0
