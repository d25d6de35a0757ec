# SPDX-License-Identifier: Apache-2.0
"""Whether images are dated right: told from the motion in contact, while running.

In free space the tool is carried along and its pose in the grasp says nothing about time. But whenever a force is built
up, the grasp is deflected as the gripper moves, and the image says when. See contact_motion.py. A surface may rise and
fall under a tool that wipes; one that is as steep as a press is not believed. Nor is a lag that a grasp may have by
itself, as it slides or stiffens: it is told, but does not hold.
"""

from collections.abc import Callable

from seed_control.monitor.contact.contact_motion import SHARES, FollowedMotion
from seed_control.parameters import ControllerParameters

_KNOWN = 0.012  # [s] of deviation, from which on the stamp error counts as told
_EXPLAINED = 0.9  # of the deflection's variance, at least
_SURE = 9.0  # chi-square by which a lag must be better than the best of a grasp's own
_STEEP = 0.03  # standard deviation of the deflection per way across


class LateStamps:
    """`update` with each look at the contact's motion.

    Attributes:
        error: by which stamps are ahead of the robot's clock [s], and deviation: its standard deviation; None before it
            is known. It stays until it is known anew.
        warning: what it comes to, '' while it is within `stamp_warning`.
        reason: why to hold, '' while it is within `max_stamp_error`.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        self._most, self._notable = parameters.max_stamp_error, parameters.stamp_warning
        self.error: float | None = None
        self.deviation = 0.0
        self.warning = self.reason = ""
        self._late = 0  # looks in a row

    def restart(self) -> None:
        """A hold is over: what is to be said has to be seen anew."""
        self.reason, self._late = "", 0

    def update(self, seen: FollowedMotion | None, sure: Callable[[], float]) -> None:
        """Take in how the deflection has followed the gripper; sure: chi-square of a lag against a grasp's own."""
        if seen is None or not _tells(seen):
            return
        self.error, self.deviation = seen.shift, seen.deviation
        size = abs(seen.shift)
        words = (
            f"images are dated {1e3 * size:.0f} +- {1e3 * max(seen.deviation, 1e-3):.0f} ms too "
            f"{'late' if seen.shift > 0.0 else 'early'}, as the motion in contact shows"
        )
        self.warning = words if size > self._notable + seen.deviation else ""
        if size > self._most and sure() < _SURE:
            self.warning += ", or the grasp slides" if self.warning else ""
            self._late = 0
            return
        self._late = self._late + 1 if size > self._most else 0
        if self._late >= 2 or size > self._most + 2.0 * seen.deviation:
            most = f"more than {1e3 * self._most:.0f} ms makes the force swing"
            self.reason = f"{words}; {most}: compare the clocks (./seed identify --live)"


def _tells(seen: FollowedMotion) -> bool:
    return (
        seen.deviation <= _KNOWN
        and seen.explained >= _EXPLAINED
        and SHARES[0] <= seen.share <= SHARES[1]
        and seen.steepness >= _STEEP
    )
