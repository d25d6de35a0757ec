# SPDX-License-Identifier: Apache-2.0
"""The rest detector: tells from the wrenches themselves when a pose has come to rest."""

from collections import deque

import numpy as np

from seed_core.spatial import Array
from seed_sysid.parameters import SettleParameters

_DEVIATIONS = 3.0  # noise may move the mean of half a window by this many standard deviations


class RestDetector:
    """Compares the two halves of a sliding window of wrenches; noise is taken from the window itself."""

    def __init__(self, parameters: SettleParameters) -> None:
        self._parameters = parameters
        self._tolerance = np.repeat([parameters.torque, parameters.force], 3)
        self._window: deque[tuple[float, Array]] = deque()
        self.quality = 0.0  # tolerance over change: 1 or more is at rest
        self._since: float | None = None

    def reset(self) -> None:
        """Forget what was seen: the arm moves again."""
        self._window.clear()
        self.quality, self._since = 0.0, None

    def update(self, stamp: float, wrench: Array) -> bool:
        """Whether the wrench (6,) has come to rest by time stamp [s], and stayed so for the time to hold."""
        self._window.append((stamp, wrench))
        while stamp - self._window[0][0] > self._parameters.window + 1e-9:
            self._window.popleft()
        if stamp - self._window[0][0] < 0.9 * self._parameters.window or len(self._window) < 6:
            return False
        values = np.array([w for _, w in self._window])
        n = len(values) // 2
        early, late = values[:n], values[-n:]
        noise = np.sqrt(0.5 * (early.var(axis=0, ddof=1) + late.var(axis=0, ddof=1)) * 2.0 / n)
        change = np.abs(late.mean(axis=0) - early.mean(axis=0))
        self.quality = float(np.min((self._tolerance + _DEVIATIONS * noise) / np.maximum(change, 1e-12)))
        if self.quality < 1.0:
            self._since = None
        elif self._since is None:
            self._since = stamp
        return self._since is not None and stamp - self._since >= self._parameters.hold
