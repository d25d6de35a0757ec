# SPDX-License-Identifier: Apache-2.0
"""The guard of an arm that does not keep the contract itself: target checks, limiter and latched hold before it."""

from dataclasses import dataclass

from seed_core.arm.hold import HoldLatch
from seed_core.arm.limits import MotionLimits, TargetLimits
from seed_core.arm.quaternion import Quaternion, turn_between
from seed_core.arm.target_checks import Target, no_pose, refusal
from seed_core.config import field, inherited
from seed_core.vector3 import Vector3, minus, norm
from seed_driver.motion.limiter import CommandLimiter

Pose = tuple[Vector3, Quaternion]
LAG = 0.2  # [s] that an arm may be behind its command: clause 1 of docs/arm_contract.md
SILENT = "no current_pose from the arm: is it running?"
STANDS = 1e-3, 0.01  # [m], [rad] within which an arm that stands is for that long


@dataclass(frozen=True)
class GuardConfig(TargetLimits):
    """Settings of the guard; as those of the driver of the same name.

    Its limits are above the controller's, which decide how the arm moves: what a limit clips trails, and a wipe that is
    kept upright by what images show begins to swing.
    """

    max_speed: float = inherited(MotionLimits, "max_speed", 0.4)
    max_acceleration: float = inherited(MotionLimits, "max_acceleration", 4.0)
    max_jerk: float = inherited(MotionLimits, "max_jerk", 2000.0)
    max_angular_speed: float = inherited(MotionLimits, "max_angular_speed", 0.6)
    max_angular_acceleration: float = inherited(MotionLimits, "max_angular_acceleration", 8.0)
    rate: float = field(250.0, unit="Hz", low=20, high=1000, doc="of the guarded targets")


class TargetGuard:
    """One arm's guard; it moves nothing before the first `resume`. Times `now` are any steady clock's [s].

    It sends while it follows targets and until it has come to rest, and nothing at all before, between and after: an
    arm that was restarted or moved by hand meanwhile finds no old pose to go to.
    """

    def __init__(self, config: GuardConfig) -> None:
        self.config = config
        self.latch = HoldLatch(config.command_timeout, "waiting for resend_robot_program")
        self._measured: Pose | None = None
        self._measured_at = float("-inf")
        self._stands: tuple[Pose, float] | None = None  # where, and since when [s]; None: not heard since it was sent
        self._limiter: CommandLimiter | None = None  # None while nothing is sent

    @property
    def reason(self) -> str:
        """Why it holds; empty while targets are followed."""
        return self.latch.reason

    def measured(self, pose: Pose, now: float) -> None:
        """Where the arm is, unless it is not finite or no rotation."""
        if no_pose(*pose):
            return
        if self._arm(now) is None or self._stands is None or _moved(pose, self._stands[0]):
            self._stands = pose, now
        self._measured, self._measured_at = pose, now

    def _arm(self, now: float) -> Pose | None:
        """Where the arm is now; None when it is not heard."""
        return self._measured if 0.0 <= now - self._measured_at <= self.config.command_timeout else None

    def _start(self, now: float) -> Pose | str:
        """Where the arm stands; why there is no such place where it moves or may: its pose is old, and it goes on."""
        arm = self._arm(now)
        if arm is None:
            return SILENT
        if self._stands is None or self._measured_at - self._stands[1] < LAG:
            return f"the arm has not been seen to stand still for {LAG:g} s: let it come to rest"
        return arm

    def resume(self, now: float) -> str:
        """Follow again, from where the arm stands when the next target comes.

        Returns:
            Why not; '' when it does.
        """
        if self._limiter is None and isinstance(why := self._start(now), str):
            return why
        if self._arm(now) is None:
            return SILENT
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
        if self.reason:
            return self.reason
        limiter = self._limiter
        if limiter is None:
            arm = self._start(now)
            if isinstance(arm, str):
                return arm
            limiter = CommandLimiter(*arm, 1.0 / self.config.rate, self.config)
        if why := refusal(target, (limiter.p, limiter.q), self.config):
            self.latch.refused(why)
            return why
        self._limiter = limiter
        self.latch.heard(now)
        limiter.follow(target.p, target.q, now, self.config.command_timeout)
        return ""

    def step(self, now: float) -> Pose | None:
        """One step of 1 / rate.

        Returns:
            The pose to send to the arm now: position [m] and quaternion in the base frame; None: send nothing.
        """
        limiter = self._limiter
        self.latch.check(now)
        arm = self._arm(now)
        if limiter is None:
            return None
        if arm is None and not self.reason:
            self.hold("no current_pose from the arm")
        if arm is not None and (why := self._astray(arm, (limiter.p, limiter.q))):
            self.hold(why)
            self._end()  # a deceleration of the command would be a jump of the arm
            return None
        if not self.latch.following:
            limiter.hold()
            if limiter.still:
                self._end()
                return None
        limiter.propose()
        limiter.advance()
        return limiter.p, limiter.q

    def _end(self) -> None:
        """Send nothing more. The arm may still be on the way to what was sent last."""
        self._limiter = self._stands = None

    def _astray(self, arm: Pose, command: Pose) -> str:
        """Whether the arm is not where it was sent, nor on the way there; '' when it is."""
        c = self.config
        bound, angle = c.max_step + LAG * c.max_speed, c.max_angular_step + LAG * c.max_angular_speed
        away, turned = norm(minus(arm[0], command[0])), norm(turn_between(arm[1], command[1]))
        if away <= bound and turned <= angle:
            return ""
        return (
            f"the arm is {away:.3f} m and {turned:.2f} rad from its command, at most {bound:.3f} m and {angle:.2f} "
            "rad: does something else move it?"
        )


def _moved(pose: Pose, stood: Pose) -> bool:
    """Whether an arm does not stand where it stood."""
    way, angle = STANDS
    return norm(minus(pose[0], stood[0])) > way or norm(turn_between(pose[1], stood[1])) > angle
