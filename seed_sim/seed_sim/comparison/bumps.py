# SPDX-License-Identifier: Apache-2.0
"""Bumps on the table, by place: seen from the table, so the arm is displaced instead and does not report it."""

from dataclasses import dataclass
from math import cos, pi

from seed_core.config import field
from seed_core.spatial import Array
from seed_sim.plant.arm import Arm, Repeatability


@dataclass(frozen=True)
class Bumps:
    """Raised cosines across the world's x."""

    size: float = field(0.0, unit="m", low=0.0, high=0.01, doc="height of each")
    length: float = field(0.015, unit="m", low=1e-3, high=0.5, doc="of each")
    every: float = field(0.03, unit="m", low=1e-3, high=0.5, doc="from one to the next")

    def height(self, x: float) -> float:
        """[m] at the place x [m]."""
        along = x % self.every
        return 0.5 * self.size * (1.0 - cos(2.0 * pi * along / self.length)) if along < self.length else 0.0


class BumpyTable(Repeatability):
    """The arm's own error less the bumps' height under the flange."""

    def __init__(self, arm: Arm, bumps: Bumps) -> None:
        self._arm, self._error, self._bumps = arm, arm.error, bumps

    def at(self, t: float) -> Array:
        """(3,) [m] at time t [s]."""
        return self._error.at(t) - (0.0, 0.0, self._bumps.height(float(self._arm.reported[0, 3])))
