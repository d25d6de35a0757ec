# SPDX-License-Identifier: Apache-2.0
"""Poses by time, with interpolation, so that an image finds the kinematics of its own moment."""

from bisect import bisect_right
from collections import deque
from itertools import takewhile
from math import inf
from operator import itemgetter

from seed_core.spatial import Array, interpolate_pose

EXTRAPOLATION = 0.02  # [s] how far past the newest pose a look-up may reach
_LEAST_SLOPE = 0.003  # [s] between the poses whose slope leads there: over less, noise of stamps and poses counts most


class PoseHistory:
    """The newest `capacity` poses (4, 4) with rising stamps [s]."""

    def __init__(self, capacity: int = 512) -> None:
        self._entries: deque[tuple[float, Array]] = deque(maxlen=capacity)
        self.newest_stamp = -inf  # [s]; minus infinity while empty

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def oldest_stamp(self) -> float:
        """Stamp of the oldest pose still held [s]; infinity while empty."""
        return self._entries[0][0] if self._entries else inf

    def newest(self) -> Array:
        """The newest pose (4, 4)."""
        return self._entries[-1][1]

    def since(self, stamp: float) -> list[tuple[float, Array]]:
        """Stamps and poses (4, 4) from a time [s] on."""
        return list(takewhile(lambda entry: entry[0] > stamp, reversed(self._entries)))[::-1]

    def add(self, stamp: float, X: Array) -> bool:
        """Append a pose; False, and nothing changes, when its stamp does not rise."""
        if stamp <= self.newest_stamp:
            return False
        self._entries.append((stamp, X.copy()))
        self.newest_stamp = stamp
        return True

    def at(self, stamp: float) -> Array | None:
        """Pose at a time: between two neighbours, or up to 20 ms past the newest; None outside.

        Past the newest it goes on as over the last 3 ms or more; a shorter history tells its newest pose.
        """
        entries, newest = self._entries, self.newest_stamp
        if not self.oldest_stamp <= stamp <= newest + EXTRAPOLATION:
            return None
        if stamp < newest:
            k = bisect_right(entries, stamp, key=itemgetter(0))
            (t0, X0), (t1, X1) = entries[k - 1], entries[k]
            return interpolate_pose(X0, X1, (stamp - t0) / (t1 - t0))
        before = next((entry for entry in reversed(entries) if newest - entry[0] >= _LEAST_SLOPE), None)
        if before is None or stamp == newest:
            return self.newest()
        t0, X0 = before
        return interpolate_pose(X0, self.newest(), (stamp - t0) / (newest - t0))
