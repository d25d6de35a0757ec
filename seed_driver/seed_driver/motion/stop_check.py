# SPDX-License-Identifier: Apache-2.0
"""Holds the command before it comes too near to anything: where it would come to rest is looked at, not where it is.

What is found there can still be avoided by braking now. A row of `Clearances` that is below `MARGIN` may not become
smaller: whatever stands too near may move away, and comes no nearer, however slowly.
"""

from collections.abc import Sequence
from contextlib import suppress
from math import ceil, degrees, inf

import numpy as np

from seed_core.arm.quaternion import Quaternion, to_pose, turned
from seed_core.spatial import Array
from seed_core.vector3 import Vector3, norm, plus, scaled
from seed_driver.clearance_settings import ClearanceSettings
from seed_driver.motion.clearances import Clearances
from seed_driver.motion.limiter import CommandLimiter
from seed_ur.kinematics import KinematicsError, URKinematics
from seed_ur.models import JOINT_NAMES

ROUNDING = 1e-6  # [m, rad] by which a row may fall and count as the same
MARGIN = 5e-4  # [m, rad] that is kept beyond the clearance, for what lies between the poses that are looked at
APART = 0.06, 0.15  # [m], [rad] between poses that are looked at on the way to rest
NEAR = 0.02  # [m, rad] from being too near, where they are three times as close
MOST_POSES = 6  # of them, where nothing is near
JUMP = 0.5  # [rad] of a joint between two poses: others between them are looked at, or the joint jumps there
FINEST = 1.0 / 32.0  # of the way between two poses
RESPONSE = 3.0  # steps at speed: this one, the next, by whose end braking begins, and what is gained until then
AGAIN = "call driver/resend_robot_program, then targets that lead away from it are followed"


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
        self._least: Array | None = None  # (rows,) at most `MARGIN`, that no row may fall below
        self._idle = 0  # steps that need no look
        self._near = False  # whether something was near at the last look
        self._jumping = ""  # why the way ended before rest at the last look

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
            start = self._arm.follow(to_pose(limiter.inner_p, limiter.inner_q), near)
        except KinematicsError as error:
            return str(error)
        rows = self._look(limiter, start)
        now, then = np.minimum(rows[0], MARGIN), rows[1:].min(axis=0, initial=np.inf)
        least = now if self._least is None else np.maximum(self._least, now)
        self._least = least
        wrong = (then < least - ROUNDING) | (then <= self.clearances.inside)
        if wrong.any():
            worst = int(np.argmin(np.where(wrong, then - least, np.inf)))
            return f"{self.clearances.words(worst, float(then[worst]))}: {AGAIN}"
        if self._jumping:
            return f"{self._jumping}: {AGAIN}"
        # The arm and the pose where it would come to rest both move, each at most as fast as the joints may turn.
        steps = (rows.min(axis=0) - least) / (2.0 * self._speeds * limiter.dt)
        self._idle = max(0, int(min(self.most_steps, steps.min())))
        return ""

    def _look(self, limiter: CommandLimiter, start: list[float]) -> Array:
        """The rows (m, rows) on the way to rest; once more, closer together, where something turns out to be near."""
        fine = self._near
        while True:
            rows = self.clearances.values(self._to_rest(limiter, start, fine))
            changing = np.ptp(rows, axis=0) > ROUNDING
            self._near = bool(rows.min(axis=0, initial=np.inf, where=changing).min() < NEAR)
            if fine or not self._near:
                return rows
            fine = True

    def _to_rest(self, limiter: CommandLimiter, start: list[float], fine: bool) -> list[list[float]]:
        """Joint angles (m, 6) [rad] on the way to rest, from `start` on, as far as the arm gets.

        Where a joint would jump, the reach ends, or a branch of the inverse kinematics. What the arm would do on
        another branch is not asked: the limit of the joint speeds stops it before.
        """
        stop, joints, t = _Stop(limiter), [start], 0.0
        self._jumping = ""
        for goal in stop.times(fine):
            ahead, finest = goal, FINEST * (goal - t)
            while t < goal:
                try:
                    q = self._arm.follow(to_pose(*stop.pose(ahead)), joints[-1])
                    jumps = [abs(a - b) for a, b in zip(q, joints[-1], strict=True)]
                except KinematicsError:
                    jumps = [inf]
                if max(jumps) <= JUMP:
                    joints.append(q)
                    t, ahead = ahead, goal
                elif ahead - t > finest:
                    ahead = 0.5 * (t + ahead)
                else:
                    self._jumping = _jump(self._arm.model.name, jumps)
                    return joints
        if fine:  # where it moves away but turns nearer, to brake sooner is to rest nearer
            with suppress(KinematicsError):
                joints.append(self._arm.follow(to_pose(*stop.soonest), joints[-1]))
        return joints


def _jump(model: str, jumps: Sequence[float]) -> str:
    """Why the arm cannot go on: its base or its elbow would have to jump, by the angles [rad]; '' otherwise.

    A wrist that turns fast is slowed down by the limit of the joint speeds, and passes.
    """
    for i in (0, 2):
        if len(jumps) == 6 and jumps[i] > JUMP:
            by, most = degrees(jumps[i]), degrees(JUMP)
            beyond = f"{JOINT_NAMES[i]} would have to jump by {by:.0f} degrees, at most {most:.0f}"
            return f"the way leads out of reach of the {model} as the arm is bent, {beyond}"
    return ""


class _Stop:
    """The way of the inner pose if it begins to brake after this step.

    It turns and moves along straight lines, each at its own deceleration: one of the two may end earlier.
    """

    def __init__(self, limiter: CommandLimiter) -> None:
        limits, self._dt, self._start = limiter.limits, limiter.dt, RESPONSE * limiter.dt
        self._p, self._q = limiter.inner_p, limiter.inner_q
        self._v, self._w = limiter.velocity, limiter.angular_velocity
        speed, angular_speed = norm(self._v), norm(self._w)
        self._moves, self._turns = speed / limits.max_acceleration, angular_speed / limits.max_angular_acceleration
        self._way = speed * (self._start + 0.5 * self._moves)  # [m]
        self._angle = angular_speed * (self._start + 0.5 * self._turns)  # [rad]

    def times(self, fine: bool) -> list[float]:
        """When [s] to look, from now on: the last is at rest, one where moving or turning ends before the other."""
        count = (3 if fine else 1) * min(MOST_POSES, max(2, ceil(self._way / APART[0]), ceil(self._angle / APART[1])))
        last, first = max(self._moves, self._turns), min(self._moves, self._turns)
        times = [k / count * last for k in range(1, count + 1)]
        bend = min(range(count - 1), key=lambda k: abs(times[k] - first))
        if 0.0 < first < last:
            times[bend] = first  # the way is bent there, and smooth elsewhere
        return [self._start + t for t in times]

    @property
    def soonest(self) -> tuple[Vector3, Quaternion]:
        """The pose at rest if it brakes as soon as this step is over."""
        p = plus(self._p, scaled(self._v, self._dt + 0.5 * self._moves))
        return p, turned(self._q, scaled(self._w, self._dt + 0.5 * self._turns))

    def pose(self, t: float) -> tuple[Vector3, Quaternion]:
        """The pose at time t [s] from now."""
        at_speed = min(t, self._start)
        braking = t - at_speed
        p = plus(self._p, scaled(self._v, at_speed + _braked(braking, self._moves)))
        return p, turned(self._q, scaled(self._w, at_speed + _braked(braking, self._turns)))


def _braked(t: float, whole: float) -> float:
    """How far a stop that takes `whole` [s] goes in its first t [s], as time at the speed that it begins with."""
    t = min(t, whole)
    return t - 0.5 * t * t / whole if whole > 0.0 else 0.0
