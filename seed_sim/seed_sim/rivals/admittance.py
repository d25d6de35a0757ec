# SPDX-License-Identifier: Apache-2.0
"""Admittance control as ros2_control's admittance_controller computes it: M x'' + D x' + K x = F, then joint damping.

From its source and parameters (ros2_controllers, admittance_rule_impl.hpp and admittance_controller_parameters.yaml):
D = 2 ratio sqrt(M K), so that without stiffness there is no damping but `joint_damping` (by default 5 1/s of speed);
the wrench is smoothed by an exponential filter (`filter_coefficient`, default 0.05); x is the distance from the
reference trajectory, so a surface that is d away from it keeps a force error of K d; here the reference is at the
height where the tool touched first, which is in its favour. It is a zero-force controller: the wanted force is
subtracted from the reading, as people do. It has no integral action.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from seed_core.config import field
from seed_core.spatial import Array
from seed_sim.rivals.law import Wanted, scale

PERIOD = 0.002  # [s]: update_rate 500 Hz, as the UR driver's controller manager runs


@dataclass(frozen=True)
class AdmittanceSettings:
    """What a user sets, along the compliant axes."""

    mass: float = field(20.0, unit="kg", low=1e-4, high=1e6, doc="M")
    stiffness: float = field(20.0, unit="N/m", low=0.0, high=1e8, doc="K")
    damping_ratio: float = field(1.0, low=0.0, high=1e4, doc="D / (2 sqrt(M K))")
    joint_damping: float = field(5.0, unit="1/s", low=0.0, high=1e3, doc="taken off the speed")
    filter_coefficient: float = field(0.05, low=1e-3, high=1.0, doc="share of a new reading in the smoothed one")
    speed_limit: float = field(0.03, unit="m/s", low=1e-3, high=0.5, doc="towards contact: what a task allows")
    lever: float = field(0.1, unit="m", low=0.01, high=1.0, doc="at which M and K count for rotation")


class Admittance:
    """The law of admittance_controller."""

    period = PERIOD

    def __init__(self, settings: AdmittanceSettings) -> None:
        s = self.settings = settings
        self._mass, self._stiffness = scale(s.mass, s.lever), scale(s.stiffness, s.lever)
        self._damping = scale(2.0 * s.damping_ratio * sqrt(s.mass * s.stiffness), s.lever)
        self._limit = np.array((s.speed_limit / s.lever,) * 3 + (s.speed_limit,) * 3)
        self._filtered: Array | None = None
        self._speed, self._offset = np.zeros(6), np.zeros(6)

    def step(self, wanted: Wanted, measured: Array) -> Array:
        share = self.settings.filter_coefficient
        last = measured if self._filtered is None else self._filtered
        self._filtered = last + share * (measured - last)
        force = wanted.error(self._filtered)
        acceleration = wanted.free * (force - self._damping * self._speed - self._stiffness * self._offset) / self._mass
        acceleration -= self.settings.joint_damping * self._speed
        self._speed = np.clip(self._speed + PERIOD * acceleration, -self._limit, self._limit)
        self._offset = self._offset + PERIOD * self._speed
        return self._offset

    def reset(self) -> None:
        self._speed, self._filtered = np.zeros(6), None
        self._offset = np.concatenate([self._offset[:3], np.zeros(3)])
