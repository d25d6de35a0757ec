# SPDX-License-Identifier: Apache-2.0
"""A force that swings by itself: a limit cycle, whatever has caused it.

Its swings are large, regular and do not fade; and the gripper's own motion explains them. Over bumps it does not: there
the surface moves first and the gripper follows late, so that the deflection is a quarter of a swing ahead of it.
"""

from collections import deque
from itertools import pairwise

from seed_control.monitor.contact.contact_motion import SHARES, FollowedMotion

LEGS = 4  # from one turn to the next
_SHORTEST, _LONGEST = 0.05, 0.6  # [s] of a leg
_UNEVEN = 2.5  # times as long as the shortest
_FADING = 0.6  # of the largest; one that is left alone becomes smaller
_EXPLAINED = 0.75  # by the gripper, of the deflection's variance


class Swing:
    """Turning points of the force along one direction. `update` with each image in contact.

    Attributes:
        suspected: whether the last legs are those of a limit cycle.
        reason: why to hold, '' while it does not swing.
    """

    def __init__(self) -> None:
        self.reason = ""
        self.clear()

    def clear(self) -> None:
        """Contact, or another force, is to be judged anew."""
        self.suspected, self._up = False, True
        self._extreme: tuple[float, float] | None = None  # [s], [N] furthest since the last turn
        self._turns: deque[tuple[float, float]] = deque(maxlen=LEGS + 1)

    def update(self, stamp: float, force: float, least: float) -> None:
        """Take in a force [N]; legs shorter than `least` [N] are noise."""
        if self._extreme is None:
            self._extreme = stamp, force
            return
        further = force - self._extreme[1] if self._up else self._extreme[1] - force
        if further >= 0.0:
            self._extreme = stamp, force
        elif further < -least:
            self._turns.append(self._extreme)
            self._extreme, self._up = (stamp, force), not self._up
            self.suspected = self._regular()
        if stamp - self._extreme[0] > _LONGEST:
            self.suspected = False

    def judge(self, seen: FollowedMotion | None) -> None:
        """Whether the gripper explains what is suspected; `seen` at the shift of the clocks that is known."""
        if seen is None or seen.explained < _EXPLAINED or not SHARES[0] <= seen.share <= SHARES[1]:
            return
        (t0, _), (t1, _) = self._turns[0], self._turns[-1]
        sizes = self._legs()[1]
        size, rate = 0.5 * sum(sizes) / len(sizes), 0.5 * LEGS / (t1 - t0)
        self.reason = (
            f"the force swings by +-{size:.1f} N at {rate:.1f} Hz by itself: "
            "compare the clocks (./seed identify --live), and let no driver limit below the controller"
        )

    def _legs(self) -> tuple[list[float], list[float]]:
        turns = list(self._turns)
        pairs = list(pairwise(turns))
        return [b[0] - a[0] for a, b in pairs], [abs(b[1] - a[1]) for a, b in pairs]

    def _regular(self) -> bool:
        if len(self._turns) <= LEGS:
            return False
        times, sizes = self._legs()
        even = min(times) >= _SHORTEST and max(times) <= min(_LONGEST, _UNEVEN * min(times))
        return even and min(sizes) >= _FADING * max(sizes)
