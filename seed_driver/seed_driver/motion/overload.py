# SPDX-License-Identifier: Apache-2.0
"""A limit on the wrench that the arm itself reads: beyond it for some time, the arm holds, whatever the target is."""

from collections.abc import Sequence

from seed_core.vector3 import norm
from seed_driver.clearance_settings import ClearanceSettings

LEEWAY = 1.1  # times the reading that it holds at, which an arm that is freed may reach


class Overload:
    """`update` with each reading; `forgive` when the arm is to move again though it still reads too much."""

    def __init__(self, settings: ClearanceSettings) -> None:
        self.settings = settings
        self._share = 0.0  # of the limit, in the last reading
        self._allowed = 1.0
        self._since: float | None = None  # [s] when it came to be beyond that

    def forgive(self) -> None:
        """Allow what is read now and a little more, until it has once been within the limit."""
        self._allowed, self._since = max(1.0, LEEWAY * self._share), None

    def update(self, wrench: Sequence[float], now: float) -> str:
        """Why to hold; '' for no reason.

        Args:
            wrench: (6,) force [N], then torque [N m]. now: [s] by any clock.
        """
        s = self.settings
        force, torque = norm(wrench[:3]), norm(wrench[3:])
        by_force, by_torque = force / s.max_arm_force, torque / s.max_arm_torque
        self._share = max(by_force, by_torque)
        if self._share <= 1.0:
            self._allowed = 1.0
        if by_force <= self._allowed and by_torque <= self._allowed:
            self._since = None
            return ""
        if self._since is None:
            self._since = now
        if now - self._since < s.overload_time:
            return ""
        value, limit = (
            (f"{force:.0f} N", f"max_arm_force = {s.max_arm_force:g} N")
            if by_force >= by_torque
            else (f"{torque:.1f} N m", f"max_arm_torque = {s.max_arm_torque:g} N m")
        )
        return (
            f"the arm reads {value} at its tool, beyond {limit}: free it, or zero the sensor and tell the payload if "
            "nothing touches it; after driver/resend_robot_program it may move off"
        )
