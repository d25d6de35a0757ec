# SPDX-License-Identifier: Apache-2.0
"""Poses by time: a ring buffer with interpolation, so that an image finds the kinematics of its own moment."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

from seed_core.spatial import Array, interpolate_pose

EXTRAPOLATION = 0.02  # [s] how far past the newest pose a look-up may reach


class PoseHistory:
    """The newest `capacity` poses (4, 4) with rising stamps [s]. Memory is allocated once."""

    def __init__(self, capacity: int = 512) -> None:
        self._capacity = capacity
        self._poses = np.zeros((capacity, 4, 4))
        self._stamps = np.full(capacity, -np.inf)
        self._count = 0
        self.newest_stamp = -np.inf  # [s]; minus infinity while empty

    def __len__(self) -> int:
        return min(self._count, self._capacity)

    @property
    def oldest_stamp(self) -> float:
        """Stamp of the oldest pose still held [s]; infinity while empty."""
        if not self._count:
            return np.inf
        return float(self._stamps[self._count % self._capacity if self._count >= self._capacity else 0])

    def newest(self) -> Array:
        """The newest pose (4, 4); a view that stays until it is overwritten a whole buffer later."""
        X: Array = self._poses[(self._count - 1) % self._capacity]
        return X

    def add(self, stamp: float, X: Array) -> bool:
        """Append a pose; False, and nothing changes, when its stamp does not rise."""
        if stamp <= self.newest_stamp:
            return False
        i = self._count % self._capacity
        self._poses[i] = X
        self._stamps[i] = self.newest_stamp = stamp
        self._count += 1
        return True

    def at(self, stamp: float) -> Array | None:
        """Pose at a time: between two neighbours, or up to 20 ms past the newest; None outside."""
        n = len(self)
        if n == 0 or stamp < self.oldest_stamp or stamp > self.newest_stamp + EXTRAPOLATION:
            return None
        if n == 1 or stamp == self.newest_stamp:
            return self.newest().copy()
        first = self._count - n
        k = bisect_right(range(n), stamp, key=lambda j: self._stamps[(first + j) % self._capacity])
        k = min(max(k, 1), n - 1)
        a, b = (first + k - 1) % self._capacity, (first + k) % self._capacity
        share = (stamp - self._stamps[a]) / (self._stamps[b] - self._stamps[a])
        return interpolate_pose(self._poses[a], self._poses[b], float(share))
