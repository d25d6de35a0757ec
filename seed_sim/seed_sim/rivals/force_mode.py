# SPDX-License-Identifier: Apache-2.0
"""UR's force mode, as its script manual and its users describe it: the missing force accelerates, damping slows down.

The manual (force_mode, force_mode_set_damping, force_mode_set_gain_scaling): compliant axes have a largest speed; the
damping is 0 (keeps its speed) to 1 (stops at once without force), by default 0.005; the gain scaling is 0 to 2, by
default 1, and above 1 it "can make force mode unstable, e.g. in case of collisions or pushing against hard surfaces".
Users see it bounce on a rigid body at 10 N, more damping helping slightly (forum.universal-robots.com/t/22537).

The controller's inner gain is published nowhere. Here it is an inertia of 5 kg, with which the defaults bounce on a
rigid body, as users see; a scaling of 0.005 to 2 covers 2.5 to 1000 kg, so tuning can find the best of them all.
"""

from dataclasses import dataclass

import numpy as np

from seed_core.config import field
from seed_core.spatial import Array
from seed_sim.rivals.law import Wanted, scale

PERIOD = 0.002  # [s] of the robot's controller
INERTIA = 5.0  # [kg] at a gain scaling of 1


@dataclass(frozen=True)
class ForceModeSettings:
    """What a user sets."""

    damping: float = field(0.005, low=0.0, high=1.0, doc="share of the speed that is lost in a step")
    gain_scaling: float = field(1.0, low=0.001, high=2.0, doc="of the missing force's effect")
    speed_limit: float = field(0.03, unit="m/s", low=1e-3, high=0.5, doc="along compliant axes")
    lever: float = field(0.1, unit="m", low=0.01, high=1.0, doc="at which inertia and speed limit count for rotation")


class ForceMode:
    """The law of force mode."""

    period = PERIOD

    def __init__(self, settings: ForceModeSettings) -> None:
        s = self.settings = settings
        self._gain = PERIOD * s.gain_scaling / scale(INERTIA, s.lever)
        self._limit = np.array((s.speed_limit / s.lever,) * 3 + (s.speed_limit,) * 3)
        self._speed, self._offset = np.zeros(6), np.zeros(6)

    def step(self, wanted: Wanted, measured: Array) -> Array:
        speed = (1.0 - self.settings.damping) * self._speed + self._gain * wanted.error(measured)
        self._speed = np.clip(speed, -self._limit, self._limit)
        self._offset = self._offset + PERIOD * self._speed
        return self._offset

    def reset(self) -> None:
        self._speed = np.zeros(6)
        self._offset = np.concatenate([self._offset[:3], np.zeros(3)])
