# SPDX-License-Identifier: Apache-2.0
"""The guard of an arm that does not keep the contract itself: target checks, limiter and latched hold before it."""

from dataclasses import dataclass

from seed_core.arm.hold import HoldLatch
from seed_core.arm.limits import TargetLimits
from seed_core.arm.quaternion import Quaternion
from seed_core.arm.target_checks import Target, no_pose, refusal
from seed_core.config import field
from seed_core.vector3 import Vector3
from seed_driver.motion.limiter import CommandLimiter

Pose = tuple[Vector3, Quaternion]


@dataclass(frozen=True)
class GuardConfig(TargetLimits):
    """Settings of the guard; as those of the driver of the same name."""

    rate: float = field(250.0, unit="Hz", low=20, high=1000, doc="of the guarded targets")


class TargetGuard:
    """One arm's guard; it moves nothing before the first `resume`. Times `now` are any steady clock's [s]."""

    def __init__(self, config: GuardConfig) -> None:
        self.config = config
        self.latch = HoldLatch(config.command_timeout, "waiting for resend_robot_program")
        self._measured: Pose | None = None
        self._measured_at = float("-inf")
        self._limiter: CommandLimiter | None = None  # from the first `resume` on

    @property
    def reason(self) -> str:
        """Why it holds; empty while targets are followed."""
        return self.latch.reason

    def measured(self, pose: Pose, now: float) -> None:
        """Where the arm is, unless it is not finite or no rotation."""
        if not no_pose(*pose):
            self._measured, self._measured_at = pose, now

    def resume(self, now: float) -> str:
        """Follow again from where the arm stands.

        Returns:
            Why not; '' when it does.
        """
        if self._measured is None or now - self._measured_at > self.config.command_timeout:
            return "no current_pose from the arm: is it running?"
        if self._limiter is None or self.reason:
            self._limiter = CommandLimiter(*self._measured, 1.0 / self.config.rate, self.config)
        self._limiter.hold()
        self.latch.resume()
        return ""

    def hold(self, reason: str) -> None:
        """Decelerate and stay."""
        self.latch.hold(reason)

    def target(self, target: Target, now: float) -> str:
        """Take a wanted pose.

        Returns:
            Why it is not followed; '' when it is.
        """
        if self._limiter is None or self.reason:
            return self.reason
        if why := refusal(target, (self._limiter.p, self._limiter.q), self.config):
            self.latch.refused(why)
            return why
        self.latch.heard(now)
        self._limiter.follow(target.p, target.q, now, self.config.command_timeout)
        return ""

    def step(self, now: float) -> Pose | None:
        """One step of 1 / rate.

        Returns:
            The pose to send to the arm now: position [m] and quaternion in the base frame; None before the first
            `resume`.
        """
        limiter = self._limiter
        if limiter is None:
            return None
        self.latch.check(now)
        if not self.reason and now - self._measured_at > self.config.command_timeout:
            self.hold("no current_pose from the arm")
        if not self.latch.following:
            limiter.hold()
        limiter.propose()
        limiter.advance()
        return limiter.p, limiter.q
