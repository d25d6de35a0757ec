# SPDX-License-Identifier: Apache-2.0
"""The motion of the servo process, from newest target to next command: reference, limiter, joint speeds, clearances.

Knows neither robot nor node; `take_target` and `step` are called once per servo cycle.
"""

from collections.abc import Sequence
from dataclasses import replace

from seed_core.arm.hold import HoldLatch
from seed_core.arm.limits import MotionLimits
from seed_core.arm.quaternion import IDENTITY, Quaternion, turn_between, turned
from seed_core.vector3 import ZERO, Vector3, minus, norm, plus_scaled, scaled
from seed_driver.config import DriverConfig
from seed_driver.motion.joint_speeds import JointSpeeds
from seed_driver.motion.limiter import CommandLimiter
from seed_driver.motion.overload import Overload
from seed_driver.motion.stop_check import StopCheck
from seed_driver.process.shared_memory import RobotState, SharedMemory, TargetSlot
from seed_ur.kinematics import URKinematics

COMMANDED = 0.93  # of a speed limit: commands that reach the robot early, late or two at once make its own speed ripple


class ServoMotion:
    """The arm's motion: `command` is where it is sent, `latch.reason` tells why it holds."""

    def __init__(self, memory: SharedMemory, arm: URKinematics, config: DriverConfig) -> None:
        self.memory, self.arm = memory, arm
        self.latch = HoldLatch(config.command_timeout, "starting")
        self.limiter = CommandLimiter(ZERO, IDENTITY, 0.002, limits_of(config))
        self.joints = JointSpeeds(arm, COMMANDED * config.max_joint_speed)
        self.stop_check = StopCheck(arm, config, COMMANDED * config.max_joint_speed)
        self.overload = Overload(config)
        self.target: TargetSlot | None = None  # the newest that was used
        self._seen = 0  # number of the newest target that was looked at
        self._begin()

    def configure(self, config: DriverConfig) -> None:
        """Take changed limits."""
        self.latch.patience = config.command_timeout
        self.limiter.set_limits(limits_of(config))
        self.joints.set_limit(COMMANDED * config.max_joint_speed, moving=self.limiter.moving)
        self.stop_check.configure(config, self.joints.top)
        self.overload.settings = config

    def _begin(self) -> None:
        self._last = self.limiter.p, self.limiter.q  # the pose before the limiter's
        self._phase = 1.0  # share of the way from there on
        self.command: tuple[Vector3, Quaternion] = self._last  # [m]

    def restart(self, sample: RobotState) -> None:
        """Command what is: the pose where the arm stands now."""
        self.limiter.hold()
        self.limiter.restart(sample.p, sample.orientation)
        self._begin()
        self.joints.restart(sample.q, self.command)
        self.stop_check.restart()

    def accept_targets(self) -> None:
        """Follow the targets that come from now on."""
        self.target = None
        slot = self.memory.read_target(0)
        self._seen = slot.number if slot is not None else self._seen
        if self.latch.reason:
            self.overload.forgive()
            self.stop_check.restart()
            self.latch.resume()

    def feel(self, wrench: Sequence[float], now: float) -> None:
        """Hold when the arm reads too much: wrench (6,) force [N] and torque [N m] at its tool, at time now [s]."""
        why = self.overload.update(wrench, now)
        if why and not self.latch.reason:
            self.hold(why)

    def hold(self, reason: str) -> None:
        """Decelerate to rest; targets are not followed any more."""
        self.latch.hold(reason)
        self.limiter.hold()

    def halt(self) -> None:
        """Be at rest at once, where the command has stood still already."""
        self.limiter.restart(*self.command)
        self._begin()

    def take_target(self, now: float, held_back: float = 0.0) -> None:
        """Follow a new target; hold when there was none for too long.

        Args:
            now: [s] by the robot's clock.
            held_back: [s] by which that is behind the clock of the times of receipt.
        """
        if self.latch.reason:
            return
        slot = self.memory.read_target(self._seen)
        if slot is not None:
            self._seen, self.target = slot.number, slot
            received = slot.received - held_back
            self.latch.heard(received)
            self.limiter.follow(slot.p, slot.q, received, self.latch.patience)
            return
        self.latch.check(now)
        if self.latch.reason:
            self.limiter.hold()

    def step(self, share: float = 1.0) -> None:
        """Go on along the path by a share of the cycle: what a robot that is scaled down has time for.

        The limiter goes on by whole cycles of the path's time; between them the command is interpolated.
        """
        self._phase += share
        if self._phase > 1.0 + 1e-9:
            self._phase -= 1.0
            self._last = self.limiter.p, self.limiter.q
            self._advance(share)
        if self._phase > 1.0 - 1e-9:
            self.command = self.limiter.p, self.limiter.q
            return
        (p, q), phase = self._last, self._phase
        way, turn = minus(self.limiter.p, p), turn_between(self.limiter.q, q)
        self.command = plus_scaled(p, phase, way), turned(q, scaled(turn, phase))

    @property
    def rise(self) -> float:
        """Fastest growth [1/s] of the share at which a motion at its speed limits keeps the acceleration limits."""
        c = self.limiter.limits
        return min(c.max_acceleration / c.max_speed, c.max_angular_acceleration / c.max_angular_speed)

    def off(self, sample: RobotState) -> tuple[float, float]:
        """How far the arm is from its command: [m], [rad]."""
        p, q = self.command
        return norm(minus(p, sample.p)), norm(turn_between(q, sample.orientation))

    def _advance(self, share: float) -> None:
        """One step of the limiter; a hold when the arm cannot go there."""
        self.limiter.propose(1.0 / (share * share))
        trouble = self.joints.limit(self.limiter) or self.stop_check.check(self.limiter, self.joints.q)
        self.limiter.advance()
        if trouble:
            self.hold(trouble)


def limits_of(config: DriverConfig) -> MotionLimits:
    """The limits of a command whose motion keeps those of the configuration."""
    return replace(
        config, max_speed=COMMANDED * config.max_speed, max_angular_speed=COMMANDED * config.max_angular_speed
    )
