# SPDX-License-Identifier: Apache-2.0
"""Hybrid force/position control with a PI law on a wrist sensor: the missing force is a speed, its integral a slope's.

What textbooks and many laboratories use on position-controlled arms (Villani and De Schutter, Force Control, Springer
Handbook of Robotics, Sec. 9.4). The integral follows slopes without an error.
"""

from dataclasses import dataclass

import numpy as np

from seed_core.config import field
from seed_core.spatial import Array
from seed_sim.rivals.law import Wanted

PERIOD = 0.002  # [s]


@dataclass(frozen=True)
class ForcePISettings:
    """What a user sets."""

    gain: float = field(1e-3, unit="m/s/N", low=1e-6, high=1.0, doc="speed per missing force")
    integral_time: float = field(0.5, unit="s", low=0.01, high=1e6, doc="of the integral")
    filter_time: float = field(0.0, unit="s", low=0.0, high=1.0, doc="low-pass of the reading")
    speed_limit: float = field(0.03, unit="m/s", low=1e-3, high=0.5, doc="along compliant axes")
    lever: float = field(0.1, unit="m", low=0.01, high=1.0, doc="at which the gain counts for rotation")


class ForcePI:
    """The PI law."""

    period = PERIOD

    def __init__(self, settings: ForcePISettings) -> None:
        s = self.settings = settings
        self._gain = s.gain / np.array((s.lever * s.lever,) * 3 + (1.0,) * 3)
        self._limit = np.array((s.speed_limit / s.lever,) * 3 + (s.speed_limit,) * 3)
        self._share = PERIOD / (PERIOD + s.filter_time)
        self._filtered: Array | None = None
        self._slope, self._offset = np.zeros(6), np.zeros(6)

    def step(self, wanted: Wanted, measured: Array) -> Array:
        last = measured if self._filtered is None else self._filtered
        self._filtered = last + self._share * (measured - last)
        speed = self._gain * wanted.error(self._filtered)
        slope = self._slope + PERIOD / self.settings.integral_time * speed
        self._slope = np.clip(slope, -self._limit, self._limit)
        self._offset = self._offset + PERIOD * np.clip(speed + self._slope, -self._limit, self._limit)
        return self._offset

    def reset(self) -> None:
        self._filtered, self._slope = None, np.zeros(6)
        self._offset = np.concatenate([self._offset[:3], np.zeros(3)])
