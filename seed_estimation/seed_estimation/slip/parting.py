# SPDX-License-Identifier: Apache-2.0
"""Fingers whose markers part: a tool is rigid, so what sticks to it goes as far on one side as on the other.

Friction and grip are never quite alike. A tool that slides along an axis that depth does not see takes one membrane
further than the other, and both are seen to stop apart. While it sticks, and while up to half of the patches slide,
they stay within 0.2 mm of each other.
"""

import math
from collections.abc import Sequence

import numpy as np

from seed_core.spatial import Array
from seed_estimation.slip.markers import Observation

PARTED = 8e-4  # [m] between the fingers' displacements
SKEW = 0.025  # [s] by which their images may be apart, unstamped: by so much of its way a tool that moves parts them
LEVER = 0.02  # [m] per [rad] about x or z, by which a scale of depth parts them that is 5 % wrong, as it does the turn
TOGETHER = 3e-4  # [m] from which on what follows counts
LEAP = 1.2e-3  # [m] beyond what their speed foretells, by which markers go that were found a pitch further
FRAMES = 2  # in a row


class Parting:
    """Of both fingers in one grasp."""

    def __init__(self) -> None:
        self._followed, self._count = True, 0

    def parts(self, a: Sequence[Observation], b: Sequence[Observation], turned: float = 0.0) -> bool:
        """Whether the markers of both fingers, each with its last frames, are too far apart for a tool that sticks.

        turned: [rad] about x and z since the grasp.
        """
        gap = math.dist(a[-1].displacement, b[-1].displacement)
        if gap < TOGETHER:
            self._followed = True
        elif max(_leap(a), _leap(b)) > LEAP:
            self._followed = False
        least = PARTED + LEVER * turned + SKEW * max(math.hypot(*_speed(a, 1)), math.hypot(*_speed(b, 1)))
        self._count = self._count + 1 if self._followed and gap > least else 0
        return self._count >= FRAMES


def _speed(seen: Sequence[Observation], back: int) -> Array:
    """(3,) [m/s] up to the frame so many before the next; 0 where it is not known."""
    if len(seen) < back + 1:
        return np.zeros(3)
    before, after = seen[-back - 1], seen[-back]
    return np.asarray((after.displacement - before.displacement) / (after.stamp - before.stamp))


def _leap(seen: Sequence[Observation]) -> float:
    """[m] from where the speed of the frame before would have brought the markers."""
    if len(seen) < 2:
        return 0.0
    before, now = seen[-2], seen[-1]
    return math.hypot(*(now.displacement - before.displacement - _speed(seen, 2) * (now.stamp - before.stamp)))
