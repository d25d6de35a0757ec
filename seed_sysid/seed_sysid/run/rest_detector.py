# SPDX-License-Identifier: Apache-2.0
"""Whether a pose has come to rest, judged from the readings themselves, and whether it stays within its limits."""

from __future__ import annotations

from collections import deque

import numpy as np

from seed_core.spatial import Array, so3_log
from seed_sysid.parameters import LimitParameters, SettleParameters

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


def limit_reached(X_TC: Array, wrench: Array, limits: LimitParameters, enforce_wrench: bool = True) -> str:
    """The limit that displacement X_TC (4, 4) or wrench (6,) (bias taken off) exceeds, with its value; '' if none."""
    turn = float(np.rad2deg(np.linalg.norm(so3_log(X_TC[:3, :3]))))
    shift = float(np.linalg.norm(X_TC[:3, 3]))
    torque, force = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
    if turn > 1.02 * limits.rotation_deg:  # 2 %: the command itself may lie on the limit
        return f"rotation {turn:.1f} deg exceeds limits.rotation_deg = {limits.rotation_deg:g} deg"
    if shift > 1.02 * limits.translation:
        return f"deflection {1e3 * shift:.1f} mm exceeds limits.translation = {1e3 * limits.translation:g} mm"
    if enforce_wrench and force > limits.force:
        return f"force {force:.1f} N exceeds limits.force = {limits.force:g} N"
    if enforce_wrench and torque > limits.torque:
        return f"torque {torque:.2f} N m exceeds limits.torque = {limits.torque:g} N m"
    return ""
