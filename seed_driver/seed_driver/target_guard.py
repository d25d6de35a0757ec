# SPDX-License-Identifier: Apache-2.0
"""The guard of an arm that does not keep the contract itself: target checks, limiter and latched hold before it."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isfinite

from seed_core.arm.hold import HoldLatch
from seed_core.config import ConfigError, field
from seed_core.quaternion import Quaternion
from seed_core.vector3 import Vector3
from seed_driver.config import DriverConfig
from seed_driver.motion.limiter import Bounds, CommandLimiter
from seed_driver.target_checks import UNIT_TOLERANCE, Target, refusal

Pose = tuple[Vector3, Quaternion]
CORNER: tuple[float, float, float] = (1.4, 1.4, 1.6)


@dataclass(frozen=True)
class GuardConfig:
    """Settings of the guard; as those of the driver of the same name."""

    base_frame: str = field("base", doc="name of the frame that targets are in")
    rate: float = field(250.0, unit="Hz", low=20, high=1000, doc="of the guarded targets")
    max_speed: float = field(0.25, unit="m/s", low=1e-3, high=3, doc="largest speed")
    max_turning: float = field(0.5, unit="rad/s", low=1e-3, high=10, doc="largest angular speed")
    max_acceleration: float = field(1.0, unit="m/s^2", low=0.01, high=50, doc="largest acceleration")
    max_turning_acceleration: float = field(4.0, unit="rad/s^2", low=0.01, high=100, doc="largest angular acceleration")
    max_jerk: float = field(250.0, unit="m/s^3", low=1, high=1e5, doc="largest jerk")
    max_step: float = field(0.05, unit="m", low=1e-4, high=1, doc="a target further from the command is a jump")
    max_turning_step: float = field(0.2, unit="rad", low=1e-3, high=3, doc="a target turned further is a jump")
    workspace_low: tuple[float, float, float] = field((-1.4, -1.4, -0.6), unit="m", low=-5, high=5, doc="lower corner")
    workspace_high: tuple[float, float, float] = field(CORNER, unit="m", low=-5, high=5, doc="upper corner")
    command_timeout: float = field(0.1, unit="s", low=0.01, high=2, doc="largest age of a target, and largest silence")

    def __post_init__(self) -> None:
        if any(a >= b for a, b in zip(self.workspace_low, self.workspace_high, strict=True)):
            raise ConfigError(f"workspace_low = {self.workspace_low} m must be below {self.workspace_high} m")


class TargetGuard:
    """One arm's guard. Times are any steady clock [s]."""

    def __init__(self, config: GuardConfig) -> None:
        c = self.config = config
        low, high = c.workspace_low, c.workspace_high
        turning = c.max_turning, c.max_acceleration, c.max_turning_acceleration, c.max_jerk
        self._bounds = Bounds(c.max_speed, *turning, low, high)
        self._rules = DriverConfig(
            base_frame=c.base_frame,
            max_step=c.max_step,
            max_turning_step=c.max_turning_step,
            workspace_low=low,
            workspace_high=high,
            command_timeout=c.command_timeout,
        )
        self.latch = HoldLatch(c.command_timeout, "waiting for resend_robot_program")
        self._measured: Pose | None = None
        self._measured_at = float("-inf")
        self._limiter: CommandLimiter | None = None  # from the first `resume` on

    @property
    def reason(self) -> str:
        """Why it holds; empty while targets are followed."""
        return self.latch.reason

    def measured(self, pose: Pose, now: float) -> None:
        """Where the arm is, unless it is not finite or no rotation."""
        if all(map(isfinite, pose[0])) and abs(hypot(*pose[1]) - 1.0) <= UNIT_TOLERANCE:
            self._measured, self._measured_at = pose, now

    def resume(self, now: float) -> str:
        """Follow again from where the arm stands; the reason why not, or nothing."""
        if self._measured is None or now - self._measured_at > self.config.command_timeout:
            return "no current_pose from the arm: is it running?"
        if self._limiter is None or self.reason:
            self._limiter = CommandLimiter(*self._measured, 1.0 / self.config.rate, self._bounds)
        self._limiter.hold()
        self.latch.resume()
        return ""

    def hold(self, reason: str) -> None:
        """Decelerate and stay."""
        self.latch.hold(reason)

    def target(self, target: Target, now: float) -> str:
        """A wanted pose; why it is not followed, or nothing."""
        if self._limiter is None or self.reason:
            return self.reason
        if why := refusal(target, (self._limiter.p, self._limiter.q), [], None, self._rules):
            self.latch.refused(why)
            return why
        self.latch.heard(now)
        self._limiter.follow(target.p, target.q, now, self.config.command_timeout)
        return ""

    def step(self, now: float) -> Pose | None:
        """The pose to send to the arm now; None before the first `resume`."""
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
