# SPDX-License-Identifier: Apache-2.0
"""From the newest target to the next command: following, holding, and the speed of every joint.

Knows neither robot nor node; `look` and `step` are called once per servo cycle and answer with the reason of a hold.
"""

from __future__ import annotations

from seed_core.quaternion import to_pose
from seed_core.vector3 import ZERO
from seed_driver.config import DriverConfig
from seed_driver.motion.limiter import Bounds, Follower, Reference
from seed_driver.process.shared_memory import Sample, SharedMemory, TargetSlot
from seed_ur.kinematics import KinematicsError, URKinematics

COMMANDED = 0.93  # of a speed limit: commands that reach the robot early, late or two at once make its own speed ripple


class Motion:
    """What the arm is to do; `follower.p`, `follower.q` is the command."""

    def __init__(self, memory: SharedMemory, arm: URKinematics, config: DriverConfig) -> None:
        self.memory, self.arm = memory, arm
        self.follower = Follower((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 0.002)
        self.armed = False  # targets are followed
        self.target: TargetSlot | None = None  # the newest that was used
        self._heard = 0.0  # [s] when it came
        self._reference: Reference | None = None
        self._seen = 0  # number of the newest target that was looked at
        self._guard_q: list[float] = [0.0] * 6
        self._unseen = 0.0  # [s] of motion since the joints were looked at
        self._calm = 0  # steps that need no look, because every joint is far below its limit
        self.configure(config)

    def configure(self, config: DriverConfig) -> None:
        """Take changed limits."""
        self.config, self.bounds = config, bounds_of(config)

    def restart(self, sample: Sample) -> None:
        """Command what is: the pose where the arm stands now."""
        self.follower.restart(sample.p, sample.orientation)
        self._guard_q, self._reference = list(sample.q), None

    def arm_it(self) -> None:
        """Follow the targets that come from now on."""
        self.armed, self.target = True, None
        slot = self.memory.read_target(0)
        self._seen = slot.number if slot is not None else self._seen

    def hold(self) -> None:
        """Decelerate to rest; targets are not followed any more."""
        self.armed, self._reference = False, None

    def halt(self) -> None:
        """Be at rest at once, where the command has stood still already."""
        self.follower.restart(self.follower.p, self.follower.q)

    @property
    def following(self) -> bool:
        """Whether a target is being followed."""
        return self.armed and self._reference is not None

    def look(self, now: float, held_back: float = 0.0) -> str:
        """Take a new target; the reason to hold when there was none for too long, else ''.

        now: [s] by the robot's clock, which is `held_back` [s] behind that of the times of receipt.
        """
        if not self.armed:
            return ""
        slot = self.memory.read_target(self._seen)
        if slot is not None and slot.number > self._seen:
            self._seen, self.target, self._heard = slot.number, slot, slot.received - held_back
            if self._reference is None:
                self._reference = Reference(self.follower.inner_p, self.follower.inner_q)
            self._reference.set_goal(slot.p, slot.q, self._heard, self.config.command_timeout)
        elif self.following and now - self._heard > self.config.command_timeout:
            return f"no target_frame for {self.config.command_timeout} s"
        return ""

    def step(self) -> str:
        """One step of the command; the reason to hold when the arm cannot go there, else ''."""
        f, trouble = self.follower, ""
        feed = self._reference.step(f.dt) if self._reference is not None else (ZERO, ZERO)
        f.propose(self._reference, feed, self.bounds)
        if any(f.velocity) or any(f.turning):
            if self._unseen < self._calm * f.dt:
                self._unseen += f.dt
            else:
                trouble = self._guard_joints(f.dt + self._unseen)
                self._unseen = 0.0
        f.advance(self.bounds)
        return trouble

    def _guard_joints(self, dt: float) -> str:
        """Slow down where a joint would be too fast (near singularities); stop where there is no way."""
        f = self.follower
        try:
            q = self.arm.follow(to_pose(*f.next_pose()), self._guard_q)
            share = self._joint_share(q, dt)
            self._calm = 3 if share > 8.0 else int(share > 3.0)
            if share < 1.0:
                f.slow(share)
                q = self.arm.follow(to_pose(*f.next_pose()), self._guard_q)
                if self._joint_share(q, dt) < 0.9:
                    f.slow(0.0)  # a branch ends here
                    return ""
            self._guard_q = q
        except KinematicsError as error:
            f.slow(0.0)
            return str(error)
        return ""

    def _joint_share(self, q: list[float], dt: float) -> float:
        """Share of the step that keeps every joint within its speed; above 1: room to spare."""
        own, top = self.arm.model.speed, COMMANDED * self.config.max_joint_speed
        pairs = zip(q, self._guard_q, own, strict=True)
        return min(min(top, limit) * dt / max(1e-12, abs(a - b)) for a, b, limit in pairs)


def bounds_of(c: DriverConfig) -> Bounds:
    """The limits of a motion as configured."""
    return Bounds(
        COMMANDED * c.max_speed,
        COMMANDED * c.max_turning,
        c.max_acceleration,
        c.max_turning_acceleration,
        c.max_jerk,
        c.workspace_low,
        c.workspace_high,
    )
