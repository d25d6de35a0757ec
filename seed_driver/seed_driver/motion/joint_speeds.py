# SPDX-License-Identifier: Apache-2.0
"""Joint speeds: the flange slows down where a joint would be too fast (near singularities), and stops at the end."""

from contextlib import suppress

from seed_core.arm.quaternion import Quaternion, to_pose
from seed_core.vector3 import Vector3, norm
from seed_driver.motion.limiter import BRAKE_SHARE, CommandLimiter
from seed_ur.kinematics import KinematicsError, URKinematics

CALIBRATION = 1.0  # [rad] of a joint that it makes up for near a singularity; more is another way to bend the arm
NO_WAY = 0.5  # [s] at the end of a branch after which it is said: a target may lead away from there again


class JointSpeeds:
    """Keeps every joint within its speed, by our own inverse kinematics of the limiter's next pose."""

    def __init__(self, arm: URKinematics, top: float) -> None:
        """top: [rad/s] of every joint, below the arm's own limits."""
        self._arm = arm
        self.restart((0.0,) * 6)
        self.set_limit(top, moving=False)

    def set_limit(self, top: float, *, moving: bool) -> None:
        """Take a changed limit [rad/s]; a lower one in motion as soon as the flange has braked within its limits."""
        self._wanted = [min(top, own) for own in self._arm.model.speed]
        self._steps_ahead = 0
        if not moving:
            self._limits = self._wanted

    @property
    def top(self) -> float:
        """Speed [rad/s] that no joint exceeds from now on."""
        return max(*self._limits, *self._wanted)

    @property
    def q(self) -> list[float]:
        """Joint angles (6,) [rad] at the pose that was looked at last, at most a few steps ago."""
        return self._q

    def restart(self, q: tuple[float, ...], pose: tuple[Vector3, Quaternion] | None = None) -> None:
        """The arm stands at joint angles q (6,) [rad], and the robot says that its flange is at a pose.

        Every UR has a calibration of its own, by which it computes that pose. Without it our model has other joints
        there, and steps are counted from those: the way from q to them is none of the arm's. Where the model reaches
        the pose with the arm bent otherwise only, they stay at q: no way leads on from there, and that is said.
        """
        self._q = list(q)  # [rad] at the pose that was looked at last
        if pose is not None:
            with suppress(KinematicsError):  # out of our model's reach: said when it is to move
                there = self._arm.follow(to_pose(*pose), q)
                if max(abs(a - b) for a, b in zip(there, q, strict=True)) <= CALIBRATION:
                    self._q = there
        self._since = 0.0  # [s] of motion since then
        self._ended = 0.0  # [s] that it stands where a branch ends
        self._steps_ahead = 0  # that need no look, because every joint is far below its limit

    def limit(self, limiter: CommandLimiter) -> str:
        """Slow the limiter's step down where needed; the reason to hold where there is no way, else ''."""
        if not limiter.moving:
            self._limits = self._wanted
            return ""
        if self._limits != self._wanted:
            self._brake(limiter)
        if self._since < self._steps_ahead * limiter.dt:
            self._since += limiter.dt
            return ""
        dt, self._since = limiter.dt + self._since, 0.0
        try:
            q = self._arm.follow(to_pose(*limiter.next_pose()), self._q)
            share = self._share(q, dt)
            self._steps_ahead = 3 if share > 8.0 else int(share > 3.0)
            if self._limits != self._wanted:
                self._steps_ahead = 0
            if share < 1.0:
                limiter.slow(share)
                q = self._arm.follow(to_pose(*limiter.next_pose()), self._q)
                if self._share(q, dt) < 0.9:
                    limiter.slow(0.0)  # a branch ends here
                    return self._no_way(limiter.dt)
            self._q, self._ended = q, 0.0
        except KinematicsError as error:
            limiter.slow(0.0)
            return str(error)
        return ""

    def _no_way(self, dt: float) -> str:
        """The reason to hold once the arm has stood for long enough where it would have to turn over to go on."""
        self._ended += dt
        if self._ended < NO_WAY:
            return ""
        self._ended = 0.0
        return "from here the arm goes on to the target only with its joints turned over: go another way, or in joints"

    def _brake(self, limiter: CommandLimiter) -> None:
        """Lower the limits in use towards those wanted by as much as slows the flange at its accelerations."""
        limits, tiny = limiter.limits, 1e-12
        linear = limits.max_acceleration / max(tiny, norm(limiter.velocity))
        angular = limits.max_angular_acceleration / max(tiny, norm(limiter.angular_velocity))
        rest = max(0.0, 1.0 - BRAKE_SHARE * limiter.dt * min(linear, angular))
        self._limits = [max(new, rest * old) for new, old in zip(self._wanted, self._limits, strict=True)]

    def _share(self, q: list[float], dt: float) -> float:
        """Share of the step of dt [s] to q that keeps every joint within its speed; above 1: room to spare."""
        turns = zip(q, self._q, self._limits, strict=True)
        return min(limit * dt / max(1e-12, abs(after - before)) for after, before, limit in turns)
